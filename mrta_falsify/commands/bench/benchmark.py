"""Measure every layer through its protocol, so that any implementation can be timed."""

from __future__ import annotations

import contextlib
import dataclasses
import os
import platform
from collections.abc import Callable, Sequence

from mrta_falsify.commands.bench.bench_worlds import fleet_world
from mrta_falsify.commands.bench.controller_speed import time_controller, time_controller_init
from mrta_falsify.commands.bench.fleet_speed import time_fleet
from mrta_falsify.commands.bench.layer_speed import (
    time_costmap,
    time_engine,
    time_first_tick,
    time_planner,
)
from mrta_falsify.commands.bench.timing_values import FleetSpeed, Machine, Speeds
from mrta_falsify.commands.stacks import Stack, load_stack
from mrta_falsify.core import registry
from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.core.errors import ConfigError
from mrta_falsify.core.world import World
from mrta_falsify.specs.library import build_specifications
from scenic_worlds.layouts import load_world
from scenic_worlds.variation import vary_world
from simulator_interface.simulate import EpisodeRun

WORLD = "aws_hospital_day"
ENGINES = ("bullet", "kinematic")  # on which fleets run
CLUSTERS = (1, 2, 3, 6)  # robots in one cluster, as in MRTA-Sim's table
ENGINE_FLEET = 6  # robots that drive circles to time the engine alone
ENGINE_SECONDS = 30.0  # s of it at most
OTHER_STEPS = 4  # beside fleets and clusters: warm-up, planner, costmap, engine
WARM_UP = 600  # ticks in which each engine's fleet comes to nearly all compiled code
MAX_ROBOTS = 1000  # in a fleet


def step_count(robots: Sequence[int], engines: Sequence[str], config: StackConfig) -> int:
    """Count the steps that :func:`bench` reports on the way."""
    return len(robots) * (1 + len(_others(engines, config))) + len(CLUSTERS) + OTHER_STEPS


def _others(engines: Sequence[str], config: StackConfig) -> list[str]:
    """List the engines that are not the stack's own, each once."""
    return [name for name in dict.fromkeys(engines) if name != config.engine.name]


def bench(
    *,
    robots: Sequence[int] = (6, 24, 50, 100, 200),
    seconds: float = 60.0,
    engines: Sequence[str] = ENGINES,
    stack: Stack | None = None,
    settings: Sequence[str] = (),
    on_progress: Callable[[float], None] = lambda done: None,
) -> Speeds:
    """Measure every layer on one core.

    Args:
        robots: fleet sizes to run with all layers and 8 people; in a warehouse without people
            where the hospital has no room for them.
        seconds: simulated time per fleet [s], >= 10.
        engines: on which the fleets are run; always on the stack's own.
        stack: the stack, or its YAML file; the default stack if None.
        settings: ``--set`` texts applied to the stack.
        on_progress: called with the number of finished steps.

    Raises:
        InputError: a fleet size that is not allowed, or an unknown layer.
    """
    if not robots or not all(1 <= size <= MAX_ROBOTS for size in robots):
        raise ConfigError(f"robots is {robots}; it must be numbers from 1 to {MAX_ROBOTS}")
    config = load_stack(stack, settings)
    world = vary_world(load_world(WORLD), 0)
    others = {
        name: dataclasses.replace(config, engine=Choice(name)) for name in _others(engines, config)
    }
    for other in others.values():
        registry.build("engine", other.engine)
    steps = iter(range(1, step_count(robots, engines, config) + 1))

    def step() -> None:
        on_progress(next(steps))

    for each in (config, *others.values()):
        _warm_up(world, each)
    step()

    def fleets_of(config: StackConfig) -> dict[str, FleetSpeed]:
        found = {}
        for count in robots:
            found[str(count)] = time_fleet(world, config, count, seconds)
            step()
        return found

    fleets = fleets_of(config)
    on_others = {name: fleets_of(other) for name, other in others.items()}
    control, programs = {}, {}
    for count in CLUSTERS:
        control[str(count)], programs[str(count)] = time_controller(config, count)
        step()
    controller_init, plan = time_controller_init(config), time_planner(world, config)
    step()
    costmap, first_tick = time_costmap(world, config), time_first_tick(world, config)
    step()
    fleet = fleet_world(world, config, ENGINE_FLEET)
    engine = time_engine(fleet, config, min(seconds, ENGINE_SECONDS))
    step()
    return Speeds(
        real_time_factor=fleets,
        engines=on_others,
        cbf_qp_ms=programs,
        control_ms=control,
        qp_init_ms=controller_init,
        plan_ms=plan,
        costmap_ms=costmap,
        first_tick_ms=first_tick,
        engine_real_time_factor={str(ENGINE_FLEET): engine},
        world=WORLD,
        machine=this_machine(),
    )


def _warm_up(world: World, config: StackConfig) -> None:
    """Compile or load compiled code, so that no figure contains it."""
    run = EpisodeRun(
        fleet_world(world, config, ENGINE_FLEET),
        config,
        specifications=build_specifications(),
        keep_trace=False,
        copies=False,
    )
    with contextlib.closing(run):
        for _ in range(WARM_UP):
            run.advance()


def this_machine() -> Machine:
    """Describe this machine."""
    model = platform.processor() or platform.machine()
    try:
        with open("/proc/cpuinfo", encoding="utf-8") as file:
            names = [line.partition(":")[2].strip() for line in file if "model name" in line]
        model = names[0] if names else model
    except OSError:
        pass
    return Machine(
        cpu=model,
        cores=os.cpu_count(),
        system=platform.platform(),
        python=platform.python_version(),
    )
