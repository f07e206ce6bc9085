"""What robots of a sampled scene use in turn: areas of the program, and changed rooms."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import shapely
from shapely.geometry import Point

from mrta_falsify.core import codec
from mrta_falsify.core.arrays import Array, frozen_array
from mrta_falsify.core.errors import InputError, WorldError
from mrta_falsify.core.shapes import polygons
from mrta_falsify.core.world import Resource, World
from simulator_interface.formats.floor_fields import FloorResource
from simulator_interface.formats.floor_resources import (
    ROOM_REACH,
    default_request_area,
    resource_of,
)
from simulator_interface.scenic_bridge.scene_contract import ScenePlaces
from simulator_interface.scenic_bridge.scene_objects import box_outline
from simulator_interface.scenic_bridge.scene_values import SceneRejected

ROBOT_RADIUS = 0.22  # m, of the robots that wait at spots
#: properties of a ``RoomUse`` that are fields of a resource of the same name
ROOM_VALUES = ("capacity", "service_time", "hold")


def is_resource(item: Any) -> bool:
    """Whether an object of a scene is a corridor, door, lift or charger."""
    return hasattr(item, "hold") and item.kind != "room_use"


def read_resource(item: Any, name: str, places: ScenePlaces) -> Resource:
    """Read a corridor, door, lift or charger.

    Raises:
        InputError: a property has a value that is not allowed.
    """
    area = _points(item.area, "area", places)
    described = {
        "name": name,
        "kind": item.kind,
        "area": (area if len(area) else box_outline(item)).tolist(),
        "spots": _points(item.spots, "spots", places).tolist(),
        "capacity": _whole(item.capacity),
        "service_time": item.service_time,
        "hold": item.hold,
        "request_area": _points(item.request_area, "request_area", places).tolist(),
    }
    return resource_of(codec.decode(FloorResource, described, where=name), name)


def use_room(
    resources: Sequence[Resource], item: Any, name: str, places: ScenePlaces
) -> list[Resource]:
    """Change the resource of a room, or add one if the floor has none for it.

    Args:
        resources: of the world so far.
        item: a ``RoomUse``.
        name: of the item, for messages.
        places: of the floor.

    Raises:
        InputError: no such room, or a value that is not allowed.
        RejectionException: the room is not on this floor, which varies.
    """
    number = places.room_number(item.room)
    known = [i for i, r in enumerate(resources) if r.kind == "room" and r.room == number]
    before = resources[known[0]] if known else _bare_room(places.layout, number)
    given: dict[str, Any] = {
        field: _whole(getattr(item, field)) if field == "capacity" else getattr(item, field)
        for field in ROOM_VALUES
        if getattr(item, field) is not None
    }
    for ours, theirs in (
        ("spots", "spots"),
        ("area", "release_area"),
        ("request_area", "request_area"),
        ("entry", "entry"),
    ):
        if getattr(item, ours) is not None:
            given[theirs] = _points(getattr(item, ours), ours, places).tolist()
    after = codec.decode(Resource, {**codec.encode(before), **given}, where=name)
    changed = list(resources)
    if known:
        changed[known[0]] = after
    else:
        changed.append(after)
    return changed


def check_waiting_spots(world: World, layout: World) -> None:
    """Reject scenes in which a robot would have to wait in a wall or beyond the floor.

    Args:
        world: of the scene.
        layout: its floor; the resources that it has itself are not looked at.

    Raises:
        SceneRejected: names the resource and the spot.
    """
    own = {id(resource) for resource in layout.resources}
    added = [resource for resource in world.resources if id(resource) not in own]
    if not any(len(resource.spots) for resource in added):
        return
    solid = shapely.union_all(polygons(world.solid_polygons()))
    low, high = world.bounds[:2], world.bounds[2:]
    for resource in added:
        for k, spot in enumerate(resource.spots):
            gap = float(solid.distance(Point(spot)))
            if gap < ROBOT_RADIUS or (spot < low).any() or (spot > high).any():
                raise SceneRejected(
                    f"{resource.name}: spots[{k}] is {spot.tolist()} m, {gap:.2f} m from an "
                    f"obstacle; a robot that waits there needs {ROBOT_RADIUS} m"
                )


def _bare_room(layout: World, number: int) -> Resource:
    """Guard a room that the floor does not guard: its area, or the surroundings of its point."""
    room = layout.rooms[number]
    reach = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * ROOM_REACH
    area = room.area if len(room.area) >= 3 else frozen_array(room.point + reach)
    none = frozen_array(np.zeros((0, 2)))
    return Resource(
        name=room.name,
        kind="room",
        room=number,
        entry=frozen_array(room.point[None, :]),
        request_area=default_request_area(area, none),
        release_area=area,
    )


def _points(given: Any, what: str, places: ScenePlaces) -> Array:
    """Read points ``(K, 2)`` [m]."""
    try:
        return np.asarray(places.route_points(given)).reshape(-1, 2)
    except InputError as error:
        raise WorldError(f"{what} {error}") from None


def _whole(value: Any) -> Any:
    """Take a sampled number such as 2.0 for the whole number that it is."""
    return int(value) if isinstance(value, float) and value.is_integer() else value


__all__ = ["check_waiting_spots", "is_resource", "read_resource", "use_room"]
