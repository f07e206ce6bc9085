"""What a report says about a campaign as a whole: facts, notes, warnings, errors."""

from __future__ import annotations

from collections.abc import Sequence

from mrta_falsify.campaigns.stats import OTHER, CampaignStats
from mrta_falsify.campaigns.store import Campaign, owner_of
from mrta_falsify.core.claims import KIND_TEXT
from mrta_falsify.core.probability import interval_text
from mrta_falsify.core.record import TrialRecord
from mrta_falsify.verbs.campaign_summary import (
    NoProbability,
    probability_of,
    shut_sentence,
    unseen_sentence,
)
from reports.contents import ErrorKind
from reports.sentences import beside_sentences

SECONDS_PER_HOUR = 3600.0
MAX_BESIDE = 10  # notes of trials


def facts_of(stats: CampaignStats) -> tuple[tuple[str, str], ...]:
    """List the facts of a campaign, each with its label."""
    settings = stats.settings
    first, counts = stats.first_primary, stats.kinds
    last, shut = stats.afterthoughts, stats.shut
    facts = [
        ("scenario", settings.trials.scenario),
        ("trials", str(stats.judged)),
        ("deadlocks", str(counts["deadlock"])),
        ("stuck", str(counts["stuck"])),
        ("other failures", str(counts[OTHER])),
        *([(KIND_TEXT["shut"], str(counts["shut"]))] if counts["shut"] else []),
        *([(f"only {' or '.join(settings.trials.then)}", str(last))] if last else []),
        ("first failure", f"trial {first.judged} of {stats.judged}" if first else "none"),
        ("scenes rejected", str(stats.rejected)),
        ("impossible worlds", str(stats.impossible)),
        *([("rooms shut", shut_sentence(shut))] if shut else []),
        ("errors of the toolkit", str(stats.errors)),
        ("sampler", settings.sampler.name),
        ("search dimensions", str(settings.cube.dimensions)),
        ("simulated", f"{stats.sim_time / SECONDS_PER_HOUR:.2f} h"),
        ("computed", f"{stats.computed_s:.0f} s on one core"),
        ("specifications", ", ".join(settings.trials.specifications)),
    ]
    agreed = stats.screening
    if agreed is not None:
        text = f"{agreed.confirmed} of {agreed.failed_in_screening} kinematic failures"
        facts.append(("confirmed by physics", text))
    for engine in stats.engines:
        text = f"{engine.fails} of {engine.asked} robust failures"
        facts.append((f"fail on {engine.engine}, too", text))
    return tuple(facts)


def notes_of(campaign: Campaign, stats: CampaignStats) -> tuple[str, ...]:
    """Say how likely a violation is, or why that is not known, and how much is still unseen."""
    text = unseen_sentence(stats.unseen) if stats.unseen is not None else ""
    seen = (f"{text}.",) if text else ()
    return _chance_notes(campaign, stats) + seen + _beside_notes(campaign)


def _beside_notes(campaign: Campaign) -> tuple[str, ...]:
    """Tell what verdicts note beside their outcomes, of the first trials that have any."""
    told = [
        f"Trial {record.id}: {text}"
        for record in campaign.records
        for text in beside_sentences(record.verdicts)
    ]
    if len(told) > MAX_BESIDE:
        told[MAX_BESIDE:] = [f"{len(told) - MAX_BESIDE} further notes of this kind."]
    return tuple(told)


def _chance_notes(campaign: Campaign, stats: CampaignStats) -> tuple[str, ...]:
    chance = probability_of(campaign, stats)
    if isinstance(chance, NoProbability):
        return (f"No probability of failure is given: {chance.why_not}.",)
    estimate = "unknown" if chance.estimate is None else f"{chance.estimate:.3g}"
    text = (
        f"Probability of a violation: {estimate}, "
        f"{interval_text(chance.low, chance.high, chance.level, digits='.3g')} "
        f"({chance.method}, {chance.trials} trials)."
    )
    note = chance.note[:1].upper() + chance.note[1:]
    return (text, f"{note}.") if note else (text,)


def warnings_of(campaign: Campaign, judged: Sequence[TrialRecord]) -> tuple[str, ...]:
    """Say what a reader must know first."""
    warnings = []
    owner = owner_of(campaign.directory)
    if owner:
        warnings.append(
            f"The campaign was still running when this page was written ({owner}); it shows the "
            f"{len(campaign.records)} trials finished by then."
        )
    kinds = {tuple(sorted(record.origin.versions.items())) for record in judged}
    if len(kinds) > 1:
        differing = sorted({name for kind in kinds for name, _ in set(kind) - set(min(kinds))})
        warnings.append(
            f"Trials were run by different versions of {', '.join(differing) or 'the toolkit'}: "
            "their digests need not agree."
        )
    return tuple(warnings)


def error_kinds(campaign: Campaign) -> tuple[ErrorKind, ...]:
    """Group errors of the toolkit by their last line, the most frequent first."""
    groups: dict[str, list[TrialRecord]] = {}
    for record in campaign.records:
        if record.status in ("crashed", "timeout"):
            groups.setdefault(last_line(record), []).append(record)
    found = [
        ErrorKind(reason=reason, ids=tuple(r.id for r in records), text=records[0].error.strip())
        for reason, records in groups.items()
    ]
    return tuple(sorted(found, key=lambda kind: (-len(kind.ids), kind.reason)))


def last_line(record: TrialRecord) -> str:
    """Last line of a trial's error."""
    return (record.error.strip().splitlines() or [record.status])[-1]
