"""Two campaigns side by side, as with two stacks on the same scenario."""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Sequence

from mrta_falsify.campaigns.rules import signed
from mrta_falsify.campaigns.store import Campaign
from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.core.record import TrialRecord
from reports.contents import Table

MAX_ROWS = 100
DIGEST_LENGTH = 12  # hex digits of a world's digest that are shown


def comparison_tables(campaign: Campaign, against: Campaign) -> tuple[Table, ...]:
    """Tabulate what differs: failures by mode, and the worlds that both have run.

    Args:
        campaign: that is reported.
        against: the other one.
    """
    tables = (_by_mode(campaign, against), _by_world(campaign, against))
    return tuple(table for table in tables if table is not None)


def _by_mode(campaign: Campaign, against: Campaign) -> Table:
    rules = _common_rules(campaign, against)
    one, other = (_modes_by(c, rules) for c in (campaign, against))
    counts = [c.stats().judged for c in (campaign, against)]
    names = sorted(one.keys() | other, key=lambda n: (-one.get(n, 0) - other.get(n, 0), n))
    rows = [(name, f"{one.get(name, 0)}", f"{other.get(name, 0)}") for name in names]
    total = (f"{sum(one.values())} of {counts[0]}", f"{sum(other.values())} of {counts[1]}")
    return Table(
        title="Against another stack",
        columns=("mode", str(campaign.directory), str(against.directory)),
        rows=(*_shortened(rows, "modes"), ("all failures", *total)),
        notes=(
            *_other_conditions(campaign, against),
            stack_difference(campaign.settings.trials.stack, against.settings.trials.stack),
        ),
    )


def _common_rules(campaign: Campaign, against: Campaign) -> int:
    """Give the rules in whose form both can be compared."""
    return min(campaign.settings.rules, against.settings.rules)


def _modes_by(campaign: Campaign, rules: int) -> Counter[str]:
    """Count failures by the signature of their verdicts, whatever version has stored them."""
    return Counter(signed(record.verdicts, rules) for record in campaign.records if record.failed)


def _shortened(rows: Sequence[tuple[str, ...]], what: str) -> tuple[tuple[str, ...], ...]:
    """Keep the first rows of a table, and count the others."""
    if len(rows) <= MAX_ROWS:
        return tuple(rows)
    return (*rows[:MAX_ROWS], (f"{len(rows) - MAX_ROWS} further {what}", "", ""))


def _other_conditions(campaign: Campaign, against: Campaign) -> tuple[str, ...]:
    """Warn if more than the stack differs."""
    one, other = campaign.settings.trials, against.settings.trials
    differing = [
        what
        for what, is_other in (
            ("scenario", one.scenario != other.scenario),
            ("version of the scenario", one.sources_digest != other.sources_digest),
            ("parameters", one.params != other.params),
            ("specifications", set(one.specifications) != set(other.specifications)),
            ("way of accepting scenes", one.mode != other.mode),
        )
        if is_other
    ]
    if "scenario" in differing and "version of the scenario" in differing:
        differing.remove("version of the scenario")
    if not differing:
        return ()
    return (
        f"Not only the stack differs, also: {', '.join(differing)}. The counts cannot be compared.",
    )


def stack_difference(one: StackConfig, other: StackConfig) -> str:
    """Say in which layers two stacks differ."""
    texts = []
    for field in dataclasses.fields(StackConfig):
        here, there = getattr(one, field.name), getattr(other, field.name)
        if here != there:
            texts.append(f"{field.name}: {_short(here)} against {_short(there)}")
    if not texts:
        return "The stacks are the same."
    return f"The stacks differ in {'; '.join(texts)}."


def _short(value: Choice | tuple[str, ...] | int) -> str:
    """Write a layer's choice, the defects or the control rate in a few words."""
    if isinstance(value, Choice):
        options = ", ".join(f"{name}={option}" for name, option in value.options.items())
        return f"{value.name} ({options})" if options else value.name
    if isinstance(value, tuple):
        return ", ".join(value) or "none"
    return str(value)


def _by_world(campaign: Campaign, against: Campaign) -> Table | None:
    """Tabulate the worlds run under both stacks on which only one of the two fails."""
    one, other = _by_digest(campaign), _by_digest(against)
    if not one or not other:
        return None
    title = "The same worlds under both stacks"
    pairs = [(record, other[digest]) for digest, record in one.items() if digest in other]
    if not pairs:
        note = "No world was run under both: the seeds or the samplers' ways differ."
        return Table(title=title, columns=(), notes=(note,))
    both = sum(a.failed and b.failed for a, b in pairs)
    here = sum(a.failed and not b.failed for a, b in pairs)
    there = sum(b.failed and not a.failed for a, b in pairs)
    neither = len(pairs) - both - here - there
    names = (str(campaign.directory), str(against.directory))
    text = (
        f"Of {len(pairs)} worlds that both have run, {both} fail in both, {here} only in "
        f"{names[0]}, {there} only in {names[1]}, {neither} in neither."
    )
    rules = _common_rules(campaign, against)
    rows = [
        (a.world_digest[:DIGEST_LENGTH], _outcome(a, rules), _outcome(b, rules))
        for a, b in pairs
        if a.failed != b.failed
    ]
    return Table(
        title=title, columns=("world", *names), rows=_shortened(rows, "worlds"), notes=(text,)
    )


def _by_digest(campaign: Campaign) -> dict[str, TrialRecord]:
    found: dict[str, TrialRecord] = {}
    for record in campaign.records:
        if record.status == "ok" and record.world_digest:
            found.setdefault(record.world_digest, record)
    return found


def _outcome(record: TrialRecord, rules: int) -> str:
    return f"{record.id}: {signed(record.verdicts, rules) or 'passes'}"
