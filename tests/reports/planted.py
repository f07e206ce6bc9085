"""Campaign directories with a failure of a planted defect in them, as a campaign leaves them."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np

from mrta_falsify.campaigns.rules import RULES
from mrta_falsify.campaigns.settings import CampaignSettings, TrialSettings
from mrta_falsify.campaigns.signature import signature
from mrta_falsify.campaigns.store import Campaign, Store, trial_folder
from mrta_falsify.commands.stored_trials import open_campaign
from mrta_falsify.core.config import StackConfig
from mrta_falsify.core.feedback import Cube
from mrta_falsify.core.record import versions
from mrta_falsify.core.trace import write_trace
from mrta_falsify.core.world import World, write_world
from mrta_falsify.specs.attribution import guess
from mrta_falsify.specs.objectives import search_score
from mrta_falsify.testing.planted import PLANTS, STANDS
from mrta_falsify.testing.records import trial_record
from mrta_falsify.trial import Job, Judged, judge, on_kinematic_engine

#: with the defect of the fixture ``stalled``
BROKEN = on_kinematic_engine(StackConfig(defects=("same_room_twice_stalls",)))


def planted_campaign(directory: Path, defect: str, specifications: tuple[str, ...]) -> Campaign:
    """A campaign of one trial: the test world of a defect, run with it.

    Args:
        directory: for the campaign.
        defect: planted.
        specifications: judged.
    """
    config = on_kinematic_engine(StackConfig(defects=(defect,)))
    world = PLANTS[defect].world(0)
    job = Job(world=world, config=config, early_stop=True, specifications=specifications)
    return stored(directory, job, judge(job))


def stalled_campaign(directory: Path, stalled: tuple[World, Judged]) -> Campaign:
    """A campaign of one trial: the run of the fixture ``stalled``, which is a deadlock.

    Args:
        directory: for the campaign.
        stalled: the fixture's world and run.
    """
    return stored(directory, stalled_job(), stalled[1])


def stalled_job() -> Job:
    """The run of the fixture ``stalled``."""
    world = PLANTS["same_room_twice_stalls"].world(0)
    return Job(world=world, config=BROKEN, early_stop=True, specifications=(STANDS,))


def stored(directory: Path, job: Job, judged: Judged) -> Campaign:
    """A campaign of one trial, which is there already.

    Args:
        directory: for the campaign.
        job: of the trial.
        judged: what it gave.
    """
    world, config, specifications = job.world, job.config, job.specifications
    settings = CampaignSettings(
        trials=TrialSettings(
            scenario="planted",
            stack=config,
            specifications=specifications,
            directory=str(directory.resolve()),
        ),
        cube=Cube(dimensions=2),
        rules=RULES,
    )
    record = trial_record(
        0,
        np.zeros(2),
        world=world.digest(),
        verdicts=judged.verdicts,
        descriptors=judged.descriptors,
        score=search_score(judged.margins),
        signature=signature(judged.verdicts),
        layer=guess(judged.verdicts, judged.outcome.trace).layer,
        trace_file="trials/0000/trace.zip",
        trace=judged.outcome.trace.digest,
        engine=config.engine.name,
        ended=judged.outcome.ended,
        sim_time=judged.outcome.sim_time,
        attempts=1,
        versions=versions(),
    )
    result = dataclasses.replace(record.result, margins=judged.margins)
    record = dataclasses.replace(record, result=result)
    with Store.create(directory, settings) as store:
        folder = trial_folder(directory, 0)
        folder.mkdir(parents=True)
        write_world(world, folder / "world.json")
        write_trace(judged.outcome.trace, folder / "trace.zip")
        store.add(record)
    return open_campaign(directory)
