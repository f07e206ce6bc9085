"""A probability of violation with its interval."""

from __future__ import annotations

from dataclasses import dataclass


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
