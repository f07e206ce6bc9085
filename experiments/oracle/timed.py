"""Scenes with timers of 20 to 200 s: pauses, waits for a partner, people who stand about."""

from __future__ import annotations

import dataclasses

import numpy as np
from shapely.geometry import box

from experiments.oracle.sampled import Scene
from experiments.oracle.scripted import swap_world
from experiments.oracle.stacks import NEVER, any_stack, outside
from mrta_falsify.core.directives import StandStill, Wait, WalkTo
from mrta_falsify.core.world import HumanSpec, Task
from mrta_falsify.testing.floors import facing_robots, facing_rooms, floor, robot
from mrta_falsify.testing.stacks import IN_TURN

DEADLINE = 900.0  # s; ``worlds.case`` moves it beyond all continuations
SHORTEST, LONGEST = 20.0, 200.0  # s, of timers that end
AFTER = 60.0  # s that a run goes on after the last timer may have ended


def _patience(random: np.random.Generator, *, ends: float = 0.7) -> float:
    """A timer [s] that ends, or does not."""
    return float(random.uniform(SHORTEST, LONGEST)) if random.random() < ends else NEVER


def _horizon(timer: float) -> float:
    return 40.0 + AFTER + (timer if timer < NEVER else 0.0)


def timer_hall(random: np.random.Generator) -> Scene:
    """Robots side by side in a hall stand for a time, or until another one has been served."""
    count = int(random.integers(2, 4))
    rows = 1.5 * np.arange(count)
    points = np.array([(-6.0, y) for y in rows] + [(6.0, y) for y in rows])
    world = floor(box(-8.0, -1.5, 8.0, float(rows[-1]) + 1.5), points)
    patience = _patience(random)
    params: dict[str, float | str] = {"mark": float(random.uniform(1.0, 8.0)), "patience": patience}
    who = int(random.integers(1, 1 << count))
    pick = int(random.integers(3))
    if pick == 0:
        start = float(random.uniform(5.0, 18.0))
        timer: dict[str, float | str] = {
            "mode": "window",
            "who": who,
            "start": start,
            "end": start + patience,
        }
        timer["patience"] = 0.0
        params |= timer
    elif pick == 1:
        params |= {"mode": "mark", "who": who}
    else:
        params |= {"mode": "partner", **_partners(random, count)}
    return dataclasses.replace(
        world,
        robots=tuple(
            robot(i, -6.0 + float(random.uniform(0.0, 0.6)), y) for i, y in enumerate(rows)
        ),
        tasks=tuple(
            Task(
                arrival=float(random.uniform(0.2, 4.0)),
                start=i,
                end=count + i,
                deadline=DEADLINE,
                robot=f"robot{i + 1}",
            )
            for i in range(count)
        ),
        horizon=_horizon(patience),
    ), outside(random, "timers", **params)


def _partners(random: np.random.Generator, count: int) -> dict[str, float]:
    """For whom each robot waits: all in a ring, or anybody, or nobody."""
    if random.random() < 0.6:
        return {f"partner{i}": (i + 1) % count for i in range(count)}
    return {
        f"partner{i}": int(random.choice([k for k in range(-1, count) if k != i]))
        for i in range(count)
    }


def timer_file(random: np.random.Generator) -> Scene:
    """One robot stands in a corridor for a time; others come behind it, or towards it."""
    width = float(random.choice([0.9, 1.2, 2.2]))
    starts = [(-5.7, 0.0), (-6.9, 0.0)]
    if random.random() < 0.5:
        starts.append((-6.7, -1.1))
    if random.random() < 0.4:
        starts[1] = (5.7, 0.0)
    world = facing_rooms(box(-4.0, -width / 2, 4.0, width / 2), starts)
    patience = _patience(random, ends=0.75)
    mark = float(random.uniform(3.0, 6.5))
    arrivals = [0.2 + 3.0 * i for i in range(len(starts))]
    return dataclasses.replace(
        world, **facing_robots(starts, arrivals, DEADLINE), horizon=_horizon(patience)
    ), outside(random, "timers", mode="mark", who=1, mark=mark, patience=patience)


def person_waits(random: np.random.Generator) -> Scene:
    """A person walks into a corridor, stands there for a time, and walks on; or does not."""
    width = float(random.choice([0.9, 1.2, 1.6]))
    world = swap_world(random, width)
    x = float(random.uniform(-2.0, 2.0))
    stays = _patience(random, ends=0.85)
    here, there = np.array([x, 0.0]), np.array([6.8, 1.1])
    steps = [WalkTo(point=here), Wait(duration=stays), WalkTo(point=there)]
    if stays >= NEVER:
        steps = [WalkTo(point=here), StandStill()]
    person = HumanSpec(
        name="h", route=np.array([[x + 2.5, 0.0]]), reacts_to_robots=False, directives=tuple(steps)
    )
    count = int(random.integers(1, 3))
    world = dataclasses.replace(
        world,
        humans=(person,),
        robots=world.robots[:count],
        tasks=world.tasks[:count],
        horizon=_horizon(stays),
    )
    return world, any_stack(random, allocator=IN_TURN)
