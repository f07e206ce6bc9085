"""What a campaign has found: failure modes, probability, agreement of engines, in figures."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from mrta_falsify.campaigns.rare_events import estimated_probability, is_known_to_estimate
from mrta_falsify.campaigns.saturation import Unseen
from mrta_falsify.campaigns.statistics import why_no_probability
from mrta_falsify.campaigns.stats import (
    OTHER,
    CampaignStats,
    EngineAgreement,
    FailureMode,
    RepeatCounts,
    ScreeningAgreement,
    StackComparison,
    draws_evenly,
)
from mrta_falsify.campaigns.store import Campaign
from mrta_falsify.core.claims import KIND_TEXT
from mrta_falsify.core.codec import later
from mrta_falsify.core.probability import WIDEST, Probability, interval_text
from mrta_falsify.core.tight_ways import TightCount, things_text
from mrta_falsify.specs.causes import DEADLOCK

if TYPE_CHECKING:
    from mrta_falsify.commands.campaign import CampaignResult

INTERRUPTED = "the campaign was interrupted; its budget is not run out"


@dataclass(frozen=True, slots=True, kw_only=True)
class NoProbability:
    """The reason why a campaign's trials allow no probability."""

    why_not: str


@dataclass(frozen=True, slots=True, kw_only=True)
class CampaignSummary:
    """What ``campaign --format json`` prints."""

    budget: int  #: largest number of simulations
    ran: int  #: simulations
    failed: int  #: trials that violate a specification
    #: failures that most perturbed runs share; null without perturbed runs and with ``--against``
    robust: int | None
    rejected: int  #: candidates without a valid scene
    impossible: int  #: worlds that no stack can do
    errors: int  #: trials in which the stack or the toolkit failed
    first_failure_at: int | None  #: simulations until the first failure
    modes: tuple[FailureMode, ...]  #: failures by signature
    by_specification: dict[str, int]  #: failures by specification
    not_judged: dict[str, int]  #: trials in which a specification could not be judged
    best_score: float | None  #: the lowest one found
    screening: ScreeningAgreement | None  #: null unless a quick engine screens
    probability: Probability | NoProbability
    sim_hours: float
    wall_s: float
    ended: str  #: ``budget``, ``clock``, ``stop-after``, ``saturated`` or ``interrupted``
    directory: str
    #: of a foreign stack, when failures were run again
    repeated: RepeatCounts | None = later(None)
    deadlocks: int = later(0)  #: failures that violate ``no_deadlock``, whatever their kind
    #: failures by kind: deadlock, stuck, shut (by the world), other; without afterthoughts
    kinds: dict[str, int] = later(dict)
    uncounted: int = later(0)  #: trials under way when the search ended: stored, and not in ``ran``
    afterthoughts: int = later(0)  #: failures in secondary specifications (``then``) only
    then: tuple[str, ...] = later(())  #: secondary specifications
    unseen: Unseen | None = later(None)  #: null without uniform trials
    #: robust failures on other engines (``--confirm``)
    confirmed: tuple[EngineAgreement, ...] = later(())
    against: StackComparison | None = later(None)  #: null without ``--against``
    #: worlds in which no robot fits to a room that a task needs
    shut: tuple[TightCount, ...] = later(())


def summarise_campaign(result: CampaignResult) -> CampaignSummary:
    """Sum a campaign up: what the search knew when it ended, and what all stored trials show."""
    campaign, known = result.campaign, result.progress
    stored = campaign.stats()
    if result.ended == "interrupted":
        probability: Probability | NoProbability = NoProbability(why_not=INTERRUPTED)
    else:
        stopped_early = bool(known.limits.stop_after) or result.ended == "saturated"
        probability = probability_of(campaign, stored, stopped_early=stopped_early)
    trials = campaign.settings.trials
    return CampaignSummary(
        budget=known.limits.budget,
        ran=known.ran,
        failed=known.failed,
        robust=known.robust if trials.jittered and trials.against is None else None,
        rejected=known.rejected,
        impossible=known.impossible,
        errors=known.errors,
        first_failure_at=known.first_failure,
        modes=stored.modes,
        by_specification=known.by_specification,
        not_judged=stored.not_judged,
        best_score=known.best if known.judged else None,
        screening=stored.screening,
        probability=probability,
        sim_hours=round(known.sim_time / 3600.0, 4),
        wall_s=round(result.wall_s, 3),
        ended=result.ended,
        directory=str(campaign.directory),
        repeated=stored.repeats,
        confirmed=stored.engines,
        deadlocks=known.by_specification.get(DEADLOCK, 0),
        kinds=known.kinds,
        uncounted=stored.records - known.records,
        afterthoughts=known.afterthoughts,
        then=trials.then,
        unseen=stored.unseen,
        against=stored.comparison,
        shut=known.shut,
    )


