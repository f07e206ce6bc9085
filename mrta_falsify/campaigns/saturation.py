"""How much of what can happen has been seen: the chance that another trial shows something new.

The estimate is Good and Turing's (Good, Biometrika 40, 1953) for trials that show several
situations each: the share of trials that show a situation which no other trial shows. Left out one
by one, each trial is a fresh draw after the others, so the estimate has no bias for one trial less.
Only trials that were drawn evenly count: a search looks where it has not been.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass, field

NORMAL_95 = 1.96  # quantile of a two-sided interval of 95 %
ENOUGH_TRIALS = 3  # trials that show a situation; more are as good as three


@dataclass(frozen=True, slots=True, kw_only=True)
class Unseen:
    """The chance that another uniform trial shows a situation that none before has shown."""

    trials: int  #: uniform trials that were simulated
    situations: int  #: different situations in them
    estimate: float | None  #: null without trials
    low: float
    high: float
    level: float = 0.95
    method: str = "Good-Turing"


@dataclass(slots=True)
class Saturation:
    """Counts the situations of uniform trials, one after the other."""

    _shown_by: dict[str, list[int]] = field(default_factory=dict)  #: trials by situation
    _trials: int = 0

    def take(self, situations: Collection[str]) -> None:
        """Take in a uniform trial."""
        for name in set(situations):
            shown_by = self._shown_by.setdefault(name, [])
            if len(shown_by) < ENOUGH_TRIALS:
                shown_by.append(self._trials)
        self._trials += 1

    def unseen(self) -> Unseen:
        """Estimate what is left to be seen, with an interval.

        The interval is Wilson's for a number of trials that has the variance of the estimate, to
        which situations shown twice add (Esty, Annals of Statistics 11, 1983).
        ``experiments.campaign.unseen`` measures how often it covers.
        """
        shown_by = self._shown_by.values()
        alone = len({trials[0] for trials in shown_by if len(trials) == 1})
        pairs = len({tuple(trials) for trials in shown_by if len(trials) == 2})
        low, high = _interval(alone, pairs, self._trials) if self._trials else (0.0, 1.0)
        return Unseen(
            trials=self._trials,
            situations=len(self._shown_by),
            estimate=alone / self._trials if self._trials else None,
            low=low,
            high=high,
        )


def _interval(alone: int, pairs: int, trials: int) -> tuple[float, float]:
    """Compute the interval of the chance of something new.

    Args:
        alone: trials that show what no other does.
        pairs: pairs of trials that show what no third does.
        trials: >= 1.
    """
    smoothed = alone + 0.5
    own = smoothed * (1.0 - smoothed / (trials + 1))
    effective = trials * own / (own + 2.0 * min(pairs, trials - alone))
    share, z2 = alone / trials, NORMAL_95**2
    middle = share + z2 / (2.0 * effective)
    half = NORMAL_95 * math.sqrt(share * (1.0 - share) / effective + z2 / (4.0 * effective**2))
    scale = 1.0 + z2 / effective
    return max((middle - half) / scale, 0.0), min((middle + half) / scale, 1.0)
