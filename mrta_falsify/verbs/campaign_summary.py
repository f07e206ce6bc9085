"""What a campaign has found: failure modes, probability, agreement of engines, in figures."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from mrta_falsify.campaigns.rare_events import estimated_probability, is_estimating
from mrta_falsify.campaigns.statistics import (
    failure_probability,
    why_no_probability,
)
from mrta_falsify.campaigns.store import Campaign
from mrta_falsify.core.codec import later
from mrta_falsify.core.probability import Probability
from mrta_falsify.core.record import TrialRecord

if TYPE_CHECKING:
    from mrta_falsify.verbs.campaign import CampaignResult

INTERRUPTED = "the campaign was interrupted; its budget is not run out"


@dataclass(frozen=True, slots=True, kw_only=True)
class FailureMode:
    """Failures with one signature."""

    signature: str
    count: int
    ids: tuple[str, ...]  #: of the trials; knife edges last, so that the first is worth a look


@dataclass(frozen=True, slots=True, kw_only=True)
class ScreeningAgreement:
    """How many failures of the quick engine physics confirmed."""

    failed_in_screening: int
    confirmed: int


@dataclass(frozen=True, slots=True, kw_only=True)
class RepeatCounts:
    """Failures that were run again, nothing changed, by how often they came again."""

    always: int
    sometimes: int
    never: int


@dataclass(frozen=True, slots=True, kw_only=True)
class NoProbability:
    """The reason why a campaign's trials allow no probability."""

    why_not: str


@dataclass(frozen=True, slots=True, kw_only=True)
class CampaignSummary:
    """What ``campaign --format json`` prints."""

    budget: int
    ran: int
    failed: int
    robust: int | None  #: failures that most copies share; None where no copies were run
    rejected: int
    impossible: int  #: worlds that no stack can do
    errors: int
    first_failure_at: int | None
    modes: tuple[FailureMode, ...]
    by_specification: dict[str, int]
    not_judged: dict[str, int]  #: trials in which a specification could not be judged
    best_score: float | None
    screening: ScreeningAgreement | None
    probability: Probability | NoProbability
    sim_hours: float
    wall_s: float
    ended: str
    directory: str
    repeated: RepeatCounts | None = later(None)  #: of a stack in a process of its own


def summarise_campaign(result: CampaignResult) -> CampaignSummary:
    """Sum a campaign up."""
    campaign, progress = result.campaign, result.progress
    if result.ended == "interrupted":
        probability: Probability | NoProbability = NoProbability(why_not=INTERRUPTED)
    else:
        stopped_early = bool(progress.limits.stop_after)
        probability = probability_of(campaign, stopped_early=stopped_early)
    return CampaignSummary(
        budget=progress.limits.budget,
        ran=progress.ran,
        failed=progress.failed,
        robust=progress.wanted if campaign.settings.trials.jittered else None,
        rejected=progress.rejected,
        impossible=progress.impossible,
        errors=progress.errors,
        first_failure_at=progress.first_failure,
        modes=modes(campaign),
        by_specification=progress.by_specification,
        not_judged=unjudged_counts(campaign),
        best_score=progress.best if progress.ran > progress.errors else None,
        screening=screening_agreement(campaign),
        probability=probability,
        sim_hours=round(progress.sim_time / 3600.0, 4),
        wall_s=round(result.wall_s, 3),
        ended=result.ended,
        directory=str(campaign.directory),
        repeated=repeat_counts(campaign),
    )


def repeat_counts(campaign: Campaign) -> RepeatCounts | None:
    """Count failures by how often they came again; None if none was run again."""
    found = [record.repeated for record in campaign.records if record.repeated is not None]
    if not found:
        return None
    always = sum(one.same.failures == one.runs for one in found)
    never = sum(one.same.failures == 0 for one in found)
    return RepeatCounts(always=always, sometimes=len(found) - always - never, never=never)


def repeat_sentence(counts: RepeatCounts) -> str:
    """Say how many failures came again when nothing was changed."""
    total = counts.always + counts.sometimes + counts.never
    return (
        f"run again, nothing changed: of {total} failures {counts.always} came again every time, "
        f"{counts.sometimes} now and then, {counts.never} never"
    )


def probability_of(
    campaign: Campaign, *, stopped_early: bool = False
) -> Probability | NoProbability:
    """Estimate the probability of a violation with its interval, or say why not.

    Args:
        campaign: its trials.
        stopped_early: whether what was found decided how many trials there are.
    """
    estimating = is_estimating(campaign.settings)
    reason = why_no_probability(
        campaign.settings, stopped_early=stopped_early, is_estimating=estimating
    )
    if reason:
        return NoProbability(why_not=reason)
    if estimating:
        return estimated_probability(campaign)
    judged = [record for record in campaign.records if record.status == "ok"]
    undecided = sum(record.status in ("crashed", "timeout") for record in campaign.records)
    undecided += sum(not record.failed and has_unjudged(record) for record in judged)
    judged = [record for record in judged if record.failed or not has_unjudged(record)]
    failed = sum(record.failed for record in judged)
    return failure_probability(failed, len(judged), undecided=undecided)


def has_unjudged(record: TrialRecord) -> bool:
    """Whether one of the specifications could not be judged in a trial."""
    return any(verdict.not_judged for verdict in record.verdicts)


def unjudged_counts(campaign: Campaign) -> dict[str, int]:
    """Count the trials in which each specification could not be judged."""
    counts: dict[str, int] = {}
    for record in campaign.records:
        for verdict in record.verdicts:
            if verdict.not_judged:
                counts[verdict.spec] = counts.get(verdict.spec, 0) + 1
    return counts


def unjudged_sentences(campaign: Campaign) -> tuple[str, ...]:
    """Say which specifications could not be judged, in how many trials, and why."""
    reasons = {
        verdict.spec: verdict.not_judged
        for record in campaign.records
        for verdict in record.verdicts
        if verdict.not_judged
    }
    return tuple(
        f"{spec} was not judged in {count} trials: {reasons[spec]}"
        for spec, count in unjudged_counts(campaign).items()
    )


def modes(campaign: Campaign) -> tuple[FailureMode, ...]:
    """Group failures by signature, most frequent first."""
    groups: dict[str, list[str]] = {}
    for record in sorted(campaign.records, key=lambda record: not record.wanted):
        if record.failed:
            groups.setdefault(record.signature, []).append(record.id)
    ordered = sorted(groups.items(), key=lambda item: (-len(item[1]), item[0]))
    return tuple(
        FailureMode(signature=name, count=len(ids), ids=tuple(ids)) for name, ids in ordered
    )


def screening_agreement(campaign: Campaign) -> ScreeningAgreement | None:
    """Count failures of the quick engine that physics confirmed; None without screening."""
    if not campaign.settings.trials.screen:
        return None
    screened = [record for record in campaign.records if record.screening is not None]
    return ScreeningAgreement(
        failed_in_screening=len(screened), confirmed=sum(record.failed for record in screened)
    )
