"""What a report says first: a campaign in a few sentences, deadlocks before all else."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from mrta_falsify.campaigns.stats import OTHER, CampaignStats
from mrta_falsify.campaigns.store import Campaign
from mrta_falsify.campaigns.trial_index import layer_sentences
from mrta_falsify.core.config import STACK_LAYERS, StackConfig
from mrta_falsify.core.defects import defect
from mrta_falsify.core.probability import WIDEST
from mrta_falsify.core.words import listed
from mrta_falsify.verbs.report.trial_table import dimension_names

SECONDS_PER_HOUR = 3600.0
MAX_NAMED = 3  # parameters


def summary_sentences(
    campaign: Campaign,
    stats: CampaignStats,
    mattering: Sequence[int],
    layers: Mapping[str, str],
) -> tuple[str, ...]:
    """Sum a campaign up for someone who knows nothing of it; empty without judged trials.

    Args:
        campaign: to report.
        stats: its counts.
        mattering: dimensions that failing goes with beyond chance.
        layers: suspected layer by id of a failing trial, by re-runs where there are any.
    """
    before, after = summary_parts(campaign, stats, mattering)
    if not stats.judged:
        return ()
    suspected = (layers.get(record.id, "") for record in campaign.records if record.rank != "none")
    return (*before, *layer_sentences(suspected), *after)


def summary_parts(
    campaign: Campaign, stats: CampaignStats, mattering: Sequence[int]
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Give the sentences before and after those on layers; see :func:`summary_sentences`."""
    if not stats.judged:
        return (), ()
    before = (
        *_stack_sentences(campaign.settings.trials.stack),
        *_failure_sentences(stats),
        *_mode_sentences(stats),
    )
    return before, (*_parameter_sentences(campaign, mattering), *_unseen_sentences(stats))


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


def _parameter_sentences(campaign: Campaign, mattering: Sequence[int]) -> list[str]:
    names = dimension_names(campaign)
    named = [names[i] for i in mattering[:MAX_NAMED]]
    return [f"Failing goes with {listed(named)}."] if named else []


def _unseen_sentences(stats: CampaignStats) -> list[str]:
    unseen = stats.unseen
    if unseen is None or unseen.estimate is None or unseen.high - unseen.low > WIDEST:
        return []
    return [
        f"Another random trial would show something new with a chance of {unseen.estimate:.0%} "
        f"({unseen.low:.0%} to {unseen.high:.0%})."
    ]
