"""Pictures of stored trials."""

from __future__ import annotations

from pathlib import Path

from mrta_falsify.campaigns.store import Campaign
from mrta_falsify.commands.trust import map_of
from mrta_falsify.core.record import TrialRecord
from mrta_falsify.lab import stack_of
from mrta_falsify.lab.stored import kept_trace, kept_world
from reports.contents import RunView


def trial_view(campaign: Campaign, record: TrialRecord) -> RunView:
    """Get what pictures of a trial are made from.

    Raises:
        NeedsOption: its world or trace was not kept.
        InputError: its world or trace is damaged.
    """
    world = kept_world(campaign, record)
    return RunView(
        world=world,
        trace=kept_trace(campaign, record),
        verdicts=record.verdicts,
        costmap=map_of(world, stack_of(campaign.settings.trials, record)),
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
