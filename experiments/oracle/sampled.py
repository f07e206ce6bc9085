"""Sampled worlds: nothing is arranged; the stack's own runs on wards and in mazes."""

from __future__ import annotations

import dataclasses

import numpy as np

from experiments.oracle.stacks import any_stack, weak_stack
from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.core.geometry import rectangle
from mrta_falsify.core.world import Blockage, Event, HumanSpec, Task, World
from mrta_falsify.testing.floors import HORIZON, maze, robot
from mrta_falsify.testing.stacks import BRAKE, IN_TURN, stack
from mrta_falsify.testing.wards import ward_layout

Scene = tuple[World, StackConfig]
FOR_GOOD = 1e6  # s
DEFECTS = (
    "queue_release_loses_exclusion",
    "room_freed_while_parked",
    "same_room_twice_stalls",
    "planner_failure_blocks_all",
    "fourth_waiter_dropped",
    "fixed_priority_starves",
    "follower_zero_command",
)


def ward(random: np.random.Generator, *, rooms: int, robots: int, tasks: int) -> World:
    """A ward with ``robots`` anywhere and a stream of ``tasks``."""
    layout = ward_layout(
        rooms=rooms,
        two_sided=bool(random.random() < 0.5),
        corridor_width=float(random.choice([2.6, 3.2, 4.0])),
        door_width=float(random.choice([0.9, 1.1, 1.4])),
        spots=int(random.integers(2, 4)),
    )
    starts = [room.point for room in layout.rooms] + list(layout.parking)
    order = random.permutation(len(starts))[:robots]
    fleet = tuple(
        robot(i, *starts[k], float(random.uniform(-np.pi, np.pi))) for i, k in enumerate(order)
    )
    stream = _stream(random, rooms, tasks, arrivals=20.0)
    return dataclasses.replace(layout, robots=fleet, tasks=stream, horizon=HORIZON)


def _stream(
    random: np.random.Generator, rooms: int, tasks: int, *, arrivals: float
) -> tuple[Task, ...]:
    stream = []
    for _ in range(tasks):
        start, end = (int(k) for k in random.integers(0, rooms, 2))
        arrival = float(random.choice([0.0, 0.0, random.uniform(0.0, arrivals)]))
        stream.append(
            Task(
                arrival=arrival,
                start=start,
                end=end,
                deadline=900.0,
                pickup_time=float(random.choice([0.0, 5.0, 15.0])),
                dropoff_time=float(random.choice([0.0, 5.0, 15.0])),
            )
        )
    return tuple(stream)


def _any_ward(random: np.random.Generator) -> World:
    return ward(
        random,
        rooms=int(random.integers(2, 5)),
        robots=int(random.integers(2, 6)),
        tasks=int(random.integers(4, 8)),
    )


def sampled(random: np.random.Generator) -> Scene:
    """The default stack's own runs on sampled wards."""
    return _any_ward(random), stack()


def sampled_weak(random: np.random.Generator) -> Scene:
    """The same under controllers that do not plan for others."""
    return _any_ward(random), weak_stack(random)


def sampled_planted(random: np.random.Generator) -> Scene:
    """The same with one planted defect."""
    world = _any_ward(random)
    return world, stack(defects=(DEFECTS[int(random.integers(len(DEFECTS)))],))


def sampled_events(random: np.random.Generator) -> Scene:
    """The same with things put down on the way, and people who stand about or walk."""
    world = _any_ward(random)
    places = [room.point for room in world.rooms] + [room.door.mean(axis=0) for room in world.rooms]
    middle = world.bounds[:2] + 0.5 * (world.bounds[2:] - world.bounds[:2])
    taken = [spec.pose[:2] for spec in world.robots]
    places = [
        p for p in (*places, middle) if min(np.hypot(*(np.array(taken) - p).T), default=9.0) > 1.0
    ]
    events: list[Event] = []
    humans: list[HumanSpec] = []
    for k in range(int(random.integers(1, 4))):
        place = places[int(random.integers(len(places)))] + random.uniform(-0.3, 0.3, 2)
        start = float(random.uniform(0.0, 40.0))
        stays = float(random.choice([random.uniform(20.0, 50.0), FOR_GOOD]))
        pick = random.random()
        if pick < 0.6:
            length, width = (float(s) for s in random.uniform(0.4, 1.2, 2))
            cart = rectangle(length, width, tuple(place))
            events.append(
                Blockage(name=f"cart{k}", polygon=cart, start=start + 2.0, end=start + stays)
            )
        elif pick < 0.8:
            humans.append(HumanSpec(name=f"h{k}", route=place[None], leaves_at=20.0 + stays))
        else:
            others = [places[int(n)] for n in random.integers(0, len(places), 2)]
            humans.append(HumanSpec(name=f"h{k}", route=np.array([place, *others])))
    world = dataclasses.replace(world, events=tuple(events), humans=tuple(humans))
    return world, any_stack(random)


def _any_maze(random: np.random.Generator) -> World:
    world = maze(random)
    rooms = len(world.rooms)
    count = int(random.integers(2, rooms + 1))
    order = random.permutation(rooms)[:count]
    robots = tuple(
        robot(i, *world.rooms[k].point, float(random.uniform(-np.pi, np.pi)))
        for i, k in enumerate(order)
    )
    tasks = _stream(random, rooms, int(random.integers(count, count + 4)), arrivals=20.0)
    return dataclasses.replace(world, robots=robots, tasks=tasks)


def maze_default(random: np.random.Generator) -> Scene:
    """Narrow corridors, the default stack, tasks in turn or by the allocator."""
    world = _any_maze(random)
    allocator = IN_TURN if random.random() < 0.6 else Choice("insertion")
    return world, stack(allocator=allocator)


def maze_weak(random: np.random.Generator) -> Scene:
    """The same under controllers that do not plan for others."""
    return _any_maze(random), weak_stack(random, allocator=IN_TURN)


def maze_brake(random: np.random.Generator) -> Scene:
    """The same under MRTA-Sim's scheme."""
    return _any_maze(random), stack(BRAKE, allocator=IN_TURN)
