"""The passing trial nearest to a failure: what differs, and its run beside the failing one."""

from __future__ import annotations

import shlex
from collections.abc import Sequence

import numpy as np

from mrta_falsify.campaigns.store import Campaign
from mrta_falsify.core.arrays import Array
from mrta_falsify.core.candidate import DimensionValue
from mrta_falsify.core.record import TrialRecord
from mrta_falsify.core.words import number_text
from mrta_falsify.verbs.made_again import keep_run
from mrta_falsify.verbs.report.trial_table import dimension_names, dimension_values
from mrta_falsify.verbs.trust import Trust
from reports.contents import Neighbour

MAX_DIFFERENCES = 8  # parameters named, those that differ most


def nearest_passing(campaign: Campaign, record: TrialRecord) -> TrialRecord | None:
    """Find the passing trial nearest to a failure in the cube of parameters; None without any.

    Continuous coordinates differ by their distance, discrete ones by 1 where their values do.
    """
    u = record.candidate.u
    passing = [
        other
        for other in campaign.records
        if other.status == "ok" and not other.failed and len(other.candidate.u) == len(u)
    ]
    if not passing or not len(u):
        return None
    steps = _steps(campaign, u, np.array([other.candidate.u for other in passing]))
    return passing[int(np.argmin((steps**2).sum(axis=1)))]


def neighbour_of(campaign: Campaign, record: TrialRecord) -> Neighbour | None:
    """Tell in which parameters the nearest passing trial differs; None without any."""
    near = nearest_passing(campaign, record)
    if near is None:
        return None
    steps = _steps(campaign, record.candidate.u, near.candidate.u)
    names = dimension_names(campaign)
    here, there = dimension_values(campaign, record), dimension_values(campaign, near)
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
        command=shlex.join(["mrta-falsify", "report", str(campaign.directory), "--beside"]),
    )


def _steps(campaign: Campaign, one: Array, others: Array) -> Array:
    """Differences ``(..., k)`` of a point ``(k,)`` from others ``(..., k)``, in [0, 1]."""
    cube, steps = campaign.settings.cube, np.abs(one - others)
    if len(cube.levels) == len(one):
        levels = np.array(cube.levels)
        is_other = np.floor(one * levels) != np.floor(others * levels)
        steps = np.where(levels > 0, is_other.astype(float), steps)
    return np.asarray(steps)


def _text(value: DimensionValue) -> str:
    if value is None:
        return ""
    return str(value) if isinstance(value, (str, bool)) else number_text(value)


def keep_neighbours(
    campaign: Campaign, failures: Sequence[TrialRecord], trust: Trust = False
) -> None:
    """Run the passing trials nearest to failures again, and keep them for the report.

    Raises:
        InputError: as of :func:`~mrta_falsify.verbs.made_again.keep_run`.
    """
    found = (nearest_passing(campaign, record) for record in failures)
    for near in {record.number: record for record in found if record is not None}.values():
        keep_run(campaign, near, trust)
