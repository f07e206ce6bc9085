"""How fast costmap, planner, first tick and engine are, each alone."""

from __future__ import annotations

import functools
import time

import numpy as np

from mrta_falsify.commands.bench.bench_worlds import (
    build_planner,
    starting_costmap,
    with_new_furniture,
)
from mrta_falsify.commands.bench.timing_values import PlanTimes, milliseconds, timed
from mrta_falsify.core import registry
from mrta_falsify.core.config import StackConfig
from mrta_falsify.core.fleet import Command
from mrta_falsify.core.seeding import stream
from mrta_falsify.core.world import World
from simulator_interface.episode import Episode

TRIPS = 40  # planned start and goal pairs


def time_costmap(world: World, config: StackConfig) -> float:
    """Time the costmap of a world never seen [ms]; median of ten."""
    worlds = [with_new_furniture(world, number) for number in range(10)]
    spent = [timed(functools.partial(starting_costmap, changed, config)) for changed in worlds]
    return milliseconds(np.array(spent), 50.0)


def time_planner(world: World, config: StackConfig) -> PlanTimes:
    """Time the first plan to a goal, and another plan to a goal seen before."""
    planner = build_planner(config, starting_costmap(world, config))
    random = stream(0, "bench/trips")
    rooms = [room.point for room in world.rooms]
    jitter = random.uniform(-0.2, 0.2, size=(TRIPS, 2))
    cold, warm = [], []
    for i in range(TRIPS):
        start, goal = rooms[i % len(rooms)], rooms[(i + 1 + i // 6) % len(rooms)] + jitter[i]
        cold.append(timed(functools.partial(planner.plan, start, goal)))
        other = rooms[(i + 2) % len(rooms)]
        warm.append(timed(functools.partial(planner.plan, other, goal)))
    return PlanTimes(
        cold_p95=milliseconds(np.array(cold), 95.0), warm_p95=milliseconds(np.array(warm), 95.0)
    )


def time_first_tick(world: World, config: StackConfig) -> float:
    """Time the way from a world never seen to its first tick [ms]; median of five."""
    spent = []
    for number in range(5):
        changed = with_new_furniture(world, 100 + number)
        before = time.perf_counter()
        frames = Episode(changed, config).frames()
        next(frames)
        next(frames)
        spent.append(time.perf_counter() - before)
        frames.close()
    return milliseconds(np.array(spent), 50.0)


def time_engine(world: World, config: StackConfig, seconds: float) -> float:
    """Measure the engine's real-time factor alone: every robot drives a slow circle."""
    engine = registry.build("engine", config.engine)
    dt = 1.0 / config.control_rate
    people = np.array([human.route[0] for human in world.humans]).reshape(-1, 2)
    command = Command(twist=np.tile([0.1, 0.0, 0.5], (len(world.robots), 1)))
    still = np.zeros_like(people)
    try:
        engine.start(world, dt, people)
        ticks = round(seconds / dt)
        spent = timed(lambda: [engine.step(command, still) for _ in range(ticks)])
    finally:
        engine.close()
    return round(seconds / spent, 1)
