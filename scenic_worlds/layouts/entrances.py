"""Where a room ends: its door, its area, and the place before the door."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from scipy import ndimage
from shapely.geometry import LineString, Polygon

from mrta_falsify.core.arrays import Array, IntArray, frozen_array
from scenic_worlds.layouts.doorways import Doorway, find_doorways
from scenic_worlds.layouts.enclosures import (
    FRONT,
    LARGEST_ROOM,
    Enclosure,
    enclose,
    outline_around,
    outline_of,
)
from scenic_worlds.layouts.routes import STEP, MiddleWays, RouteMap, evenly
from scenic_worlds.layouts.stops import APRON
from simulator_interface.formats.floor_yaml import FloorRoom
from simulator_interface.formats.outlines import outlines

AT_EDGE = 1.0  # m from the edge of a given area, where its door lies
OPEN_ROOM = 1.2  # m around the point of a room without door and area


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Entrance:
    """How a room is entered."""

    door: Array  #: (D, 2) segment [m], empty: open
    area: Array  #: (V, 2) [m]
    mouth: Array  #: (2,) middle of the door, or where the room begins [m]
    outwards: Array  #: (2,) unit vector
    front: Array  #: (2,) before the door [m]
    entry: Array  #: (K, 2) from the front to the room point [m]
    release_area: Array  #: (V, 2) [m]
    inside: Array  #: (V, 2) what the room's doors close off [m], empty: it is open
    cells: IntArray  #: (n,) flat indices of the cells inside, where robots can be
    is_dead_end: bool  #: it has one door, so no way leads through it


def find_entrance(
    routes: RouteMap,
    ways: MiddleWays,
    room: FloorRoom,
    others: Array,
    taken: Sequence[Polygon] = (),
) -> Entrance:
    """Find the entrance of a room.

    Args:
        routes: the floor.
        ways: over it.
        room: as the user describes it; what is given is kept.
        others: ``(K, 2)`` points of the other rooms [m].
        taken: areas of other rooms that the user gave.
    """
    given = _given_door(room)
    enclosure = enclose(routes, ways, room.point, others, given, taken)
    inside = np.zeros((0, 2)) if enclosure is None else outline_of(routes, enclosure)
    doorway = given or (enclosure.main if enclosure else None)
    if given is None and len(room.area):
        doorway = _doorway_of_area(routes, ways, room, others, doorway)
    if doorway is None:
        mouth, outwards = _where_it_begins(ways.to_nearest(room.point, others), room)
    else:
        mouth, outwards = doorway.middle, doorway.outwards
    door = doorway.posts if doorway is not None and doorway.is_door else np.zeros((0, 2))
    area = room.area if len(room.area) else _area(routes, room.point, enclosure, inside)
    front = _front(routes, mouth, outwards)
    inner = mouth - 0.5 * outwards
    is_direct = routes.is_clear(front, room.point) or not routes.is_clear(inner, room.point)
    entry = [front, room.point] if is_direct else [front, inner, room.point]
    return Entrance(
        door=frozen_array(door),
        area=frozen_array(area),
        mouth=mouth,
        outwards=outwards,
        front=front,
        entry=frozen_array(np.vstack(entry)),
        release_area=_release_area(room.point, area, door, mouth, outwards),
        inside=frozen_array(inside),
        cells=np.zeros(0, dtype=np.int64) if enclosure is None else enclosure.cells,
        is_dead_end=enclosure is not None and len(enclosure.doorways) == 1,
    )


def _given_door(room: FloorRoom) -> Doorway | None:
    if len(room.door) != 2:
        return None
    along = room.door[1] - room.door[0]
    across = np.array([-along[1], along[0]]) / max(float(np.hypot(*along)), 1e-9)
    is_outwards = (room.door.mean(axis=0) - room.point) @ across >= 0.0
    outwards = frozen_array(across if is_outwards else -across)
    return Doorway(
        posts=room.door,
        outwards=outwards,
        reach=0.0,
        depth=0.0,
        size=0.0,
        at=0.0,
        is_framed=True,
        is_door=True,
    )


def _doorway_of_area(
    routes: RouteMap, ways: MiddleWays, room: FloorRoom, others: Array, found: Doorway | None
) -> Doorway | None:
    """Keep a doorway at the edge of the area that the user gave, or find another one there."""
    edge = Polygon(room.area).exterior
    on_way = find_doorways(routes, ways.to_nearest(room.point, others))
    near = [
        doorway
        for doorway in (*([found] if found else []), *on_way)
        if edge.distance(shapely.points(doorway.middle)) <= AT_EDGE
    ]
    return near[0] if near else None


def _where_it_begins(way: Array, room: FloorRoom) -> tuple[Array, Array]:
    """Find where a room without a door begins on the way out of it, and the way's direction."""
    if len(way) < 2:
        return room.point + np.array([OPEN_ROOM, 0.0]), np.array([1.0, 0.0])
    points = evenly(way)
    heading = ndimage.uniform_filter1d(np.gradient(points, axis=0), 9, axis=0, mode="nearest")
    heading /= np.maximum(np.hypot(*heading.T), 1e-9)[:, None]
    k = min(round(OPEN_ROOM / STEP), len(points) - 1)
    if len(room.area):
        inside = shapely.contains_xy(Polygon(room.area), points)
        k = int(np.argmin(inside)) if not inside.all() else len(points) - 1
    return points[k], heading[k]


