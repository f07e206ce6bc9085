"""The settings of a new campaign, everything in them checked before a trial runs."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from mrta_falsify.campaigns.rare_events import is_estimating
from mrta_falsify.campaigns.rules import RULES
from mrta_falsify.campaigns.settings import (
    COMPARISON_RUNS,
    DEFAULTS,
    CampaignSettings,
    Mode,
    TrialSettings,
)
from mrta_falsify.commands.folders import Place, located
from mrta_falsify.commands.programs import Params, check_params, parse_params
from mrta_falsify.commands.stacks import Stack, load_other_stack, load_stack
from mrta_falsify.core import registry
from mrta_falsify.core.config import Choice
from mrta_falsify.core.errors import InputError
from mrta_falsify.core.feedback import cube_of
from mrta_falsify.lab import open_program
from mrta_falsify.specs.library import build_specifications
from mrta_falsify.trial import Job, primary_and_secondary, run_first_tick

if TYPE_CHECKING:
    from scenic_worlds.program import Program


def new_settings(
    scenario: Place,
    *,
    output: Place,
    stack: Stack | None = None,
    settings: Sequence[str] = (),
    against: Stack | None = None,
    specs: str | Sequence[str] = (),
    then: str | Sequence[str] = (),
    params: Params = (),
    sampler: Choice | str = DEFAULTS.sampler.name,
    seed: int = DEFAULTS.trials.seed,
    mode: Mode = DEFAULTS.trials.mode,
    screen: bool = DEFAULTS.trials.screen,
    jittered: int = DEFAULTS.trials.jittered,
    verify: int = DEFAULTS.trials.verify,
    confirm: Sequence[str] = (),
    with_shut_rooms: bool = DEFAULTS.trials.with_shut_rooms,
    window: int = DEFAULTS.window,
    tick_limit: float = DEFAULTS.trials.tick_limit,
    memory_limit: float = DEFAULTS.trials.memory_limit,
    time_limit: float = DEFAULTS.time_limit,
) -> CampaignSettings:
    """Make the settings of a new campaign (see :mod:`mrta_falsify.campaigns.settings`).

    Args:
        scenario: shipped name or path of a Scenic program.
        output: directory of the campaign.
        stack: the stack under test, or its YAML file; the default stack if None.
        settings: ``--set`` texts applied to the stack.
        against: another stack, on which failures must not happen; none is compared if None.
        specs: names of specifications, or ``stl:FORMULA``; those of campaigns if empty.
        then: secondary specifications; deadlines and undone tasks if both are empty.
        params: Scenic's global parameters to override.
        sampler: registered name, or a choice with options.
        seed: of the campaign; candidate n gets its own from it.
        mode: how scenes are accepted, ``repair`` or ``exact``.
        screen: kinematic engine first, physics only for what fails there.
        jittered: copies with small differences that are run of each failing world.
        verify: runs again of each failure of a foreign stack.
        confirm: engines that robust failures are run on as well.
        with_shut_rooms: simulate worlds, too, in which no robot fits to a room of a task.
        window: how far trials may run ahead of what the sampler knows.
        tick_limit: CPU time for one tick [s], after which the stack hangs.
        memory_limit: resident memory that the stack may take up [GiB].
        time_limit: work and sleep of all processes of one trial [s].

    Raises:
        InputError: anything of it is wrong.
    """
    config = load_stack(stack, settings)
    other = load_other_stack(against, config) if against is not None else None
    is_foreign = other is not None and other.stack is not None
    specifications, last = primary_and_secondary(specs, then, other if is_foreign else config)
    trials = TrialSettings(
        scenario=str(scenario),
        params=parse_params(params),
        stack=config,
        against=other,
        specifications=specifications,
        then=last,
        seed=seed,
        mode=mode,
        screen=screen,
        jittered=jittered or (COMPARISON_RUNS if other is not None else 0),
        verify=verify,
        confirm=_known_engines(confirm),
        with_shut_rooms=with_shut_rooms,
        tick_limit=tick_limit,
        memory_limit=memory_limit,
        directory=str(Path(output).resolve()),
    )
    build_specifications([name for name in specifications if name not in last])
    if last:
        build_specifications(last, where="--secondary-spec")
    program = open_program(trials)
    check_params(program, trials.scenario)
    _check_first_scene(program, trials)
    if other is not None:
        _check_first_scene(program, trials.of_other)
    made = CampaignSettings(
        trials=dataclasses.replace(trials, sources_digest=program.sources_digest),
        sampler=Choice(sampler) if isinstance(sampler, str) else sampler,
        cube=cube_of(program.space),
        space=program.space,
        window=window,
        time_limit=time_limit,
        rules=RULES,
    )
    estimating = is_estimating(made)  # builds the sampler, and so checks its options
    if estimating and other is not None:
        raise InputError(
            f"sampler {made.sampler.name} estimates the probability of any failure, so it compares "
            "no stacks; leave --against out, or choose another sampler"
        )
    if estimating and jittered:
        raise InputError(
            f"jittered is {jittered}: a probability counts every failure, so sampler "
            f"{made.sampler.name} runs no perturbed worlds; it must be 0"
        )
    return made


def _known_engines(names: Sequence[str]) -> tuple[str, ...]:
    """Refuse engines that are not known, or not installed.

    Raises:
        InputError: names the engine.
    """
    for name in names:
        registry.load("engine", name, where="confirm")
    return tuple(names)


def _check_first_scene(program: Program, trials: TrialSettings) -> None:
    """Refuse what would fail in every trial: values that no world can have, unknown signals.

    So is a campaign of which nothing can be judged, because the stack tells too little.

    A scene like that later in the campaign, where only some values are to blame, is a rejected
    trial with the same words; so is a candidate without a valid scene.

    Raises:
        InputError: names the program, the field and the value, the formula and the signal, or
            what cannot be judged and why.
    """
    from scenic_worlds.program import RejectedScene  # noqa: PLC0415 - Scenic loads slowly

    try:
        with located(str(program.path)):
            first = program.realise(program.candidate(trials.seed), trials.mode)
    except RejectedScene:
        return
    asked = tuple(name for name in trials.specifications if name.startswith("stl:"))
    if trials.stack.withheld:
        asked = trials.specifications
    if asked:  # which signals there are, and what the stack tells, only a frame can show
        run_first_tick(
            Job(world=first.world, config=trials.stack, specifications=asked, scene=first.scene)
        )
