"""Scripted scenes: one situation each, with random lengths, times and stacks."""

from __future__ import annotations

import dataclasses

import numpy as np
from shapely import unary_union
from shapely.geometry import box

from experiments.oracle.sampled import Scene, ward
from experiments.oracle.stacks import any_stack
from mrta_falsify.core.geometry import rectangle
from mrta_falsify.core.world import Blockage, CommsOutage, HumanSpec, Resource, Task, World
from mrta_falsify.testing.floors import HORIZON, floor, robot, two_rooms
from mrta_falsify.testing.planted import PLANTS
from mrta_falsify.testing.stacks import IN_TURN, SHARED, SYMMETRIC, stack


def swap_tasks(random: np.random.Generator, rounds: int = 1) -> tuple[Task, ...]:
    """One task each way, ``rounds`` times."""
    tasks = []
    for k in range(rounds):
        for start, end in ((0, 1), (1, 0)):
            late = float(random.uniform(0.0, 3.0)) if k == 0 else 60.0 * k
            tasks.append(Task(arrival=late, start=start, end=end, deadline=900.0))
    return tuple(tasks)


def swap_world(random: np.random.Generator, width: float, **more: float) -> World:
    """A robot in each of two rooms that wants to the other one."""
    world = two_rooms(box(-5.0, -width / 2, 5.0, width / 2))
    shift = random.uniform(-0.2, 0.2, 4)
    robots = (
        robot(0, -6.5 + shift[0], shift[1], 0.0, **more),
        robot(1, 6.5 + shift[2], shift[3], np.pi, **more),
    )
    return dataclasses.replace(world, robots=robots, tasks=swap_tasks(random))


def corridor_swap(random: np.random.Generator) -> Scene:
    """Head-on in a corridor, from single file to wide enough to pass."""
    width = float(random.choice([0.8, 1.0, 1.2, 1.5, 2.0, 2.6]))
    return swap_world(random, width), any_stack(random)


def corridor_many(random: np.random.Generator) -> Scene:
    """Two against one, or two against two, in a corridor."""
    world = swap_world(random, float(random.choice([0.9, 1.2, 1.6, 2.4])))
    robots = list(world.robots)
    robots.append(robot(2, -7.3, 0.9, 0.0))
    if random.random() < 0.5:
        robots.append(robot(3, 7.3, -0.9, np.pi))
    tasks = (*world.tasks, *swap_tasks(random))
    return dataclasses.replace(world, robots=tuple(robots), tasks=tasks), any_stack(random)


def doorway(random: np.random.Generator) -> Scene:
    """Two halls joined by a door; both robots want through."""
    width = float(random.choice([0.8, 1.0, 1.3, 1.8]))
    world = two_rooms(box(-0.15, -width / 2, 0.15, width / 2), side=5.0, gap=0.3)
    shift = random.uniform(-0.3, 0.3, 4)
    robots = (
        robot(0, -2.7 + shift[0], shift[1], 0.0),
        robot(1, 2.7 + shift[2], shift[3], np.pi),
    )
    world = dataclasses.replace(world, robots=robots, tasks=swap_tasks(random))
    return world, any_stack(random)


def niches(random: np.random.Generator) -> Scene:
    """A corridor whose rooms are no wider than itself: two to four robots, no passing place.

    Or, for some of them, one: a bay beside the corridor.
    """
    width = float(random.choice([0.8, 0.9, 1.1, 1.4]))
    passage = box(-4.0, -width / 2, 4.0, width / 2)
    if random.random() < 0.3:
        x = float(random.uniform(-2.0, 2.0))
        passage = unary_union([passage, box(x - 0.6, -width / 2, x + 0.6, width / 2 + 1.1)])
    world = two_rooms(passage, side=width, gap=8.0)
    robots = [robot(0, -4.0, 0.0, 0.0), robot(1, 4.0, 0.0, np.pi)]
    tasks = swap_tasks(random)
    if random.random() < 0.4:
        robots.append(robot(2, -2.5, 0.0, 0.0))
        tasks = (*tasks, Task(arrival=1.0, start=0, end=1, deadline=900.0))
    order = tuple(sorted(tasks[:2], key=lambda task: task.start)) + tasks[2:]
    same = tuple(dataclasses.replace(task, arrival=0.5) for task in order)
    world = dataclasses.replace(world, robots=tuple(robots), tasks=same)
    return world, any_stack(random, allocator=IN_TURN)


