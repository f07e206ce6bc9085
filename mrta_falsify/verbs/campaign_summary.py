"""What a campaign has found: failure modes, probability, agreement of engines, in figures."""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from mrta_falsify.campaigns.rare_events import estimated_probability, is_known_to_estimate
from mrta_falsify.campaigns.saturation import Unseen, unseen_of
from mrta_falsify.campaigns.statistics import why_no_probability
from mrta_falsify.campaigns.store import Campaign
from mrta_falsify.core.claims import KIND_TEXT, KINDS
from mrta_falsify.core.codec import later
from mrta_falsify.core.probability import WIDEST, Probability, failure_probability, interval_text
from mrta_falsify.core.record import TrialRecord
from mrta_falsify.core.tight_ways import TightCount, counted, things_text
from mrta_falsify.specs.causes import DEADLOCK, group_of, kind_of, leading

if TYPE_CHECKING:
    from mrta_falsify.verbs.campaign import CampaignResult

OTHER = "other"  #: kind of the failures that are neither deadlock nor stuck nor shut
INTERRUPTED = "the campaign was interrupted; its budget is not run out"


@dataclass(frozen=True, slots=True, kw_only=True)
class FailureMode:
    """Failures with one signature."""

    signature: str
    count: int
    ids: tuple[str, ...]  #: of the trials; knife edges last, so that the first is worth a look
    is_afterthought: bool = later(False)  #: only in what the campaign looks for last
    kind: str = later("")  #: deadlock, stuck or shut; empty: none of them


@dataclass(frozen=True, slots=True, kw_only=True)
class ScreeningAgreement:
    """How many failures of the quick engine physics confirmed."""

    failed_in_screening: int
    confirmed: int


@dataclass(frozen=True, slots=True, kw_only=True)
class EngineAgreement:
    """How many robust failures are failures on another engine, too."""

    engine: str
    asked: int
    fails: int  #: of them, in most runs of the world and its copies


@dataclass(frozen=True, slots=True, kw_only=True)
class RepeatCounts:
    """Failures that were run again, nothing changed, by how often they came again."""

    always: int
    sometimes: int
    never: int


@dataclass(frozen=True, slots=True, kw_only=True)
class StackComparison:
    """What became of failures on the other stack."""

    found: int  #: it passes them, as most copies on both stacks bear out
    knife_edges: int  #: it passes them, but copies do not bear that out
    on_both: int  #: it fails, too
    not_judged: int  #: it tells too little
    runs: int  #: of the other stack, copies included; no part of the budget
    wall_s: float  #: that these took


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
    #: failures that most copies share; None without copies, and where two stacks are compared
    robust: int | None
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
    deadlocks: int = later(0)  #: of the failures, those of ``no_deadlock``, whatever their kind
    #: failures by kind: deadlock, stuck, shut (by the world), and other; without afterthoughts
    kinds: dict[str, int] = later(dict)
    uncounted: int = later(0)  #: trials that were under way when the search ended; stored, too
    afterthoughts: int = later(0)  #: of the failures, those only in what is looked for last
    then: tuple[str, ...] = later(())  #: what is looked for last
    unseen: Unseen | None = later(None)  #: None without uniform trials
    confirmed: tuple[EngineAgreement, ...] = later(())  #: of robust failures, by engine
    against: StackComparison | None = later(None)  #: None where no other stack is compared
    shut: tuple[TightCount, ...] = later(())  #: worlds in which no robot fits to a room of a task


def summarise_campaign(result: CampaignResult) -> CampaignSummary:
    """Sum a campaign up."""
    campaign, progress = result.campaign, result.progress
    against = stack_comparison(campaign)
    known = campaign.records
    if result.ended != "interrupted":  # what the search knew when it ended, as is all of progress
        known = tuple(r for r in campaign.records if r.candidate.number < progress.told)
    if result.ended == "interrupted":
        probability: Probability | NoProbability = NoProbability(why_not=INTERRUPTED)
    else:
        stopped_early = bool(progress.limits.stop_after) or result.ended == "saturated"
        probability = probability_of(campaign, stopped_early=stopped_early)
    return CampaignSummary(
        budget=progress.limits.budget,
        ran=progress.ran,
        failed=progress.failed,
        robust=progress.robust if campaign.settings.trials.jittered and not against else None,
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
        confirmed=engine_agreement(campaign),
        deadlocks=deadlock_count(known),
        kinds=_by_kind(progress.kinds),
        uncounted=len(campaign.records) - len(known),
        afterthoughts=progress.afterthoughts,
        then=campaign.settings.trials.then,
        unseen=unseen_in(campaign),
        against=against,
        shut=counted(record.origin.shut for record in known),
    )


