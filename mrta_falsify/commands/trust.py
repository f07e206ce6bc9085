"""What commands would run of a campaign, and whether they may (see :mod:`..campaigns.foreign`).

Commands that look run nothing that is not ours. What they miss they say, and ``--run`` makes it
again. All others ask for ``--trust`` where what they would run is not ours and the folder that
names it was not made by this user on this machine. Workers ask nothing: who starts them vouches for
them.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Iterable, Iterator
from pathlib import Path
from typing import Any

from mrta_falsify.campaigns.foreign import (
    Foreign,
    Trust,
    of_choice,
    of_judging,
    of_links,
    of_settings,
    of_stack,
    of_values,
    permit,
)
from mrta_falsify.campaigns.settings import CampaignSettings, TrialSettings
from mrta_falsify.campaigns.store import Campaign, trial_folder
from mrta_falsify.commands.folders import Place
from mrta_falsify.commands.stacks import costmap_of
from mrta_falsify.commands.stored_trials import open_campaign
from mrta_falsify.core import codec
from mrta_falsify.core.config import StackConfig
from mrta_falsify.core.costmap import Costmap
from mrta_falsify.core.errors import InputError
from mrta_falsify.core.record import TrialRecord
from mrta_falsify.core.world import World
from mrta_falsify.lab import stack_of
from mrta_falsify.lab.stored import WORLD_NAME, kept_world
from scenic_worlds.shipped import LIBRARY
from scenic_worlds.sources import source_files

__all__ = ["Trust", "of_links", "open_to_run", "permit"]


def open_to_run(directory: Place, trust: Trust) -> Campaign:
    """Open a campaign whose trials are to be run.

    Args:
        directory: of the campaign.
        trust: whether its files may lie elsewhere, if somebody else has made it.

    Raises:
        StoreError: not a campaign.
        NeedsOption: some of its files lie elsewhere.
    """
    permit(Path(directory), of_links(Path(directory)), trust)
    return open_campaign(directory)


def permit_runs(
    campaign: Campaign,
    records: Iterable[TrialRecord],
    trust: Trust,
    *,
    config: StackConfig | None = None,
    with_other: bool = False,
    told: bool = False,
    only_sampled: bool = False,
) -> None:
    """Ask whether trials of a campaign may be run again; nothing is asked where all of it is ours.

    Args:
        campaign: that has them.
        records: of the trials.
        trust: of the user.
        config: the stack, as far as the campaign's files name it; None: as each trial was run.
        with_other: the other stack runs too, where two are compared.
        told: stored answers are told in place of asking a foreign stack.
        only_sampled: their worlds are sampled anew, and nothing is run.

    Raises:
        NeedsOption: they may not; says what would run.
    """
    trials = campaign.settings.trials

    def found() -> Iterator[Foreign]:
        if not only_sampled:
            yield from of_judging(trials)
        if with_other and trials.against is not None:
            yield from of_stack(trials.against)
        if config is not None:
            yield from of_stack(config)
        for record in records:
            folder = trial_folder(campaign.directory, record.number)
            yield from of_links(campaign.directory, folder)
            if config is None and not only_sampled:
                yield from of_stack(_asked(stack_of(trials, record), told=told))
            yield from of_scene(trials, folder)

    permit(campaign.directory, found(), trust)


def permit_rechecks(
    campaign: Campaign,
    named: StackConfig | None,
    trust: Trust,
    *,
    only: Collection[str] = (),
    run: bool = False,
) -> None:
    """Ask whether the failures of a campaign may be run on a changed stack.

    Args:
        campaign: whose failures.
        named: what its files name of that stack; None: the stack is its own.
        trust: of the user.
        only: ids of the failures; all if empty.
        run: worlds that were not kept may be sampled anew.

    Raises:
        NeedsOption: they may not, or a world was not kept.
    """
    failures = [r for r in campaign.records if r.failed and (not only or r.id in only)]
    permit_runs(campaign, failures, trust, config=named)
    for record in failures:
        if not run and not (campaign.folder(record) / WORLD_NAME).is_file():
            kept_world(campaign, record)


def _asked(config: StackConfig, *, told: bool) -> StackConfig:
    return dataclasses.replace(config, stack=None) if told else config


def of_scene(trials: TrialSettings, folder: Path) -> Iterator[Foreign]:
    """Yield the program of a trial if its run needs it: the world is not kept, or scripted."""
    program = tuple(of_program(trials))
    if program and _needs_program(folder / WORLD_NAME):
        yield from program


def _needs_program(world: Path) -> bool:
    try:
        data: Any = codec.read_json(world)
    except InputError:
        return True
    return not isinstance(data, dict) or bool(data.get("scripted"))


def of_program(trials: TrialSettings) -> Iterator[Foreign]:
    """Yield a campaign's program, unless it ships with the toolkit, and what it is given."""
    path = Path(trials.scenario)
    is_file = path.suffix == ".scenic" and path.is_file()
    if is_file and not path.resolve().is_relative_to(LIBRARY):
        others = [f for f in source_files(path) if not f.is_relative_to(LIBRARY)]
        yield Foreign("Scenic program", trials.scenario, path.resolve(), tuple(others))
    yield from of_values(trials.params)


def of_campaign(settings: CampaignSettings) -> Iterator[Foreign]:
    """Yield all that a campaign names, which runs when it goes on."""
    yield from of_settings(settings)
    yield from of_program(settings.trials)


def map_of(world: World, config: StackConfig) -> Costmap | None:
    """Build the costmap that the stack sees, to be drawn; None where that is not ours to build."""
    return None if any(of_choice("costmap", config.costmap)) else costmap_of(world, config)
