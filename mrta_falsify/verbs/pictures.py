"""Pictures of stored trials."""

from __future__ import annotations

from pathlib import Path

from mrta_falsify.campaigns.store import Campaign
from mrta_falsify.core.record import TrialRecord
from mrta_falsify.core.trace import read_trace
from mrta_falsify.verbs.stacks import costmap_of
from mrta_falsify.verbs.stored_trials import stored_world
from mrta_falsify.worker import rerun, stack_of
from reports.run_view import RunView


def trial_view(campaign: Campaign, record: TrialRecord) -> RunView:
    """Get what pictures of a trial are made from; it is run again if its trace was not kept.

    Raises:
        InputError: its world or trace is missing or damaged.
    """
    world = stored_world(campaign, record)
    path = campaign.folder(record) / "trace.zip"
    settings = campaign.settings.trials
    trace = read_trace(path) if path.is_file() else rerun(settings, record, world).outcome.trace
    return RunView(
        world=world,
        trace=trace,
        verdicts=record.verdicts,
        costmap=costmap_of(world, stack_of(settings, record)),
    )


def draw_trial(campaign: Campaign, record: TrialRecord) -> Path:
    """Draw a trial into its folder, and return the file.

    Raises:
        InputError: its world or trace is missing or damaged.
    """
    from reports.run_picture import write_picture  # noqa: PLC0415 - matplotlib loads slowly

    path = campaign.make_folder(record) / "picture.png"
    write_picture(trial_view(campaign, record), path)
    return path
