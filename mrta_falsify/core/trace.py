"""The trace of an episode: columns over K ticks, path table, event table."""

from __future__ import annotations

import hashlib
import io
import json
import operator
import shutil
import tempfile
import zipfile
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from mrta_falsify.core import codec
from mrta_falsify.core.arrays import Array
from mrta_falsify.core.columns import ColumnStore
from mrta_falsify.core.durable import naming, replacing
from mrta_falsify.core.errors import FormatError
from mrta_falsify.core.fleet import BlockedBy, Frame, StackEvent

TRACE_VERSION = 1
LARGE = 64 * 2**20  # bytes of a stored column that is not read into memory
#: what reading a damaged archive raises; RuntimeError: a flag or method that was never written
DAMAGE = (OSError, EOFError, KeyError, RuntimeError, ValueError, zipfile.BadZipFile, zlib.error)

#: columns of a trace: name -> where the value is in a frame
SENSED_COLUMNS = (
    "time",
    "pose",
    "velocity",
    "human_position",
    "human_velocity",
    "obstacle_points",
    "gap_robot",
    "gap_human",
    "gap_static",
    "nearest_robot",
    "nearest_human",
    "contact",
    "furniture_pose",
)
INTENT_COLUMNS = (
    "phase",
    "goal",
    "waypoint",
    "cluster",
    "leader",
    "slack",
    "tasks_left",
    "queue",
)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PathChange:
    """From ``tick`` on, ``robot`` follows ``points``."""

    tick: int
    robot: int
    points: Array  #: (L, 2) [m], empty: no path


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class EdgeSpan:
    """A blocked-by edge that held from tick ``first`` to tick ``last``, both included."""

    first: int
    last: int
    edge: BlockedBy


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Trace:
    """Everything that was seen of one episode.

    ``columns`` maps the names of ``SENSED_COLUMNS``, ``INTENT_COLUMNS`` and ``command`` to
    arrays whose first axis is the K recorded ticks, e.g. ``pose`` (K, N, 3).
    """

    world_digest: str
    dt: float  #: control period [s]
    robots: tuple[str, ...]  #: names, N
    humans: tuple[str, ...]  #: names, H
    columns: Mapping[str, np.ndarray]
    paths: tuple[PathChange, ...]
    events: tuple[StackEvent, ...]
    edges: tuple[EdgeSpan, ...]
    ended: str  #: why the episode ended: "all-tasks-done", "horizon", "decided"
    digest: str  #: sha256 over every frame and the reason of the end
    #: tick that brought each of ``events``; empty: an older version, which did not keep it
    event_ticks: tuple[int, ...] = ()

    def __repr__(self) -> str:
        """Write it in one line."""
        kept = f"{self.duration:.1f} s" if "time" in self.columns else "columns not kept"
        robots, digest = len(self.robots), self.digest[:12]
        return f"<Trace {kept}, {robots} robots, ended {self.ended}, digest {digest}>"

    def __len__(self) -> int:
        """Number of ticks K."""
        return len(self.columns["time"])

    @property
    def duration(self) -> float:
        """Simulated time [s]."""
        times = self.columns["time"]
        return float(times[-1]) if len(times) else 0.0

    def edges_at(self, tick: int) -> tuple[BlockedBy, ...]:
        """Find the blocked-by edges that held at ``tick``."""
        return tuple(span.edge for span in self.edges if span.first <= tick <= span.last)


@dataclass(slots=True)
class TraceRecorder:
    """Folds frames into a :class:`Trace`; with ``keep=False`` only into its digest."""

    world_digest: str
    dt: float
    robots: tuple[str, ...]
    humans: tuple[str, ...]
    keep: bool = True
    _hash: hashlib._Hash = field(default_factory=hashlib.sha256)
    _store: ColumnStore | None = None  #: of the columns, as the first tick has them
    _paths: list[PathChange] = field(default_factory=list)
    _events: list[StackEvent] = field(default_factory=list)
    _event_ticks: list[int] = field(default_factory=list)
    _spans: list[EdgeSpan] = field(default_factory=list)
    _open: dict[BlockedBy, int] = field(default_factory=dict)  #: since which tick
    _last_edges: tuple[BlockedBy, ...] = ()
    _last_tick: int = -1
    _last_paths: tuple[Array, ...] = ()

    def add(self, frame: Frame) -> None:
        """Take in one frame."""
        tick = frame.sensed.tick
        time, *rest = _frame_values(frame)
        row = b"".join([np.asarray(time).tobytes(), *map(_bytes_of, rest)])
        self._hash.update(row)
        for event in frame.events:
            self._hash.update(repr(event).encode())
        paths, known = frame.intent.path, self._last_paths
        if len(paths) != len(known) or not all(map(operator.is_, paths, known)):
            self._add_paths(tick, paths)
        if self.keep:
            self._store = self._store or ColumnStore(_layout_of(frame))
            self._store.add(row)
            self._events.extend(frame.events)
            self._event_ticks.extend([tick] * len(frame.events))
            self._add_edges(tick, frame.blocked_by)

    def _add_paths(self, tick: int, paths: tuple[Array, ...]) -> None:
        for robot, points in enumerate(paths):
            known = self._last_paths[robot] if robot < len(self._last_paths) else None
            if points is known:
                continue
            self._hash.update(np.ascontiguousarray(points).tobytes())
            if self.keep:
                self._paths.append(PathChange(tick=tick, robot=robot, points=np.array(points)))
        self._last_paths = paths

    def _add_edges(self, tick: int, edges: tuple[BlockedBy, ...]) -> None:
        if edges is not self._last_edges:
            still_open = {edge: self._open.pop(edge, tick) for edge in edges}
            self._close_edges()
            self._open, self._last_edges = still_open, edges
        self._last_tick = tick

    def _close_edges(self) -> None:
        for edge, first in self._open.items():
            self._spans.append(EdgeSpan(first=first, last=self._last_tick, edge=edge))
        self._open = {}

    def finish(self, ended: str) -> Trace:
        """Build the trace; the recorder must not be used afterwards."""
        self._hash.update(ended.encode())
        self._close_edges()
        return Trace(
            world_digest=self.world_digest,
            dt=self.dt,
            robots=self.robots,
            humans=self.humans,
            columns={} if self._store is None else self._store.columns(),
            paths=tuple(self._paths),
            events=tuple(self._events),
            edges=tuple(sorted(self._spans, key=lambda span: (span.first, span.edge.robot))),
            ended=ended,
            digest=self._hash.hexdigest(),
            event_ticks=tuple(self._event_ticks),
        )