def _area(routes: RouteMap, point: Array, enclosure: Enclosure | None, inside: Array) -> Array:
    """Outline ``(V, 2)`` [m] the floor that the doors close off, or a piece around the point."""
    if enclosure and len(enclosure.cells) * routes.resolution**2 <= LARGEST_ROOM:
        return inside
    return outline_around(routes, point, octagon(point, OPEN_ROOM))


def octagon(point: Array, reach: float) -> Array:
    """Outline ``(8, 2)`` [m] what lies within ``reach`` [m] of a point ``(2,)``."""
    angle = np.pi / 8.0 + np.arange(8) * np.pi / 4.0
    return frozen_array(point + reach * np.stack([np.cos(angle), np.sin(angle)], axis=1))


def _release_area(point: Array, area: Array, door: Array, mouth: Array, outwards: Array) -> Array:
    """Outline ``(V, 2)`` [m] the room with the floor before its door."""
    half = float(np.hypot(*(door[1] - door[0]))) / 2.0 if len(door) else 0.4
    reach = min(max(half + 0.2, 0.5), 0.85)
    side = np.array([-outwards[1], outwards[0]])
    apron = Polygon(
        [
            mouth - 0.3 * outwards - reach * side,
            mouth + APRON * outwards - reach * side,
            mouth + APRON * outwards + reach * side,
            mouth - 0.3 * outwards + reach * side,
        ]
    )
    inside = LineString([point, mouth]).buffer(0.5, cap_style="square", join_style="mitre")
    whole = shapely.union_all([Polygon(area).buffer(0.05, join_style="mitre"), apron, inside])
    if not isinstance(whole, Polygon):
        whole = whole.buffer(0.3, join_style="mitre").buffer(-0.25, join_style="mitre")
    parts = sorted(outlines(_filled(whole)), key=lambda ring: -Polygon(ring).area)
    return parts[0]


def _filled(shape: shapely.Geometry) -> shapely.Geometry:
    largest = max(getattr(shape, "geoms", [shape]), key=lambda part: part.area)
    return Polygon(largest.exterior)


def _front(routes: RouteMap, mouth: Array, outwards: Array) -> Array:
    """Choose the point before a door that is clearest of walls."""
    reaches = np.array([FRONT, 0.5, 0.7, 0.4, 0.3])
    points = mouth + reaches[:, None] * outwards
    gaps = np.minimum(routes.gap(points), 0.45 + routes.extra)
    return frozen_array(points[int(np.argmax(np.round(gaps, 3)))])
