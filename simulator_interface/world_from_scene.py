"""Scene -> World: the border; nothing below knows Scenic.

Scenic's heading 0 points to +y, a body's yaw 0 to +x: yaw = heading + pi/2. Scenic's
position is the centre of the box.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from scenic.core.scenarios import Scene

from mrta_falsify.core import geometry
from mrta_falsify.core.arrays import frozen_array
from mrta_falsify.core.errors import WorldError
from mrta_falsify.core.world import Furniture, HumanSpec, RobotSpec, Task, World


def world_from_scene(scene: Scene, *, name: str, seed: int) -> World:
    """World of a sampled scene of a program over ``scenic_worlds.model``.

    Args:
        scene: what ``Scenario.generate`` returned.
        name: of the world, usually the program's.
        seed: of all noise inside the episode.

    Returns:
        The world; generated furniture follows the layout's own.

    Raises:
        WorldError: a task, route or robot that cannot be (for example a deadline before
            its arrival), named as in the program.
    """
    places = scene.params["_places"]
    layout: World = places.layout
    objects = [item for item in scene.objects if hasattr(item, "kind")]
    names = _names(objects)
    furniture, robots, humans = list(layout.furniture), [], []
    for item in objects:
        if item.kind == "robot":
            robots.append(_robot(item, names[id(item)]))
        elif item.kind == "human":
            humans.append(_human(item, names[id(item)], places))
        else:
            furniture.append(_furniture(item, names[id(item)]))
    return dataclasses.replace(
        layout,
        name=name,
        furniture=tuple(furniture),
        robots=tuple(robots),
        humans=tuple(humans),
        tasks=tuple(_task(i, entry, places) for i, entry in enumerate(scene.params["tasks"])),
        horizon=float(scene.params["horizon"]),
        seed=seed,
    )


def _names(objects: list[Any]) -> dict[int, str]:
    names: dict[int, str] = {}
    counts: dict[str, int] = {}
    for item in objects:
        given = getattr(item, "name", None)
        counts[item.kind] = counts.get(item.kind, 0) + 1
        names[id(item)] = given or f"{item.kind}_{counts[item.kind]}"
    return names


def _pose(item: Any) -> tuple[float, float, float]:
    yaw = float(geometry.wrap_angle(float(item.heading) + np.pi / 2.0))
    return float(item.position.x), float(item.position.y), yaw


def _furniture(item: Any, name: str) -> Furniture:
    # Scenic's length runs along the heading, which is the body's x axis.
    outline = geometry.rectangle(float(item.length), float(item.width))
    return Furniture(
        name=name,
        kind=item.kind,
        polygon=frozen_array(geometry.transform(outline, _pose(item))),
        height=float(item.height),
    )


def _robot(item: Any, name: str) -> RobotSpec:
    return RobotSpec(
        name=name,
        model=item.robotModel,
        pose=frozen_array(_pose(item)),
        max_speed=float(item.maxSpeed),
        capacity=int(item.capacity),
    )


def _human(item: Any, name: str, places: Any) -> HumanSpec:
    points = [
        places.room_point(stop) if isinstance(stop, (int, str)) else tuple(stop)[:2]
        for stop in item.route
    ]
    return HumanSpec(
        name=name,
        route=frozen_array(np.array(points, dtype=np.float64)),
        repeat=bool(item.repeat),
        speed=float(item.speed),
        reacts_to_robots=bool(item.reacts),
    )


def _task(number: int, entry: Any, places: Any) -> Task:
    if len(entry) != 4:
        raise WorldError(
            f"param tasks[{number}] is {entry!r}; "
            "it must be (arrival, start room, end room, deadline)"
        )
    arrival, start, end, deadline = entry
    return Task(
        arrival=float(arrival),
        start=places.room_number(start),
        end=places.room_number(end),
        deadline=float(deadline),
    )
