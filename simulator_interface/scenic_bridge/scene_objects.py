"""Objects of a sampled scene as parts of a world: robots, furniture, blockages, outages.

Scenic's heading 0 points to +y, a body's yaw 0 to +x: yaw = heading + pi/2. Scenic's
position is the centre of the box.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from scenic.core.scenarios import Scene

from mrta_falsify.core import geometry
from mrta_falsify.core.arrays import Array, frozen_array
from mrta_falsify.core.errors import WorldError
from mrta_falsify.core.words import number_text
from mrta_falsify.core.world import LINKS, Blockage, CommsOutage, Furniture, RobotSpec
from simulator_interface.scenic_bridge.scene_values import (
    SceneRejected,
    read_number,
    read_property,
)


def world_objects(scene: Scene) -> list[Any]:
    """List the objects that a world can hold: those of the library's classes."""
    return [item for item in scene.objects if hasattr(item, "kind")]


def names_in_world(objects: Iterable[Any]) -> dict[int, str]:
    """Name each object as in the world; keys are ``id``s."""
    names: dict[int, str] = {}
    counts: dict[str, int] = {}
    for item in objects:
        given = getattr(item, "name", None)
        counts[item.kind] = counts.get(item.kind, 0) + 1
        names[id(item)] = str(given) if given else f"{item.kind}_{counts[item.kind]}"
    return names


def read_pose(item: Any) -> tuple[float, float, float]:
    """Read the pose of an object: x, y [m], yaw [rad], map frame."""
    yaw = float(geometry.wrap_angle(float(item.heading) + np.pi / 2.0))
    return float(item.position.x), float(item.position.y), yaw


def box_outline(item: Any) -> Array:
    """Outline an object's box ``(4, 2)`` [m], map frame."""
    # Scenic's length runs along the heading, which is the body's x axis.
    outline = geometry.rectangle(float(item.length), float(item.width))
    return frozen_array(geometry.transform(outline, read_pose(item)))


def read_furniture(item: Any, name: str) -> Furniture:
    """Read a piece of furniture."""
    return Furniture(
        name=name,
        kind=item.kind,
        polygon=box_outline(item),
        height=float(item.height),
        mesh=str(getattr(item, "mesh", "")),
        movable=bool(getattr(item, "movable", False)),
    )


def read_robot(item: Any, name: str) -> RobotSpec:
    """Read a robot.

    Raises:
        WorldError: a property is not a finite number.
    """
    return RobotSpec(
        name=name,
        model=str(item.model),
        pose=frozen_array(read_pose(item)),
        radius=read_property(item, "body_radius"),
        max_speed=read_property(item, "max_speed"),
        max_acceleration=read_property(item, "max_acceleration"),
        max_turn_rate=read_property(item, "max_turn_rate"),
        capacity=int(read_property(item, "capacity")),
        position_noise=read_property(item, "position_noise"),
        heading_noise=read_property(item, "heading_noise"),
        wheel_slip=read_property(item, "wheel_slip"),
        command_latency=read_property(item, "command_latency"),
        joins_at=read_property(item, "joins_at"),
        cruise_speed=read_property(item, "cruise_speed"),
    )


# --- events ------------------------------------------------------------------------------


def read_blockage(item: Any, name: str) -> Blockage:
    """Read a blockage.

    Raises:
        WorldError: ``during`` is not a pair of numbers.
        SceneRejected: it ends before its start.
    """
    start, end = _during(item)
    return Blockage(
        name=name, polygon=box_outline(item), start=start, end=end, height=float(item.height)
    )


def read_outage(item: Any, name: str, names: dict[int, str], objects: Iterable[Any]) -> CommsOutage:
    """Read an outage; robots that are not active are left out.

    Args:
        item: the object.
        name: in the world.
        names: of all objects, by ``id``.
        objects: all of them.

    Raises:
        WorldError: ``during`` is not a pair of numbers, or a link is unknown.
        SceneRejected: it ends before its start.
    """
    start, end = _during(item)
    given = [item.robots] if isinstance(item.robots, str) else list(item.robots)
    absent = {names[id(o)] for o in objects if o.kind == "robot" and not o.active}
    robots = [names.get(id(robot), str(robot)) for robot in given]
    links = (item.links,) if isinstance(item.links, str) else tuple(item.links)
    for link in links:
        if link not in LINKS:
            raise WorldError(f"links has {link!r}; a link is one of {', '.join(LINKS)}")
    return CommsOutage(
        name=name,
        robots=tuple(robot for robot in robots if robot not in absent),
        links=links,
        start=start,
        end=end,
    )


def _during(item: Any) -> tuple[float, float]:
    try:
        start, end = item.during
    except (TypeError, ValueError):
        raise WorldError(f"during is {item.during!r}; it must be (start, end) in seconds") from None
    first, last = read_number(start, "during[0]"), read_number(end, "during[1]")
    if last < first:
        raise SceneRejected(
            f"during ends at {number_text(last)} s, before its start at {number_text(first)} s"
        )
    return first, last
