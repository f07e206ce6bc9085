"""Scenes in which robots hold each other up: creeping pairs, chains behind a root, rings."""

from __future__ import annotations

import dataclasses

import numpy as np
from shapely import unary_union
from shapely.geometry import box

from experiments.oracle.sampled import FOR_GOOD, Scene
from experiments.oracle.scripted import swap_tasks
from experiments.oracle.stacks import mixed_stack
from mrta_falsify.core.config import Choice
from mrta_falsify.core.geometry import rectangle
from mrta_falsify.core.world import Blockage, CommsOutage, Event, Task, World
from mrta_falsify.testing.floors import floor, robot, two_rooms
from mrta_falsify.testing.stacks import BRAKE, IN_TURN, SHARED, SYMMETRIC, stack

DEADLINE = 900.0  # s; ``worlds.case`` moves it beyond all continuations


def creeping(random: np.random.Generator) -> Scene:
    """Head-on in a lane hardly wider than a robot, without a bay, under pairwise barriers."""
    width = float(random.uniform(0.65, 0.8))
    half = float(random.uniform(2.0, 5.0))
    side = float(random.choice([width, 1.6, 3.0]))
    lane = box(-half, -width / 2, half, width / 2)
    world = two_rooms(lane, side=side, gap=2.0 * half)
    away = half + side / 2
    robots = (robot(0, -away, 0.0, 0.0), robot(1, away, 0.0, np.pi))
    world = dataclasses.replace(world, robots=robots, tasks=swap_tasks(random))
    share = Choice("decentralised_cbf", {"share": float(random.uniform(0.3, 0.5))})
    controller = (SYMMETRIC, SYMMETRIC, share, SHARED, BRAKE)[int(random.integers(5))]
    return world, stack(controller, allocator=IN_TURN)


def chain(random: np.random.Generator) -> Scene:
    """A root that something stops for good, and one to four robots behind it in single file.

    Room 2 lies beside the corridor. Robots that want there are held up by the root alone, if it
    stands before the mouth; those that want to room 1 are held up by what stops the root, too.
    """
    width = float(random.uniform(0.8, 1.3))
    mouth = float(random.uniform(-2.0, 2.0))
    free = unary_union(
        [
            box(-11.0, -1.5, -5.0, 1.5),
            box(-5.0, -width / 2, 5.0, width / 2),
            box(5.0, -1.5, 8.0, 1.5),
            box(mouth - width / 2, 0.0, mouth + width / 2, width / 2 + 1.5),
            box(mouth - 1.0, width / 2 + 1.5, mouth + 1.0, width / 2 + 3.5),
        ]
    )
    rooms = np.array([[-8.0, 0.0], [6.5, 0.0], [mouth, width / 2 + 2.5]])
    world = floor(free, rooms)
    behind = int(random.integers(1, 5))
    places = [(-5.6, 0.0), (-6.8, 0.5), (-7.4, -0.5), (-8.6, 0.5), (-9.2, -0.5)]
    robots = tuple(robot(i, *places[i], 0.0) for i in range(behind + 1))
    to_side = float(random.choice([0.5, 1.0]))
    tasks = tuple(
        Task(
            arrival=0.2 if i == 0 else float(random.uniform(0.5, 4.0)),
            start=0,
            end=1 if i == 0 or random.random() > to_side else 2,
            deadline=DEADLINE,
        )
        for i in range(behind + 1)
    )
    event = _stopper(random, mouth, width)
    world = dataclasses.replace(world, robots=robots, tasks=tasks, events=(event,))
    return world, mixed_stack(random, allocator=IN_TURN)


def _stopper(random: np.random.Generator, mouth: float, width: float) -> Event:
    """What stops the root: a cart across its way, or a link that fails, mostly for good."""
    end = FOR_GOOD if random.random() < 0.8 else float(random.uniform(40.0, 110.0))
    if random.random() < 0.7:
        x = mouth + float(random.uniform(0.3, 2.0))
        cart = rectangle(0.4, width, (x, 0.0))
        return Blockage(name="cart", polygon=cart, start=0.1, end=end)
    link = ("states", "leader", "planner")[int(random.integers(3))]
    start = float(random.uniform(6.0, 20.0))
    return CommsOutage(name="out", robots=("robot1",), links=(link,), start=start, end=end)


def ring_of_niches(random: np.random.Generator) -> Scene:
    """Three to five robots in niches beside a corridor, each of which wants the next one's."""
    count = int(random.integers(3, 6))
    width = float(random.uniform(0.75, 1.6))
    niche = float(random.uniform(0.75, 1.2))
    step = float(random.uniform(1.4, 2.4))
    deep = float(random.uniform(0.9, 1.5))
    xs = step * np.arange(count)
    parts = [box(-niche / 2, 0.0, xs[-1] + niche / 2, width)]
    parts += [box(x - niche / 2, width, x + niche / 2, width + deep) for x in xs]
    points = np.stack([xs, np.full(count, width + deep / 2)], axis=1)
    world = floor(unary_union(parts), points)
    robots = tuple(robot(i, *points[i], float(random.uniform(-np.pi, np.pi))) for i in range(count))
    return _exchange(random, dataclasses.replace(world, robots=robots))


def loop(random: np.random.Generator) -> Scene:
    """Three or four robots on a loop of single file, some of them against the others' way."""
    count = int(random.integers(3, 5))
    width = float(random.uniform(0.75, 1.2))
    side = float(random.uniform(3.0, 5.0))
    outer = box(-width / 2, -width / 2, side + width / 2, side + width / 2)
    inner = box(width / 2, width / 2, side - width / 2, side - width / 2)
    points = side * np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    world = floor(outer.difference(inner), points)
    robots = tuple(robot(i, *points[i], float(random.uniform(-np.pi, np.pi))) for i in range(count))
    return _exchange(random, dataclasses.replace(world, robots=robots))


def _exchange(random: np.random.Generator, world: World) -> Scene:
    """Let each robot load where it stands, and deliver at the next one's place, or the last's."""
    count = len(world.robots)
    turns = 1 if random.random() < 0.7 else count - 1
    loading = float(random.choice([0.0, 3.0]))
    tasks = tuple(
        Task(
            arrival=0.2,
            start=i,
            end=(i + (turns if random.random() < 0.85 else 1)) % count,
            deadline=DEADLINE,
            pickup_time=loading,
        )
        for i in range(count)
    )
    return dataclasses.replace(world, tasks=tasks), mixed_stack(random, allocator=IN_TURN)
