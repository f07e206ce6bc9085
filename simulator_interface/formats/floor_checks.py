"""What must hold of a floor file as a whole: extent, names, lanes, travel times."""

from __future__ import annotations

import numpy as np
import shapely

from mrta_falsify.core.arrays import Array, frozen_array
from mrta_falsify.core.errors import FormatError, UnknownNameError
from simulator_interface.formats.floor_fields import FloorFile, FloorRoom
from simulator_interface.formats.floor_shapes import checked_polygon

EXTENT = 2000.0  # m, farthest coordinate; more is a mistake in units
LARGEST_FLOOR = 40_000.0  # m^2; ways are planned on every 0.1 m of it
LONGEST_NAME = 80  # characters; names are drawn and printed
MARGIN = 0.3  # m of floor file bounds around everything in it


def checked_bounds(
    described: FloorFile, extents: list[Array], *, is_map: bool, where: str
) -> Array:
    """Find the bounds ``(4,)`` [m] of a floor, as given or around everything in it.

    Args:
        described: the file.
        extents: points ``(K, 2)`` [m] that the floor must hold.
        is_map: the floor is a map, whose cells must stay cells of the costmap.
        where: what errors begin with.

    Raises:
        FormatError: they are not a box, too large, or leave out a room.
    """
    bounds = _given_bounds(described, where)
    if bounds is None:
        margin = 0.0 if is_map else MARGIN
        points = np.vstack(extents)
        bounds = np.concatenate([points.min(axis=0) - margin, points.max(axis=0) + margin])
    if np.abs(bounds).max() > EXTENT:
        raise FormatError(
            f"{where}: the floor reaches from {bounds[:2].tolist()} to {bounds[2:].tolist()} m; "
            f"coordinates must stay within {EXTENT:g} m (metres, not millimetres?)"
        )
    width, depth = (bounds[2:] - bounds[:2]).tolist()
    if width * depth > LARGEST_FLOOR:
        raise FormatError(
            f"{where}: the floor measures {width:g} x {depth:g} m; at most {LARGEST_FLOOR:g} m^2 "
            "are allowed (cut out the part that robots use)"
        )
    for i, room in enumerate(described.rooms):
        if not len(room.point):
            continue
        if not ((room.point >= bounds[:2]) & (room.point <= bounds[2:])).all():
            raise FormatError(
                f"{where}: rooms[{i}].point of {room.name!r} is {room.point.tolist()} m; it must "
                f"lie within the floor, {bounds[:2].tolist()} to {bounds[2:].tolist()} m"
            )
    return frozen_array(bounds)


def _given_bounds(described: FloorFile, where: str) -> Array | None:
    bounds = described.bounds
    if not len(bounds):
        return None
    if len(bounds) != 4 or not (bounds[:2] < bounds[2:]).all():
        raise FormatError(
            f"{where}: bounds is {bounds.tolist()} m; it must be [x min, y min, x max, y max]"
        )
    return bounds


def check_rooms(described: FloorFile, where: str) -> None:
    """Refuse rooms without a name of their own, and doors and areas that do not fit.

    Raises:
        FormatError: names the room and what is wrong with it.
    """
    names = [room.name for room in described.rooms]
    for i, name in enumerate(names):
        if not name or name in names[:i]:
            problem = "is empty" if not name else f"is {name!r} again"
            raise FormatError(f"{where}: rooms[{i}].name {problem}; every room needs its own name")
        if not name.isprintable() or len(name) > LONGEST_NAME:
            raise FormatError(
                f"{where}: rooms[{i}].name is {name[:LONGEST_NAME]!a}; it must be one line "
                f"of at most {LONGEST_NAME} characters"
            )
    for i, room in enumerate(described.rooms):
        _check_point(room, f"{where}: rooms[{i}]")
        if len(room.door) not in (0, 2):
            raise FormatError(
                f"{where}: rooms[{i}].door has {len(room.door)} points; it must have 2, the "
                "posts of the door"
            )
        for field in ("release_area", "request_area"):
            if len(getattr(room, field)):
                checked_polygon(getattr(room, field), f"{where}: rooms[{i}].{field}")
        if len(room.area):
            shape = checked_polygon(room.area, f"{where}: rooms[{i}].area")
            if len(room.point) and not shape.covers(shapely.Point(room.point)):
                raise FormatError(
                    f"{where}: rooms[{i}].point of {room.name!r} is {room.point.tolist()} m; it "
                    "must lie in the room's area"
                )


def _check_point(room: FloorRoom, where: str) -> None:
    if len(room.point) == 2 or (len(room.area) and not len(room.point)):
        return
    if len(room.point):
        raise FormatError(f"{where}.point is {room.point.tolist()} m; it must be [x, y]")
    raise FormatError(f"{where}.point is missing; {room.name!r} needs a point or an area")


def check_lanes(described: FloorFile, where: str) -> None:
    """Refuse lanes that do not lead from one room to another.

    Raises:
        UnknownNameError: a room is not there.
        FormatError: names the lane and what is wrong with it.
    """
    names = [room.name for room in described.rooms]
    for i, lane in enumerate(described.lanes):
        for field in ("start", "end"):
            name = getattr(lane, field)
            if name not in names:
                raise UnknownNameError("room", name, names, where=f"{where}: lanes[{i}].{field}")
        if lane.start == lane.end:
            raise FormatError(f"{where}: lanes[{i}] leads from {lane.start!r} to itself")
        if not len(lane.to_room):
            raise FormatError(f"{where}: lanes[{i}].to_room is empty; it needs waypoints")


def checked_times(described: FloorFile, where: str) -> Array:
    """Check travel times ``(R, R)`` [s]; empty: none are given.

    Raises:
        FormatError: not one row and column per room.
    """
    times, rooms = described.travel_times, len(described.rooms)
    if times.size and times.shape != (rooms, rooms):
        raise FormatError(
            f"{where}: travel_times has shape {times.shape}; it must be ({rooms}, {rooms}), one "
            "row and column per room"
        )
    return times
