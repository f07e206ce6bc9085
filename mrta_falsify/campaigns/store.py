"""One directory per campaign: an append-only log that survives kill -9.

::

    campaign.json        settings, format version (written atomically; later only its budget)
    records.jsonl        one line per finished trial: checksum, tab, JSON of a TrialRecord
    seal.json            says that this user has made it (see :mod:`.made_here`)
    lock                 held (flock) by the one owner; says who
    trials/0042/         world.json and trace.zip of trials worth keeping
    trials/0042/other/   the same of the other stack, where two are compared

A record counts once its line is on disc (fsync), and what it names is there before. A record of an
older version whose run was interrupted does not count: its trial is run again. The next owner cuts
off a torn last line, which only a crash during the write leaves behind. Any other damage is an
error that names the line, and nothing is changed. The owner looks at the log before each record: it
adds nothing to a log that somebody else has changed or removed.
"""

from __future__ import annotations

import dataclasses
import fcntl
import hashlib
import json
import os
import shlex
import socket
import time
import warnings
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mrta_falsify.campaigns import made_here
from mrta_falsify.campaigns.foreign import sealed_places
from mrta_falsify.campaigns.rules import why_no_resume
from mrta_falsify.campaigns.settings import (
    DEFAULT_TARGET,
    FORMAT_VERSION,
    STORED_TARGETS,
    CampaignSettings,
)
from mrta_falsify.core import codec
from mrta_falsify.core.candidate import DimensionValue
from mrta_falsify.core.durable import (
    append,
    make_folder,
    naming,
    place_error,
    sync_directory,
    write_atomically,
)
from mrta_falsify.core.errors import FormatError, InputError, InputNote, PlaceError
from mrta_falsify.core.parsing import parse_json, refuse_pipe
from mrta_falsify.core.record import OtherRun, TrialRecord
from mrta_falsify.specs.causes import kind_of

if TYPE_CHECKING:
    import pandas as pd

SETTINGS, RECORDS = made_here.SETTINGS, "records.jsonl"
LOCK, TRIALS = "lock", "trials"
CHECKSUM_LENGTH = 16  # hex digits of sha256
OTHER = "other"  # folder of the other stack's run, in that of its trial
MAX_DIGITS = 18  # of a trial's id
INTERRUPTED = "interrupted"  # why a run ended that older versions stored: it is no answer