def shut_sentence(counts: Sequence[TightCount]) -> str:
    """Say in how many worlds no robot fits to which room; empty: in none."""
    return ", ".join(f"{c.room} shut by {things_text(c.by)} ({c.worlds})" for c in counts)


def stack_comparison(campaign: Campaign) -> StackComparison | None:
    """Count what became of failures on the other stack; None if no other one is compared."""
    if campaign.settings.trials.against is None:
        return None
    compared = [(record, record.other) for record in campaign.records if record.other is not None]
    found = sum(record.is_robust for record, _ in compared)
    return StackComparison(
        found=found,
        knife_edges=sum(other.passes for _, other in compared) - found,
        on_both=sum(other.fate == "fails" for _, other in compared),
        not_judged=sum(other.fate == "not judged" for _, other in compared),
        runs=sum(other.runs for _, other in compared),
        wall_s=round(sum(other.wall_s for _, other in compared), 3),
    )


def comparison_sentence(counts: StackComparison) -> str:
    """Say what became of failures on the other stack."""
    worlds = "world" if counts.found == 1 else "worlds"
    unjudged = f", {counts.not_judged} not judged there" if counts.not_judged else ""
    return (
        f"{counts.found} {worlds} on which only this stack fails, as copies on both bear out; "
        f"{counts.knife_edges} on a knife edge, fails on both: {counts.on_both}{unjudged} "
        f"({counts.runs} runs of the other stack, {counts.wall_s:.0f} s)"
    )


def first_failure(judged: Sequence[TrialRecord]) -> int | None:
    """Count the judged trials up to the first failure in what is looked for first; None: none."""
    return next((i for i, record in enumerate(judged, start=1) if record.is_primary), None)


def deadlock_count(records: Sequence[TrialRecord]) -> int:
    """Count the trials that violate ``no_deadlock``, whatever their kind."""
    return sum(
        any(verdict.violated and verdict.spec == DEADLOCK for verdict in record.verdicts)
        for record in records
    )


def failures_by_kind(records: Iterable[TrialRecord]) -> dict[str, int]:
    """Count failures by kind: deadlock, stuck, shut, and other.

    Those only in what is looked for last are not counted: together they are all failures.
    """
    return _by_kind(Counter(group_of(record.result) for record in records))


def _by_kind(counts: Counter[str]) -> dict[str, int]:
    return {**{kind: counts[kind] for kind in KINDS}, OTHER: counts[OTHER]}


def kinds_text(counts: Mapping[str, int]) -> str:
    """Write counts of :func:`failures_by_kind`, as ``2 deadlocks, 1 stuck, 3 failed otherwise``.

    Places that the world shut are counted only if there are any.
    """
    deadlocks = counts["deadlock"]
    sentences = [f"{deadlocks} deadlock" + "s" * (deadlocks != 1), f"{counts['stuck']} stuck"]
    sentences += [f"{counts[OTHER]} failed otherwise"]
    sentences += [f"{counts['shut']} {KIND_TEXT['shut']}"] if counts["shut"] else []
    return ", ".join(sentences)


def unseen_in(campaign: Campaign) -> Unseen | None:
    """Estimate which part of what can happen has not been seen; None without uniform trials."""
    found = unseen_of(campaign.records)
    return found if found.trials else None


def unseen_sentence(found: Unseen) -> str:
    """Say how probably another uniform trial shows a new situation; empty: too few to tell."""
    if found.high - found.low > WIDEST:
        return ""
    return (
        f"{found.situations} situations in {found.trials} uniform trials; chance that another one "
        f"shows a new situation: {found.estimate:.2f}, "
        f"{interval_text(found.low, found.high, found.level)} ({found.method})"
    )


def repeat_counts(campaign: Campaign) -> RepeatCounts | None:
    """Count failures by how often they came again; None if none was run again."""
    found = [record.repeats for record in campaign.records if record.repeats is not None]
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


