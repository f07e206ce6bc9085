"""The trace of an episode: columns over K ticks, path table, event table."""

from __future__ import annotations

import hashlib
import itertools
import json
import operator
import zipfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from mrta_falsify.core import codec
from mrta_falsify.core.archives import DAMAGE, read_array, read_json_member
from mrta_falsify.core.arrays import Array
from mrta_falsify.core.codec import quantity
from mrta_falsify.core.columns import ColumnStore
from mrta_falsify.core.durable import replacing
from mrta_falsify.core.errors import FormatError
from mrta_falsify.core.fleet import INTENT, SENSED, BlockedBy, Command, Frame, StackEvent
from mrta_falsify.core.observed import Observed, observed_in
from mrta_falsify.core.parsing import refuse_pipe

TRACE_VERSION = 1
MAX_TABLE = 2**30  # bytes of what stands beside the columns

SENSED_COLUMNS = tuple(SENSED)
INTENT_COLUMNS = tuple(INTENT)


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

    def paths_at(self, tick: int) -> dict[int, Array]:
        """Find the paths ``(L, 2)`` [m] at ``tick``, by the number of a robot that has had one."""
        changes = itertools.takewhile(lambda change: change.tick <= tick, self.paths)
        return {change.robot: change.points for change in changes}

    def path_at(self, robot: int, tick: int) -> Array:
        """Find the path ``(L, 2)`` [m] that a robot follows at ``tick``; empty if none."""
        return self.paths_at(tick).get(robot, np.empty((0, 2)))

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
        row = b"".join(map(_bytes_of, _hashed_values(frame)))
        self._hash.update(row)
        for event in frame.events:
            self._hash.update(repr(event).encode())
        paths, known = frame.intent.path, self._last_paths
        if len(paths) != len(known) or not all(map(operator.is_, paths, known)):
            self._add_paths(tick, paths)
        if self.keep:
            self._store = self._store or ColumnStore(_layout_of(frame), kept_as=_KEPT_AS)
            self._store.add(row + b"".join(map(_bytes_of, _other_values(frame))))
            self._events.extend(frame.events)
            self._event_ticks.extend([tick] * len(frame.events))
            self._add_edges(tick, frame.blocked_by)

    def _add_paths(self, tick: int, paths: tuple[Array, ...]) -> None:
        for robot, points in enumerate(paths):
            known = self._last_paths[robot] if robot < len(self._last_paths) else None
            if points is known:
                continue
            self._hash.update(np.ascontiguousarray(points).tobytes())
            if self.keep and (known is None or not np.array_equal(points, known)):
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


#: what a frame is asked for, by the name of the column
_PLACES = {
    **{name: f"sensed.{name}" for name in SENSED},
    "command": "command.twist",
    **{name: f"intent.{name}" for name in INTENT},
}
#: of each column; the hashed ones come first in a row
COLUMNS: dict[str, Observed] = {**SENSED, "command": observed_in(Command)["twist"], **INTENT}
_HASHED = tuple(name for name, column in COLUMNS.items() if column.hashed)
_OTHERS = tuple(name for name, column in COLUMNS.items() if not column.hashed)
_KEPT_AS = {name: np.dtype(c.kept_as) for name, c in COLUMNS.items() if c.kept_as}


def _reader(names: Sequence[str]) -> Callable[[Frame], Iterator[Any]]:
    """Make a function that reads columns off a frame."""
    places = [operator.attrgetter(_PLACES[name]) for name in names]
    return lambda frame: (place(frame) for place in places)


_hashed_values, _other_values = _reader(_HASHED), _reader(_OTHERS)


def _bytes_of(value: Any) -> bytes:
    return np.asarray(value).tobytes()


def _layout_of(frame: Frame) -> np.dtype[np.void]:
    """Describe how the bytes of a frame's columns follow each other."""
    values = map(np.asarray, (*_hashed_values(frame), *_other_values(frame)))
    named = zip((*_HASHED, *_OTHERS), values, strict=True)
    return np.dtype([(name, array.dtype, array.shape) for name, array in named])


# --- files -----------------------------------------------------------------------------


def _json_parts(table: Mapping[str, Any]) -> Iterator[str]:
    """Write a table as JSON row by row: the rows of a long run need not be in memory as text."""
    for i, (name, value) in enumerate(table.items()):
        yield f"{', ' if i else '{'}{json.dumps(name)}: "
        if not isinstance(value, (tuple, list)):
            yield json.dumps(codec.encode(value))
            continue
        yield "["
        for k, row in enumerate(value):
            yield f"{', ' if k else ''}{json.dumps(codec.encode(row))}"
        yield "]"
    yield "}"


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
        # a member that is opened by its name has no time: equal traces are equal files
        with archive.open("table.json", "w", force_zip64=True) as member:
            for part in _json_parts(table):
                member.write(part.encode())
        for name, column in sorted(trace.columns.items()):
            with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                np.lib.format.write_array(member, column, allow_pickle=False)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _PathRow:
    tick: int = quantity(low=0)
    robot: int = quantity(low=0)
    points: Array = quantity(shape=("L", 2), unit="m")


