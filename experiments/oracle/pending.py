"""Scenes in which something is about to happen: services, openings, people who leave, late escapes.

Most of them look like deadlocks for a while and are none.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from shapely import unary_union
from shapely.geometry import box

from experiments.oracle.sampled import FOR_GOOD, Scene
from experiments.oracle.scripted import swap_tasks, swap_world
from experiments.oracle.stacks import any_stack, mixed_stack
from mrta_falsify.core.geometry import rectangle
from mrta_falsify.core.world import Blockage, HumanSpec, Resource, Task, World
from mrta_falsify.testing.floors import floor, robot, two_rooms
from mrta_falsify.testing.stacks import IN_TURN, stack

DEADLINE = 900.0  # s; ``worlds.case`` moves it beyond all continuations
LATEST_END = 200.0  # s, of what is in the way for a time: beyond the horizon


def pending_service(random: np.random.Generator) -> Scene:
    """Robots wait behind one that is served for long; it comes out past them, or cannot."""
    width = float(random.choice([0.9, 1.3, 2.0, 2.6]))
    count = int(random.integers(2, 5))
    world = two_rooms(box(-5.0, -width / 2, 5.0, width / 2))
    aside = max(0.0, width / 2 - 0.4)
    spots = np.array([[3.4, aside], [2.4, aside], [1.4, aside]])
    room = Resource(
        name="room1",
        kind="room",
        room=1,
        spots=spots if random.random() < 0.6 else spots - np.array([8.5, 0.0]),
        entry=np.zeros((0, 2)),
        request_area=np.array(box(-8.0, -2.0, 8.5, 2.0).exterior.coords)[:-1][::-1],
        release_area=np.array(box(4.4, -1.6, 8.5, 1.6).exterior.coords)[:-1][::-1],
    )
    places = [(6.5, 0.0), (-5.8, 0.6), (-5.8, -0.6), (-7.2, 0.0)]
    robots = tuple(robot(i, *places[i], 0.0) for i in range(count))
    service = float(random.uniform(30.0, 150.0))
    leaves = random.random() < 0.7
    first = Task(arrival=0.0, start=1, end=int(not leaves), deadline=DEADLINE, pickup_time=service)
    rest = tuple(
        Task(arrival=0.2, start=0, end=1, deadline=DEADLINE, dropoff_time=10.0)
        for _ in range(count - 1)
    )
    world = dataclasses.replace(world, resources=(room,), robots=robots, tasks=(first, *rest))
    return world, any_stack(random, allocator=IN_TURN)


def pending_opening(random: np.random.Generator) -> Scene:
    """A cart across the only way that is taken away late; robots on one side of it, or both."""
    width = float(random.choice([0.8, 1.2, 2.4]))
    world = swap_world(random, width)
    start = float(random.uniform(0.0, 8.0))
    x = float(random.uniform(-2.0, 2.0))
    end = float(random.uniform(40.0, LATEST_END)) if random.random() < 0.85 else FOR_GOOD
    cart = rectangle(0.4, width, (x, 0.0))
    event = Blockage(name="door", polygon=cart, start=start, end=end)
    robots = [*world.robots, robot(2, -7.3, 0.9, 0.0)]
    tasks = [*world.tasks, Task(arrival=3.0, start=0, end=1, deadline=DEADLINE)]
    pick = int(random.integers(3))
    keep = ((0,), (0, 2), (0, 1))[pick]
    fleet = tuple(dataclasses.replace(robots[k], name=f"robot{i + 1}") for i, k in enumerate(keep))
    orders = tuple(sorted((tasks[k] for k in keep), key=lambda task: task.arrival))
    world = dataclasses.replace(world, robots=fleet, tasks=orders, events=(event,))
    return world, any_stack(random, allocator=IN_TURN)


def pending_person(random: np.random.Generator) -> Scene:
    """A person who stands in the way and leaves late, with one or two robots before them."""
    width = float(random.choice([0.9, 1.2, 1.6]))
    world = swap_world(random, width)
    place = np.array([[float(random.uniform(-2.0, 2.0)), 0.0]])
    person = HumanSpec(name="h", route=place, leaves_at=float(random.uniform(30.0, LATEST_END)))
    count = int(random.integers(1, 3))
    world = dataclasses.replace(
        world, humans=(person,), robots=world.robots[:count], tasks=world.tasks[:count]
    )
    return world, any_stack(random, allocator=IN_TURN)


def late_escape(random: np.random.Generator) -> Scene:
    """Head-on in single file with one bay, far from where they meet: one has to back up a lot."""
    width = float(random.uniform(0.8, 1.2))
    half = float(random.uniform(5.0, 8.0))
    bay = float(random.choice([-1.0, 1.0]) * random.uniform(1.5, half - 1.0))
    deep = float(random.uniform(0.7, 1.3))
    passage = unary_union(
        [
            box(-half, -width / 2, half, width / 2),
            box(bay - 0.6, -width / 2, bay + 0.6, width / 2 + deep),
        ]
    )
    world = two_rooms(passage, side=width, gap=2.0 * half)
    robots = (robot(0, -half, 0.0, 0.0), robot(1, half, 0.0, np.pi))
    world = dataclasses.replace(world, robots=robots, tasks=swap_tasks(random))
    return world, mixed_stack(random, allocator=IN_TURN)


def slow_arrival(random: np.random.Generator) -> Scene:
    """Robots at a few centimetres a second that pass each other, follow each other, or cannot."""
    speed = float(random.uniform(0.05, 0.12))
    width = float(random.choice([0.8, 1.4, 2.0, 2.6]))
    world = two_rooms(box(-2.0, -width / 2, 2.0, width / 2), gap=4.0)
    opposed = random.random() < 0.5
    robots = (
        robot(0, -3.2, 0.0, 0.0, max_speed=speed),
        robot(1, 3.2, 0.0, np.pi, max_speed=speed)
        if opposed
        else robot(1, -4.2, 0.4, 0.0, max_speed=float(random.uniform(0.05, 1.5))),
    )
    tasks = tuple(
        Task(
            arrival=0.2,
            start=1 if opposed and i == 1 else 0,
            end=0 if opposed and i == 1 else 1,
            deadline=DEADLINE,
        )
        for i in range(2)
    )
    return dataclasses.replace(world, robots=robots, tasks=tasks), stack(allocator=IN_TURN)


def refuges(random: np.random.Generator) -> Scene:
    """A corridor in single file with a bay or two, and more robots than the bays take."""
    width = float(random.uniform(0.8, 1.2))
    side = float(random.choice([width, 2.0]))
    parts = [box(-4.5, -width / 2, 4.5, width / 2)]
    for x in random.uniform(-3.0, 3.0, int(random.integers(1, 3))):
        parts.append(box(x - 0.55, -width / 2, x + 0.55, width / 2 + 1.1))
    world = two_rooms(unary_union(parts), side=side, gap=9.0)
    end = 4.5 + side / 2
    places = [(-end, 0.0), (end, 0.0), (-3.3, 0.0), (3.3, 0.0), (0.0, 0.0)]
    count = int(random.integers(3, 6))
    idle = count == 5 or random.random() < 0.3
    robots = tuple(robot(i, *places[i], np.pi * (i % 2)) for i in range(count))
    tasks = tuple(
        Task(arrival=0.2, start=i % 2, end=(i + 1) % 2, deadline=DEADLINE)
        for i in range(count - idle)
    )
    world = dataclasses.replace(world, robots=robots, tasks=tasks)
    return world, mixed_stack(random, allocator=IN_TURN)


def parked_in_file(random: np.random.Generator) -> Scene:
    """Robots queue up behind an idle one that may be sent to a parking place, or may not."""
    width = float(random.uniform(0.8, 1.5))
    world = _file(width, float(random.choice([width, 2.6])))
    count = int(random.integers(2, 5))
    x = float(random.uniform(0.0, 3.0))
    robots = [robot(i, -5.8 + 0.9 * i, 0.0) for i in range(count - 1)]
    robots.append(robot(count - 1, x, 0.0, float(random.uniform(-np.pi, np.pi))))
    tasks = tuple(
        Task(arrival=0.2 + 0.5 * i, start=0, end=1, deadline=DEADLINE) for i in range(count - 1)
    )
    parking = np.array([[6.2, 0.0]]) if random.random() < 0.4 else np.zeros((0, 2))
    world = dataclasses.replace(world, robots=tuple(robots), tasks=tasks, parking=parking)
    return world, mixed_stack(random, allocator=IN_TURN)


def _file(width: float, side: float) -> World:
    """A corridor between a hall and an end room of ``side`` [m]."""
    hall, lane = box(-8.0, -1.5, -4.5, 1.5), box(-4.5, -width / 2, 4.0, width / 2)
    end = box(4.0, -side / 2, 7.0, side / 2)
    return floor(unary_union([hall, lane, end]), np.array([[-6.5, 0.0], [5.0, 0.0]]))
