"""One directory per campaign: an append-only log that survives kill -9.

::

    campaign.json        settings, format version (written atomically; later only its budget)
    records.jsonl        one line per finished trial: checksum, tab, JSON of a TrialRecord
    seal.json            says that this user has made it (see :mod:`.made_here`)
    lock                 held (flock) by the one owner; says who
    records.2.jsonl      the log as version 2 left it, where such a campaign was resumed
    trials/0042/         world.json and trace.zip of trials worth keeping
    trials/0042/other/   the same of the other stack, where two are compared

A record counts once its line is on disc (fsync), and what it names is there before. A record of an
older version whose run was interrupted does not count: its trial is run again. The next owner cuts
off a torn last line, which only a crash during the write leaves behind. Any other damage is an
error that names the line, and nothing is changed. The owner looks at the log before each record: it
adds nothing to a log that somebody else has changed or removed.
"""

from __future__ import annotations

import contextlib
import dataclasses
import fcntl
import hashlib
import json
import math
import os
import shlex
import shutil
import socket
import time
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mrta_falsify.campaigns import made_here
from mrta_falsify.campaigns.foreign import sealed_places
from mrta_falsify.campaigns.record_formats import is_flat, migrated
from mrta_falsify.campaigns.rules import why_no_resume
from mrta_falsify.campaigns.settings import (
    DEFAULT_TARGET,
    FORMAT_VERSION,
    STORED_TARGETS,
    CampaignSettings,
)
from mrta_falsify.campaigns.stats import CampaignStats
from mrta_falsify.core import codec
from mrta_falsify.core.candidate import DimensionValue
from mrta_falsify.core.durable import (
    append,
    make_folder,
    naming,
    place_error,
    replacing,
    sync_directory,
    write_atomically,
)
from mrta_falsify.core.errors import FormatError, InputError, InputNote, PlaceError
from mrta_falsify.core.parsing import parse_json, refuse_pipe
from mrta_falsify.core.record import OtherRun, PerturbedRuns, SearchData, TrialRecord
from mrta_falsify.core.run_result import Rank
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.specs.causes import kind_of

if TYPE_CHECKING:
    import pandas as pd

SETTINGS, RECORDS = made_here.SETTINGS, made_here.RECORDS
NEW_RECORDS = f"{RECORDS}.part"  # the log while it is written in today's format
OLD_RECORDS = made_here.OLD_RECORDS  # the log as an older version left it, by its format
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
        wanted = _number_of(str(name))
        for record in self.records:
            if record.number == wanted:
                return record
        known = f"trials {self.records[0].id} to {self.records[-1].id}" if self.records else "none"
        raise StoreError(f"{self.directory}: has no trial {str(name)!r}; it has {known}")

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
        failed = self.stats().failed
        return f"<Campaign {self.directory}: {len(self.records)} trials, {failed} failed>"

    def stats(self) -> CampaignStats:
        """Count the trials, what became of them, and what they show."""
        stats = CampaignStats(self.settings)
        stats.take_all(self.records)
        return stats

    def values_of(self, record: TrialRecord) -> dict[str, DimensionValue]:
        """Give the values of a trial's search dimensions by name, as a person reads them.

        Empty for trials whose scenario could not be sampled, and for campaigns of older versions.
        """
        told = zip(self.settings.space.dimensions, record.origin.values, strict=False)
        return {dimension.name: dimension.told(value) for dimension, value in told}

    def frame(self) -> pd.DataFrame:
        """Tabulate the trials.

        ``rank`` says whether a primary specification is violated, only a secondary one, or none;
        ``uniform`` whether the trial was drawn evenly, as trials for a failure rate must be. There
        is a column for each specification's robustness (``rho.``), each margin
        (``margin.``), each descriptor (``what.``), and each dimension of the search space under
        its name (after ``param`` where another column has it), with values as a person reads them.
        """
        import pandas as pd  # noqa: PLC0415 - loads slowly

        columns: dict[str, list[Any]] = {}
        for number, record in enumerate(self.records):
            margins = record.result.margins if record.result is not None else {}
            row: dict[str, Any] = {
                "id": record.id,
                "status": record.status,
                "failed": record.failed,
                "score": record.score,
                "signature": record.signature,
                "kind": kind_of(record.verdicts),
                "rank": record.result.rank if record.result is not None else "none",
                "uniform": record.origin.uniform,
                "layer": record.layer,
                "engine": record.engine,
                "sim_time": record.sim_time,
                "wall_s": record.wall_s,
                "attempts": record.origin.attempts,
                "world_digest": record.world_digest,
                "trace_digest": record.trace_digest,
            }
            row |= {f"rho.{v.spec}": v.robustness for v in record.verdicts}
            row |= {f"margin.{name}": value for name, value in margins.items()}
            row |= {f"what.{name}": value for name, value in record.search.descriptors.items()}
            values = self.values_of(record)
            row |= {f"param {n}" if n in row else n: value for n, value in values.items()}
            for name, value in row.items():
                column = columns.setdefault(name, [])
                column.extend([math.nan] * (number - len(column)))  # trials without such a value
                column.append(value)
        for column in columns.values():
            column.extend([math.nan] * (len(self.records) - len(column)))
        return pd.DataFrame(columns)