class StoreError(InputError):
    """A campaign directory cannot be used: of another version, damaged, locked, not one."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Campaign:
    """A campaign as stored: what a report reads."""

    directory: Path
    settings: CampaignSettings
    records: tuple[TrialRecord, ...]  #: by number

    def record(self, name: str | int) -> TrialRecord:
        """Find a record by its id, as ``0042``, ``42`` or the number.

        Raises:
            StoreError: no such trial.
        """
        name = str(name)
        is_number = name.isascii() and name.isdigit() and len(name) <= MAX_DIGITS
        wanted = int(name) if is_number else -1
        for record in self.records:
            if record.number == wanted:
                return record
        known = f"trials {self.records[0].id} to {self.records[-1].id}" if self.records else "none"
        raise StoreError(f"{self.directory}: has no trial {name!r}; it has {known}")

    def folder(self, record: TrialRecord) -> Path:
        """Name the directory of the files of a trial; it need not exist.

        Raises:
            InputError: some of them lie elsewhere, in a campaign of somebody else.
        """
        own = trial_folder(self.directory, record.number)
        made_here.refuse_links(self.directory, own)
        return own / OTHER if Path(record.trace_file).parent.name == OTHER else own

    def make_folder(self, record: TrialRecord) -> Path:
        """Make the directory of the files of a trial, and return it.

        Raises:
            PlaceError: it cannot be made, or the campaign was removed.
        """
        if not (self.directory / SETTINGS).is_file():
            raise removed(self.directory)
        return make_folder(self.folder(record))

    def seen_by_other(self) -> Campaign:
        """Give the trials that the other stack has run, as those of a campaign on that stack.

        Raises:
            ConfigError: the campaign compares no two stacks.
        """
        trials = self.settings.trials.of_other
        return dataclasses.replace(
            self,
            settings=dataclasses.replace(self.settings, trials=trials),
            records=tuple(_of_other(r, r.other) for r in self.records if r.other is not None),
        )

    def __repr__(self) -> str:
        """Write it in one line."""
        failed = sum(record.failed for record in self.records)
        return f"<Campaign {self.directory}: {len(self.records)} trials, {failed} failed>"

    def values_of(self, record: TrialRecord) -> dict[str, DimensionValue]:
        """Give the values of a trial's search dimensions by name, as a person reads them.

        Empty for trials whose scenario could not be sampled, and for campaigns of older versions.
        """
        told = zip(self.settings.space.dimensions, record.values, strict=False)
        return {dimension.name: dimension.told(value) for dimension, value in told}

    def frame(self) -> pd.DataFrame:
        """Tabulate the trials.

        There is a column for each specification's robustness (``rho.``), each margin
        (``margin.``), each descriptor (``what.``), and each dimension of the search space under
        its name (after ``param`` where another column has it), with values as a person reads them.
        """
        import pandas as pd  # noqa: PLC0415 - loads slowly

        rows = []
        for record in self.records:
            row: dict[str, Any] = {
                "id": record.id,
                "status": record.status,
                "failed": record.failed,
                "score": record.score,
                "signature": record.signature,
                "kind": kind_of(record.verdicts),
                "layer": record.layer,
                "engine": record.engine,
                "sim_time": record.sim_time,
                "wall_s": record.wall_s,
                "attempts": record.attempts,
                "world_digest": record.world_digest,
                "trace_digest": record.trace_digest,
            }
            row |= {f"rho.{v.spec}": v.robustness for v in record.verdicts}
            row |= {f"margin.{name}": value for name, value in record.objectives.items()}
            row |= {f"what.{name}": value for name, value in record.descriptors.items()}
            values = self.values_of(record)
            row |= {f"param {n}" if n in row else n: value for n, value in values.items()}
            rows.append(row)
        return pd.DataFrame(rows)


def _of_other(record: TrialRecord, other: OtherRun) -> TrialRecord:
    """Write what the other stack did as a record."""
    return dataclasses.replace(
        record,
        verdicts=other.verdicts,
        objectives={},
        descriptors={},
        situations=(),
        blamed=(),
        is_afterthought=False,
        is_shut=kind_of(other.verdicts) == "shut",
        score=other.score,
        signature=other.signature,
        signature_before=other.signature_before,
        layer="",
        trace_file=other.trace_file,
        trace_digest=other.trace_digest,
        screening=None,
        jittered=other.jittered,
        repeated=None,
        other=None,
        coupling=None,
        ended=other.ended,
        sim_time=other.sim_time,
        wall_s=other.wall_s,
    )


def removed(directory: Path) -> PlaceError:
    """Say that the directory of a campaign is not there any more."""
    return PlaceError(
        f"{directory}: was removed, or another one was put in its place, while this ran; "
        "nothing more is written to it; put it back"
    )


def trial_folder(directory: Path, number: int) -> Path:
    """Name the directory of the files of trial ``number``."""
    return directory / TRIALS / f"{number:04d}"


# --- lines -------------------------------------------------------------------------------


def _line(record: TrialRecord) -> bytes:
    text = json.dumps(codec.encode(record), separators=(",", ":"))
    return f"{_checksum(text)}\t{text}\n".encode()


def _checksum(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:CHECKSUM_LENGTH]


def log_size(directory: Path) -> int:
    """Size of a campaign's log [bytes], which grows with every trial; 0: there is none yet."""
    path = directory / RECORDS
    return path.stat().st_size if path.is_file() else 0