@dataclass(frozen=True, slots=True, kw_only=True)
class _EdgeRow:
    first: int = quantity(low=0)
    last: int = quantity(low=0)
    edge: BlockedBy


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Table:
    """What stands in a trace beside its columns."""

    version: int
    world_digest: str
    dt: float = quantity(above=0.0, unit="s")
    robots: tuple[str, ...]
    humans: tuple[str, ...]
    paths: tuple[_PathRow, ...]
    events: tuple[StackEvent, ...]
    event_ticks: tuple[int, ...] = ()
    edges: tuple[_EdgeRow, ...]
    ended: str
    digest: str
    columns: tuple[str, ...]

    def __post_init__(self) -> None:
        robots, humans = len(self.robots), len(self.humans)
        for i, row in enumerate(self.paths):
            _check_number(row.robot, robots, f"paths[{i}].robot")
        for i, event in enumerate(self.events):
            _check_number(event.robot, robots, f"events[{i}].robot", low=-1)
        for i, span in enumerate(self.edges):
            edge, where = span.edge, f"edges[{i}].edge"
            _check_number(edge.robot, robots, f"{where}.robot")
            others = humans if edge.cause == "human" else robots
            _check_number(edge.other, others, f"{where}.other", low=-1)
        if self.event_ticks and len(self.event_ticks) != len(self.events):
            raise FormatError(
                f"event_ticks has {len(self.event_ticks)} entries; there are {len(self.events)} "
                "events"
            )


def _check_number(number: int, below: int, where: str, low: int = 0) -> None:
    if not low <= number < below:
        raise FormatError(f"{where} is {number}; it must be from {low} to {below - 1}")


#: shapes of columns, ticks first: N robots, H people, other letters any length
def _check_columns(columns: Mapping[str, np.ndarray], table: _Table) -> None:
    """Refuse columns that do not fit each other."""
    for name in (*COLUMNS, *columns) if columns else ():
        if name not in COLUMNS:
            raise FormatError(f"column {name!r:.60} is not known")
        if name not in columns and not COLUMNS[name].optional:
            raise FormatError(f"column {name} is missing")
    lengths = {"K": len(columns["time"]) if columns else 0}
    lengths |= {"N": len(table.robots), "H": len(table.humans)}
    for name, column in columns.items():
        wanted = [lengths.get(str(n), n) for n in ("K", *COLUMNS[name].shape)]
        fits = len(column.shape) == len(wanted) and all(
            isinstance(n, str) or n == m for n, m in zip(wanted, column.shape, strict=True)
        )
        if not fits:
            text = ", ".join(map(str, wanted))
            raise FormatError(f"column {name} has shape {column.shape}; it must be ({text})")
        if COLUMNS[name].finite and not np.isfinite(column).all():
            raise FormatError(f"column {name} has nan or infinity; it must be finite")


def read_trace(path: str | Path) -> Trace:
    """Read what :func:`write_trace` wrote.

    Raises:
        FormatError: not such a file, damaged, or of another version.
    """
    refuse_pipe(Path(path))
    try:
        with zipfile.ZipFile(path) as archive:
            data = read_json_member(archive, "table.json", MAX_TABLE)
            version = data.get("version") if isinstance(data, dict) else None
            if version != TRACE_VERSION:
                raise FormatError(
                    f"{path}: trace version {codec.shown(version)}; this version reads "
                    f"{TRACE_VERSION}"
                )
            table = codec.decode(_Table, data, where=f"{path}: table.json")
            columns = {name: read_array(archive, name) for name in table.columns}
    except DAMAGE as error:
        raise FormatError(
            f"{path}: is not a readable trace: {error}; restore it, or make the run again"
        ) from None
    try:
        _check_columns(columns, table)
    except FormatError as error:
        raise FormatError(f"{path}: {error}") from None
    return Trace(
        world_digest=table.world_digest,
        dt=table.dt,
        robots=table.robots,
        humans=table.humans,
        columns=columns,
        paths=tuple(
            PathChange(tick=row.tick, robot=row.robot, points=row.points) for row in table.paths
        ),
        events=table.events,
        edges=tuple(EdgeSpan(first=row.first, last=row.last, edge=row.edge) for row in table.edges),
        ended=table.ended,
        digest=table.digest,
        event_ticks=table.event_ticks,
    )
