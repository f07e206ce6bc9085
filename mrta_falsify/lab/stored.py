"""Stored trials of a campaign: their worlds and traces, and their runs as jobs to be varied."""

from __future__ import annotations

import dataclasses
from pathlib import Path

from mrta_falsify.campaigns.store import Campaign, StoreError
from mrta_falsify.core.config import StackConfig
from mrta_falsify.core.errors import NeedsOption
from mrta_falsify.core.record import TrialRecord
from mrta_falsify.core.trace import Trace, read_trace
from mrta_falsify.core.world import World, read_world
from mrta_falsify.lab.recorded import experiment_of_record, open_program, stack_of
from mrta_falsify.lab.running import job_of_experiment
from mrta_falsify.trial import Job

WORLD_NAME, TRACE_NAME = "world.json", "trace.zip"  # in the folder of a trial


def job_of(campaign: Campaign, record: TrialRecord) -> Job:
    """Make a job of a stored trial, to be varied; it is stopped early.

    Raises:
        StoreError: as of :func:`stored_world`.
    """
    world = stored_world(campaign, record)
    own = experiment_of_record(campaign.settings.trials, record, world)
    own = dataclasses.replace(own, early_stop=True, rules=campaign.settings.rules)
    return job_of_experiment(own, world)


def other_stack_of(campaign: Campaign, record: TrialRecord) -> StackConfig | None:
    """Give the stack that does not share a failure, on the engine that its verdicts come from.

    None where no two stacks are compared, or where the other one does not pass.
    """
    if record.other is None or not record.other.passes:
        return None
    return stack_of(campaign.settings.trials.of_other, record)


def stored_world(campaign: Campaign, record: TrialRecord) -> World:
    """Read the world of a trial: its file if it was kept, sampled anew otherwise.

    Sampling runs the campaign's program; who calls this has asked whether it may.

    Raises:
        StoreError: the trial has no world, or what there is is not the world that was run.
    """
    path = _world_file(campaign, record)
    if path.is_file():
        world = read_world(path)
    else:
        world = open_program(campaign.settings.trials).realise(record.candidate).world
    _check_is_of(record, world, path)
    return world


def kept_world(campaign: Campaign, record: TrialRecord) -> World:
    """Read the world of a trial that was kept; nothing is run.

    Raises:
        StoreError: the trial has no world, or the file is not the world that was run.
        NeedsOption: it was not kept.
    """
    path = _world_file(campaign, record)
    if not path.is_file():
        raise NeedsOption(
            f"trial {record.id}: its world is not kept ({path}); to sample it anew runs "
            f"{campaign.settings.trials.scenario}",
            "--run",
        )
    world = read_world(path)
    _check_is_of(record, world, path)
    return world


def _world_file(campaign: Campaign, record: TrialRecord) -> Path:
    if record.status == "rejected":
        raise StoreError(f"trial {record.id} has no world: {record.error}")
    return campaign.folder(record) / WORLD_NAME


def _check_is_of(record: TrialRecord, world: World, path: Path) -> None:
    if not record.world_digest:
        raise StoreError(
            f"{path}: the record of trial {record.id} has no digest of its world, so this "
            "world cannot be compared with the one that was run"
        )
    if world.digest() != record.world_digest:
        raise StoreError(
            f"{path}: its digest is {world.digest()[:12]}, the record says "
            f"{record.world_digest[:12]}; the world is not the one that was run"
        )


def kept_trace(campaign: Campaign, record: TrialRecord) -> Trace:
    """Read the trace of a trial that was kept; nothing is run.

    Raises:
        NeedsOption: it was not kept.
        InputError: it is damaged.
    """
    path = campaign.folder(record) / TRACE_NAME
    if not path.is_file():
        raise NeedsOption(f"trial {record.id}: its trace is not kept ({path})", "--run")
    return read_trace(path)
