"""How likely is a violation that is too rare for independent trials? Intervals over repeated runs.

A sampler with a method ``estimates`` (see :class:`~mrta_falsify.core.feedback.Estimates`) gives
independent estimates of equal law, each without bias, and a few plain uniform trials beside
them. Their mean is the estimate; how they scatter gives the interval.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Protocol, runtime_checkable

import numpy as np

from mrta_falsify.campaigns.foreign import of_choice
from mrta_falsify.campaigns.runner import build_sampler, feedback_of
from mrta_falsify.campaigns.settings import CampaignSettings
from mrta_falsify.campaigns.stats import CampaignStats
from mrta_falsify.campaigns.store import Campaign
from mrta_falsify.core.arrays import Array
from mrta_falsify.core.errors import HarnessError
from mrta_falsify.core.feedback import Estimates
from mrta_falsify.core.probability import Probability, failure_probability
from mrta_falsify.core.protocols import Sampler

FEWEST = 4  # estimates that an interval can be made of


@runtime_checkable
class EstimatingSampler(Sampler, Protocol):
    """A sampler that estimates the probability of a violation."""

    def estimates(self) -> Estimates:
        """Give what was found so far."""


def estimated_probability(campaign: Campaign) -> Probability:
    """Estimate the probability of a violation from a campaign whose sampler estimates it.

    Args:
        campaign: its trials; the sampler is asked and told again.
    """
    reported = CampaignStats(campaign.settings)
    reported.take_all(campaign.records[: _reported_of(campaign)])
    undecided = reported.errors
    found = rare_probability(estimates_of(campaign))
    errors = f"{undecided} trials ended in an error and count as not drawn" if undecided else ""
    return replace(
        found,
        failures=reported.primary,
        trials=reported.judged,
        undecided=undecided,
        note="; ".join(part for part in (found.note, errors) if part),
    )


def rare_probability(found: Estimates) -> Probability:
    """Combine estimates to the probability of a violation.

    With too few estimates, or too many that are 0, it comes from the plain uniform trials
    alone: valid all the same, but wide; the note says so.
    """
    interval = mean_interval(found.repeats)
    if interval is not None:
        return Probability(
            failures=0,
            trials=0,
            estimate=float(np.mean(found.repeats)),
            low=interval[0],
            high=interval[1],
            method=f"splitting, {len(found.repeats)} independent runs",
        )
    plain = failure_probability(found.uniform_failures, found.uniform_trials)
    stuck = sum(estimate == 0.0 for estimate in found.repeats)
    why = found.waiting_for or (f"{stuck} of {len(found.repeats)} runs did not reach a violation")
    return replace(
        plain, method=f"Blaker, {plain.trials} uniform trials", note=f"no estimate yet: {why}"
    )


def estimates_of(campaign: Campaign) -> Estimates:
    """Replay a campaign to its sampler, and collect the sampler's estimates."""
    settings = campaign.settings
    sampler = build_sampler(settings)
    if not isinstance(sampler, EstimatingSampler):
        raise HarnessError(f"sampler {settings.sampler.name} estimates no probability")
    proposed = 0
    for reported in range(_reported_of(campaign)):
        while proposed < reported + settings.window:
            sampler.ask()
            proposed += 1
        sampler.tell(feedback_of(campaign.records[reported], settings.cube, settings.trials.then))
    return sampler.estimates()


def _reported_of(campaign: Campaign) -> int:
    """Count the records before the first gap: the others were not told to the sampler."""
    numbers = [record.number for record in campaign.records]
    return next((i for i, number in enumerate(numbers) if i != number), len(numbers))


def mean_interval(estimates: Sequence[float], level: float = 0.95) -> tuple[float, float] | None:
    """Estimate the interval of the mean of a skewed, positive distribution.

    Estimates of splitting are products of shares, hence nearly log-normal, and few: Student's
    interval is too low then. This is the smallest interval that holds two others. One is Cox's
    for the mean of a log-normal law (Land 1972; Zhou and Gao 1997, with Student's quantile), the
    other Student's on the logarithm by the delta method. `experiments/campaign/rare.py` measures
    its coverage.

    Estimates that are 0 have no logarithm. Then means of pairs, triples, ... are taken, in groups
    as small as leave no mean that is 0.

    Args:
        estimates: independent, of equal law, each >= 0.
        level: of confidence.

    Returns:
        Low and high end; None if there are not enough estimates, or too many are 0.
    """
    values = _without_zeros(np.asarray(estimates, dtype=np.float64))
    if values is None:
        return None
    from scipy import stats  # noqa: PLC0415 - takes 0.4 s, and commands that estimate nothing wait

    count = len(values)
    quantile = float(stats.t.ppf(0.5 + level / 2.0, count - 1))
    logs = np.log(values)
    variance = float(logs.var(ddof=1))
    middle = float(logs.mean()) + variance / 2.0
    reach = quantile * np.sqrt(variance / count + variance**2 / (2.0 * (count - 1)))
    mean = float(values.mean())
    spread = quantile * float(values.std(ddof=1)) / (mean * np.sqrt(count))
    low = min(np.exp(middle - reach), mean * np.exp(-spread))
    high = max(np.exp(middle + reach), mean * np.exp(spread))
    return float(low), float(min(high, 1.0))


def _without_zeros(estimates: Array) -> Array | None:
    """Average groups of neighbours, the smallest groups of which none is 0."""
    for size in range(1, len(estimates) // FEWEST + 1):
        count = len(estimates) // size
        groups = np.array([part.mean() for part in np.array_split(estimates, count)])
        if (groups > 0.0).all():
            return groups
    return None


def is_estimating(settings: CampaignSettings) -> bool:
    """Whether the sampler of a campaign estimates the probability of a violation.

    Raises:
        InputError: unknown name or option.
    """
    return isinstance(build_sampler(settings), EstimatingSampler)


def is_known_to_estimate(settings: CampaignSettings) -> bool:
    """Whether it does, by its name alone where the sampler is not ours: nothing of it is run."""
    is_foreign = any(of_choice("sampler", settings.sampler))
    return not is_foreign and is_estimating(settings)
