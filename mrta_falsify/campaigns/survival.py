"""How long searches take to their first failure, with the searches that found none counted.

A search that ran its budget out without a failure is a right-censored observation; leaving it
out would flatter a sampler that rarely finds one. Hence the restricted mean (area under the
Kaplan-Meier curve up to the budget) and the log-rank test, both on scipy.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.seeding import stream

RESAMPLES = 2000  # bootstrap resamples: enough for the 2.5 % ends


@dataclass(frozen=True, slots=True, kw_only=True)
class SearchCost:
    """One search: what it spent, and whether it ended with a failure."""

    spent: float  #: simulations, or seconds of computing
    found: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class IntervalEstimate:
    """A number with its 95 % interval."""

    value: float
    low: float
    high: float


def survival_curve(searches: Sequence[SearchCost]) -> tuple[Array, Array]:
    """Estimate the share of searches without a failure (Kaplan and Meier).

    Args:
        searches: at least one.

    Returns:
        Times ``(n,)``, increasing, from 0 on, and the share ``(n,)`` from each time on.
    """
    curve = stats.ecdf(_censored(searches)).sf
    times = np.concatenate([[0.0], curve.quantiles])
    return times, np.concatenate([[1.0], curve.probabilities])


def restricted_mean(searches: Sequence[SearchCost], limit: float) -> float:
    """Average what is spent until the first failure, each search cut at ``limit``."""
    times, share = survival_curve(searches)
    inside = times < limit
    edges = np.concatenate([times[inside], [limit]])
    return float((np.diff(edges) * share[inside]).sum())


def restricted_mean_interval(
    searches: Sequence[SearchCost], limit: float, *, seed: int = 0
) -> IntervalEstimate:
    """Compute the restricted mean with a percentile bootstrap interval over searches."""
    return _bootstrapped(lambda some: restricted_mean(some, limit), searches, seed)


def spent_per_failure(searches: Sequence[SearchCost]) -> float:
    """Divide all that was spent, also by searches that found nothing, by the failures found.

    The maximum-likelihood mean if a failure is equally likely at any time. Unlike the restricted
    mean it is not bounded by the budget, so it is of use where most searches find nothing.
    """
    found = sum(search.found for search in searches)
    return sum(search.spent for search in searches) / found if found else float("inf")


def spent_per_failure_interval(
    searches: Sequence[SearchCost], *, seed: int = 0
) -> IntervalEstimate:
    """Compute :func:`spent_per_failure` with a percentile bootstrap interval over searches."""
    return _bootstrapped(spent_per_failure, searches, seed)


def _bootstrapped(
    statistic: Callable[[Sequence[SearchCost]], float], searches: Sequence[SearchCost], seed: int
) -> IntervalEstimate:
    random = stream(seed, "bootstrap")
    picks = random.integers(len(searches), size=(RESAMPLES, len(searches)))
    values = np.sort([statistic([searches[i] for i in row]) for row in picks])
    low, high = values[round(0.025 * RESAMPLES)], values[round(0.975 * RESAMPLES) - 1]
    return IntervalEstimate(value=statistic(searches), low=float(low), high=float(high))


def median(searches: Sequence[SearchCost]) -> float:
    """Find what is spent until half of the searches have found a failure; inf if fewer do."""
    times, share = survival_curve(searches)
    reached = np.flatnonzero(share <= 0.5)
    return float(times[reached[0]]) if len(reached) else float("inf")


def found_share(searches: Sequence[SearchCost]) -> IntervalEstimate:
    """Estimate the falsification rate: share of searches that found a failure, Clopper-Pearson."""
    count = sum(search.found for search in searches)
    interval = stats.binomtest(count, len(searches)).proportion_ci(method="exact")
    return IntervalEstimate(
        value=count / len(searches), low=float(interval.low), high=float(interval.high)
    )


def log_rank(one: Sequence[SearchCost], other: Sequence[SearchCost]) -> float:
    """Compute the p-value of the log-rank test that both need equally long.

    It is 1 where there is nothing to compare: no failure while both were still searching.
    """
    if not any(search.found for search in (*one, *other)):
        return 1.0
    with np.errstate(invalid="ignore"):
        p = float(stats.logrank(_censored(one), _censored(other)).pvalue)
    return 1.0 if np.isnan(p) else p


def _censored(searches: Sequence[SearchCost]) -> stats.CensoredData:
    found = [search.spent for search in searches if search.found]
    missed = [search.spent for search in searches if not search.found]
    return stats.CensoredData(uncensored=found, right=missed)
