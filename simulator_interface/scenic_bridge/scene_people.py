"""People of a sampled scene: on routes, with scripts, and those who appear while it runs."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np

from mrta_falsify.core.arrays import frozen_array
from mrta_falsify.core.directives import Appear, Directive, FollowRoute, Push, StandStill, WaitUntil
from mrta_falsify.core.errors import InputError, WorldError
from mrta_falsify.core.world import HumanSpec, World
from simulator_interface.scenic_bridge.behaviors import BehaviorReader
from simulator_interface.scenic_bridge.scene_contract import ScenePlaces
from simulator_interface.scenic_bridge.scene_values import read_property
from simulator_interface.staging import FAR_FUTURE


def read_human(item: Any, name: str, places: ScenePlaces) -> HumanSpec:
    """Read a person on a route.

    Raises:
        InputError: the route leads to a room that is not there, or a property is not a number.
        RejectionException: the room is not on this floor, which varies.
    """
    try:
        route = places.route_points(item.route)
    except InputError as error:
        error.args = (f"route {error}",)
        raise
    if not len(route):
        route = np.array([[float(item.position.x), float(item.position.y)]])
    return HumanSpec(
        name=name,
        route=frozen_array(route),
        repeat=bool(item.repeat),
        speed=read_property(item, "speed"),
        radius=read_property(item, "body_radius"),
        reacts_to_robots=bool(item.reacts),
        start=read_property(item, "phase"),
        appears_at=read_property(item, "appears_at"),
        leaves_at=read_property(item, "leaves_at"),
        pause=read_property(item, "pause"),
    )


def scripted_person(item: Any, name: str, reader: BehaviorReader) -> HumanSpec:
    """Read a person or robot with a behaviour.

    Without directives the behaviour is the program's own.

    Raises:
        InputError: another object has a behaviour, or an argument is not allowed.
    """
    if item.kind not in ("human", "robot"):
        raise WorldError(f"has a behavior; only Human and Robot can have one, it is {item.kind}")
    is_robot = item.kind == "robot"
    return HumanSpec(
        name=name,
        route=frozen_array([[float(item.position.x), float(item.position.y)]]),
        speed=read_property(item, "max_speed" if is_robot else "speed"),
        radius=read_property(item, "body_radius"),
        reacts_to_robots=True if is_robot else bool(item.reacts),
        appears_at=0.0 if is_robot else read_property(item, "appears_at"),
        leaves_at=FAR_FUTURE if is_robot else read_property(item, "leaves_at"),
        directives=reader.of_behavior(item.behavior) or (),
        body="robot" if is_robot else "person",
    )


def pushed_names(directives: Sequence[Directive]) -> set[str]:
    """Collect the names of the furniture that directives push."""
    return {directive.furniture for directive in directives if isinstance(directive, Push)}


# --- people who appear while the simulation runs -----------------------------------------


def late_person(item: Any, name: str, reader: BehaviorReader) -> HumanSpec:
    """Read a person who appears while the simulation runs.

    Raises:
        InputError: as :func:`read_human` and :func:`scripted_person`.
    """
    if item.behavior is not None:
        return scripted_person(item, name, reader)
    spec = read_human(item, name, reader.places)
    if len(spec.route) < 2:
        return dataclasses.replace(spec, directives=(StandStill(),))
    follow = FollowRoute(route=spec.route, repeat=spec.repeat)
    return dataclasses.replace(spec, directives=(follow,))


def with_late_people(world: World, count: int) -> World:
    """Add places for ``count`` people who may appear while the world runs."""
    point = world.rooms[0].point if world.rooms else 0.5 * (world.bounds[:2] + world.bounds[2:])
    taken = {human.name for human in world.humans}
    names = (f"late_{i + 1}" for i in range(count + len(taken)))
    free = [name for name in names if name not in taken][:count]
    never = (WaitUntil(time=FAR_FUTURE), Appear(point=frozen_array(point)))
    late = (
        HumanSpec(name=name, route=frozen_array(np.atleast_2d(point)), directives=never)
        for name in free
    )
    return dataclasses.replace(world, humans=(*world.humans, *late))


def is_free_place(human: HumanSpec) -> bool:
    """Whether an entry of a world is such a place, not taken yet."""
    first = human.directives[0] if human.directives else None
    return isinstance(first, WaitUntil) and first.time == FAR_FUTURE
