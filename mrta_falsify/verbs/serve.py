"""A campaign live in the browser, while it runs: loopback only, read only.

The page asks for a small summary every two seconds. The server reads only what has been appended
to the log since, and keeps counts, so its memory does not grow with the trials. The full report is
written by a process of its own, when it is asked for and the log has grown. So are the runs of
failures as MCAP files, which one Lichtblick that the user names may read.
"""

from __future__ import annotations

import json
import re
import subprocess
import tempfile
import threading
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any, ClassVar

from mrta_falsify.campaigns.made_here import refuse_links
from mrta_falsify.campaigns.store import owner_of, read_campaign_settings, read_records
from mrta_falsify.core.claims import KINDS
from mrta_falsify.core.errors import InputError, PlaceError
from mrta_falsify.core.modules import python_command
from mrta_falsify.core.record import TrialRecord
from mrta_falsify.specs.causes import DEADLOCK, kind_of, leading
from mrta_falsify.verbs.folders import Place
from reports.live_page import render_live
from reports.sentences import violation_sentence

LOOPBACK = "127.0.0.1"
MOST_POINTS = 200  # of the curve of failures
MOST_MODES = 500  # counted one by one
SHOWN_MODES = 30  # told to the page
PATIENCE = 10.0  # s for a request to arrive
ORIGIN = re.compile(r"https?://[\w.-]+(:\d+)?")
RUN = re.compile(r"/runs/(\d{4,18})\.mcap")  # address of a trial's run
RANGE = re.compile(r"bytes=(\d+)-(\d*)")


@dataclass(slots=True)
class Mode:
    """Failures with one signature, counted."""

    happened: str  #: in the first of them, in one sentence
    first: str  #: id of the trial
    kind: str  #: deadlock, stuck or shut; empty: none of them
    count: int = 0


@dataclass(slots=True)
class LiveSummary:
    """Counts of a campaign, brought up to date from the end of its log."""

    directory: Path
    offset: int = 0  #: bytes of the log that are counted
    trials: int = 0
    judged: int = 0
    failed: int = 0
    deadlocks: int = 0  #: failures of ``no_deadlock``, whatever their kind
    kinds: Counter[str] = field(default_factory=Counter)
    rejected: int = 0  #: impossible ones included
    errors: int = 0
    sim_time: float = 0.0  #: [s]
    latest: str = ""  #: failure, in one sentence
    modes: dict[str, Mode] = field(default_factory=dict)
    points: list[tuple[int, int, int]] = field(default_factory=list)  #: judged, failed, deadlocks
    _every: int = 1  #: judged trials between two points

    def update(self) -> None:
        """Count what has been appended.

        Raises:
            StoreError: the log is damaged.
        """
        records, self.offset = read_records(self.directory, self.offset)
        for record in records:
            self._take(record)

    def _take(self, record: TrialRecord) -> None:
        self.trials += 1
        self.rejected += record.status in ("rejected", "impossible")
        self.errors += record.status in ("crashed", "timeout")
        if record.status != "ok":
            return
        self.judged += 1
        self.sim_time += record.sim_time
        if record.is_reported:
            self._take_failure(record)
        if self.judged % self._every == 0:
            self.points.append((self.judged, self.failed, self.kinds["deadlock"]))
        if len(self.points) > MOST_POINTS:
            self.points = self.points[1::2]
            self._every *= 2

    def _take_failure(self, record: TrialRecord) -> None:
        verdict = leading(record.verdicts)
        told = violation_sentence(verdict) if verdict is not None else ""
        kind = kind_of(record.verdicts)
        self.failed += 1
        self.deadlocks += any(v.violated and v.spec == DEADLOCK for v in record.verdicts)
        self.kinds[kind] += 1
        self.latest = f"Trial {record.id}: {told}"
        if record.signature not in self.modes and len(self.modes) >= MOST_MODES:
            return
        mode = self.modes.setdefault(record.signature, Mode(told, record.id, kind))
        mode.count += 1

    def data(self) -> dict[str, Any]:
        """Give what the page shows, JSON-shaped and of bounded size."""
        ranked = sorted(self.modes.values(), key=_rank)
        return {
            "running": owner_of(self.directory),
            "budget": read_campaign_settings(self.directory).budget,
            "trials": self.trials,
            "judged": self.judged,
            "failed": self.failed,
            "deadlocks": self.deadlocks,
            "kinds": {kind: self.kinds[kind] for kind in KINDS},
            "rejected": self.rejected,
            "errors": self.errors,
            "hours": round(self.sim_time / 3600.0, 3),
            "latest": self.latest,
            "modes": [[mode.count, mode.happened, mode.first] for mode in ranked[:SHOWN_MODES]],
            "further_modes": max(0, len(ranked) - SHOWN_MODES),
            "points": [*self.points, (self.judged, self.failed, self.kinds["deadlock"])],
        }


