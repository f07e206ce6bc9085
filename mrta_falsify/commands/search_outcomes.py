"""What searches with different samplers came to: how often, how soon, how many kinds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from mrta_falsify.campaigns import survival
from mrta_falsify.campaigns.stats import CampaignStats
from mrta_falsify.campaigns.store import Campaign
from mrta_falsify.campaigns.survival import IntervalEstimate, SearchCost
from mrta_falsify.core.arrays import Array


@dataclass(frozen=True, slots=True, kw_only=True)
class SearchOutcome:
    """What one search came to."""

    simulations: SearchCost
    seconds: SearchCost  #: of computing
    trials: int  #: simulated, those after the first failure included
    modes: tuple[str, ...]  #: signatures of its failures, each once


def search_outcome(campaign: Campaign, *, budget: int, knife_edges: bool = False) -> SearchOutcome:
    """Count what a search came to within a budget.

    Only the trials up to the first failure count for how long it took. Where copies were run, a
    knife edge counts as a failure only with ``knife_edges``.
    """
    stats = CampaignStats(campaign.settings)
    for record in campaign.records:
        stats.take(record)
        if stats.ran >= budget:
            break
    first = stats.first_primary if knife_edges else stats.first_robust
    found = first is not None
    ran, seconds = (first.ran, first.computed_s) if first else (stats.ran, stats.computed_s)
    return SearchOutcome(
        simulations=SearchCost(spent=float(ran), found=found),
        seconds=SearchCost(spent=seconds, found=found),
        trials=stats.ran,
        modes=stats.signatures(knife_edges=knife_edges),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class TimeToFailure:
    """Simulations to the first failure, with the searches that found none counted."""

    restricted_mean: IntervalEstimate
    median: float  #: null if fewer than half of the searches found one


@dataclass(frozen=True, slots=True, kw_only=True)
class SamplerRow:
    """What the searches of one sampler came to."""

    sampler: str
    searches: int  #: number of searches
    falsification_rate: IntervalEstimate  #: share of the searches that find a failure
    simulations_to_failure: TimeToFailure
    simulations_per_failure: IntervalEstimate
    seconds_to_failure: float
    seconds_per_failure: float
    log_rank_p: float  #: p value of the log-rank test against the first sampler
    trials: int  #: simulations of all searches
    modes_per_1000: float  #: failure modes in 1000 trials


def sampler_rows(
    found: Mapping[str, Sequence[SearchOutcome]], budget: int
) -> tuple[SamplerRow, ...]:
    """Sum up each sampler: falsification rate, simulations to first failure, modes.

    Args:
        found: outcomes by sampler; the log-rank p-value compares with the first one.
        budget: simulations per search.
    """
    reference = next(iter(found.values()), [])
    return tuple(_row(name, rows, reference, budget) for name, rows in found.items())


def survival_curves(found: Mapping[str, Sequence[SearchOutcome]]) -> dict[str, tuple[Array, Array]]:
    """Estimate the share of searches without a failure, by sampler (Kaplan-Meier)."""
    return {
        name: survival.survival_curve([row.simulations for row in rows])
        for name, rows in found.items()
    }


def _row(
    name: str, found: Sequence[SearchOutcome], reference: Sequence[SearchOutcome], budget: int
) -> SamplerRow:
    simulations = [row.simulations for row in found]
    seconds = [row.seconds for row in found]
    trials = sum(row.trials for row in found)
    longest = max(row.seconds.spent for row in (*found, *reference))
    return SamplerRow(
        sampler=name,
        searches=len(found),
        falsification_rate=survival.found_share(simulations),
        simulations_to_failure=TimeToFailure(
            restricted_mean=survival.restricted_mean_interval(simulations, budget),
            median=survival.median(simulations),
        ),
        simulations_per_failure=survival.spent_per_failure_interval(simulations),
        seconds_to_failure=survival.restricted_mean(seconds, longest),
        seconds_per_failure=survival.spent_per_failure(seconds),
        log_rank_p=survival.log_rank(simulations, [row.simulations for row in reference]),
        trials=trials,
        modes_per_1000=1000.0 * sum(len(row.modes) for row in found) / max(trials, 1),
    )