def four_way(random: np.random.Generator) -> Scene:
    """A crossing of two corridors; three or four robots, each straight across."""
    width = float(random.choice([0.9, 1.2, 1.6, 2.2]))
    side = float(random.choice([width, 2.4]))
    arms = [(-4.0, 0.0), (0.0, -4.0), (4.0, 0.0), (0.0, 4.0)]
    cross = [box(-4.0, -width / 2, 4.0, width / 2), box(-width / 2, -4.0, width / 2, 4.0)]
    ends = [box(x - side / 2, y - side / 2, x + side / 2, y + side / 2) for x, y in arms]
    world = floor(unary_union([*cross, *ends]), np.array(arms))
    count = int(random.integers(3, 5))
    robots = tuple(robot(i, *arms[i], i * np.pi / 2) for i in range(count))
    tasks = tuple(Task(arrival=0.5, start=i, end=(i + 2) % 4, deadline=900.0) for i in range(count))
    pick = int(random.integers(3))
    layers = {"allocator": IN_TURN}
    config = (
        any_stack(random, **layers) if pick == 0 else stack((SHARED, SYMMETRIC)[pick - 1], **layers)
    )
    return dataclasses.replace(world, robots=robots, tasks=tasks), config


def slow(random: np.random.Generator) -> Scene:
    """Robots that creep."""
    speed = float(random.uniform(0.05, 0.15))
    world = swap_world(random, 2.6, max_speed=speed)
    return dataclasses.replace(world, tasks=world.tasks[:1], horizon=120.0), stack()


def human(random: np.random.Generator) -> Scene:
    """A person stands in a corridor for a while, or walks it up and down, or stays."""
    width = float(random.choice([1.0, 1.4, 2.0]))
    world = swap_world(random, width)
    pick = int(random.integers(3))
    place = np.array([[float(random.uniform(-2.0, 2.0)), 0.0]])
    if pick == 0:
        leaves = float(random.uniform(40.0, 90.0))
        person = HumanSpec(name="h", route=place, leaves_at=leaves)
    elif pick == 1:
        route = np.array([[-4.0, 0.0], [4.0, 0.0]])
        person = HumanSpec(name="h", route=route, reacts_to_robots=bool(random.random() < 0.5))
    else:
        person = HumanSpec(name="h", route=place)
    world = dataclasses.replace(
        world, humans=(person,), robots=world.robots[:1], tasks=world.tasks[:1]
    )
    return world, stack()


def no_task(random: np.random.Generator) -> Scene:
    """Long waits for tasks, several robots close together."""
    world = swap_world(random, 2.0)
    arrival = float(random.uniform(30.0, 60.0))
    task = Task(arrival=arrival, start=0, end=1, deadline=900.0, pickup_time=10.0)
    robots = (*world.robots, robot(2, -5.8, 0.5, 0.0))
    return dataclasses.replace(world, robots=robots, tasks=(task,)), any_stack(random)


def blocked(random: np.random.Generator) -> Scene:
    """Furniture appears on the way, for good or for a time; with or without a gap beside it."""
    width = float(random.choice([1.0, 1.6, 2.4]))
    world = swap_world(random, width)
    start = float(random.uniform(0.0, 12.0))
    end = float(random.choice([start + random.uniform(15.0, 60.0), 1e6]))
    size = float(random.choice([width, width, max(0.3, width - 1.2)]))
    middle = float(random.uniform(-2.0, 2.0))
    cart = rectangle(0.5, size, (middle, (width - size) / 2))
    event = Blockage(name="cart", polygon=cart, start=start, end=end)
    one = bool(random.random() < 0.5)
    world = dataclasses.replace(
        world,
        events=(event,),
        robots=world.robots[:1] if one else world.robots,
        tasks=world.tasks[:1] if one else world.tasks,
    )
    return world, any_stack(random)


def outage(random: np.random.Generator) -> Scene:
    """Links fail for a time, or for good, while two robots pass in a corridor."""
    world = swap_world(random, float(random.choice([1.2, 2.4])))
    start = float(random.uniform(0.0, 10.0))
    end = float(random.choice([start + 30.0, 1e6]))
    robots = (("robot1",), ("robot2",), ())[int(random.integers(3))]
    link = ("dispatcher", "planner", "states", "leader")[int(random.integers(4))]
    event = CommsOutage(name="out", robots=robots, links=(link,), start=start, end=end)
    return dataclasses.replace(world, events=(event,)), any_stack(random)


def queue(random: np.random.Generator) -> Scene:
    """Everybody wants the same room."""
    robots = int(random.integers(3, 6))
    world = ward(random, rooms=3, robots=robots, tasks=0)
    tasks = tuple(
        Task(arrival=0.0, start=0, end=int(random.integers(0, 3)), deadline=900.0, pickup_time=12.0)
        for _ in range(robots + 1)
    )
    return dataclasses.replace(world, tasks=tasks), any_stack(random)


