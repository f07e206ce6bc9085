"""Probabilities of a violation, with exact intervals."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mrta_falsify.core.arrays import Array

WIDEST = 0.5  #: an interval that is wider says next to nothing, and is not told
GRID = 1024  # points at which an end of an interval is looked for, per refinement


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
    """A probability of a violation with its interval."""

    failures: int
    trials: int
    estimate: float | None  #: None without trials
    low: float
    high: float
    level: float = 0.95
    method: str = "Blaker"
    undecided: int = 0  #: trials that ended in an error: they may have failed, or not
    note: str = ""  #: what else there is to know


def failure_probability(
    failures: int, trials: int, *, undecided: int = 0, level: float = 0.95
) -> Probability:
    """Estimate the probability of a violation from independent trials, with an exact interval.

    Blaker's interval (Canadian Journal of Statistics 28, 2000): exact, that is covering with
    at least ``level`` for every probability, and never wider than Clopper and Pearson's.
    Trials that ended in an error widen it both ways: the low end counts them as passes, the
    high end as failures.

    Args:
        failures: of ``trials``, both without the undecided ones.
        trials: independent, their number fixed beforehand.
        undecided: trials that ended in an error.
        level: of confidence.
    """
    total = trials + undecided
    if total == 0:
        return Probability(failures=0, trials=0, estimate=None, low=0.0, high=1.0)
    low, _ = blaker_interval(failures, total, level)
    _, high = blaker_interval(failures + undecided, total, level)
    return Probability(
        failures=failures,
        trials=trials,
        estimate=failures / trials if trials else None,
        low=low,
        high=high,
        level=level,
        undecided=undecided,
    )


def one_sided_bounds(
    failures: int, trials: int, *, undecided: int = 0, level: float = 0.9
) -> tuple[float, float]:
    """Compute a lower and an upper bound of the probability of a violation.

    Clopper and Pearson's (Biometrika 26, 1934): each holds with at least ``level``. Undecided
    trials count as passes for the lower bound and as failures for the upper one.

    Args:
        failures: of ``trials``, both without the undecided ones.
        trials: independent, their number fixed beforehand.
        undecided: trials that told nothing.
        level: of confidence, of each bound alone.
    """
    from scipy import stats  # noqa: PLC0415 - takes 0.4 s, and most trials do without

    total, most = trials + undecided, failures + undecided
    low = float(stats.beta.ppf(1.0 - level, failures, total - failures + 1)) if failures else 0.0
    high = float(stats.beta.ppf(level, most + 1, total - most)) if most < total else 1.0
    return low, high


def blaker_interval(successes: int, trials: int, level: float = 0.95) -> tuple[float, float]:
    """Compute Blaker's exact interval of a binomial proportion.

    Args:
        successes: 0 to ``trials``.
        trials: >= 1.
        level: of confidence.
    """
    if not 0 <= successes <= trials or trials < 1:
        raise AssertionError(f"{successes} of {trials}")
    alpha = 1.0 - level
    # Mirror for the upper end, so that both ends are looked for from Clopper and Pearson's inward.
    low = _lower_end(successes, trials, alpha)
    high = 1.0 - _lower_end(trials - successes, trials, alpha)
    return low, high


def _lower_end(successes: int, trials: int, alpha: float) -> float:
    if successes == 0:
        return 0.0
    from scipy import stats  # noqa: PLC0415 - takes 0.4 s, and most trials do without

    left = float(stats.beta.ppf(alpha / 2.0, successes, trials - successes + 1))
    right = successes / trials
    for _ in range(3):  # each refinement narrows the bracket a thousandfold
        grid = np.linspace(left, right, GRID)
        first = int(np.argmax(_acceptability(successes, trials, grid) >= alpha))
        if first == 0:
            return float(grid[0])
        left, right = float(grid[first - 1]), float(grid[first])
    return left


def _acceptability(successes: int, trials: int, p: Array) -> Array:
    """Evaluate Blaker's acceptability function at ``p`` ``(n,)``."""
    from scipy import stats  # noqa: PLC0415 - as above

    upper = stats.binom.sf(successes - 1, trials, p)
    lower = stats.binom.cdf(successes, trials, p)
    # The opposite tail of at most the same probability joins the smaller one.
    from_upper = upper + stats.binom.cdf(stats.binom.ppf(upper, trials, p) - 1, trials, p)
    from_lower = lower + stats.binom.sf(stats.binom.isf(lower, trials, p), trials, p)
    acceptable: Array = np.minimum(np.minimum(from_upper, from_lower), 1.0)
    return acceptable
