"""Worlds to measure on: busy fleets of any size, and furniture never seen before."""

from __future__ import annotations

import dataclasses

import numpy as np

from mrta_falsify.core import registry
from mrta_falsify.core.arrays import Array, frozen_array
from mrta_falsify.core.config import StackConfig
from mrta_falsify.core.costmap import Costmap
from mrta_falsify.core.errors import ConfigError
from mrta_falsify.core.geometry import rectangle, transform
from mrta_falsify.core.protocols import Planner
from mrta_falsify.core.seeding import stream
from mrta_falsify.core.world import Furniture, RobotSpec, Task, World
from scenic_worlds.layouts.warehouse import warehouse

HOSPITAL_HOLDS = 400  # robots; the AWS hospital has no room for 100 more
SPACING = 1.2  # m between added robots
HOUR = 3600.0  # s; no run of a benchmark is as long


def fleet_world(world: World, config: StackConfig, robots: int) -> World:
    """Give ``world`` so many robots, and tasks enough to keep them all busy.

    More than ``HOSPITAL_HOLDS`` get a warehouse instead, without people.
    """
    radius = world.robots[0].radius
    if robots > HOSPITAL_HOLDS:
        world = warehouse(
            aisles=24, aisle_length=40.0, cross_width=5.0, picks=48, stations=12, chargers=0
        )
    fleet = list(world.robots[:robots])
    free = _free_places(world, config, robots - len(fleet))
    for i, place in enumerate(free):
        fleet.append(
            RobotSpec(name=f"extra{i + 1}", pose=frozen_array([*place, 0.0]), radius=radius)
        )
    rooms = len(world.rooms)
    tasks = [
        Task(
            arrival=0.0,
            start=i % rooms,
            end=(i + 1 + i // rooms % (rooms - 1)) % rooms,
            deadline=HOUR,
        )
        for i in range(4 * robots)
    ]
    return dataclasses.replace(
        world, robots=tuple(fleet), tasks=tuple(tasks), horizon=HOUR, name=f"bench_{robots}"
    )


def _free_places(world: World, config: StackConfig, count: int) -> list[Array]:
    """Draw points ``(2,)`` [m] on reachable floor, clear of obstacles, robots and each other."""
    if count <= 0:
        return []
    costmap = starting_costmap(world, config)
    planner = build_planner(config, costmap)
    cells = np.argwhere(costmap.cost == 0)
    order = stream(0, "bench/places").permutation(len(cells))
    taken = np.array([robot.pose[:2] for robot in world.robots]).reshape(-1, 2)
    found: list[Array] = []
    for point in costmap.centers(cells[order]):
        if len(found) == count:
            return found
        if (np.hypot(*(taken - point).T) < SPACING).any():
            continue
        if planner.plan(point, world.rooms[0].point).found:
            taken = np.vstack([taken, point])
            found.append(point)
    raise ConfigError(f"{world.name}: has no room for {count} more robots")


def with_new_furniture(world: World, number: int) -> World:
    """Add up to five trolleys to ``world``, at places that depend on ``number``."""
    places = stream(number, "bench/furniture").uniform(
        world.bounds[:2] + 1.0, world.bounds[2:] - 1.0, size=(5, 2)
    )
    extra = tuple(
        Furniture(
            name=f"bench{number}_{i}",
            kind="trolley",
            polygon=frozen_array(transform(rectangle(0.9, 0.6), (*place, 0.3 * i))),
        )
        for i, place in enumerate(places)
        if _is_clear(place, world)
    )
    return dataclasses.replace(world, furniture=(*world.furniture, *extra))


def _is_clear(place: Array, world: World) -> bool:
    actors = [robot.pose[:2] for robot in world.robots] + [human.route[0] for human in world.humans]
    return all(np.hypot(*(place - other)) > 2.0 for other in actors)


def starting_costmap(world: World, config: StackConfig) -> Costmap:
    """Build the costmap of a world at time 0, without robots on it."""
    source = registry.build("costmap", config.costmap).bind(world)
    built: Costmap = source.costmap(0.0, np.zeros((0, 2)))
    return built


def build_planner(config: StackConfig, costmap: Costmap) -> Planner:
    """Build the stack's planner on a costmap."""
    planner: Planner = registry.build("planner", config.planner)
    planner.use(costmap)
    return planner