def _number_of(name: str) -> int:
    """Give the number of a trial by its id, as ``0042`` or ``42``; -1: it is none."""
    is_number = name.isascii() and name.isdigit() and len(name) <= MAX_DIGITS
    return int(name) if is_number else -1


def _of_other(record: TrialRecord, other: OtherRun) -> TrialRecord:
    """Write what the other stack did as a record."""
    assert record.result is not None, "the other stack runs only worlds that were run"
    result = dataclasses.replace(
        record.result,
        verdicts=other.verdicts,
        margins={},
        signature=other.signature,
        rank=_rank(other.verdicts),
        ended=other.ended,
        trace=other.trace_digest,
        sim_time=other.sim_time,
        wall_s=other.wall_s,
        layer="",
        trace_file=other.trace_file,
        coupling=None,
    )
    return dataclasses.replace(
        record,
        origin=dataclasses.replace(record.origin, screening=None),
        result=result,
        vote=PerturbedRuns.vote(other.jittered),
        repeats=None,
        other=None,
        engines={},
        search=SearchData(score=other.score),
    )


def _rank(verdicts: Sequence[Verdict]) -> Rank:
    if not any(verdict.violated for verdict in verdicts):
        return "none"
    return "secondary" if kind_of(verdicts) == "shut" else "primary"


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


@dataclass(frozen=True, slots=True, kw_only=True)
class _Log:
    """What a log holds."""

    records: tuple[TrialRecord, ...] = ()  #: in the order of their lines
    sound: int = 0  #: length of its whole lines [bytes]
    is_old: bool = False  #: whether it has lines of an older format


def _read_log(path: Path, *, leaves_out: bool = False) -> _Log:
    """Read a log of any format.

    Args:
        path: of the log.
        leaves_out: a record that is whole, but has content that no record has, is left out, and
            an :class:`~mrta_falsify.core.errors.InputNote` names it.

    Raises:
        StoreError: damage anywhere but in a torn last line, or such content.
    """
    records: dict[int, TrialRecord] = {}
    sound, is_old = 0, False
    for number, (raw, text) in enumerate(_whole_lines(path), start=1):
        where = f"{path}:{number}"
        sound += len(raw)
        try:
            data = parse_json(text, where)
            is_old = is_old or is_flat(data)
            record = codec.decode(TrialRecord, migrated(data), where=where)
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
        if record.number in records:
            raise StoreError(f"{where}: trial {record.id} is in the log twice")
        records[record.number] = record
    return _Log(records=tuple(records.values()), sound=sound, is_old=is_old)


def _whole_lines(path: Path) -> Iterator[tuple[bytes, str]]:
    """Yield the lines of a log, each with its text behind the checksum, without a torn last one.

    Raises:
        StoreError: a line is damaged.
    """
    sound = 0
    for number, raw in enumerate(_lines(path), start=1):
        checksum, _, text = raw.rstrip(b"\n").decode("utf-8", "replace").partition("\t")
        if not raw.endswith(b"\n"):
            return
        if checksum != _checksum(text):
            if b"\0" in raw and sound + len(raw) >= path.stat().st_size:
                return  # a power cut: blocks that were never written are zeros
            raise StoreError(
                f"{path}:{number}: this record is damaged (its checksum is {checksum[:16]!r}, it "
                f"should be {_checksum(text)!r}); restore the file, or cut the line out and run "
                f"its trial anew by `mrta-falsify campaign --resume {path.parent}`"
            )
        sound += len(raw)
        yield raw, text


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
    if version not in range(1, FORMAT_VERSION + 1):
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
    log = _read_log(directory / RECORDS, leaves_out=True)
    records = sorted(log.records, key=lambda record: record.number)
    return Campaign(directory=directory, settings=settings, records=tuple(records))


