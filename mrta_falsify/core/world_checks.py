"""What must hold between the parts of a world; each message names the field and both values."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.directives import Directive, Push
from mrta_falsify.core.errors import UnknownNameError, WorldError

if TYPE_CHECKING:
    from mrta_falsify.core.world import World


def check_world(world: World) -> None:
    """Refuse worlds whose parts contradict each other.

    Raises:
        WorldError: the first contradiction found, with the field and both values. Geometry
            (a start inside a wall) is checked where the costmap is known.
    """
    x_min, y_min, x_max, y_max = world.bounds
    if not (x_min < x_max and y_min < y_max):
        raise WorldError(
            f"bounds is {world.bounds.tolist()}; it must be [x min, y min, x max, y max]"
        )
    _check_unique(world)
    _check_polygons(world)
    _check_directives(world)
    _check_tasks(world)
    _check_room_numbers(world)
    _check_events(world)


def _check_tasks(world: World) -> None:
    rooms = len(world.rooms)
    robots = {robot.name for robot in world.robots}
    for i, task in enumerate(world.tasks):
        if task.robot and task.robot not in robots:
            raise UnknownNameError("robot", task.robot, robots, where=f"tasks[{i}].robot")
        for field in ("start", "end"):
            number = getattr(task, field)
            if number >= rooms:
                raise WorldError(f"tasks[{i}].{field} is room {number}; rooms are 0 to {rooms - 1}")
        if task.deadline < task.arrival:
            raise WorldError(
                f"tasks[{i}].deadline is {task.deadline} s, before its arrival at {task.arrival} s"
            )


def _check_room_numbers(world: World) -> None:
    rooms = len(world.rooms)
    for i, lane in enumerate(world.lanes):
        if max(lane.start, lane.end) >= rooms:
            raise WorldError(
                f"lanes[{i}] joins rooms {lane.start} and {lane.end}; rooms are 0 to {rooms - 1}"
            )
    for i, resource in enumerate(world.resources):
        if resource.kind == "room" and (resource.room is None or not 0 <= resource.room < rooms):
            raise WorldError(f"resources[{i}].room is {resource.room}; rooms are 0 to {rooms - 1}")
    if world.tasks and world.travel_times.shape != (rooms, rooms):
        raise WorldError(
            f"travel_times has shape {world.travel_times.shape}; it must be ({rooms}, {rooms})"
        )


def _check_events(world: World) -> None:
    names = {robot.name for robot in world.robots}
    for i, event in enumerate(world.events):
        if event.end < event.start:
            raise WorldError(
                f"events[{i}].end is {event.end} s, before its start at {event.start} s"
            )
        if event.kind == "comms_outage":
            for name in event.robots:
                if name not in names:
                    raise UnknownNameError("robot", name, names, where=f"events[{i}].robots")


def _check_unique(world: World) -> None:
    groups: dict[str, tuple[Any, ...]] = {
        "walls": world.walls,
        "furniture": world.furniture,
        "rooms": world.rooms,
        "resources": world.resources,
        "robots": world.robots,
        "humans": world.humans,
        "events": world.events,
    }
    for group, items in groups.items():
        seen: dict[str, int] = {}
        for i, item in enumerate(items):
            if item.name in seen:
                raise WorldError(
                    f"{group}[{i}].name is {item.name!r}, the name of {group}[{seen[item.name]}]; "
                    "names must differ"
                )
            seen[item.name] = i


def _check_polygons(world: World) -> None:
    solids: list[tuple[str, Array]] = [
        *((f"walls[{i}]", wall.polygon) for i, wall in enumerate(world.walls)),
        *((f"furniture[{i}]", item.polygon) for i, item in enumerate(world.furniture)),
        *((f"events[{i}]", e.polygon) for i, e in enumerate(world.events) if e.kind == "blockage"),
    ]
    for where, polygon in solids:
        if len(polygon) < 3:
            raise WorldError(f"{where}.polygon has {len(polygon)} corners; it needs at least 3")
    for i, item in enumerate(world.furniture):
        if item.movable and not _is_convex(item.polygon):
            raise WorldError(
                f"furniture[{i}].polygon of {item.name!r} is not convex and counter-clockwise; "
                "movable furniture must be"
            )


def _is_convex(polygon: Array) -> bool:
    side = np.roll(polygon, -1, axis=0) - polygon
    turned = np.roll(side, -1, axis=0)
    return bool((side[:, 0] * turned[:, 1] - side[:, 1] * turned[:, 0] >= -1e-9).all())


def _check_directives(world: World) -> None:
    for i, human in enumerate(world.humans):
        if human.directives and not len(human.route):
            raise WorldError(f"humans[{i}].route is empty; its first point is where they begin")
        check_pushes(world, human.directives, where=f"humans[{i}].directives")


def check_pushes(
    world: World, directives: Sequence[Directive], *, where: str = "directives"
) -> None:
    """Refuse to push what cannot be pushed.

    Raises:
        UnknownNameError: no such furniture.
        WorldError: it is not movable.
    """
    names = {item.name: item.movable for item in world.furniture}
    for i, directive in enumerate(directives):
        if not isinstance(directive, Push):
            continue
        if directive.furniture not in names:
            raise UnknownNameError(
                "furniture", directive.furniture, names, where=f"{where}[{i}].furniture"
            )
        if not names[directive.furniture]:
            raise WorldError(
                f"{where}[{i}].furniture is {directive.furniture!r}; it must be furniture with "
                "movable true"
            )
