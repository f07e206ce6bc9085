"""Scripted and sampled worlds in which robots may or may not block each other for ever.

Nothing here says which is which: labels are made by continuation (``labels.py``).
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from shapely import unary_union
from shapely.geometry import Polygon, box

from mrta_falsify.core import seeding
from mrta_falsify.core.arrays import frozen_array
from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.core.geometry import rectangle
from mrta_falsify.core.world import (
    Blockage,
    CommsOutage,
    HumanSpec,
    Lane,
    Resource,
    RobotSpec,
    Room,
    Task,
    Wall,
    World,
)
from scenic_worlds.layouts.ward import ward_layout

HORIZON = 240.0


@dataclass(frozen=True)
class Case:
    """One run to label."""

    name: str
    kind: str
    world: World
    config: StackConfig


def cases(per_kind: int = 20, kinds: tuple[str, ...] = ()) -> Iterator[Case]:
    """All cases, ``per_kind`` of each kind, the same at every call."""
    for kind in kinds or tuple(KINDS):
        for number in range(per_kind):
            random = seeding.stream(number, f"oracle/{kind}")
            world, config = KINDS[kind](random)
            tasks = tuple(sorted(world.tasks, key=lambda task: task.arrival))
            world = dataclasses.replace(world, seed=number, tasks=tasks)
            yield Case(f"{kind}/{number}", kind, world, config)


def _config(*, brake: bool = False, defects: tuple[str, ...] = (), **more: str) -> StackConfig:
    options = {"followers": "brake"} if brake else {}
    layers = {name: Choice(value) for name, value in more.items()}
    controller = layers.pop("controller", Choice("cluster_cbf", options))
    return StackConfig(
        engine=Choice("kinematic"), controller=controller, defects=tuple(sorted(defects)), **layers
    )


def _any_stack(random: np.random.Generator) -> StackConfig:
    pick = int(random.integers(4))
    if pick == 0:
        return _config(controller="decentralised_cbf")
    if pick == 1:
        return _config(priority_rule="distance_to_goal")
    return _config(brake=pick == 2)


# --- two rooms and what lies between them ----------------------------------------------


def _two_rooms(passage: Polygon, *, side: float = 3.0, gap: float = 10.0) -> World:
    """West room 0 and east room 1, ``gap`` apart, joined by ``passage``."""
    half = gap / 2
    west = box(-half - side, -side / 2, -half, side / 2)
    east = box(half, -side / 2, half + side, side / 2)
    free = unary_union([west, east, passage])
    rim = 0.5
    outside = (-half - side - rim, -side / 2 - rim, half + side + rim, side / 2 + rim)
    points = np.array([[-half - side / 2, 0.0], [half + side / 2, 0.0]])
    doors = np.array([[-half + 0.3, 0.0], [half - 0.3, 0.0]])
    lanes = []
    for start, end in ((0, 1), (1, 0)):
        way = np.array([doors[start], doors[end], points[end]])
        lanes.append(Lane(start=start, end=end, to_queue=way, to_room=way))
    seconds = np.ceil((gap + side) / 0.69 + 5.0)
    areas = [np.array(room.exterior.coords)[:-1] for room in (west, east)]
    return World(
        name="two_rooms",
        bounds=frozen_array(outside),
        walls=tuple(_walls(outside, free)),
        rooms=tuple(
            Room(name=f"end{i}", point=points[i], door=np.zeros((0, 2)), area=areas[i])
            for i in range(2)
        ),
        lanes=tuple(lanes),
        travel_times=frozen_array([[0.0, seconds], [seconds, 0.0]]),
        horizon=HORIZON,
    )


def _walls(outside: tuple[float, float, float, float], free: Polygon) -> Iterator[Wall]:
    x_min, y_min, x_max, y_max = outside
    xs = sorted({x_min, x_max, *(round(float(x), 6) for x, _ in free.exterior.coords)})
    number = itertools.count()
    for left, right in itertools.pairwise(xs):
        column = box(left + 1e-5, y_min, right - 1e-5, y_max).difference(free)
        for part in getattr(column, "geoms", [column]):
            if part.area > 1e-4:
                piece = box(left, part.bounds[1], right, part.bounds[3])
                corners = np.array(piece.exterior.coords)[:-1][::-1]
                yield Wall(name=f"wall_{next(number)}", polygon=corners)


def _robot(number: int, x: float, y: float, yaw: float, **more: float) -> RobotSpec:
    return RobotSpec(name=f"robot{number + 1}", pose=np.array([x, y, yaw]), **more)


def _swap_tasks(random: np.random.Generator, rounds: int = 1, service: float = 0.0) -> tuple:
    tasks = []
    for k in range(rounds):
        arrival = 60.0 * k
        for start, end in ((0, 1), (1, 0)):
            late = float(random.uniform(0.0, 3.0)) if k == 0 else 0.0
            tasks.append(
                Task(
                    arrival=arrival + late,
                    start=start,
                    end=end,
                    deadline=900.0,
                    pickup_time=service,
                    dropoff_time=service,
                )
            )
    return tuple(tasks)


def _swap_world(random: np.random.Generator, width: float, **more: float) -> World:
    world = _two_rooms(box(-5.0, -width / 2, 5.0, width / 2))
    shift = random.uniform(-0.2, 0.2, 4)
    robots = (
        _robot(0, -6.5 + shift[0], shift[1], 0.0, **more),
        _robot(1, 6.5 + shift[2], shift[3], np.pi, **more),
    )
    return dataclasses.replace(world, robots=robots, tasks=_swap_tasks(random))


def corridor_swap(random: np.random.Generator) -> tuple[World, StackConfig]:
    """Head-on in a corridor, from single file to wide enough to pass."""
    width = float(random.choice([0.8, 1.0, 1.2, 1.5, 2.0, 2.6]))
    return _swap_world(random, width), _any_stack(random)


def corridor_many(random: np.random.Generator) -> tuple[World, StackConfig]:
    """Two against one, or two against two, in a corridor."""
    world = _swap_world(random, float(random.choice([0.9, 1.2, 1.6, 2.4])))
    robots = list(world.robots)
    robots.append(_robot(2, -7.3, 0.9, 0.0))
    if random.random() < 0.5:
        robots.append(_robot(3, 7.3, -0.9, np.pi))
    tasks = (*world.tasks, *_swap_tasks(random))
    return dataclasses.replace(world, robots=tuple(robots), tasks=tasks), _any_stack(random)


def doorway(random: np.random.Generator) -> tuple[World, StackConfig]:
    """Two halls joined by a door; both robots want through."""
    width = float(random.choice([0.8, 1.0, 1.3, 1.8]))
    world = _two_rooms(box(-0.15, -width / 2, 0.15, width / 2), side=5.0, gap=0.3)
    shift = random.uniform(-0.3, 0.3, 4)
    robots = (
        _robot(0, -2.7 + shift[0], shift[1], 0.0),
        _robot(1, 2.7 + shift[2], shift[3], np.pi),
    )
    world = dataclasses.replace(world, robots=robots, tasks=_swap_tasks(random))
    return world, _any_stack(random)


def slow(random: np.random.Generator) -> tuple[World, StackConfig]:
    """Robots that creep."""
    speed = float(random.uniform(0.05, 0.15))
    world = _swap_world(random, 2.6, max_speed=speed)
    return dataclasses.replace(world, tasks=world.tasks[:1], horizon=150.0), _config()


def human_in_the_way(random: np.random.Generator) -> tuple[World, StackConfig]:
    """A person stands in a corridor for a while, or walks it up and down, or stays."""
    width = float(random.choice([1.0, 1.4, 2.0]))
    world = _swap_world(random, width)
    pick = int(random.integers(3))
    place = np.array([[float(random.uniform(-2.0, 2.0)), 0.0]])
    if pick == 0:
        leaves = float(random.uniform(40.0, 90.0))
        human = HumanSpec(name="h", route=place, leaves_at=leaves)
    elif pick == 1:
        route = np.array([[-4.0, 0.0], [4.0, 0.0]])
        human = HumanSpec(name="h", route=route, reacts_to_robots=bool(random.random() < 0.5))
    else:
        human = HumanSpec(name="h", route=place)
    world = dataclasses.replace(
        world, humans=(human,), robots=world.robots[:1], tasks=world.tasks[:1]
    )
    return world, _config()


def no_task(random: np.random.Generator) -> tuple[World, StackConfig]:
    """Long waits for tasks, several robots close together."""
    world = _swap_world(random, 2.0)
    arrival = float(random.uniform(40.0, 80.0))
    task = Task(arrival=arrival, start=0, end=1, deadline=900.0, pickup_time=10.0)
    robots = (*world.robots, _robot(2, -5.8, 0.5, 0.0))
    return dataclasses.replace(world, robots=robots, tasks=(task,)), _any_stack(random)


def blocked(random: np.random.Generator) -> tuple[World, StackConfig]:
    """Furniture appears on the way, for good or for a time; with or without a gap beside it."""
    width = float(random.choice([1.0, 1.6, 2.4]))
    world = _swap_world(random, width)
    start = float(random.uniform(0.0, 12.0))
    end = float(random.choice([start + random.uniform(15.0, 60.0), 1e6]))
    size = float(random.choice([width, width, max(0.3, width - 1.2)]))
    middle = float(random.uniform(-2.0, 2.0))
    cart = rectangle(0.5, size, (middle, (width - size) / 2))
    event = Blockage(name="cart", polygon=cart, start=start, end=end)
    one = bool(random.random() < 0.5)
    return (
        dataclasses.replace(
            world,
            events=(event,),
            robots=world.robots[:1] if one else world.robots,
            tasks=world.tasks[:1] if one else world.tasks,
        ),
        _any_stack(random),
    )


def outage(random: np.random.Generator) -> tuple[World, StackConfig]:
    """Links fail for a time, or for good, while two robots pass in a corridor."""
    world = _swap_world(random, float(random.choice([1.2, 2.4])))
    start = float(random.uniform(0.0, 10.0))
    end = float(random.choice([start + 30.0, 1e6]))
    robots = (("robot1",), ("robot2",), ())[int(random.integers(3))]
    link = ("dispatcher", "planner", "states", "leader")[int(random.integers(4))]
    event = CommsOutage(name="out", robots=robots, links=(link,), start=start, end=end)
    return dataclasses.replace(world, events=(event,)), _any_stack(random)


# --- wards: queues and rooms -----------------------------------------------------------


def _ward(random: np.random.Generator, *, rooms: int, robots: int, tasks: int) -> World:
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
        _robot(i, *starts[k], float(random.uniform(-np.pi, np.pi))) for i, k in enumerate(order)
    )
    stream = []
    for _ in range(tasks):
        start, end = (int(k) for k in random.integers(0, rooms, 2))
        arrival = float(random.choice([0.0, 0.0, random.uniform(0.0, 60.0)]))
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
    return dataclasses.replace(layout, robots=fleet, tasks=tuple(stream), horizon=HORIZON)


def queue(random: np.random.Generator) -> tuple[World, StackConfig]:
    """Everybody wants the same room."""
    robots = int(random.integers(3, 6))
    world = _ward(random, rooms=3, robots=robots, tasks=0)
    tasks = tuple(
        Task(arrival=0.0, start=0, end=int(random.integers(0, 3)), deadline=900.0, pickup_time=12.0)
        for _ in range(robots + 1)
    )
    return dataclasses.replace(world, tasks=tasks), _any_stack(random)


def room_exchange(random: np.random.Generator) -> tuple[World, StackConfig]:
    """Each robot stands in a room and wants the next one's."""
    rooms = int(random.integers(2, 5))
    world = _ward(random, rooms=rooms, robots=rooms, tasks=0)
    robots = tuple(
        _robot(i, *world.rooms[i].point, float(random.uniform(-np.pi, np.pi))) for i in range(rooms)
    )
    tasks = tuple(
        Task(arrival=0.0, start=i, end=(i + 1) % rooms, deadline=900.0, pickup_time=3.0)
        for i in range(rooms)
    )
    return dataclasses.replace(world, robots=robots, tasks=tasks), _any_stack(random)


