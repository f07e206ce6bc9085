"""Stored trials: list them, show one, get its world back."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from mrta_falsify.campaigns.store import Campaign, StoreError, read_campaign
from mrta_falsify.core.record import Status, TrialRecord
from mrta_falsify.core.world import World, read_world
from mrta_falsify.trial import Job
from mrta_falsify.verbs.folders import Place
from mrta_falsify.worker import open_program, specifications_of, stack_of


@dataclass(frozen=True, slots=True, kw_only=True)
class TrialRow:
    """A trial in one line, as ``list --format json`` prints it."""

    id: str
    status: Status
    score: float
    signature: str
    failed: bool
    jittered: int  #: copies with small differences that were run
    jittered_failures: int
    violated: tuple[str, ...]  #: specifications
    layer: str
    engine: str
    sim_time_s: float
    wall_s: float
    attempts: int
    world_digest: str
    trace_digest: str
    error: str


def open_campaign(directory: Place) -> Campaign:
    """Open a campaign directory for reading.

    Raises:
        StoreError: it is not one.
    """
    return read_campaign(Path(directory))


def list_trials(directory: Place, failed: bool = False) -> tuple[TrialRow, ...]:
    """List the trials of a campaign, one row each.

    Args:
        directory: of the campaign.
        failed: only trials that violate a specification.

    Raises:
        StoreError: not a campaign.
    """
    records = open_campaign(directory).records
    return tuple(_row(record) for record in records if record.failed or not failed)


def _row(record: TrialRecord) -> TrialRow:
    return TrialRow(
        id=record.id,
        status=record.status,
        score=record.score,
        signature=record.signature,
        failed=record.failed,
        jittered=record.jittered.runs if record.jittered else 0,
        jittered_failures=record.jittered.failed if record.jittered else 0,
        violated=tuple(verdict.spec for verdict in record.verdicts if verdict.violated),
        layer=record.layer,
        engine=record.engine,
        sim_time_s=record.sim_time,
        wall_s=record.wall_s,
        attempts=record.attempts,
        world_digest=record.world_digest,
        trace_digest=record.trace_digest,
        error=record.error,
    )


def show_trial(directory: Place, id: str | int) -> TrialRecord:
    """Look at one trial: verdicts, evidence, digests.

    Args:
        directory: of the campaign.
        id: of the trial, as ``"0042"``, ``"42"`` or 42.

    Raises:
        StoreError: not a campaign, or no such trial.
    """
    return open_campaign(directory).record(str(id))


def stored_world(campaign: Campaign, record: TrialRecord) -> World:
    """Read the world of a trial: its file if it was kept, sampled anew otherwise.

    Raises:
        StoreError: the trial has no world, or the file is not the world it was.
    """
    if record.status == "rejected":
        raise StoreError(f"trial {record.id} has no world: {record.error}")
    path = campaign.folder(record) / "world.json"
    if path.is_file():
        world = read_world(path)
    else:
        world = open_program(campaign.settings.trials).realise(record.candidate).world
    if record.world_digest and world.digest() != record.world_digest:
        raise StoreError(
            f"{path}: its digest is {world.digest()[:12]}, the record says "
            f"{record.world_digest[:12]}; the world is not the one that was run"
        )
    return world


def job_of(campaign: Campaign, record: TrialRecord) -> Job:
    """Make a job of a stored trial, to be varied; it is stopped early.

    Raises:
        StoreError: as of :func:`stored_world`.
    """
    settings = campaign.settings.trials
    return Job(
        world=stored_world(campaign, record),
        config=stack_of(settings, record),
        specifications=specifications_of(settings),
        early_stop=True,
        limits=settings.limits,
    )
