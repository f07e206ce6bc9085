"""Which places of a floor a robot can come to; where the way is too narrow, and by how much."""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import numpy as np
import shapely
from scipy import ndimage
from shapely.geometry import Polygon

from mrta_falsify.core.arrays import Array, BoolArray, frozen_array
from mrta_falsify.core.errors import WorldError
from mrta_falsify.core.world import World
from scenic_worlds.layouts.routes import MiddleWays, RouteMap, evenly
from simulator_interface.formats.floor_yaml import Floor, FloorRoom

CELLS_LOST = 3.0  # cells of a doorway that its posts take at most, as they meet the grid
STEPS = 12  # halvings of the clearance in the search for the widest way


class _Narrowest(NamedTuple):
    """The narrowest place of the widest way between two points."""

    point: Array  #: (2,) [m]
    width: float  #: [m], to a cell


def with_points(routes: RouteMap, floor: Floor) -> Floor:
    """Give every room without a point the most open place of its area.

    Raises:
        WorldError: no robot fits into the area.
    """
    rooms = tuple(
        room if len(room.point) else dataclasses.replace(room, point=_middle_of(routes, floor, i))
        for i, room in enumerate(floor.rooms)
    )
    return dataclasses.replace(floor, rooms=rooms)


def _middle_of(routes: RouteMap, floor: Floor, number: int) -> Array:
    room = floor.rooms[number]
    cells = np.argwhere(routes.free)
    points = routes.costmap.centers(cells)
    shape = Polygon(room.area)
    inside = shapely.contains_xy(shape, points)
    if not inside.any():
        raise WorldError(
            f"{_named(floor, number)}.area of {room.name!r} holds no place where a robot of "
            f"{routes.radius} m radius can be (is the area drawn on the map's walls?)"
        )
    cells, points = cells[inside], points[inside]
    # The edge of the area counts as a wall: the middle of the room is wanted, not its door.
    edge = shapely.distance(shape.exterior, shapely.points(points))
    open_by = np.minimum(routes.clearance[cells[:, 0], cells[:, 1]], edge)
    return frozen_array(points[int(np.argmax(np.round(open_by, 6)))])


def check_reachable(routes: RouteMap, floor: Floor) -> int:
    """Find the part of the floor that all room points are on.

    Raises:
        WorldError: names the rooms that are not, and how narrow the way to them is.
    """
    parts = []
    for i, room in enumerate(floor.rooms):
        cell = routes.cell(room.point)
        if not routes.free[cell]:
            gap = max(float(routes.clearance[cell]), 0.0)
            raise WorldError(
                f"{_named(floor, i)}.point of {room.name!r} is {room.point.tolist()} m, "
                f"{gap:.2f} m from an obstacle; a robot needs {routes.radius} m (move the point"
                f"{_nearest_free(routes, room)})"
            )
        parts.append(int(routes.part[cell]))
    main = max(sorted(set(parts)), key=parts.count)
    cut_off = [i for i, part in enumerate(parts) if part != main]
    if cut_off:
        raise WorldError(_cut_off(routes, floor, cut_off, parts.index(main)))
    return main


def check_spots(routes: RouteMap, floor: Floor, part: int) -> None:
    """Refuse given waiting spots and parking that no robot can reach.

    Raises:
        WorldError: names the place and what it belongs to.
    """
    given = [(f"resource {r.name!r}: spots", r.spots) for r in floor.resources]
    given += [(f"room {room.name!r}: queue", room.queue) for room in floor.rooms]
    given.append(("parking", floor.parking))
    for whose, places in given:
        for k, place in enumerate(places):
            if routes.part[routes.cell(place)] != part:
                raise WorldError(
                    f"{floor.name}: {whose}[{k}] is {place.tolist()} m, where no robot of "
                    f"{routes.radius} m radius can come (move it)"
                )


def closed_off_by_waiting(world: World, radius: float) -> tuple[str, ...]:
    """Name the rooms that cannot be reached while robots stand on all spots and parking places.

    Args:
        world: a derived layout.
        radius: of the robots [m].
    """
    routes = RouteMap(world, radius)
    uses = [use for use in world.resources if use.room is not None]
    standing = np.vstack([*(use.spots.reshape(-1, 2) for use in uses), world.parking])
    passable = routes.free & (routes.distance_to(standing) > 2.0 * radius)
    parts, _ = ndimage.label(passable)
    here = [int(parts[routes.cell(use.entry[0])]) for use in uses]
    main = max(sorted(set(here)), key=here.count)
    return tuple(
        use.name for use, part in zip(uses, here, strict=True) if part != main or part == 0
    )


def _named(floor: Floor, number: int) -> str:
    return f"{floor.name}: rooms[{number}]"


def _nearest_free(routes: RouteMap, room: FloorRoom) -> str:
    cells = np.argwhere(routes.free)
    if not len(cells):
        return "; nowhere on this floor is there room for one"
    points = routes.costmap.centers(cells)
    nearest = points[int(np.argmin(np.hypot(*(points - room.point).T)))]
    return f"; there is room at [{nearest[0]:.2f}, {nearest[1]:.2f}]"


# --- how narrow ------------------------------------------------------------------------------


def _cut_off(routes: RouteMap, floor: Floor, cut_off: list[int], home: int) -> str:
    rooms = [floor.rooms[i] for i in cut_off]
    needed = 2.0 * routes.radius + CELLS_LOST * routes.resolution
    said = (
        f"{floor.name}: rooms {', '.join(repr(room.name) for room in rooms)} cannot be reached "
        f"from {floor.rooms[home].name!r} by a robot of {routes.radius} m radius; "
    )
    narrowest = _narrowest(routes, rooms[0].point, floor.rooms[home].point)
    if narrowest is None:
        return (
            f"{said}what is solid closes {rooms[0].name!r} off, and every doorway must be at "
            f"least {needed:.2f} m wide"
        )
    x, y = narrowest.point.tolist()
    return (
        f"{said}the widest way to {rooms[0].name!r} narrows to {narrowest.width:.2f} m at "
        f"[{x:.2f}, {y:.2f}], and every doorway must be at least {needed:.2f} m wide"
    )


def _narrowest(routes: RouteMap, start: Array, end: Array) -> _Narrowest | None:
    """Find the narrowest place of the widest way between two points; None: there is no way."""
    here, there = routes.cell(start), routes.cell(end)
    if not _is_joined(~routes.lethal, here, there):
        return None
    joined, parted = 0.0, routes.radius + 2.0 * routes.resolution
    for _ in range(STEPS):
        middle = 0.5 * (joined + parted)
        if _is_joined(routes.clearance >= middle, here, there):
            joined = middle
        else:
            parted = middle
    wide = ~routes.lethal & (routes.clearance >= joined)
    (way,) = MiddleWays(routes, routes.clearance, floor=wide).to(start, [end])
    points = evenly(way, 0.5 * routes.resolution)
    gaps = routes.gap(points)
    at = points[int(np.argmin(gaps))]
    return _Narrowest(at, 2.0 * float(gaps.min()))


def _is_joined(floor: BoolArray, here: tuple[int, int], there: tuple[int, int]) -> bool:
    parts, _ = ndimage.label(floor)
    return bool(parts[here] and parts[here] == parts[there])
