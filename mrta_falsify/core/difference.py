"""Where two runs of the same world part."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from mrta_falsify.core.trace import COLUMNS, INTENT_COLUMNS, SENSED_COLUMNS, Trace

T = TypeVar("T")

#: what is sensed comes first: it is the cause of what is intended at the same tick
_ORDER = (*SENSED_COLUMNS, *INTENT_COLUMNS, "command")


@dataclass(frozen=True, slots=True, kw_only=True)
class Difference:
    """First difference between two traces."""

    tick: int
    time: float  #: [s]
    what: str  #: column of the trace, or ``path``, ``event``, ``end``
    who: str = ""  #: robot or person
    size: float | None = None  #: largest absolute difference, in the column's unit

    def __str__(self) -> str:
        """Write it as the end of a sentence."""
        who = f" of {self.who}" if self.who else ""
        by = f" by {self.size:.3g}" if self.size is not None else ""
        return f"at tick {self.tick} ({self.time:.2f} s): {self.what}{who}{by}"


def first_difference(one: Trace, other: Trace) -> Difference | None:
    """Find the first tick at which two traces of the same world differ, and in what.

    Args:
        one: a trace.
        other: of the same robots and people.

    Returns:
        None if all that traces keep is equal. Distances to obstacles are kept in single
        precision, so two such traces may still have different digests.

    Raises:
        ValueError: other robots or people.
    """
    if (one.robots, one.humans) != (other.robots, other.humans):
        raise ValueError("the traces have different robots or people")
    both = [name for name in _ORDER if name in one.columns and name in other.columns]
    found = [_in_column(name, one, other) for name in both]
    found += [_in_paths(one, other), _in_events(one, other), _in_end(one, other)]
    there = [difference for difference in found if difference is not None]
    return min(there, key=lambda difference: difference.tick, default=None)


def _in_column(name: str, one: Trace, other: Trace) -> Difference | None:
    ticks = min(len(one), len(other))
    a, b = one.columns[name][:ticks], other.columns[name][:ticks]
    if a.shape != b.shape:
        return Difference(tick=0, time=0.0, what=name)
    differs = _differs(a, b)
    at = np.flatnonzero(differs.any(axis=tuple(range(1, differs.ndim))))
    if not at.size:
        return None
    tick = int(at[0])
    whose: dict[tuple[str | int, ...], tuple[str, ...]] = {
        ("N",): one.robots,
        ("H",): one.humans,
    }
    who, of = "", whose.get(COLUMNS[name].shape[:1])
    if of is not None:
        which = np.flatnonzero(differs[tick].reshape(len(of), -1).any(axis=1))
        who = of[int(which[0])]
    first, second = (np.asarray(values[tick], dtype=np.float64)[differs[tick]] for values in (a, b))
    gap = np.abs(first - second)
    size = float(np.max(gap)) if np.isfinite(gap).all() else None
    return Difference(tick=tick, time=_time(one, tick), what=name, who=who, size=size)


def _differs(a: NDArray[Any], b: NDArray[Any]) -> NDArray[np.bool_]:
    unequal: NDArray[np.bool_] = a != b
    if np.issubdtype(a.dtype, np.floating):
        unequal &= ~(np.isnan(a) & np.isnan(b))
    return unequal


def _in_paths(one: Trace, other: Trace) -> Difference | None:
    changed = _where_they_part(_path_rows(one), _path_rows(other))
    if changed is None:
        return None
    tick, robot, _ = changed
    return Difference(tick=tick, time=_time(one, tick), what="path", who=one.robots[robot])


def _path_rows(trace: Trace) -> list[tuple[int, int, bytes]]:
    """List the changes of paths; older traces have those to an equal path as well."""
    rows, last = [], dict[int, bytes]()
    for change in trace.paths:
        points = np.ascontiguousarray(change.points).tobytes()
        if last.get(change.robot) != points:
            rows.append((change.tick, change.robot, points))
        last[change.robot] = points
    return rows


def _in_events(one: Trace, other: Trace) -> Difference | None:
    event = _where_they_part(one.events, other.events)
    if event is None:
        return None
    who = one.robots[event.robot] if event.robot >= 0 else ""
    tick = round(event.time / one.dt)
    return Difference(tick=tick, time=event.time, what=f"event {event.kind}", who=who)


def _where_they_part(one: Sequence[T], other: Sequence[T]) -> T | None:
    """Find the first element that the other lacks at its place; None if they are equal."""
    for a, b in itertools.zip_longest(one, other):
        if a != b:
            return a if a is not None else b
    return None


def _in_end(one: Trace, other: Trace) -> Difference | None:
    if len(one) == len(other) and one.ended == other.ended:
        return None
    shorter = min(one, other, key=len)
    return Difference(tick=len(shorter), time=shorter.duration, what=f"end ({shorter.ended})")


def _time(trace: Trace, tick: int) -> float:
    times = trace.columns["time"]
    return float(times[min(tick, len(times) - 1)]) if len(times) else 0.0
