"""How likely is a violation? Intervals that cover as often as they say.

Only draws from the scenario's own distribution say anything about a probability. So scenes must
be accepted as Scenic would (mode ``exact``), and only trials count that were drawn evenly: all of
``random``, one in five of ``auto``. A sampler may also estimate the probability itself
(:mod:`~mrta_falsify.campaigns.rare_events`). A search that looks for failures finds more of them
than there are.
"""

from __future__ import annotations

import numpy as np

from mrta_falsify.campaigns.settings import CampaignSettings
from mrta_falsify.core.arrays import Array
from mrta_falsify.core.probability import Probability
from mrta_falsify.core.record import PerturbedRuns

GRID = 1024  # points at which an end of the interval is looked for, per refinement


def why_no_probability(
    settings: CampaignSettings,
    *,
    any_uniform: bool,
    stopped_early: bool,
    is_estimating: bool = False,
    accepted: tuple[int, int] = (0, 0),
) -> str:
    """Say why the trials of a campaign allow no interval; empty if they do.

    Args:
        settings: of the campaign.
        any_uniform: whether trials are drawn evenly, whatever has been found.
        stopped_early: whether what was found decided how many trials there are.
        is_estimating: whether the sampler estimates the probability itself.
        accepted: proposals that the scenario took as they were, of how many.
    """
    if not any_uniform and not is_estimating:
        return (
            f"sampler {settings.sampler.name} looks for failures; use --sampler random, or auto, "
            "of which one trial in five counts, or splitting if failures are rare"
        )
    if settings.trials.mode != "exact":
        as_they_were, proposals = accepted
        first = "repaired scenes do not have the scenario's distribution"
        if proposals and not as_they_were:
            return (
                f"{first}, and none of {proposals} proposals was accepted as it was, so that "
                "--mode exact would reject most: check names what rejects them"
            )
        return f"{first}; use --mode exact"
    if stopped_early:
        return (
            "the campaign stopped because of what it found; run it without --stop-after and "
            "--until-saturated"
        )
    return ""


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


def chance_in_vote(copies: PerturbedRuns, most: int) -> Probability:
    """Estimate how probably a copy of a world fails, from copies that ended once decided.

    Copies that were not run count both ways, as trials without an answer do. So the interval
    covers although what the first copies did decided how many there are.

    Args:
        copies: that were run.
        most: copies that would have been run.
    """
    return failure_probability(copies.failed, copies.runs, undecided=max(most - copies.runs, 0))


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
