"""A probability of violation with its interval."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

WIDEST = 0.5  #: an interval that is wider says next to nothing, and is not told


def interval_text(low: float, high: float, level: float, *, digits: str = ".2f") -> str:
    """Write an interval of a chance; one wider than 0.5 is only said to be wide.

    Args:
        low: end of it.
        high: other end.
        level: of confidence.
        digits: format of the ends.
    """
    if high - low > WIDEST:
        return f"too few runs for a {level:.0%} interval"
    return f"{level:.0%} interval {low:{digits}} to {high:{digits}}"


class Chance(NamedTuple):
    """What runs tell of a chance of failure: its mean and its variance."""

    mean: float
    variance: float


def chance_of_failure(failed: int, runs: int) -> Chance:
    """Compute the posterior of a chance that may be anything beforehand, Beta(1 + f, 1 + r - f).

    When the runs ended may hang on what they showed; the posterior is the same.

    Args:
        failed: runs that failed.
        runs: all runs.
    """
    mean = (failed + 1) / (runs + 2)
    return Chance(mean, mean * (1.0 - mean) / (runs + 3))


@dataclass(frozen=True, slots=True, kw_only=True)
class Probability:
    """A probability of violation with its interval."""

    failures: int
    trials: int
    estimate: float | None  #: None without trials
    low: float
    high: float
    level: float = 0.95
    method: str = "Blaker"
    undecided: int = 0  #: trials that ended in an error: they may have failed, or not
    note: str = ""  #: what else there is to know
