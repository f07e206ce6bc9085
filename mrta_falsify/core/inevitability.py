"""Inevitability: the chance of a failure by the time from which its run is repeated.

A run is rewound to a time and repeated from there many times with small differences, by the stack
as it is, with one layer replaced from then on, or without one robot. The later that is, the less
is left open: the chance of failure is taken not to fall with time. At the violation it is one.

The time is what a branching process calls its point of no return: the first from which most
continuations fail. Of a change it says until when the change would have averted the failure.

References: Pearl, *Causality* (2009), chapter 9, for what would have averted an outcome; Ayer et
al., "An empirical distribution function for sampling with incomplete information" (Annals of
Mathematical Statistics 26, 1955), for the monotone fit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple, TypeAlias

from mrta_falsify.core.probability import Probability

Replaced: TypeAlias = Literal["nothing", "layer", "robot"]
EVEN = 0.5  # chance of failure above which a failure counts as decided


@dataclass(frozen=True, slots=True, kw_only=True)
class RewoundTo:
    """How often the run fails if it is repeated from a time with small differences."""

    time: float  #: from which the repeated runs differ [s]
    chance: Probability

    @property
    def is_tried(self) -> bool:
        """Whether any copy has told something."""
        return self.chance.trials > 0


class Turn(NamedTuple):
    """Where the chance of failure rises above one half for good."""

    open_until: float | None  #: last time at which most copies got by [s]; None: at none
    lost_from: float  #: first time from which most copies fail [s]


class Band(NamedTuple):
    """The interval of a chance that does not fall with time."""

    low: float
    high: float


@dataclass(frozen=True, slots=True, kw_only=True)
class ChanceCurve:
    """The chance of failure by the time from which the run is repeated."""

    replaced: Replaced
    name: str = ""  #: of the layer or robot
    change: str  #: in words
    restores: bool = False  #: whether the shipped layer replaced another one
    points: tuple[RewoundTo, ...]  #: by time, all at which runs could be judged
    open_until: float | None  #: last time examined at which most runs avoid the failure [s]
    #: first time examined from which most runs fail [s]; the violation at the latest
    lost_from: float

    def band(self, time: float) -> Band:
        """Bound the chance at a time by the intervals before and after it."""
        before = (p.chance.low for p in self.points if p.time <= time)
        after = (p.chance.high for p in self.points if p.time >= time)
        return Band(max(before, default=0.0), min(after, default=1.0))

    def at(self, time: float) -> RewoundTo | None:
        """Find the point of a time."""
        return next((point for point in self.points if point.time == time), None)


@dataclass(frozen=True, slots=True, kw_only=True)
class Inevitability:
    """When a failure was decided, and by which layer."""

    onset: float  #: when the cause of the violation began [s]
    found: float  #: when the violation was found [s]
    curves: tuple[ChanceCurve, ...]  #: of the stack as it is, then of what was replaced
    decided_at: float | None  #: from when on it was decided [s]; None: that is not known
    by: str = ""  #: the layer that would have averted it until then; empty: no single one
    runs: int  #: repeated runs
    left_out: str = ""  #: what could not be rewound, and why


def monotone_fit(points: Sequence[RewoundTo]) -> list[float]:
    """Fit chances that do not fall with time: pool neighbours that do until none does.

    Args:
        points: by time, each with trials.
    """
    pools: list[tuple[int, int, int]] = []  # failures, trials, points
    for point in points:
        failures, trials, size = point.chance.failures, point.chance.trials, 1
        while pools and pools[-1][0] * trials >= failures * pools[-1][1]:
            before = pools.pop()
            failures, trials, size = (
                before[0] + failures,
                before[1] + trials,
                before[2] + size,
            )
        pools.append((failures, trials, size))
    return [failures / trials for failures, trials, size in pools for _ in range(size)]


def turn_of(points: Sequence[RewoundTo], found: float) -> Turn:
    """Find where the chance of failure rises above one half for good.

    Args:
        points: by time, each with trials.
        found: when the violation was found [s], from which nothing is open.
    """
    fit = monotone_fit(points)
    open_times = [p.time for p, chance in zip(points, fit, strict=True) if chance <= EVEN]
    lost_times = [p.time for p, chance in zip(points, fit, strict=True) if chance > EVEN]
    return Turn(max(open_times, default=None), min(lost_times, default=found))


def moves_the_turn(curve: ChanceCurve, stack: ChanceCurve) -> bool:
    """Whether a replacement lowers the chance of failure at a time, beyond both intervals."""
    if curve.open_until is None:
        return False
    still_open = (point for point in curve.points if point.time <= curve.open_until)
    return any(point.chance.high < stack.band(point.time).low for point in still_open)


def decisive(curves: Sequence[ChanceCurve]) -> ChanceCurve | None:
    """Choose the replaced layer that decided a failure; None: none would have averted it.

    It would have averted the failure until just before that time, and not from then on. Of
    several, the shipped layer in place of another says most, then the one that would have averted
    it longest.

    Args:
        curves: of the stack as it is, then of what was replaced.
    """
    stack, *replaced = curves
    movers = [c for c in replaced if c.replaced == "layer" and moves_the_turn(c, stack)]
    return max(movers, key=lambda curve: (curve.restores, curve.lost_from), default=None)


def decision(curves: Sequence[ChanceCurve]) -> float | None:
    """Tell from when on a failure was decided [s]; None if that is not known.

    From then on most copies fail, whether the decisive layer is replaced or not.

    Args:
        curves: of the stack as it is, then of what was replaced.
    """
    if not curves[0].points:
        return None
    first = decisive(curves)
    return max(first.lost_from if first else 0.0, curves[0].lost_from)