def long_resource(random: np.random.Generator) -> tuple[World, StackConfig]:
    """The corridor between two rooms is itself a resource for one robot."""
    world = _swap_world(random, float(random.choice([0.9, 1.2])))
    middle = box(-5.2, -1.0, 5.2, 1.0)
    area = np.array(middle.exterior.coords)[:-1][::-1]
    near = np.array(box(-8.0, -1.5, 8.0, 1.5).exterior.coords)[:-1][::-1]
    resource = Resource(
        name="bottleneck",
        kind="corridor",
        spots=np.array([[-5.6, 1.0], [5.6, 1.0]]),
        entry=np.zeros((0, 2)),
        request_area=near,
        release_area=area,
    )
    return dataclasses.replace(world, resources=(resource,)), _any_stack(random)


def sampled(random: np.random.Generator) -> tuple[World, StackConfig]:
    """The default stack's own runs on sampled wards."""
    world = _ward(
        random,
        rooms=int(random.integers(2, 5)),
        robots=int(random.integers(2, 7)),
        tasks=int(random.integers(4, 10)),
    )
    return world, _config()


def sampled_brake(random: np.random.Generator) -> tuple[World, StackConfig]:
    """The same with MRTA-Sim's followers, which brake."""
    world, _ = sampled(random)
    return world, _config(brake=True)


def planted(random: np.random.Generator) -> tuple[World, StackConfig]:
    """The same with one planted defect."""
    world, _ = sampled(random)
    names = (
        "queue_release_loses_exclusion",
        "room_freed_while_parked",
        "same_room_twice_stalls",
        "planner_failure_blocks_all",
        "fourth_waiter_dropped",
        "fixed_priority_starves",
        "follower_zero_command",
    )
    return world, _config(defects=(names[int(random.integers(len(names)))],))


KINDS: dict[str, Callable[[np.random.Generator], tuple[World, StackConfig]]] = {
    "corridor_swap": corridor_swap,
    "corridor_many": corridor_many,
    "doorway": doorway,
    "slow": slow,
    "human": human_in_the_way,
    "no_task": no_task,
    "blocked": blocked,
    "outage": outage,
    "queue": queue,
    "room_exchange": room_exchange,
    "long_resource": long_resource,
    "sampled": sampled,
    "sampled_brake": sampled_brake,
    "planted": planted,
}