def read_trial(directory: Path, name: str | int) -> Campaign:
    """Read a campaign with one of its records alone, without decoding the others.

    Args:
        directory: of the campaign.
        name: id of the trial, as ``0042``, ``42`` or the number.

    Returns:
        The campaign with that record; with all that there are, if it has no such record.

    Raises:
        StoreError: not a campaign, of another version, or the log is damaged.
    """
    made_here.refuse_links(directory)
    settings = read_campaign_settings(directory)
    path = directory / RECORDS
    begins = f'{{"candidate":{{"number":{_number_of(str(name))},'
    for number, (_, text) in enumerate(_whole_lines(path), start=1):
        if text.startswith(begins):
            where = f"{path}:{number}"
            with contextlib.suppress(InputError):  # all are read, and the message names it
                data = migrated(parse_json(text, where))
                record = codec.decode(TrialRecord, data, where=where)
                if record.ended != INTERRUPTED:
                    return Campaign(directory=directory, settings=settings, records=(record,))
    return read_campaign(directory)


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
    _stored: _Log = _Log()  # what there was
    _known: tuple[int, ...] = ()  # state of the log before that was read
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
                f"{directory}: holds a campaign already; continue it by "
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
            store._known = _state(directory / RECORDS)
            store._stored = _read_log(directory / RECORDS)
        except BaseException:
            store.close()
            raise
        store.finished = {record.number: record for record in store._stored.records}
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
            _read_log(path)  # damaged in its place, or not at all
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
        error.then = f"continue with: {self._resume()} ({kept})"
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

    def _is_of_older_format(self) -> bool:
        return format_version(self.directory) < FORMAT_VERSION

    def _rewritten(self, old: int) -> int:
        """Write the log in today's format, keep the old one beside it, and open the new one.

        Both logs can be read in each moment between: the settings say that the format is today's
        once the new log is durable, and the log of either format is read by its lines.

        Args:
            old: the open log, which is held.

        Returns:
            The new log, which is held.
        """
        path, new = self.directory / RECORDS, self.directory / NEW_RECORDS
        version = format_version(self.directory)
        try:
            with replacing(new) as file:
                file.writelines(map(_line, self._stored.records))
            log = os.open(new, os.O_RDWR | os.O_APPEND | os.O_CLOEXEC)
            try:
                fcntl.flock(log, fcntl.LOCK_EX | fcntl.LOCK_NB)
                self._write_settings()
                self._keep_old_log(min(version, FORMAT_VERSION - 1))
                os.replace(new, path)
            except BaseException:
                os.close(log)
                raise
        except BaseException:
            with contextlib.suppress(OSError):
                new.unlink()
            raise
        sync_directory(self.directory)
        os.close(old)
        return log

    def _keep_old_log(self, version: int) -> None:
        """Keep the log under the number of its format; one that is kept already stays."""
        path = self.directory / RECORDS
        kept = self.directory / OLD_RECORDS.format(version)
        if kept.exists():
            return
        try:
            os.link(path, kept)
        except OSError:  # a file system without links
            with replacing(kept) as file, path.open("rb") as log:
                shutil.copyfileobj(log, file)
        sync_directory(self.directory)

    def _open_log(self) -> None:
        """Open the log, and hold it too: the lock is a file that somebody may have deleted."""
        path = self.directory / RECORDS
        with naming(path):
            log = os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND | os.O_CLOEXEC, 0o644)
            try:
                fcntl.flock(log, fcntl.LOCK_EX | fcntl.LOCK_NB)
                if _state(path) != self._known:
                    self._stored = _read_log(path)
                if os.fstat(log).st_size > self._stored.sound:
                    os.ftruncate(log, self._stored.sound)
                    os.fsync(log)
                sync_directory(self.directory)
                if self._stored.is_old or self._is_of_older_format():
                    log = self._rewritten(log)
            except BlockingIOError:
                os.close(log)
                owner = _owner_text(self.directory / LOCK)
                raise StoreError(f"{self.directory}: is in use by {owner}") from None
            except BaseException:
                os.close(log)
                raise
        self._log = log
        self._seen = self._look()


def _state(path: Path) -> tuple[int, ...]:
    """Tell a file from one that was changed since, by number, length and time; empty: none."""
    try:
        found = path.stat()
    except OSError:
        return ()
    return found.st_ino, found.st_size, found.st_mtime_ns


def decode_record(data: Any, *, where: str) -> TrialRecord:
    """Decode a record from JSON-shaped data of a worker.

    Raises:
        FormatError: it is not one.
    """
    try:
        return codec.decode(TrialRecord, data, where=where)
    except InputError as error:
        raise FormatError(str(error)) from None