_FRAME_COLUMNS = (*SENSED_COLUMNS, "command", *INTENT_COLUMNS)
_sensed_values = operator.attrgetter(*SENSED_COLUMNS)
_intent_values = operator.attrgetter(*INTENT_COLUMNS)
_bytes_of = operator.methodcaller("tobytes")


def _frame_values(frame: Frame) -> tuple[Any, ...]:
    """List the time, then arrays, in the order of ``_FRAME_COLUMNS``."""
    return (*_sensed_values(frame.sensed), frame.command.twist, *_intent_values(frame.intent))


def _layout_of(frame: Frame) -> np.dtype[np.void]:
    """Describe how the bytes of a frame's columns follow each other."""
    arrays = [np.asarray(value) for value in _frame_values(frame)]
    named = zip(_FRAME_COLUMNS, arrays, strict=True)
    return np.dtype([(name, array.dtype, array.shape) for name, array in named])


# --- files -----------------------------------------------------------------------------


def write_trace(trace: Trace, path: str | Path) -> None:
    """Write ``trace`` atomically as a zip of .npy columns and one JSON table (no pickle).

    Raises:
        PlaceError: the file cannot be written.
    """
    path = Path(path)
    table = {
        "version": TRACE_VERSION,
        "world_digest": trace.world_digest,
        "dt": trace.dt,
        "robots": trace.robots,
        "humans": trace.humans,
        "paths": trace.paths,
        "events": trace.events,
        "event_ticks": trace.event_ticks,
        "edges": trace.edges,
        "ended": trace.ended,
        "digest": trace.digest,
        "columns": sorted(trace.columns),
    }
    with (
        replacing(path) as file,
        zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive,
    ):
        # without the time: equal traces are equal files
        info = zipfile.ZipInfo("table.json")
        archive.writestr(info, json.dumps(codec.encode(table)), zipfile.ZIP_DEFLATED, 1)
        for name, column in sorted(trace.columns.items()):
            with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                np.lib.format.write_array(member, column, allow_pickle=False)


def _read_column(archive: zipfile.ZipFile, name: str) -> np.ndarray:
    member = archive.getinfo(f"{name}.npy")
    if member.file_size < LARGE:
        return np.lib.format.read_array(io.BytesIO(archive.read(member)), allow_pickle=False)
    with tempfile.NamedTemporaryFile(prefix="mrta-falsify-trace-") as file:
        with archive.open(member) as source, naming(tempfile.gettempdir()):
            shutil.copyfileobj(source, file)
            file.flush()
        column: np.ndarray = np.load(file.name, mmap_mode="r", allow_pickle=False)
    return column


def read_trace(path: str | Path) -> Trace:
    """Read what :func:`write_trace` wrote.

    Raises:
        FormatError: not such a file, damaged, or of another version.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            table = json.loads(archive.read("table.json"))
            if table.get("version") != TRACE_VERSION:
                given = table.get("version")
                raise FormatError(
                    f"{path}: trace version {given}; this version reads {TRACE_VERSION}"
                )
            columns = {name: _read_column(archive, name) for name in table["columns"]}
    except DAMAGE as error:
        raise FormatError(f"{path}: is not a readable trace: {error}") from None
    return Trace(
        world_digest=table["world_digest"],
        dt=table["dt"],
        robots=tuple(table["robots"]),
        humans=tuple(table["humans"]),
        columns=columns,
        paths=tuple(
            PathChange(
                tick=row["tick"],
                robot=row["robot"],
                points=np.array(row["points"], dtype=np.float64).reshape(-1, 2),
            )
            for row in table["paths"]
        ),
        events=tuple(StackEvent(**row) for row in table["events"]),
        edges=tuple(
            EdgeSpan(first=row["first"], last=row["last"], edge=BlockedBy(**row["edge"]))
            for row in table["edges"]
        ),
        ended=table["ended"],
        digest=table["digest"],
        event_ticks=tuple(table.get("event_ticks", ())),
    )
