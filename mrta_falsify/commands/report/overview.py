"""What a report says of a campaign as a whole: headline, summary, facts, notes, modes, errors."""

from __future__ import annotations

import shlex
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import yaml

from mrta_falsify.campaigns.settings import TrialSettings
from mrta_falsify.campaigns.stats import OTHER, CampaignStats
from mrta_falsify.campaigns.trial_index import layer_sentences
from mrta_falsify.commands.campaign_summary import (
    NoProbability,
    comparison_sentence,
    kinds_text,
    shut_sentence,
    unjudged_sentences,
    unseen_sentence,
)
from mrta_falsify.commands.report.against import stack_difference
from mrta_falsify.commands.report.parameters import names_of, parameter_importances, trial_table
from mrta_falsify.commands.report.reading import CampaignView
from mrta_falsify.core import codec
from mrta_falsify.core.claims import KIND_TEXT
from mrta_falsify.core.config import STACK_LAYERS, StackConfig
from mrta_falsify.core.defects import defect
from mrta_falsify.core.probability import WIDEST, Probability, interval_text
from mrta_falsify.core.record import TrialRecord
from mrta_falsify.core.words import listed
from mrta_falsify.core.world import World
from mrta_falsify.specs.causes import kind_of, leading
from reports.contents import CaseContents, ErrorKind, Mode, ReportContents, Table, TrialScores
from reports.sentences import beside_sentences, violation_sentence

SECONDS_PER_HOUR = 3600.0
MAX_BESIDE = 10  # notes of trials
MAX_NAMED = 3  # parameters


def tell_campaign(
    view: CampaignView,
    shown: Sequence[CaseContents],
    lost: Sequence[str],
    floor: World | None,
    tables: tuple[Table, ...],
) -> ReportContents:
    """Tell a campaign as its report shows it.

    Args:
        view: of the campaign.
        shown: failures that are shown in full.
        lost: sentences on those that cannot be.
        floor: of one of its worlds.
        tables: that compare it with another campaign.
    """
    settings, stats, ranking = view.settings, view.stats, view.ranking
    trials = settings.trials
    versions = next((record.origin.versions for record in view.judged), {})
    ranked = [one.dimension for one in ranking.found]
    return ReportContents(
        title=f"{Path(trials.scenario).stem}, seed {trials.seed}",
        headline=headline_of(stats),
        summary=summary_sentences(view),
        counted_by=shlex.join(["mrta-falsify", "list", str(view.directory)]),
        facts=facts_of(stats),
        modes=modes_of(view, shown),
        trials=scores_of(view.judged, floor),
        importances=parameter_importances(settings, view.judged, ranking),
        even=ranking.is_even,
        table=trial_table(settings, view.records, stats.modes, ranked),
        errors=error_kinds(view.records),
        floor=floor,
        stack=_yaml_of(trials.stack),
        other_stack=_yaml_of(trials.against),
        versions=tuple(sorted(versions.items())),
        notes=(
            *comparison_notes(trials),
            *notes_of(view),
            *(f"{s}." for s in unjudged_sentences(stats)),
            *lost,
        ),
        warnings=warnings_of(view),
        tables=tables,
    )


def _yaml_of(stack: StackConfig | None) -> str:
    return yaml.safe_dump(codec.encode(stack), sort_keys=False) if stack is not None else ""


def headline_of(stats: CampaignStats) -> str:
    """Give the result of a campaign in one line; failures of secondary specifications apart."""
    judged = stats.judged
    if not judged:
        return "No trial has been judged" if stats.records else "No trial has been run yet"
    if stats.comparison is not None:
        return f"{judged} trials: {comparison_sentence(stats.comparison)}"
    last, shut, sought = stats.afterthoughts, stats.kinds["shut"], stats.sought
    count = stats.primary_modes
    kinds = "one mode" if count == 1 else f"{count} modes"
    verb = "violates" if sought == 1 else "violate"
    which = "primary " if last else ""
    first = f"{sought} of {judged} trials {verb} a {which}specification, in {kinds}"
    first += f": {kinds_text({**stats.kinds, 'shut': 0})}"
    if not sought:
        which = "primary " if last or shut else ""
        first = f"None of {judged} trials violates a {which}specification"
    first += f"; {shut} {KIND_TEXT['shut']}" if shut else ""
    names = " or ".join(stats.settings.trials.then)
    return f"{first}; {last} only {names}" if last else first


# --- the summary, for someone who knows nothing of the campaign -----------------------------