def _accepted(campaign: Campaign) -> tuple[int, int]:
    """Count the proposals that the scenario took as they were, and all that it took."""
    attempts = [r.origin.attempts for r in campaign.records if r.origin.attempts]
    return attempts.count(1), len(attempts)


def probability_of(
    campaign: Campaign, *, stopped_early: bool = False
) -> Probability | NoProbability:
    """Estimate the probability of a violation with its interval, or say why not.

    Args:
        campaign: its trials.
        stopped_early: whether what was found decided how many trials there are.
    """
    estimating = is_known_to_estimate(campaign.settings)
    uniform = uniform_trials(campaign)
    reason = why_no_probability(
        campaign.settings,
        any_uniform=bool(uniform) or campaign.settings.sampler.name == "random",
        stopped_early=stopped_early,
        is_estimating=estimating,
        accepted=_accepted(campaign),
    )
    if reason:
        return NoProbability(why_not=reason)
    if estimating:
        return estimated_probability(campaign)
    judged = [record for record in uniform if record.status == "ok"]
    undecided = sum(record.status in ("crashed", "timeout") for record in uniform)
    undecided += sum(not record.is_primary and has_unjudged(record) for record in judged)
    judged = [record for record in judged if record.is_primary or not has_unjudged(record)]
    failed = sum(record.is_primary for record in judged)
    found = failure_probability(failed, len(judged), undecided=undecided)
    return dataclasses.replace(found, note=_what_counts(campaign, len(uniform)))


def uniform_trials(campaign: Campaign) -> list[TrialRecord]:
    """List the trials that were drawn evenly; of ``random`` all were, also in older versions."""
    is_random = campaign.settings.sampler.name == "random"
    return [record for record in campaign.records if record.origin.uniform or is_random]


def _what_counts(campaign: Campaign, uniform: int) -> str:
    """Say which trials and violations a probability leaves out; empty if none."""
    parts = []
    if uniform < len(campaign.records):
        parts.append("only trials that were drawn evenly count")
    if campaign.settings.trials.then:
        parts.append(f"violations of {' and '.join(campaign.settings.trials.then)} do not count")
    return "; ".join(parts)


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
    """Group failures by signature: deadlocks, stuck, others, shut, then what is looked for last.

    Each with the most frequent first. Failures that the other stack does not pass, where there is
    one, are only counted (:func:`stack_comparison`).
    """
    groups: dict[str, list[TrialRecord]] = {}
    for record in sorted(campaign.records, key=lambda record: not record.is_robust):
        if record.rank != "none":
            groups.setdefault(record.signature, []).append(record)
    found = [
        FailureMode(
            signature=name,
            count=len(records),
            ids=tuple(record.id for record in records),
            is_afterthought=group_of(records[0].result) == "secondary",
            kind=_kind_of_mode(records[0]),
        )
        for name, records in groups.items()
    ]
    return tuple(sorted(found, key=_rank))


def _kind_of_mode(record: TrialRecord) -> str:
    first = leading(record.verdicts)
    return kind_of(record.verdicts) if first is not None and first.spec == DEADLOCK else ""


def primary_modes(found: Sequence[FailureMode]) -> int:
    """Count the modes of what is looked for first; a place that the world shut is none."""
    return sum(not mode.is_afterthought and mode.kind != "shut" for mode in found)


def _rank(mode: FailureMode) -> tuple[bool, int, int, str]:
    place = ("deadlock", "stuck", "", "shut").index(mode.kind)
    return mode.is_afterthought, place, -mode.count, mode.signature


def screening_agreement(campaign: Campaign) -> ScreeningAgreement | None:
    """Count failures of the quick engine that physics confirmed; None without screening."""
    if not campaign.settings.trials.screen:
        return None
    screened = [record for record in campaign.records if record.origin.screening is not None]
    return ScreeningAgreement(
        failed_in_screening=len(screened), confirmed=sum(record.failed for record in screened)
    )


def engine_agreement(campaign: Campaign) -> tuple[EngineAgreement, ...]:
    """Count the robust failures that other engines share, in the order they were asked for."""
    counts: dict[str, list[bool]] = {}
    for record in campaign.records:
        for name, run in record.engines.items():
            counts.setdefault(name, []).append(run.total.robust)
    return tuple(
        EngineAgreement(engine=name, asked=len(fails), fails=sum(fails))
        for name, fails in counts.items()
    )