def _rank(mode: Mode) -> tuple[int, int]:
    return ("deadlock", "stuck", "", "shut").index(mode.kind), -mode.count


@dataclass(slots=True)
class _Reports:
    """Writes the full report when the log has grown since it was last written."""

    directory: Path
    path: Path
    _size: int = -1
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def page(self, size: int) -> bytes:
        """Give the page; ``size`` [bytes] of the log says whether it is still true."""
        with self._lock:
            if size != self._size:
                _command("report", str(self.directory), "-o", str(self.path))
                self._size = size
            return self.path.read_bytes()

    def run(self, id: str) -> bytes:
        """Give the run of a trial as an MCAP file; the last one asked for is kept."""
        with self._lock:
            path = self.path.with_name(f"{id}.mcap")
            if not path.is_file():
                for other in self.path.parent.glob("*.mcap"):
                    other.unlink()
                _command("export", str(self.directory), id, "--format", "mcap", "-o", str(path))
            return path.read_bytes()


def _command(*words: str) -> None:
    """Run one of our commands in a process of its own, whose memory goes with it."""
    done = subprocess.run(
        python_command("mrta_falsify.cli", *words),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        check=False,
    )
    if done.returncode:
        raise InputError(done.stderr.decode(errors="replace").strip())


class LiveServer(ThreadingHTTPServer):
    """Serves one campaign on the loopback interface; a context manager."""

    daemon_threads = True

    def __init__(self, directory: Place, port: int = 0, *, lichtblick: str = "") -> None:
        self.lichtblick = lichtblick.rstrip("/")
        if self.lichtblick and not ORIGIN.fullmatch(self.lichtblick):
            raise InputError(
                f"--lichtblick is {lichtblick}; it must be an address without a path, as "
                "http://localhost:8080"
            )
        refuse_links(Path(directory))
        self.summary = LiveSummary(Path(directory))
        self._title = Path(read_campaign_settings(Path(directory)).trials.scenario).stem
        self._lock = threading.Lock()
        self._folder = tempfile.TemporaryDirectory(prefix="mrta-falsify-serve-")
        self._reports = _Reports(Path(directory), Path(self._folder.name) / "report.html")
        self._update()
        try:
            super().__init__((LOOPBACK, port), _Handler)
        except OSError as error:
            self._folder.cleanup()
            raise InputError(
                f"port {port} of {LOOPBACK} cannot be used: {error.strerror}; choose another one "
                "by --port, or 0 for any"
            ) from None

    @property
    def address(self) -> str:
        """Where the page is."""
        return f"http://{LOOPBACK}:{self.server_port}/"

    def server_close(self) -> None:
        """Close the socket and remove the report."""
        super().server_close()
        self._folder.cleanup()

    def _update(self) -> dict[str, Any]:
        with self._lock:
            self.summary.update()
            return {**self.summary.data(), "lichtblick": self.lichtblick}

    def live_page(self) -> bytes:
        """Render the page that asks for the summary."""
        return render_live(self._title).encode()

    def summary_text(self) -> bytes:
        """Render the summary as JSON."""
        return json.dumps(self._update()).encode()

    def report_page(self) -> bytes:
        """Render the full report."""
        self._update()
        return self._reports.page(self.summary.offset)

    def run_file(self, id: str) -> bytes:
        """Give the run of a trial as an MCAP file."""
        return self._reports.run(id)

    def allows(self, host: str | None, origin: str | None, *, is_run: bool = False) -> bool:
        """Whether a request with these headers comes from this page, or from no page at all.

        Args:
            host: that was asked for.
            origin: of the page that asks; None: none does.
            is_run: a run is asked for, which Lichtblick may read as well.
        """
        own = {f"{name}:{self.server_port}" for name in (LOOPBACK, "localhost")}
        known = {f"http://{name}" for name in own}
        if is_run and self.lichtblick:
            known.add(self.lichtblick)
        return host in own and (origin is None or origin in known)


