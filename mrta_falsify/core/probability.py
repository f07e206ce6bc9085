"""A probability of violation with its interval."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple


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
