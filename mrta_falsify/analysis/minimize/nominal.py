"""Values moved to nominal: noise, delays, service times, paces and arrivals."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import NamedTuple

from mrta_falsify.core.world import World

USUAL_PACE = 1.0  # m/s, of people; the mean that worlds are varied around


class NominalChange(NamedTuple):
    """One kind of value set to its nominal value."""

    what: str  #: that is no longer odd, in words
    apply: Callable[[World], World]


def _calm_robots(world: World) -> World:
    robots = tuple(
        dataclasses.replace(
            robot,
            position_noise=0.0,
            heading_noise=0.0,
            wheel_slip=0.0,
            command_latency=0.0,
            joins_at=0.0,
        )
        for robot in world.robots
    )
    return dataclasses.replace(world, robots=robots)


def _exact_rays(world: World) -> World:
    return dataclasses.replace(world, ray_noise=0.0)


def _no_service(world: World) -> World:
    tasks = tuple(dataclasses.replace(t, pickup_time=0.0, dropoff_time=0.0) for t in world.tasks)
    return dataclasses.replace(world, tasks=tasks)


def _calm_people(world: World) -> World:
    humans = tuple(
        dataclasses.replace(human, speed=USUAL_PACE) if human.speed else human
        for human in world.humans
    )
    return dataclasses.replace(world, humans=humans)


def _all_at_once(world: World) -> World:
    tasks = tuple(dataclasses.replace(task, arrival=0.0) for task in world.tasks)
    return dataclasses.replace(world, tasks=tasks)


NOMINAL = (
    NominalChange("noise and delays of robots", _calm_robots),
    NominalChange("noise of obstacle distances", _exact_rays),
    NominalChange("service times", _no_service),
    NominalChange("different paces of people", _calm_people),
    NominalChange("different arrivals of tasks", _all_at_once),
)


def all_nominal(world: World) -> World:
    """Apply every nominal change."""
    for change in NOMINAL:
        world = change.apply(world)
    return world
