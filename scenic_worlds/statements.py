"""Furniture, robots, people, resources and events of a world as the statements that make them."""

from __future__ import annotations

import dataclasses
import functools
import math
import re
from collections.abc import Callable, Iterable

import numpy as np

from mrta_falsify.core import directives, geometry
from mrta_falsify.core.arrays import Array
from mrta_falsify.core.directives import Directive
from mrta_falsify.core.errors import WorldError
from mrta_falsify.core.world import (
    Blockage,
    CommsOutage,
    Event,
    Furniture,
    HumanSpec,
    Resource,
    RobotSpec,
)
from scenic_worlds.exact_numbers import Box, box_of, heading_text, number_text, point_text
from scenic_worlds.shipped import LIBRARY

CLOSE = 1e-6  # m from its corners that a blockage may be written off by
PLACED = "with allowCollisions True, with regionContainedIn everywhere"


@functools.cache
def _furniture_classes() -> dict[str, str]:
    """Find the library's class for each kind of furniture."""
    text = (LIBRARY / "furniture.scenic").read_text(encoding="utf-8")
    parts = re.split(r"^class (\w+)\(\w+\):", text, flags=re.MULTILINE)[1:]
    found = {}
    for name, body in zip(parts[::2], parts[1::2], strict=True):
        kind = re.search(r"^ {4}kind: '(\w+)'", body, re.MULTILINE)
        if kind:
            found[kind[1]] = name
    return found


def _lines(first: str, *rest: str) -> str:
    return ",\n    ".join([first, *(line for line in rest if line)])


def _withs(pairs: Iterable[tuple[str, str]]) -> str:
    return ", ".join(f"with {name} {value}" for name, value in pairs)


def _box_text(box: Box, height: float) -> str:
    return (
        f"at ({number_text(box.x)}, {number_text(box.y)}, {number_text(height / 2.0)}), "
        f"facing {box.heading}, with width {number_text(box.width)}, "
        f"with length {number_text(box.length)}, with height {number_text(height)}"
    )


def furniture_text(piece: Furniture) -> str:
    """Write a piece of furniture."""
    name = _furniture_classes().get(piece.kind)
    kind = [] if name else [("kind", repr(piece.kind))]
    movable = [("movable", "True")] if piece.movable else []
    return _lines(
        f"new {name or 'Furniture'} with name {piece.name!r}",
        _box_text(box_of(piece.polygon), piece.height),
        _withs([*kind, ("mesh", repr(piece.mesh)), *movable]),
        PLACED,
    )


#: name in the world and in the program, of numbers that are left out at their default
ROBOT_VALUES = {
    "radius": "body_radius",
    "max_speed": "max_speed",
    "max_acceleration": "max_acceleration",
    "max_turn_rate": "max_turn_rate",
    "capacity": "capacity",
    "position_noise": "position_noise",
    "heading_noise": "heading_noise",
    "wheel_slip": "wheel_slip",
    "command_latency": "command_latency",
    "joins_at": "joins_at",
    "cruise_speed": "cruise_speed",
}
HUMAN_VALUES = {
    "speed": "speed",
    "radius": "body_radius",
    "start": "phase",
    "appears_at": "appears_at",
    "leaves_at": "leaves_at",
    "pause": "pause",
}


def changed_values(item: RobotSpec | HumanSpec, names: dict[str, str]) -> list[tuple[str, str]]:
    """List the properties of ``item`` that are not at their default."""
    defaults = {field.name: field.default for field in dataclasses.fields(item)}
    return [
        (theirs, number_text(getattr(item, ours)))
        for ours, theirs in names.items()
        if getattr(item, ours) != defaults[ours]
    ]


def comment_text(said: str) -> str:
    """Keep a comment from ending the string that it is written in."""
    return said.replace("\\", "/").replace('"""', "'''")


def robot_values(robot: RobotSpec) -> list[tuple[str, str]]:
    """List the properties of a robot that are not at their default, its pose left out."""
    model = [("model", repr(robot.model))] if robot.model != "waffle" else []
    return [*model, *changed_values(robot, ROBOT_VALUES)]


def robot_text(robot: RobotSpec) -> str:
    """Write a robot of the fleet."""
    x, y, yaw = robot.pose
    return _lines(
        f"new Robot with name {robot.name!r}",
        f"at ({number_text(x)}, {number_text(y)}, 0.075), facing {heading_text(float(yaw))}",
        _withs(robot_values(robot)),
        PLACED,
    )


