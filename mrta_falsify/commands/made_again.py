"""A trial made again: its world and its trace, kept beside it as a campaign keeps them."""

from __future__ import annotations

from mrta_falsify.campaigns.store import Campaign, trial_folder
from mrta_falsify.commands.folders import make_directory
from mrta_falsify.commands.trust import Trust, of_links, permit, permit_runs
from mrta_falsify.core.errors import InputError
from mrta_falsify.core.record import TrialRecord
from mrta_falsify.core.trace import write_trace
from mrta_falsify.core.world import write_world
from mrta_falsify.lab import Lab, experiment_of_record
from mrta_falsify.lab.stored import TRACE_NAME, WORLD_NAME, stored_world


def keep_run(
    campaign: Campaign, record: TrialRecord, trust: Trust = False, *, with_trace: bool = True
) -> None:
    """Sample the world of a trial anew, and run it again, if they are not kept yet; keep them.

    Args:
        campaign: that has it.
        record: of the trial.
        trust: whether what is not ours may run, if somebody else has made the campaign.
        with_trace: False: only the world.

    Raises:
        NeedsOption: it may not.
        InputError: it comes out differently now.
    """
    own = trial_folder(campaign.directory, record.number)
    permit(campaign.directory, of_links(campaign.directory, own), trust)
    folder = campaign.folder(record)
    has_world = (folder / WORLD_NAME).is_file()
    runs = with_trace and not (folder / TRACE_NAME).is_file()
    if has_world and not runs:
        return
    permit_runs(campaign, (record,), trust, only_sampled=not runs)
    world = stored_world(campaign, record)
    if not runs:
        write_world(world, make_directory(folder) / WORLD_NAME)
        return
    with Lab() as lab:
        experiment = experiment_of_record(campaign.settings.trials, record, world)
        trace = lab.judge(experiment).outcome.trace
    if trace.digest != record.trace_digest:
        told = record.trace_digest[:12] or "none"
        raise InputError(
            f"trial {record.id} runs differently now: its trace has digest {trace.digest[:12]}, "
            f"the record says {told}; another version has recorded it"
        )
    write_world(world, make_directory(folder) / WORLD_NAME)
    write_trace(trace, folder / TRACE_NAME)
