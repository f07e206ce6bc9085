"""Which search dimensions failing goes with, under the names and values of the program."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mrta_falsify.campaigns.stats import is_uniform
from mrta_falsify.campaigns.store import Campaign
from mrta_falsify.core.importance import Group, Importance, importances
from mrta_falsify.core.record import TrialRecord
from mrta_falsify.verbs.report.trial_table import dimension_names, values_of
from reports.contents import ParameterImportance

MAX_SHOWN = 10


@dataclass(frozen=True, slots=True, kw_only=True)
class Ranking:
    """Dimensions by how much failing goes with them, the largest first."""

    found: tuple[Importance, ...]
    is_even: bool  #: of independent trials; only then do the intervals say what they cover

    @property
    def mattering(self) -> tuple[int, ...]:
        """Dimensions that failing goes with beyond chance."""
        return tuple(one.dimension for one in self.found if self.is_even and one.matters)


def rank_dimensions(campaign: Campaign, judged: Sequence[TrialRecord]) -> Ranking:
    """Rank the search dimensions by how much failing goes with them.

    By the trials that were drawn evenly, if enough of them failed and passed, else by all.

    Args:
        campaign: whose dimensions.
        judged: its judged trials.
    """
    cube = campaign.settings.cube
    even = [record for record in judged if is_uniform(record, campaign.settings)]
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
    campaign: Campaign, judged: Sequence[TrialRecord], ranking: Ranking
) -> tuple[ParameterImportance, ...]:
    """Put the most important dimensions under their names, with the values of the judged trials."""
    names = dimension_names(campaign)
    told = [values_of(record) for record in judged]
    return tuple(
        ParameterImportance(
            name=names[one.dimension],
            share=one.share,
            low=one.low,
            high=one.high,
            matters=one.dimension in ranking.mattering,
            values=tuple(values[one.dimension] for values in told),
            options=_options(campaign, one.dimension),
            parts=tuple(_in_values(group, one.dimension, judged, told) for group in one.groups),
        )
        for one in ranking.found[:MAX_SHOWN]
    )


def _options(campaign: Campaign, number: int) -> tuple[str, ...]:
    """Put the options of a choice in words; empty for other dimensions."""
    if not len(campaign.settings.space):
        return ()
    dimension = campaign.settings.space.dimensions[number]
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
