"""Corridors, doors, lifts and chargers of a floor file or a scene, as resources of a world."""

from __future__ import annotations

import numpy as np
import shapely
from shapely.geometry import MultiPoint, Point, Polygon

from mrta_falsify.core.arrays import Array, frozen_array
from mrta_falsify.core.errors import FormatError
from mrta_falsify.core.world import Resource
from simulator_interface.formats.floor_fields import FloorFile, FloorResource
from simulator_interface.formats.floor_shapes import checked_polygon

ROOM_REACH = 3.0  # m around the room point that counts as the room, where no outline is known
ASK_AROUND = 1.0  # m around area and spots; on its way a robot asks 2 m before its stop anyway


def resources_of(described: FloorFile, where: str) -> tuple[Resource, ...]:
    """Read the resources of a floor file that are no rooms.

    Args:
        described: the file.
        where: what errors begin with.

    Raises:
        FormatError: names the resource and what is wrong with it.
    """
    taken = {room.name for room in described.rooms}
    found = []
    for i, entry in enumerate(described.resources):
        place = f"{where}: resources[{i}]"
        if not entry.name or entry.name in taken:
            problem = f"is {entry.name!r} again" if entry.name else "is empty"
            raise FormatError(
                f"{place}.name {problem}; each room and resource needs a different name"
            )
        taken.add(entry.name)
        found.append(resource_of(entry, place))
    return tuple(found)


def resource_of(entry: FloorResource, where: str) -> Resource:
    """Make the resource that an entry describes; ``where`` begins the errors' messages.

    Raises:
        FormatError: no area or two, an outline that crosses itself, or a waiting spot inside.
    """
    if entry.kind == "room":
        raise FormatError(
            f"{where}.kind is 'room'; it must be corridor, door, elevator or charger (capacity, "
            "queue, service_time, hold and areas of a room are fields of the room itself)"
        )
    area = _area_of(entry, where)
    shape = Polygon(area)
    for k, spot in enumerate(entry.spots):
        if shape.covers(Point(spot)):
            raise FormatError(
                f"{where}.spots[{k}] is {spot.tolist()} m, inside the area; robots must wait "
                "outside, or they close it to those who leave"
            )
    asked_in = entry.request_area
    if len(asked_in):
        checked_polygon(asked_in, f"{where}.request_area")
    return Resource(
        name=entry.name,
        kind=entry.kind,
        capacity=entry.capacity,
        spots=entry.spots,
        request_area=asked_in if len(asked_in) else default_request_area(area, entry.spots),
        release_area=area,
        hold=entry.hold,
        service_time=entry.service_time,
    )


def default_request_area(area: Array, spots: Array) -> Array:
    """Outline ``(V, 2)`` [m] of all floor near an area ``(V, 2)`` and its spots ``(S, 2)``."""
    near = shapely.convex_hull(MultiPoint(np.vstack([area, spots.reshape(-1, 2)])))
    grown = shapely.buffer(near, ASK_AROUND, join_style="mitre")
    return frozen_array(np.array(grown.normalize().exterior.coords)[:-1])


def _area_of(entry: FloorResource, where: str) -> Array:
    given = [name for name in ("area", "box") if len(getattr(entry, name))]
    if len(given) != 1:
        names = " and ".join(given) if given else "neither"
        raise FormatError(f"{where} has {names}; it must have one of area and box")
    if given == ["area"]:
        checked_polygon(entry.area, f"{where}.area")
        return entry.area
    if len(entry.box) != 4 or not (entry.box[:2] < entry.box[2:]).all():
        raise FormatError(
            f"{where}.box is {entry.box.tolist()} m; it must be [x min, y min, x max, y max]"
        )
    x1, y1, x2, y2 = entry.box.tolist()
    return frozen_array([[x1, y1], [x2, y1], [x2, y2], [x1, y2]])