def queue_mouth(random: np.random.Generator) -> Scene:
    """A room at the end of a corridor in which the waiters stand: can the one inside get out?"""
    width = float(random.choice([0.9, 1.2, 1.8, 2.4]))
    world = two_rooms(box(-5.0, -width / 2, 5.0, width / 2), side=3.0)
    near = np.array(box(-1.0, -2.0, 8.5, 2.0).exterior.coords)[:-1][::-1]
    room = Resource(
        name="room1",
        kind="room",
        room=1,
        spots=np.array([[3.6, 0.0], [2.6, 0.0], [1.6, 0.0]]),
        entry=np.zeros((0, 2)),
        request_area=near,
        release_area=np.array(box(4.4, -1.6, 8.5, 1.6).exterior.coords)[:-1][::-1],
    )
    count = int(random.integers(2, 5))
    starts = [(6.5, 0.0), (-6.0, 0.6), (-6.0, -0.6), (-7.2, 0.0)]
    robots = tuple(robot(i, *starts[i], np.pi if i == 0 else 0.0) for i in range(count))
    service = float(random.choice([5.0, 15.0]))
    tasks = tuple(
        Task(
            arrival=0.0,
            start=1 if i == 0 else 0,
            end=0 if i == 0 else 1,
            deadline=900.0,
            pickup_time=service if i == 0 else 0.0,
            dropoff_time=0.0 if i == 0 else service,
        )
        for i in range(count)
    )
    world = dataclasses.replace(world, resources=(room,), robots=robots, tasks=tasks)
    return world, any_stack(random, allocator=IN_TURN)


def cork(random: np.random.Generator) -> Scene:
    """An idle robot stands in the corridor; it has no parking place, or one far ahead."""
    width = float(random.choice([0.9, 1.3, 2.0]))
    half = float(random.choice([width, 3.0]))
    world = two_rooms(box(-4.0, -width / 2, 4.0, width / 2), side=half, gap=8.0)
    x = float(random.uniform(-1.0, 3.0))
    robots = [robot(0, -4.0 - half / 2, 0.0, 0.0), robot(1, x, 0.0, float(random.uniform(-3, 3)))]
    if random.random() < 0.5:
        robots.append(robot(2, -2.5, 0.0, 0.0))
    tasks = (Task(arrival=0.0, start=0, end=1, deadline=900.0),)
    world = dataclasses.replace(world, robots=tuple(robots), tasks=tasks, lanes=())
    return world, any_stack(random, allocator=IN_TURN)


def room_exchange(random: np.random.Generator) -> Scene:
    """Each robot stands in a room and wants the next one's."""
    rooms = int(random.integers(2, 5))
    world = ward(random, rooms=rooms, robots=rooms, tasks=0)
    robots = tuple(
        robot(i, *world.rooms[i].point, float(random.uniform(-np.pi, np.pi))) for i in range(rooms)
    )
    tasks = tuple(
        Task(arrival=0.0, start=i, end=(i + 1) % rooms, deadline=900.0, pickup_time=3.0)
        for i in range(rooms)
    )
    return dataclasses.replace(world, robots=robots, tasks=tasks), any_stack(random)


def long_resource(random: np.random.Generator) -> Scene:
    """The corridor between two rooms is itself a resource for one robot."""
    world = swap_world(random, float(random.choice([0.9, 1.2])))
    area = np.array(box(-5.2, -1.0, 5.2, 1.0).exterior.coords)[:-1][::-1]
    near = np.array(box(-8.0, -1.5, 8.0, 1.5).exterior.coords)[:-1][::-1]
    resource = Resource(
        name="bottleneck",
        kind="corridor",
        spots=np.array([[-5.6, 1.0], [5.6, 1.0]]),
        entry=np.zeros((0, 2)),
        request_area=near,
        release_area=area,
    )
    return dataclasses.replace(world, resources=(resource,)), any_stack(random)


def plants(random: np.random.Generator) -> Scene:
    """Worlds of the planted defects that hold robots up, with the defect."""
    names = (
        "same_room_twice_stalls",
        "fourth_waiter_dropped",
        "planner_failure_blocks_all",
        "fixed_priority_starves",
        "room_freed_while_parked",
        "queue_release_loses_exclusion",
    )
    name = names[int(random.integers(len(names)))]
    world = PLANTS[name].world(int(random.integers(1, 1000)))
    return dataclasses.replace(world, horizon=HORIZON), stack(defects=(name,))