def _records(path: Path, *, leaves_out: bool = False) -> tuple[list[TrialRecord], int]:
    """Read the records of a log, and the length [bytes] of its sound part.

    Args:
        path: of the log.
        leaves_out: a record that is whole, but has content that no record has, is left out, and
            an :class:`~mrta_falsify.core.errors.InputNote` names it.

    Raises:
        StoreError: damage anywhere but in a torn last line, or such content.
    """
    records: list[TrialRecord] = []
    seen: set[int] = set()
    sound = 0
    for number, raw in enumerate(_lines(path), start=1):
        where = f"{path}:{number}"
        torn = not raw.endswith(b"\n")
        checksum, _, text = raw.rstrip(b"\n").decode("utf-8", "replace").partition("\t")
        if torn:
            break
        if checksum != _checksum(text):
            if b"\0" in raw and sound + len(raw) >= path.stat().st_size:
                break  # a power cut: blocks that were never written are zeros
            raise StoreError(
                f"{where}: this record is damaged (its checksum is {checksum[:16]!r}, it should be "
                f"{_checksum(text)!r}); restore the file, or cut the line out and run its trial "
                f"anew by `mrta-falsify campaign --resume {path.parent}`"
            )
        sound += len(raw)
        try:
            record = codec.decode(TrialRecord, parse_json(text, where), where=where)
        except InputError as error:
            if leaves_out:
                warnings.warn(InputNote(f"{error}; this record is left out"), stacklevel=3)
                continue
            raise StoreError(
                f"{error}; restore the file, or cut the line out and run its trial "
                f"anew by `mrta-falsify campaign --resume {path.parent}`"
            ) from None
        if record.ended == INTERRUPTED:
            continue
        if record.number in seen:
            raise StoreError(f"{where}: trial {record.id} is in the log twice")
        seen.add(record.number)
        records.append(record)
    return records, sound


def _lines(path: Path) -> Iterator[bytes]:
    refuse_pipe(path)
    try:
        with path.open("rb") as file:
            yield from file
    except FileNotFoundError:
        return
    except OSError as error:
        raise StoreError(f"{path}: cannot be read: {error.strerror}") from None


# --- reading -----------------------------------------------------------------------------


def read_campaign_settings(directory: Path) -> CampaignSettings:
    """Read the settings of a campaign directory.

    Raises:
        StoreError: not a campaign, or of another version.
    """
    data, where = _stored_settings(directory), str(directory / SETTINGS)
    target = data.get("target", DEFAULT_TARGET)
    if not isinstance(target, str) or target not in STORED_TARGETS:
        raise StoreError(
            f"{where}: target is {codec.shown(target)}; it must be {DEFAULT_TARGET}, since workers "
            "run nothing else for a campaign"
        )
    known = {**data, "version": FORMAT_VERSION, "target": STORED_TARGETS[target]}
    return codec.decode(CampaignSettings, known, where=where)


def format_version(directory: Path) -> int:
    """Version of the format that a campaign directory was written in.

    Raises:
        StoreError: not a campaign, or of another version.
    """
    return int(_stored_settings(directory)["version"])


def _hint(directory: Path) -> str:
    """Say what to try in place of a directory that is no campaign."""
    if not directory.exists():
        return "; it does not exist: `mrta-falsify campaign SCENARIO -o DIR` begins one"
    if (directory / "verdicts.json").is_file():
        return f"; it is that of one run, whose page is {directory / 'report.html'}"
    inside = sorted(path.parent for path in directory.glob(f"*/{SETTINGS}"))
    inside += sorted(path.parent for path in directory.glob(f"*/*/{SETTINGS}"))
    return f"; did you mean {inside[0]}?" if inside else ""


def _stored_settings(directory: Path) -> dict[str, Any]:
    path = directory / SETTINGS
    if not path.is_file():
        raise StoreError(
            f"{directory}: is not a campaign directory (it has no {SETTINGS}){_hint(directory)}"
        )
    data = codec.read_json(path)
    version = data.get("version") if isinstance(data, dict) else None
    if version not in (1, FORMAT_VERSION):
        raise StoreError(
            f"{path}: has format version {codec.shown(version)}; this reads 1 to {FORMAT_VERSION}"
        )
    return dict(data)


def read_campaign(directory: Path) -> Campaign:
    """Read a campaign as it is on disc; works while another process owns it.

    Raises:
        StoreError: not a campaign, of another version, or damaged.
        InputError: a file of it lies elsewhere, in a campaign of somebody else.

    Warns:
        InputNote: a record was left out, because its content is none of a record.
    """
    made_here.refuse_links(directory)
    settings = read_campaign_settings(directory)
    records, _ = _records(directory / RECORDS, leaves_out=True)
    records.sort(key=lambda record: record.number)
    return Campaign(directory=directory, settings=settings, records=tuple(records))