def human_text(human: HumanSpec) -> str:
    """Write a person, or a scripted robot."""
    if human.directives:
        return _scripted(human)
    route = ", ".join(point_text(point) for point in human.route)
    flags = [("reacts", "False")] * (not human.reacts_to_robots)
    flags += [("repeat", "False")] * (not human.repeat)
    return _lines(
        f"new Human with name {human.name!r}",
        f"with route [{route}]",
        _withs([*changed_values(human, HUMAN_VALUES), *flags]),
    )


def _scripted(human: HumanSpec) -> str:
    """Write a person or a scripted robot whose behaviour is the library's."""
    steps = [_directive(step) for step in human.directives]
    behavior = steps[0] if len(steps) == 1 else f"InTurn({', '.join(steps)})"
    place = point_text(human.route[0])
    if human.body == "robot":
        values = [
            ("max_speed", number_text(human.speed)),
            ("body_radius", number_text(human.radius)),
        ]
        first = f"new Robot with name {human.name!r}, at {place}"
        return _lines(first, f"with behavior {behavior}", _withs(values), PLACED)
    flags = [("reacts", "False")] * (not human.reacts_to_robots)
    return _lines(
        f"new Human with name {human.name!r}, at {place}",
        f"with behavior {behavior}",
        _withs([*changed_values(human, HUMAN_VALUES), *flags]),
    )


def _pace(speed: float) -> str:
    return f", speed={number_text(speed)}" if speed else ""


def _kept(keeps: bool) -> str:
    return ", keeps=True" if keeps else ""


#: how each directive is written as a behaviour of behaviors.scenic
_WRITERS: dict[type, Callable[..., str]] = {
    directives.FollowRoute: lambda d: (
        f"FollowRoute([{', '.join(map(point_text, d.route))}], repeat={d.repeat}{_pace(d.speed)})"
    ),
    directives.WalkTo: lambda d: f"WalkTo({point_text(d.point)}{_pace(d.speed)})",
    directives.Wait: lambda d: f"WaitFor({number_text(d.duration)})",
    directives.WaitUntil: lambda d: f"WaitUntil({number_text(d.time)})",
    directives.StandStill: lambda d: "StandStill()",
    directives.Push: lambda d: (
        f"Push({d.furniture!r}, {point_text(d.point)}{_pace(d.speed)}{_kept(d.keeps)})"
    ),
    directives.Appear: lambda d: f"Appear({point_text(d.point)})",
    directives.Leave: lambda d: "Leave()",
}


def _directive(directive: Directive) -> str:
    return _WRITERS[type(directive)](directive)


#: class of resources.scenic for each kind that robots pass on their way
RESOURCE_CLASSES = {
    "corridor": "Corridor",
    "door": "Door",
    "elevator": "Lift",
    "charger": "Charger",
}


def resource_text(resource: Resource) -> str:
    """Write a corridor, door, lift or charger, or how a room is used."""
    values = [
        ("capacity", str(resource.capacity)),
        ("service_time", number_text(resource.service_time)),
        ("hold", repr(resource.hold)),
    ]
    areas = [
        f"with area {_points(resource.release_area)}",
        f"with request_area {_points(resource.request_area)}",
        f"with spots {_points(resource.spots)}",
    ]
    if resource.kind == "room":
        entry = f"with entry {_points(resource.entry)}"
        return _lines(f"new RoomUse with room {resource.room}", _withs(values), *areas, entry)
    x, y = resource.release_area.mean(axis=0)
    first = f"new {RESOURCE_CLASSES[resource.kind]} with name {resource.name!r}"
    return _lines(f"{first}, at ({number_text(x)}, {number_text(y)})", _withs(values), *areas)


def _points(points: Array) -> str:
    return f"[{', '.join(map(point_text, points))}]"


def event_text(event: Event) -> str:
    """Write a blockage or an outage.

    Raises:
        WorldError: a blockage is not a rectangle.
    """
    during = f"with during ({number_text(event.start)}, {number_text(event.end)})"
    if isinstance(event, CommsOutage):
        return _lines(
            f"new CommsOutage with name {event.name!r}",
            f"with robots {event.robots!r}, with links {event.links!r}",
            during,
        )
    return _lines(
        f"new Blockage with name {event.name!r}",
        _box_text(_blockage_box(event), event.height),
        during,
    )


def _blockage_box(event: Blockage) -> Box:
    box = box_of(event.polygon)
    if box.is_exact:
        return box
    yaw = math.atan2(*(event.polygon[1] - event.polygon[0])[::-1])
    outline = geometry.rectangle(box.length, box.width)
    moved = geometry.transform(outline, (box.x, box.y, yaw))
    if moved.shape != event.polygon.shape or np.abs(moved - event.polygon).max() > CLOSE:
        raise WorldError(
            f"blockage {event.name!r} is not a rectangle, as a program's Blockage must be, so "
            "this world cannot be written as a program"
        )
    return box