def shut_sentence(counts: Sequence[TightCount]) -> str:
    """List the rooms that no robot fits to, each with the number of worlds; may be empty."""
    return ", ".join(f"{c.room} shut by {things_text(c.by)} ({c.worlds})" for c in counts)


def comparison_sentence(counts: StackComparison) -> str:
    """Say what became of failures on the other stack."""
    worlds = "world" if counts.found == 1 else "worlds"
    unjudged = f", {counts.not_judged} not judged there" if counts.not_judged else ""
    return (
        f"{counts.found} {worlds} on which only this stack fails, confirmed by perturbed runs on "
        f"both; {counts.knife_edges} on a knife edge, fails on both: {counts.on_both}{unjudged} "
        f"({counts.runs} runs of the other stack, {counts.wall_s:.0f} s)"
    )


def kinds_text(counts: Mapping[str, int]) -> str:
    """Write counts of failures by kind, as ``2 deadlocks, 1 stuck, 3 failed otherwise``.

    Places that the world shut are counted only if there are any.
    """
    deadlocks = counts["deadlock"]
    sentences = [f"{deadlocks} deadlock" + "s" * (deadlocks != 1), f"{counts['stuck']} stuck"]
    sentences += [f"{counts[OTHER]} failed otherwise"]
    sentences += [f"{counts['shut']} {KIND_TEXT['shut']}"] if counts["shut"] else []
    return ", ".join(sentences)


def unseen_sentence(found: Unseen) -> str:
    """Say the chance of a new situation in another uniform trial; empty if it is uncertain."""
    if found.high - found.low > WIDEST:
        return ""
    return (
        f"{found.situations} situations in {found.trials} uniform trials; chance that another one "
        f"shows a new situation: {found.estimate:.2f}, "
        f"{interval_text(found.low, found.high, found.level)} ({found.method})"
    )


def repeat_sentence(counts: RepeatCounts) -> str:
    """Say how many failures came again when nothing was changed."""
    total = counts.always + counts.sometimes + counts.never
    return (
        f"repeated without any change: of {total} failures {counts.always} failed every time, "
        f"{counts.sometimes} sometimes, {counts.never} never"
    )


def probability_of(
    campaign: Campaign, stats: CampaignStats, *, stopped_early: bool = False
) -> Probability | NoProbability:
    """Estimate the probability of a violation with its interval, or say why not.

    Args:
        campaign: its trials.
        stats: their counts.
        stopped_early: whether what was found decided how many trials there are.
    """
    estimating = is_known_to_estimate(campaign.settings)
    reason = why_no_probability(
        campaign.settings,
        any_uniform=stats.uniform.drawn > 0 or draws_evenly(campaign.settings),
        stopped_early=stopped_early,
        is_estimating=estimating,
        accepted=(stats.accepted_at_once, stats.accepted),
    )
    if reason:
        return NoProbability(why_not=reason)
    if estimating:
        return estimated_probability(campaign)
    return dataclasses.replace(stats.uniform.probability(), note=_what_counts(stats))


def _what_counts(stats: CampaignStats) -> str:
    """Say which trials and violations a probability leaves out; empty if none."""
    parts = []
    if stats.uniform.drawn < stats.records:
        parts.append("only trials that were drawn evenly count")
    if then := stats.settings.trials.then:
        parts.append(f"violations of {' and '.join(then)} do not count")
    return "; ".join(parts)


def unjudged_sentences(stats: CampaignStats) -> tuple[str, ...]:
    """Say which specifications could not be judged, in how many trials, and why."""
    return tuple(
        f"{spec} was not judged in {count} trials: {stats.why_not_judged[spec]}"
        for spec, count in stats.not_judged.items()
    )