def owner_of(directory: Path) -> str:
    """Name the process that owns a campaign directory at this moment; empty if none does."""
    path = directory / LOCK
    try:
        handle = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    except OSError:
        return ""
    try:
        fcntl.flock(handle, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return _owner_text(path)
    except OSError:  # a file system without locks
        return ""
    finally:
        os.close(handle)
    return ""


def _owner_text(path: Path) -> str:
    return path.read_text(encoding="utf-8", errors="replace").strip() or "another process"


# --- writing -----------------------------------------------------------------------------


@dataclass(slots=True)
class Store:
    """The one writer of a campaign directory; a context manager that holds its lock."""

    directory: Path
    settings: CampaignSettings
    finished: dict[int, TrialRecord] = field(default_factory=dict)  #: by number
    _lock: int = -1
    _log: int = -1
    _seen: tuple[int, int] = (0, 0)  # of the log, after the last record
    _has_new_settings: bool = False

    @classmethod
    def create(cls, directory: Path, settings: CampaignSettings) -> Store:
        """Create a campaign in an empty or missing directory.

        Raises:
            StoreError: the directory holds something already.
            PlaceError: it cannot be written.
        """
        make_folder(directory)
        if (directory / SETTINGS).exists():
            raise StoreError(
                f"{directory}: holds a campaign already; go on with it by "
                f"`mrta-falsify campaign --resume {directory}`, or name another directory"
            )
        with naming(directory):
            others = sorted(p.name for p in directory.iterdir() if p.name != LOCK)
        if others and not all(name.endswith(".part") for name in others):
            raise StoreError(f"{directory}: is not empty (it holds {others[0]})")
        store = cls(directory, settings)
        store._take_lock()
        try:
            store._write_settings()
            store._seal()
            store.begin()
        except BaseException:
            store.close()
            raise
        return store

    @classmethod
    def resume(cls, directory: Path) -> Store:
        """Open an existing campaign to resume it; nothing is written before :meth:`begin`.

        Raises:
            StoreError: not a campaign, of another version or other rules, damaged, or owned by a
                living process.
        """
        settings = read_campaign_settings(directory)
        reason = why_no_resume(settings.rules)
        if reason:
            raise StoreError(f"{directory}: {reason}")
        store = cls(directory, settings)
        store._take_lock()
        try:
            records, _ = _records(directory / RECORDS)
        except BaseException:
            store.close()
            raise
        store.finished = {record.number: record for record in records}
        return store

    def begin(self) -> None:
        """Make the directory ready for records: owner, budget, log without a torn last line.

        A resumed campaign does so once what is stored was found to belong to it. May be called
        twice.

        Raises:
            StoreError: the log is damaged, or another process writes to it.
            PlaceError: it cannot be written.
        """
        if self._log >= 0:
            return
        self._open_log()
        self._sign_lock()
        if self._has_new_settings:
            self._write_settings()

    def add(self, record: TrialRecord) -> None:
        """Append a record; it is durable on return.

        Raises:
            StoreError: somebody else has damaged the log.
            PlaceError: the disc is full or broken, or the directory was removed. The log is as
                before.
        """
        if record.number in self.finished:
            raise AssertionError(f"trial {record.id} is stored already")
        self.begin()
        self.check()
        try:
            append(self._log, _line(record))
        except OSError as error:
            raise self.without(
                record.number, place_error(self.directory / RECORDS, error)
            ) from error
        self._seen = self._look()
        self.finished[record.number] = record

    def check(self) -> None:
        """Make sure that the log is still the one that was written here.

        Raises:
            StoreError: somebody else has changed it.
            PlaceError: the directory was removed, or another one is in its place.
        """
        if self._log < 0:
            return
        path = self.directory / RECORDS
        try:
            is_ours = os.path.samestat(os.stat(path), os.fstat(self._log))
        except OSError:
            is_ours = False
        if not (is_ours and (self.directory / SETTINGS).is_file()):
            raise removed(self.directory)
        now = self._look()
        if now == self._seen:
            return
        if now[0] == self._seen[0]:
            _records(path)  # damaged in its place, or not at all
            self._seen = now
            return
        raise StoreError(
            f"{path}: has {now[0]} bytes where this campaign has written {self._seen[0]}: somebody "
            "else has changed it meanwhile. Nothing was added to it. Put it back as it was, or run "
            f"what is missing: {self._resume()}"
        )

    def without(self, number: int, error: PlaceError) -> PlaceError:
        """Complete an error of a place that has cost trial ``number``: how to go on.

        Raises:
            PlaceError: the directory was removed, which nothing completes.
            StoreError: see :meth:`check`.
        """
        self.check()
        kept = f"trial {number:04d} is not stored, all that ended before are"
        error.then = f"go on with: {self._resume()} ({kept})"
        return error

    def _resume(self) -> str:
        return f"mrta-falsify campaign --resume {shlex.quote(str(self.directory))}"

    def _look(self) -> tuple[int, int]:
        """Give length [bytes] and time of the last change [ns] of the log."""
        found = os.fstat(self._log)
        return found.st_size, found.st_mtime_ns

    def keep(self, *, budget: int, time_limit: float) -> None:
        """Note what may change when a campaign is resumed; :meth:`begin` writes it."""
        kept = dataclasses.replace(self.settings, budget=budget, time_limit=time_limit)
        if kept != self.settings:
            self.settings, self._has_new_settings = kept, True

    def campaign(self) -> Campaign:
        """Give what is stored so far."""
        records = tuple(self.finished[number] for number in sorted(self.finished))
        return Campaign(directory=self.directory, settings=self.settings, records=records)

    def close(self) -> None:
        """Let go of the directory; may be called twice."""
        for handle in (self._log, self._lock):
            if handle >= 0:
                os.close(handle)
        self._log = self._lock = -1

    def __enter__(self) -> Store:
        return self

    def __exit__(self, *reason: object) -> None:
        self.close()

    def _write_settings(self) -> None:
        text = json.dumps(codec.encode(self.settings), indent=1) + "\n"
        has_seal = made_here.has_seal(self.directory)
        write_atomically(self.directory / SETTINGS, text.encode())
        if has_seal:  # this version may write them in other words
            self._seal()

    def _seal(self) -> None:
        made_here.write_seal(self.directory, sealed_places(self.settings))

    def _take_lock(self) -> None:
        path = self.directory / LOCK
        try:
            self._lock = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(self._lock)
            self._lock = -1
            raise StoreError(f"{self.directory}: is in use by {_owner_text(path)}") from None
        except OSError as error:
            raise StoreError(f"{self.directory}: cannot be locked: {error.strerror}") from None

    def _sign_lock(self) -> None:
        """Write into the lock who has it."""
        now = time.strftime("%Y-%m-%d %H:%M:%S")
        text = f"process {os.getpid()} on {socket.gethostname()}, {now}\n"
        with naming(self.directory / LOCK):
            os.ftruncate(self._lock, 0)
            os.pwrite(self._lock, text.encode(), 0)

    def _open_log(self) -> None:
        """Open the log, and hold it too: the lock is a file that somebody may have deleted."""
        path = self.directory / RECORDS
        with naming(path):
            log = os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND | os.O_CLOEXEC, 0o644)
            try:
                fcntl.flock(log, fcntl.LOCK_EX | fcntl.LOCK_NB)
                _, sound = _records(path)
                if os.fstat(log).st_size > sound:
                    os.ftruncate(log, sound)
                    os.fsync(log)
                sync_directory(self.directory)
            except BlockingIOError:
                os.close(log)
                owner = _owner_text(self.directory / LOCK)
                raise StoreError(f"{self.directory}: is in use by {owner}") from None
            except BaseException:
                os.close(log)
                raise
        self._log = log
        self._seen = self._look()


def decode_record(data: Any, *, where: str) -> TrialRecord:
    """Decode a record from JSON-shaped data of a worker.

    Raises:
        FormatError: it is not one.
    """
    try:
        return codec.decode(TrialRecord, data, where=where)
    except InputError as error:
        raise FormatError(str(error)) from None