def summary_sentences(view: CampaignView) -> tuple[str, ...]:
    """Sum a campaign up in a few sentences, deadlocks before all else; none if nothing was judged.

    The suspected layers are by re-runs where there are any.
    """
    before, after = summary_parts(view)
    if not view.stats.judged:
        return ()
    failed = (record for record in view.records if record.rank != "none")
    suspected = (view.layers.get(record.id, "") for record in failed)
    return (*before, *layer_sentences(suspected), *after)


def summary_parts(view: CampaignView) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Give the sentences before and after those on layers; see :func:`summary_sentences`."""
    stats = view.stats
    if not stats.judged:
        return (), ()
    before = (
        *_stack_sentences(view.settings.trials.stack),
        *_failure_sentences(stats),
        *_mode_sentences(stats),
    )
    return before, (*_parameter_sentences(view), *_unseen_sentences(stats))


def _stack_sentences(stack: StackConfig) -> list[str]:
    """Say which faults are planted in the stack under test, and what else is not as shipped."""
    if stack.stack is not None:
        return []
    parts = [
        f"A fault is planted in the stack under test: {planted.what} ({name}, "
        f"{planted.layer.replace('_', ' ')})."
        for name, planted in ((name, defect(name)) for name in stack.defects)
    ]
    shipped = StackConfig()
    other = [
        f"{layer.replace('_', ' ')} {getattr(stack, layer).name}{_options_text(stack, layer)}"
        for layer in STACK_LAYERS
        if getattr(stack, layer) != getattr(shipped, layer)
    ]
    return parts + ([f"The stack under test is not as shipped: {listed(other)}."] if other else [])


def _options_text(stack: StackConfig, layer: str) -> str:
    options = getattr(stack, layer).options
    parts = ", ".join(
        f"{name} {str(value).lower() if isinstance(value, bool) else value}"
        for name, value in options.items()
    )
    return f" with {parts}" if parts else ""


def _failure_sentences(stats: CampaignStats) -> list[str]:
    trials, judged, last = stats.settings.trials, stats.judged, stats.afterthoughts
    name = Path(trials.scenario).stem
    hours = stats.sim_time / SECONDS_PER_HOUR
    counts = stats.reported_kinds
    parts = [_share("ended in a deadlock", counts["deadlock"], judged)]
    parts += [
        _share(what, counts[kind], judged)
        for kind, what in (
            ("stuck", "ended with robots stuck"),
            (OTHER, "failed otherwise"),
            ("shut", "had a place shut by the world"),
        )
        if counts[kind]
    ]
    if last:
        missed = " or ".join(name.replace("_", " ") for name in trials.then)
        parts.append(_share(f"failed only in {missed}", last, judged))
    count = "One trial" if judged == 1 else f"{judged} trials"
    return [f"{count} of {name} ({hours:.2f} h simulated): {'; '.join(parts)}."]


def _share(what: str, count: int, total: int) -> str:
    return f"{count} of {total} {what} ({count / total:.0%})" if count else f"none {what}"


def _mode_sentences(stats: CampaignStats) -> list[str]:
    first = stats.first_primary
    if first is None:
        return []
    count = stats.primary_modes
    kinds = "one way" if count == 1 else f"{count} different ways"
    return [
        f"They fail in {kinds}; the first of these came in trial {first.judged} of {stats.judged}."
    ]


def _parameter_sentences(view: CampaignView) -> list[str]:
    names = names_of(view.settings)
    named = [names[i] for i in view.ranking.mattering[:MAX_NAMED]]
    return [f"Failing goes with {listed(named)}."] if named else []


def _unseen_sentences(stats: CampaignStats) -> list[str]:
    unseen = stats.unseen
    if unseen is None or unseen.estimate is None or unseen.high - unseen.low > WIDEST:
        return []
    return [
        f"Another random trial would show something new with a chance of {unseen.estimate:.0%} "
        f"({unseen.low:.0%} to {unseen.high:.0%})."
    ]


# --- facts, notes and warnings -------------------------------------------------------------


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


def comparison_notes(settings: TrialSettings) -> tuple[str, ...]:
    """Say what a campaign compares, and when a failure counts; nothing if it compares nothing."""
    if settings.against is None:
        return ()
    return (
        "A failure counts if this stack fails in most copies of its world with small differences, "
        "and the other one passes in the world and in most of the same copies.",
        stack_difference(settings.stack, settings.against),
    )


def notes_of(view: CampaignView) -> tuple[str, ...]:
    """Say how likely a violation is, or why that is not known, and how much is still unseen."""
    unseen = view.stats.unseen
    text = unseen_sentence(unseen) if unseen is not None else ""
    seen = (f"{text}.",) if text else ()
    return _chance_notes(view.chance) + seen + _beside_notes(view.records)


def _beside_notes(records: Sequence[TrialRecord]) -> tuple[str, ...]:
    """Tell what verdicts note beside their outcomes, of the first trials that have any."""
    told = [
        f"Trial {record.id}: {text}"
        for record in records
        for text in beside_sentences(record.verdicts)
    ]
    if len(told) > MAX_BESIDE:
        told[MAX_BESIDE:] = [f"{len(told) - MAX_BESIDE} further notes of this kind."]
    return tuple(told)


def _chance_notes(chance: Probability | NoProbability) -> tuple[str, ...]:
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


def warnings_of(view: CampaignView) -> tuple[str, ...]:
    """Say what a reader must know first."""
    warnings = []
    if view.owner:
        warnings.append(
            f"The campaign was still running when this page was written ({view.owner}); it shows "
            f"the {len(view.records)} trials finished by then."
        )
    kinds = {tuple(sorted(record.origin.versions.items())) for record in view.judged}
    if len(kinds) > 1:
        differing = sorted({name for kind in kinds for name, _ in set(kind) - set(min(kinds))})
        warnings.append(
            f"Trials were run by different versions of {', '.join(differing) or 'the toolkit'}: "
            "their digests need not agree."
        )
    return tuple(warnings)


# --- modes, errors and the course of the search --------------------------------------------


def modes_of(view: CampaignView, shown: Sequence[CaseContents]) -> tuple[Mode, ...]:
    """List the failure modes, each with those of its cases that are shown."""
    by_id = {record.id: record for record in view.judged}
    cases: dict[str, list[CaseContents]] = {}
    for case in shown:
        cases.setdefault(case.signature, []).append(case)
    found = []
    for mode in view.stats.modes:
        layers = Counter(view.layers[i] for i in mode.ids)
        layers.pop("", None)
        found.append(
            Mode(
                signature=mode.signature,
                ids=tuple(mode.ids),
                cases=tuple(cases.get(mode.signature, ())),
                happened=what_happened(by_id[mode.ids[0]]),
                layers=tuple(sorted(layers, key=lambda name: (-layers[name], name))),
            )
        )
    return tuple(found)


def what_happened(record: TrialRecord) -> str:
    """Tell in one sentence what a trial violates first; empty if it violates nothing."""
    verdict = leading(record.verdicts)
    return violation_sentence(verdict) if verdict is not None else ""


def error_kinds(records: Sequence[TrialRecord]) -> tuple[ErrorKind, ...]:
    """Group errors of the toolkit by their last line, the most frequent first."""
    groups: dict[str, list[TrialRecord]] = {}
    for record in records:
        if record.status in ("crashed", "timeout"):
            groups.setdefault(last_line(record), []).append(record)
    found = [
        ErrorKind(reason=reason, ids=tuple(r.id for r in group), text=group[0].error.strip())
        for reason, group in groups.items()
    ]
    return tuple(sorted(found, key=lambda kind: (-len(kind.ids), kind.reason)))


def last_line(record: TrialRecord) -> str:
    """Last line of a trial's error."""
    return (record.error.strip().splitlines() or [record.status])[-1]


def scores_of(judged: Sequence[TrialRecord], floor: World | None) -> TrialScores:
    """Collect how the judged trials went, in order, and where on a floor."""
    places = np.array(
        [[r.search.descriptors.get("x", 0.5), r.search.descriptors.get("y", 0.5)] for r in judged]
    ).reshape(-1, 2)
    if floor is not None:
        places = floor.bounds[:2] + places * (floor.bounds[2:] - floor.bounds[:2])
    return TrialScores(
        numbers=tuple(record.number for record in judged),
        scores=tuple(record.score for record in judged),
        failed=tuple(record.rank != "none" for record in judged),
        deadlocked=tuple(r.rank != "none" and kind_of(r.verdicts) == "deadlock" for r in judged),
        situations=_situations_so_far(judged),
        places=places,
    )


def _situations_so_far(judged: Sequence[TrialRecord]) -> tuple[int, ...]:
    """Count the different situations that trials have shown, after each; empty: none are stored."""
    seen: set[str] = set()
    counts = []
    for record in judged:
        seen.update(record.search.situations)
        counts.append(len(seen))
    return tuple(counts) if seen else ()
