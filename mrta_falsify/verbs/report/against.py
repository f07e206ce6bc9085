"""Two campaigns side by side, as with two stacks on the same scenario."""

from __future__ import annotations

from typing import Any

from mrta_falsify.campaigns.store import Campaign
from mrta_falsify.core import codec
from mrta_falsify.core.record import TrialRecord
from mrta_falsify.verbs.campaign_summary import modes
from reports.contents import Table

MOST_ROWS = 100


def comparison_tables(campaign: Campaign, against: Campaign) -> tuple[Table, ...]:
    """What differs: failures by mode, and the worlds that both have run.

    Args:
        campaign: that is reported.
        against: the other one.
    """
    tables = (_by_mode(campaign, against), _by_world(campaign, against))
    return tuple(table for table in tables if table is not None)


def _by_mode(campaign: Campaign, against: Campaign) -> Table:
    one, other = ({m.signature: m.count for m in modes(c)} for c in (campaign, against))
    counts = [sum(record.status == "ok" for record in c.records) for c in (campaign, against)]
    names = sorted(one.keys() | other, key=lambda n: (-one.get(n, 0) - other.get(n, 0), n))
    rows = [(name, f"{one.get(name, 0)}", f"{other.get(name, 0)}") for name in names[:MOST_ROWS]]
    if len(names) > MOST_ROWS:
        rows.append((f"{len(names) - MOST_ROWS} further modes", "", ""))
    total = (f"{sum(one.values())} of {counts[0]}", f"{sum(other.values())} of {counts[1]}")
    return Table(
        title="Against another stack",
        columns=("mode", str(campaign.directory), str(against.directory)),
        rows=(*rows, ("all failures", *total)),
        notes=(*_other_conditions(campaign, against), _other_stack(campaign, against)),
    )


def _other_conditions(campaign: Campaign, against: Campaign) -> tuple[str, ...]:
    """A warning if more than the stack differs."""
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


def _other_stack(campaign: Campaign, against: Campaign) -> str:
    one, other = (codec.encode(c.settings.trials.stack) for c in (campaign, against))
    differing = [name for name in one if one[name] != other.get(name)]
    if not differing:
        return "The stacks are the same."
    texts = [f"{name}: {_short(one[name])} against {_short(other.get(name))}" for name in differing]
    return f"The stacks differ in {'; '.join(texts)}."


def _short(value: Any) -> str:
    """A layer's choice in a few words."""
    if isinstance(value, dict) and "name" in value:
        options = ", ".join(f"{k}={v}" for k, v in (value.get("options") or {}).items())
        return f"{value['name']} ({options})" if options else str(value["name"])
    if isinstance(value, list):
        return ", ".join(map(str, value)) or "none"
    return str(value)


def _by_world(campaign: Campaign, against: Campaign) -> Table | None:
    """Worlds run under both stacks, and those of them that only one of the two fails on."""
    one, other = _by_digest(campaign), _by_digest(against)
    shared = [digest for digest in one if digest in other]
    if not one or not other:
        return None
    title = "The same worlds under both stacks"
    if not shared:
        return Table(
            title=title,
            columns=(),
            notes=("No world was run under both: the seeds or the samplers' ways differ.",),
        )
    pairs = [(one[digest], other[digest]) for digest in shared]
    both = sum(a.failed and b.failed for a, b in pairs)
    here = sum(a.failed and not b.failed for a, b in pairs)
    there = sum(b.failed and not a.failed for a, b in pairs)
    neither = len(pairs) - both - here - there
    names = (str(campaign.directory), str(against.directory))
    text = (
        f"Of {len(pairs)} worlds that both have run, {both} fail in both, {here} only in "
        f"{names[0]}, {there} only in {names[1]}, {neither} in neither."
    )
    telling = [(a, b) for a, b in pairs if a.failed != b.failed]
    rows = [(a.world_digest[:12], _told(a), _told(b)) for a, b in telling[:MOST_ROWS]]
    if len(telling) > MOST_ROWS:
        rows.append((f"{len(telling) - MOST_ROWS} further worlds", "", ""))
    return Table(title=title, columns=("world", *names), rows=tuple(rows), notes=(text,))


def _by_digest(campaign: Campaign) -> dict[str, TrialRecord]:
    found: dict[str, TrialRecord] = {}
    for record in campaign.records:
        if record.status == "ok" and record.world_digest:
            found.setdefault(record.world_digest, record)
    return found


def _told(record: TrialRecord) -> str:
    return f"{record.id}: {record.signature or 'passes'}"