class _Handler(BaseHTTPRequestHandler):
    """Answers GET for three pages, and for runs where Lichtblick may read them."""

    server: LiveServer
    timeout = PATIENCE
    server_version = "mrta-falsify"
    sys_version = ""
    PAGES: ClassVar[dict[str, tuple[str, Callable[[LiveServer], bytes] | None]]] = {
        "/": ("text/html; charset=utf-8", LiveServer.live_page),
        "/summary.json": ("application/json", LiveServer.summary_text),
        "/report": ("text/html; charset=utf-8", LiveServer.report_page),
    }

    def do_GET(self) -> None:
        """Answer a request."""
        path = self.path.partition("?")[0]
        run = RUN.fullmatch(path)
        origin = self.headers.get("Origin")
        if not self.server.allows(self.headers.get("Host"), origin, is_run=run is not None):
            self._answer(HTTPStatus.FORBIDDEN, "text/plain", b"only pages of this server may ask\n")
            return
        kind, page = self.PAGES.get(path, ("", None))
        try:
            if run is not None and self.server.lichtblick:
                self._answer_run(self.server.run_file(run[1]))
            elif page is not None:
                self._answer(HTTPStatus.OK, kind, page(self.server))
            else:
                self._answer(HTTPStatus.NOT_FOUND, "text/plain", b"no such page\n")
        except (InputError, PlaceError) as error:
            self._answer(HTTPStatus.INTERNAL_SERVER_ERROR, "text/plain", f"{error}\n".encode())

    def _answer_run(self, body: bytes) -> None:
        """Send a file, or the part of it that is asked for."""
        headers = {
            "Access-Control-Allow-Origin": self.server.lichtblick,
            "Access-Control-Expose-Headers": "Accept-Ranges, Content-Range, Content-Length",
            "Accept-Ranges": "bytes",
            "Cross-Origin-Resource-Policy": "cross-origin",
        }
        part = RANGE.fullmatch(self.headers.get("Range", ""))
        if part is None:
            self._answer(HTTPStatus.OK, "application/octet-stream", body, headers)
            return
        first = int(part[1])
        last = min(int(part[2] or len(body) - 1), len(body) - 1)
        if first > last:
            status = HTTPStatus.REQUESTED_RANGE_NOT_SATISFIABLE
            self._answer(status, "text/plain", b"", {"Content-Range": f"bytes */{len(body)}"})
            return
        headers["Content-Range"] = f"bytes {first}-{last}/{len(body)}"
        status = HTTPStatus.PARTIAL_CONTENT
        self._answer(status, "application/octet-stream", body[first : last + 1], headers)

    def _answer(
        self, status: HTTPStatus, kind: str, body: bytes, headers: dict[str, str] | None = None
    ) -> None:
        self.send_response(status)
        sent = {
            "Content-Type": kind,
            "Content-Length": str(len(body)),
            "Cache-Control": "no-store",
            "X-Content-Type-Options": "nosniff",
            "Cross-Origin-Resource-Policy": "same-origin",
            "X-Frame-Options": "DENY",
        }
        for name, value in {**sent, **(headers or {})}.items():
            self.send_header(name, value)
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, format: str, *args: Any) -> None:
        """Say nothing; the page polls."""
