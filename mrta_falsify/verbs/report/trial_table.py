"""The table of all trials: what became of each, and the values of its parameters."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mrta_falsify.campaigns.stats import FailureMode
from mrta_falsify.campaigns.store import Campaign
from mrta_falsify.core.candidate import DimensionValue
from mrta_falsify.core.record import TrialRecord
from mrta_falsify.specs.causes import kind_of, leading
from reports.contents import TrialRow, TrialTable

MAX_CELLS = 120_000  # values of parameters; about 0.5 MB of the page
FATES = {"crashed": "error", "timeout": "error"}  # of trials that were not judged


def trial_table(
    campaign: Campaign, found: Sequence[FailureMode], ranked: Sequence[int]
) -> TrialTable | None:
    """Tabulate the trials of a campaign; None without any.

    Args:
        campaign: whose trials.
        found: its failure modes, in the order of the page.
        ranked: dimensions, the most important first.
    """
    records = campaign.records
    if not records:
        return None
    names = dimension_names(campaign)
    order = [*ranked, *(i for i in range(len(names)) if i not in set(ranked))]
    kept = order[: max(1, MAX_CELLS // len(records))]
    mode_of = {id: number for number, mode in enumerate(found, start=1) for id in mode.ids}
    has_values = any(record.origin.values for record in records)
    notes = [] if has_values or not names else ["Parameters are shares of their ranges, 0 to 1."]
    if len(kept) < len(order):
        notes.append(f"{len(order) - len(kept)} parameters are left out: the page has no room.")
    return TrialTable(
        parameters=tuple(names[i] for i in kept),
        rows=tuple(_row(campaign, record, mode_of.get(record.id, 0), kept) for record in records),
        note=" ".join(notes),
    )


def dimension_names(campaign: Campaign) -> tuple[str, ...]:
    """Name the search dimensions; campaigns of older versions know only whose each is."""
    settings = campaign.settings
    if len(settings.space):
        return tuple(dimension.name for dimension in settings.space.dimensions)
    cube = settings.cube
    if not cube.owners:
        return tuple(f"u[{i}]" for i in range(cube.dimensions))
    seen: dict[str, int] = {}
    names = []
    for group in cube.groups:
        owner = cube.owners[group]
        names.append(f"{owner} ({seen.setdefault(owner, 0) + 1})")
        seen[owner] += 1
    return tuple(names)


def values_of(record: TrialRecord) -> tuple[float | None, ...]:
    """Give the values of a trial's parameters, or shares of their ranges where none are stored.

    A choice is told by the number of its option.
    """
    return record.origin.values or tuple(map(float, record.candidate.u))


def dimension_values(campaign: Campaign, record: TrialRecord) -> tuple[DimensionValue, ...]:
    """Give the same as a person reads them."""
    return tuple(campaign.values_of(record).values()) or values_of(record)


def outcome_of(record: TrialRecord) -> str:
    """Say in a word what became of a trial."""
    if record.status != "ok":
        return FATES.get(record.status, record.status)
    if not record.failed:
        return "pass"
    return kind_of(record.verdicts) or "failure"


def _row(campaign: Campaign, record: TrialRecord, mode: int, kept: Sequence[int]) -> TrialRow:
    verdict = leading(record.verdicts)
    values = dimension_values(campaign, record)
    return TrialRow(
        id=record.id,
        outcome=outcome_of(record),
        mode=mode,
        found=verdict.violated_at if verdict is not None else None,
        score=record.score if record.status == "ok" and np.isfinite(record.score) else None,
        simulated=record.sim_time,
        values=tuple(values[i] if i < len(values) else None for i in kept),
    )
