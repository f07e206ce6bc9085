"""Scenes in which something that comes from outside may free robots: tasks, openings.

Robots of a foreign stack drive until another one stands before them; an idle one never moves.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from shapely import unary_union
from shapely.geometry import box

from experiments.oracle.pending import DEADLINE, LATEST_END
from experiments.oracle.sampled import FOR_GOOD, Scene
from experiments.oracle.stacks import NEVER, any_stack, outside
from mrta_falsify.core.geometry import rectangle
from mrta_falsify.core.world import Blockage, Task, World
from mrta_falsify.testing.floors import facing_robots, facing_rooms, floor, robot
from mrta_falsify.testing.stacks import IN_TURN

AFTER = 60.0  # s that a run goes on after the last arrival


def _idle_in_the_way(random: np.random.Generator) -> World:
    """A corridor with a hall at one end and a room at the other, an idle robot in between.

    A task for the idle robot arrives 30 to 200 s later, or for the one behind it, or none. The
    idle robot's task leads it on, or back towards the others.
    """
    width = float(random.uniform(0.8, 1.2))
    hall, lane = box(-8.0, -1.5, -4.5, 1.5), box(-4.5, -width / 2, 4.0, width / 2)
    end = box(4.0, -1.5, 7.0, 1.5)
    points = np.array([[-6.5, 0.0], [-7.3, 0.8], [6.4, 1.0], [6.4, 0.0], [6.4, -1.0]])
    world = floor(unary_union([hall, lane, end]), points)
    count = int(random.integers(2, 4))
    robots = [robot(i, *points[i], 0.0) for i in range(count - 1)]
    robots.append(robot(count - 1, float(random.uniform(0.0, 3.0)), 0.0))
    tasks = [
        Task(arrival=0.2 + 0.5 * i, start=i, end=2 + i, deadline=DEADLINE, robot=f"robot{i + 1}")
        for i in range(count - 1)
    ]
    arrival = float(random.uniform(30.0, LATEST_END))
    pick = random.random()
    idle, last = f"robot{count}", len(points) - 1
    if pick < 0.65:
        tasks.append(Task(arrival=arrival, start=last, end=last, deadline=DEADLINE, robot=idle))
    elif pick < 0.78:
        tasks.append(Task(arrival=arrival, start=0, end=last, deadline=DEADLINE, robot=idle))
    elif pick < 0.9:
        tasks.append(Task(arrival=arrival, start=0, end=last, deadline=DEADLINE, robot="robot1"))
    return dataclasses.replace(
        world, robots=tuple(robots), tasks=tuple(tasks), horizon=arrival + AFTER
    )


def arrival_frees(random: np.random.Generator) -> Scene:
    """An idle robot in the way that may get a task, with the shipped stack."""
    return _idle_in_the_way(random), any_stack(random, allocator=IN_TURN)


def arrival_frees_outside(random: np.random.Generator) -> Scene:
    """The same with a foreign stack."""
    return _idle_in_the_way(random), outside(random, "lanes")


def opening_outside(random: np.random.Generator) -> Scene:
    """A cart across the only way of one or two robots in file, taken away late, or never."""
    width = float(random.choice([0.8, 1.2]))
    starts = [(-5.5, 0.0), (-6.6, 0.0)][: int(random.integers(1, 3))]
    world = facing_rooms(box(-4.0, -width / 2, 4.0, width / 2), starts)
    end = float(random.uniform(40.0, LATEST_END)) if random.random() < 0.7 else FOR_GOOD
    cart = rectangle(0.4, width, (float(random.uniform(-1.0, 2.5)), 0.0))
    event = Blockage(name="cart", polygon=cart, start=float(random.uniform(0.0, 6.0)), end=end)
    return dataclasses.replace(
        world,
        **facing_robots(starts, [0.2 + i for i in range(len(starts))], DEADLINE),
        events=(event,),
        horizon=AFTER + (end if end < FOR_GOOD else 40.0),
    ), outside(random, "lanes")


def lane_pair(random: np.random.Generator) -> Scene:
    """Head-on in a corridor, maybe with one more behind; one goes back after a time, or none."""
    width = float(random.choice([0.8, 1.0, 1.2, 1.2, 2.6]))
    half = float(random.uniform(2.5, 5.0))
    starts = [(-half - 1.7, 0.9), (half + 1.7, -0.9)]
    arrivals = [float(late) for late in random.uniform(0.0, 3.0, 2)]
    if random.random() < 0.4:
        west = bool(random.random() < 0.5)
        starts.append(((-1.0 if west else 1.0) * (half + 2.9), 0.0))
        arrivals.append(float(random.uniform(3.0, 6.0)))
    world = facing_rooms(box(-half, -width / 2, half, width / 2), starts, gap=2.0 * half)
    patience = float(random.uniform(20.0, 150.0)) if random.random() < 0.45 else NEVER
    return dataclasses.replace(
        world,
        **facing_robots(starts, arrivals, DEADLINE),
        horizon=90.0 + (patience if patience < NEVER else 0.0),
    ), outside(random, "lanes", patience=patience)
