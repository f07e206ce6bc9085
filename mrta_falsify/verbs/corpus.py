"""All stored failures on a changed stack: fixed, still failing, or flaky."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal, get_args

from mrta_falsify.campaigns.settings import TrialSettings
from mrta_falsify.campaigns.signature import signature
from mrta_falsify.campaigns.store import Campaign
from mrta_falsify.core.config import StackConfig
from mrta_falsify.core.record import TrialRecord
from mrta_falsify.core.world import World
from mrta_falsify.verbs.stored_trials import stored_world
from mrta_falsify.worker import rerun
from scenic_worlds.variation import jittered_worlds

Fate = Literal["fixed", "still failing", "flaky"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Recheck:
    """What became of one stored failure.

    It is *fixed* if neither its world nor any of the jittered ones fails any more, *still
    failing* if its world fails, and *flaky* if only jittered ones do: then the change has
    moved the failure, not removed it.
    """

    id: str
    fate: Fate
    signature: str  #: as stored
    violated: tuple[str, ...]  #: by the stored world on the changed stack
    signature_now: str
    jittered_failures: int
    jittered: int  #: runs


def recheck(
    campaign: Campaign,
    *,
    config: StackConfig | None = None,
    jittered: int = 2,
    on_done: Callable[[Recheck], None] = lambda row: None,
) -> tuple[Recheck, ...]:
    """Run all stored failures again.

    Args:
        campaign: whose failures.
        config: the changed stack; the campaign's own if None.
        jittered: runs beside each world with small differences (see ``jitter_world``).
        on_done: called after each.

    Returns:
        One row per failure, in the order of the trials.

    Raises:
        InputError: a stored world is missing or damaged.
    """
    settings = campaign.settings.trials
    if config is not None:
        settings = dataclasses.replace(settings, stack=config)
    rows = []
    for record in campaign.records:
        if record.failed:
            rows.append(_recheck(settings, record, stored_world(campaign, record), jittered))
            on_done(rows[-1])
    return tuple(rows)


def _recheck(settings: TrialSettings, record: TrialRecord, world: World, jittered: int) -> Recheck:
    # A changed stack is judged by physics if that is its engine, whatever found the failure.
    record = dataclasses.replace(record, engine=settings.stack.engine.name)
    judged = rerun(settings, record, world)
    around = [rerun(settings, record, near) for near in jittered_worlds(world, jittered)]
    failures = sum(run.failed for run in around)
    fate: Fate = "still failing" if judged.failed else "flaky" if failures else "fixed"
    return Recheck(
        id=record.id,
        fate=fate,
        signature=record.signature,
        violated=tuple(v.spec for v in judged.verdicts if v.violated),
        signature_now=signature(judged.verdicts),
        jittered_failures=failures,
        jittered=len(around),
    )


def summary(rows: tuple[Recheck, ...]) -> dict[str, Any]:
    """Counts by fate, and the rows."""
    counts = {fate: sum(row.fate == fate for row in rows) for fate in get_args(Fate)}
    return {**counts, "failures": [dataclasses.asdict(row) for row in rows]}
