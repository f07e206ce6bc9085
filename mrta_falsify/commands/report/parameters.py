"""The parameters of trials: names, values, which failing goes with, and the nearest passing trial.

A parameter is a search dimension under the name that the program gives it.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mrta_falsify.campaigns.settings import CampaignSettings
from mrta_falsify.campaigns.stats import FailureMode, is_uniform
from mrta_falsify.core.arrays import Array
from mrta_falsify.core.candidate import DimensionValue
from mrta_falsify.core.importance import Group, Importance, importances
from mrta_falsify.core.record import TrialRecord
from mrta_falsify.core.words import number_text
from mrta_falsify.specs.causes import kind_of, leading
from reports.contents import Neighbour, ParameterImportance, TrialRow, TrialTable

MAX_SHOWN = 10  # parameters that failing goes with
MAX_CELLS = 120_000  # values of parameters; about 0.5 MB of the page
MAX_DIFFERENCES = 8  # parameters named, those that differ most
FATES = {"crashed": "error", "timeout": "error"}  # of trials that were not judged


def names_of(settings: CampaignSettings) -> tuple[str, ...]:
    """Name the search dimensions; campaigns of older versions know only whose each is."""
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


def told_values(settings: CampaignSettings, record: TrialRecord) -> tuple[DimensionValue, ...]:
    """Give the same as a person reads them."""
    pairs = zip(settings.space.dimensions, record.origin.values, strict=False)
    return tuple(dimension.told(value) for dimension, value in pairs) or values_of(record)


# --- which of them failing goes with -------------------------------------------------------


@dataclass(frozen=True, slots=True, kw_only=True)
class Ranking:
    """Dimensions by how much failing goes with them, the largest first."""

    found: tuple[Importance, ...]
    is_even: bool  #: of independent trials; only then do the intervals say what they cover

    @property
    def mattering(self) -> tuple[int, ...]:
        """Dimensions that failing goes with beyond chance."""
        return tuple(one.dimension for one in self.found if self.is_even and one.matters)


def rank_dimensions(settings: CampaignSettings, judged: Sequence[TrialRecord]) -> Ranking:
    """Rank the search dimensions by how much failing goes with them.

    By the trials that were drawn evenly, if enough of them failed and passed, else by all.

    Args:
        settings: of the campaign whose dimensions they are.
        judged: its judged trials.
    """
    cube = settings.cube
    even = [record for record in judged if is_uniform(record, settings)]
    for is_even, records in ((True, even), (False, judged)):
        points = [record.candidate.u for record in records]
        if not points or not cube.dimensions or any(len(u) != cube.dimensions for u in points):
            continue
        failed = np.array([record.rank != "none" for record in records])
        found = importances(np.array(points), failed, cube.levels)
        if found:
            return Ranking(found=found, is_even=is_even)
    return Ranking(found=(), is_even=True)


def parameter_importances(
    settings: CampaignSettings, judged: Sequence[TrialRecord], ranking: Ranking
) -> tuple[ParameterImportance, ...]:
    """Put the most important dimensions under their names, with the values of the judged trials."""
    names = names_of(settings)
    told = [values_of(record) for record in judged]
    return tuple(
        ParameterImportance(
            name=names[one.dimension],
            share=one.share,
            low=one.low,
            high=one.high,
            matters=one.dimension in ranking.mattering,
            values=tuple(values[one.dimension] for values in told),
            options=_options(settings, one.dimension),
            parts=tuple(_in_values(group, one.dimension, judged, told) for group in one.groups),
        )
        for one in ranking.found[:MAX_SHOWN]
    )


def _options(settings: CampaignSettings, number: int) -> tuple[str, ...]:
    """Put the options of a choice in words; empty for other dimensions."""
    if not len(settings.space):
        return ()
    dimension = settings.space.dimensions[number]
    return tuple(str(dimension.told(option)) for option in range(len(dimension.options)))


def _in_values(
    group: Group,
    dimension: int,
    judged: Sequence[TrialRecord],
    told: Sequence[tuple[float | None, ...]],
) -> Group:
    """Give the ends of a group in the units of the values, as far as these are numbers."""
    inside = [
        values[dimension]
        for record, values in zip(judged, told, strict=True)
        if group.low <= record.candidate.u[dimension] <= group.high
    ]
    known = [value for value in inside if value is not None]
    if not known:
        return group
    return dataclasses.replace(group, low=min(known), high=max(known))


# --- the table of all trials ---------------------------------------------------------------


def trial_table(
    settings: CampaignSettings,
    records: Sequence[TrialRecord],
    modes: Sequence[FailureMode],
    ranked: Sequence[int],
) -> TrialTable | None:
    """Tabulate the trials of a campaign, what became of each and its parameters; None without any.

    Args:
        settings: of the campaign.
        records: all of its trials.
        modes: its failure modes, in the order of the page.
        ranked: dimensions, the most important first.
    """
    if not records:
        return None
    names = names_of(settings)
    order = [*ranked, *(i for i in range(len(names)) if i not in set(ranked))]
    kept = order[: max(1, MAX_CELLS // len(records))]
    mode_of = {id: number for number, mode in enumerate(modes, start=1) for id in mode.ids}
    has_values = any(record.origin.values for record in records)
    notes = [] if has_values or not names else ["Parameters are shares of their ranges, 0 to 1."]
    if len(kept) < len(order):
        notes.append(f"{len(order) - len(kept)} parameters are left out: the page has no room.")
    return TrialTable(
        parameters=tuple(names[i] for i in kept),
        rows=tuple(_row(settings, record, mode_of.get(record.id, 0), kept) for record in records),
        note=" ".join(notes),
    )


def _row(
    settings: CampaignSettings, record: TrialRecord, mode: int, kept: Sequence[int]
) -> TrialRow:
    verdict = leading(record.verdicts)
    values = told_values(settings, record)
    return TrialRow(
        id=record.id,
        outcome=outcome_of(record),
        mode=mode,
        found=verdict.violated_at if verdict is not None else None,
        score=record.score if record.status == "ok" and np.isfinite(record.score) else None,
        simulated=record.sim_time,
        values=tuple(values[i] if i < len(values) else None for i in kept),
    )


def outcome_of(record: TrialRecord) -> str:
    """Say in a word what became of a trial."""
    if record.status != "ok":
        return FATES.get(record.status, record.status)
    if not record.failed:
        return "pass"
    return kind_of(record.verdicts) or "failure"


# --- the nearest passing trial -------------------------------------------------------------


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PassingTrials:
    """The trials of a campaign that pass, and where they lie in the cube of parameters."""

    records: tuple[TrialRecord, ...]
    points: Array  #: (n, k)


def passing_trials(records: Sequence[TrialRecord], dimensions: int) -> PassingTrials:
    """Collect the passing trials with so many parameters."""
    found = tuple(
        record
        for record in records
        if record.status == "ok" and not record.failed and len(record.candidate.u) == dimensions
    )
    points = np.array([record.candidate.u for record in found]).reshape(len(found), dimensions)
    return PassingTrials(records=found, points=points)


def nearest_passing(
    settings: CampaignSettings, passing: PassingTrials, record: TrialRecord
) -> TrialRecord | None:
    """Find the passing trial nearest to a failure in the cube of parameters; None without any.

    Continuous coordinates differ by their distance, discrete ones by 1 where their values do.
    """
    u = record.candidate.u
    if not len(u) or passing.points.shape[1] != len(u) or not passing.records:
        return None
    steps = _steps(settings, u, passing.points)
    return passing.records[int(np.argmin((steps**2).sum(axis=1)))]


def neighbour_of(
    settings: CampaignSettings, record: TrialRecord, near: TrialRecord, command: str
) -> Neighbour:
    """Tell in which parameters a passing trial differs from a failure.

    Args:
        settings: of the campaign.
        record: the failure.
        near: the passing trial.
        command: that runs it again and shows it beside the failure.
    """
    steps = _steps(settings, record.candidate.u, near.candidate.u)
    names = names_of(settings)
    here, there = told_values(settings, record), told_values(settings, near)
    texts = {int(i): (_text(here[i]), _text(there[i])) for i in np.flatnonzero(steps > 0.0)}
    order = [
        int(i)
        for i in np.argsort(-steps, kind="stable")
        if i in texts and texts[i][0] != texts[i][1]
    ]
    return Neighbour(
        id=near.id,
        differences=tuple((names[i], *texts[i]) for i in order[:MAX_DIFFERENCES]),
        further=max(0, len(order) - MAX_DIFFERENCES),
        command=command,
    )


def _steps(settings: CampaignSettings, one: Array, others: Array) -> Array:
    """Differences ``(..., k)`` of a point ``(k,)`` from others ``(..., k)``, in [0, 1]."""
    cube, steps = settings.cube, np.abs(one - others)
    if len(cube.levels) == len(one):
        levels = np.array(cube.levels)
        is_other = np.floor(one * levels) != np.floor(others * levels)
        steps = np.where(levels > 0, is_other.astype(float), steps)
    return np.asarray(steps)


def _text(value: DimensionValue) -> str:
    if value is None:
        return ""
    return str(value) if isinstance(value, (str, bool)) else number_text(value)
