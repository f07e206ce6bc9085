"""Rooms that others drive past: their spot moves beside the lane, and their space keeps off it.

A place on a lane is passed by robots that have nothing to do there. So it is no space that one
robot may have for itself: only the spot where a robot stands is, and that is best beside the lane.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
import shapely
from scipy import ndimage
from shapely.geometry import Point, Polygon

from mrta_falsify.core.arrays import Array, BoolArray, frozen_array
from mrta_falsify.core.world import Lane, Room, World
from scenic_worlds.layouts.entrances import OPEN_ROOM, Entrance, octagon
from scenic_worlds.layouts.queues import OFF_AREA, PARK_APART, PARK_TO_LANE, SPOT_GAP
from scenic_worlds.layouts.routes import ROBOT_RADIUS, RouteMap
from simulator_interface.formats.floor_yaml import Floor, FloorLane

LEAST_TO_LANE = 0.62  # m; a place nearer to what others drive lies in their way
SPACE_TO_LANE = 0.15  # m between a room's space and what others drive
SPOT_SHARE = 0.9  # of a robot's radius: no second robot comes this near to who stands there
BESIDE_SPACE = 0.5  # m around a spot beside a lane that its robot has for itself
LET_GO = 0.5  # m from its spot at least, where a robot lets go of the room
SEARCHED = 3.0  # m around a place, for a spot beside the lane
DIRECTIONS = 15  # degrees between the directions in which one is looked for
TRIED = 200  # spots at most


# --- spots beside lanes ----------------------------------------------------------------------


def move_beside_lanes(floor: Floor, *, radius: float = ROBOT_RADIUS) -> Floor:
    """Move the places of a building that others drive over to spots beside the lanes.

    The lanes to such a place lead on to its spot. Where there is no room for one, the place stays.

    Args:
        floor: of a building; another floor stays as it is.
        radius: of the largest robot [m].
    """
    near = [
        i
        for i, (room, past) in enumerate(zip(floor.rooms, floor.driven_past, strict=False))
        if _gap(room.point, past) < LEAST_TO_LANE
    ]
    if not near:
        return floor
    solid = World(
        name=floor.name, bounds=floor.bounds, walls=floor.walls, furniture=floor.furniture
    )
    routes = RouteMap(solid, radius)
    rooms, legs = list(floor.rooms), list[Array]()
    for i in near:
        room = rooms[i]
        others = [*(other.point for k, other in enumerate(rooms) if k != i), *floor.parking]
        others += [spot for other in rooms for spot in other.queue]
        lanes = np.vstack([floor.driven_past[i], *legs])
        spot = _spot_beside(routes, floor, room.point, lanes, np.array(others).reshape(-1, 2))
        if spot is None:
            continue
        legs.append(np.stack([room.point, spot])[None])
        rooms[i] = dataclasses.replace(
            room,
            point=frozen_array(spot),
            area=octagon(spot, BESIDE_SPACE + routes.extra),
            release_area=octagon(spot, BESIDE_SPACE + routes.extra + 0.1),
        )
    before = {room.name: room.point for room in floor.rooms}
    moved = {room.name: room.point for room in rooms if room.point is not before[room.name]}
    led_on = tuple(_led_on(lane, before, moved) for lane in floor.lanes)
    return dataclasses.replace(
        floor,
        rooms=tuple(rooms),
        lanes=led_on,
        described=dataclasses.replace(floor.described, rooms=tuple(rooms), lanes=led_on),
    )


def _spot_beside(
    routes: RouteMap, floor: Floor, place: Array, lanes: Array, others: Array
) -> Array | None:
    """Find the nearest spot ``(2,)`` [m] where a robot is in nobody's way; None: there is none.

    Args:
        routes: the floor.
        floor: whose doors and corridors stay clear.
        place: ``(2,)`` on a lane [m].
        lanes: ``(L, 2, 2)`` that others drive [m].
        others: ``(K, 2)`` places where robots stand [m].
    """
    nearest = lanes[int(np.argmin(shapely.distance(shapely.linestrings(lanes), Point(place))))]
    along = np.arctan2(*(nearest[1] - nearest[0])[::-1])
    angle = along + np.arange(0, 360, DIRECTIONS) * np.pi / 180.0
    far = np.repeat(np.arange(PARK_TO_LANE, SEARCHED, 0.1), len(angle))
    rays = np.tile(np.stack([np.cos(angle), np.sin(angle)], axis=1), (len(far) // len(angle), 1))
    points = place + far[:, None] * rays
    open_by = routes.gap(points)
    keep = open_by >= SPOT_GAP[0] + routes.extra
    keep &= _gaps(points, lanes) >= PARK_TO_LANE + 2.0 * routes.extra - 1e-6
    for other in others:
        keep &= np.hypot(*(points - other).T) >= PARK_APART + 2.0 * routes.extra
    for use in floor.resources:
        area = Polygon(use.release_area)
        keep &= shapely.distance(area, shapely.points(points)) >= OFF_AREA
    points, far, open_by = points[keep], far[keep], open_by[keep]
    order = np.lexsort((np.arange(len(far)), -np.round(open_by, 1), np.round(far, 1)))
    for k in order[:TRIED].tolist():
        if routes.is_clear(place, points[k]):
            return np.asarray(np.round(points[k], 3))
    return None


def _led_on(lane: FloorLane, before: dict[str, Array], moved: dict[str, Array]) -> FloorLane:
    """Let a lane begin and end at the spots beside it."""
    to_room, to_queue = np.asarray(lane.to_room), np.asarray(lane.to_queue)
    if lane.start in moved:
        to_room = np.vstack([before[lane.start], to_room])
        if len(to_queue):
            to_queue = np.vstack([before[lane.start], to_queue])
    if lane.end in moved:
        to_room = np.vstack([to_room, moved[lane.end]])
    return dataclasses.replace(lane, to_room=frozen_array(to_room), to_queue=frozen_array(to_queue))


# --- spaces off ways -------------------------------------------------------------------------


class Way(NamedTuple):
    """What a robot drives from one room to another, or to its waiting spots."""

    start: int  #: room number
    end: int  #: room number
    points: Array  #: (K, 2) [m], K >= 2


def ways_of(floor: Floor, lanes: Iterable[Lane], *, only_derived: bool = False) -> list[Way]:
    """List the ways of lanes, from the first room's point on.

    Args:
        floor: with points of all rooms.
        lanes: between them.
        only_derived: leave out what the floor's own lanes say.
    """
    given = {(lane.start, lane.end): lane for lane in floor.lanes} if only_derived else {}
    ways = []
    for lane in lanes:
        begin, end = floor.rooms[lane.start], floor.rooms[lane.end]
        known = given.get((begin.name, end.name))
        if known is None:
            ways.append(Way(lane.start, lane.end, np.vstack([begin.point, lane.to_room])))
        if len(lane.to_queue) and (known is None or not len(known.to_queue)):
            ways.append(Way(lane.start, lane.end, np.vstack([begin.point, lane.to_queue])))
    return ways


class Passers:
    """What robots drive and where they stand on a floor, seen by each of its rooms.

    Args:
        floor: with points of all rooms.
        ways: that are driven between rooms.
        queues: ``(S, 2)`` waiting spots of each room [m].
    """

    def __init__(self, floor: Floor, ways: Sequence[Way], queues: Sequence[Array]) -> None:
        self._past = floor.driven_past
        self._ends = [(way.start, way.end) for way in ways]
        self._lines = shapely.STRtree([shapely.linestrings(way.points) for way in ways])
        points = [np.asarray(room.point) for room in floor.rooms]
        stands = [(i, point) for i, point in enumerate(points)]
        stands += [(i, spot) for i, queue in enumerate(queues) for spot in queue]
        stands += [(-1, place) for place in floor.parking]
        self._whose = np.array([i for i, _ in stands])
        self._stands = np.array([place for _, place in stands]).reshape(-1, 2)

    def crosses(self, room: int, area: Polygon) -> bool:
        """Whether others drive or stand in a room's area."""
        if any(room not in self._ends[k] for k in self._lines.query(area, "intersects")):
            return True
        past = self._past[room] if self._past else np.zeros((0, 2, 2))
        if shapely.intersects(area, shapely.linestrings(past)).any():
            return True
        return bool(shapely.intersects_xy(area, self.stands_of_others(room)).any())

    def gap(self, room: int, point: Array) -> float:
        """Measure from a room's point to where others drive or stand [m], inf: not near."""
        spot = Point(point)
        near = self._lines.query(spot.buffer(2.0 * OPEN_ROOM), "intersects")
        lines = self._lines.geometries[[k for k in near if room not in self._ends[k]]]
        gaps = [
            shapely.distance(lines, spot),
            np.hypot(*(self.stands_of_others(room) - point).T),
        ]
        if self._past:
            gaps.append(shapely.distance(shapely.linestrings(self._past[room]), spot))
        return float(np.concatenate(gaps).min(initial=np.inf))

    def stands_of_others(self, room: int) -> Array:
        """List where robots of other rooms stand, and parked ones ``(K, 2)`` [m]."""
        return np.asarray(self._stands[self._whose != room])


def rooms_driven_through(entrances: Sequence[Entrance], passers: Passers) -> list[int]:
    """List the rooms in whose area others drive or stand."""
    return [i for i, entrance in enumerate(entrances) if passers.crosses(i, Polygon(entrance.area))]


def spaces_off_ways(
    routes: RouteMap, floor: Floor, entrances: Sequence[Entrance], passers: Passers
) -> list[Entrance]:
    """Keep the space of each room off what others drive, and off the only way to anywhere.

    A room in which nobody else drives or stands keeps its area. Another one has the surroundings of
    its point, as far as they are its own: at least the spot where a robot stands.

    Args:
        routes: the floor.
        floor: with points of all rooms.
        entrances: of the rooms.
        passers: who drives past.
    """
    found = []
    spot = SPOT_SHARE * routes.radius
    for i, entrance in enumerate(entrances):
        point, area = floor.rooms[i].point, entrance.area
        stands = passers.stands_of_others(i)
        if passers.crosses(i, Polygon(area)) or _cuts_off(routes, area, stands):
            reach = min(max(passers.gap(i, point) - SPACE_TO_LANE, spot), OPEN_ROOM)
            area = octagon(point, reach)
            if reach > spot and _cuts_off(routes, area, stands):
                reach, area = spot, octagon(point, spot)
            release_area = octagon(point, max(reach + 0.1, LET_GO))
            found.append(dataclasses.replace(entrance, area=area, release_area=release_area))
        else:
            found.append(entrance)
    return found


def is_outside_rooms(
    routes: RouteMap, entrances: Sequence[Entrance], driven: Array, places: Array
) -> BoolArray:
    """Whether each of ``places`` ``(K, 2)`` [m] is reached from the lanes through no room.

    Args:
        routes: the floor.
        entrances: of the rooms.
        driven: ``(D, 2)`` points on lanes [m].
        places: ``(K, 2)`` [m].
    """
    outside = routes.free.copy()
    for entrance in entrances:
        outside &= ~routes.cells_in(entrance.area)
    parts = ndimage.label(outside)[0]

    def parts_at(points: Array) -> Array:
        rows, cols = np.clip(routes.costmap.cells(points), 0, np.array(parts.shape) - 1).T
        return np.asarray(parts[rows, cols])

    counts = np.bincount(parts_at(driven))
    counts[0] = 0  # inside rooms
    return np.asarray(parts_at(places) == np.argmax(counts))


def is_mere_spot(room: Room, radius: float) -> bool:
    """Whether a room's space is but the spot where a robot of ``radius`` [m] stands."""
    return len(room.area) > 2 and bool(np.hypot(*(room.area - room.point).T).max() < radius)


def _cuts_off(routes: RouteMap, area: Array, stands: Array) -> bool:
    """Whether an area lies on the only way between two of the places ``stands`` ``(K, 2)``."""
    rows, cols = routes.window(area.min(axis=0) - 0.5, area.max(axis=0) + 0.5)
    free = routes.free[rows, cols]
    rest = free & ~routes.cells_in(area)[rows, cols]
    before, after = ndimage.label(free)[0][rest], ndimage.label(rest)[0][rest]
    pairs = np.unique(np.stack([before, after], axis=1), axis=0)
    if len(np.unique(pairs[:, 0])) == len(pairs):
        return False  # what hangs together near by still does
    floor = routes.free.copy()
    floor[rows, cols] = rest
    parts = ndimage.label(floor)[0]
    reached = {int(parts[routes.cell(place)]) for place in stands} - {0}
    return len(reached) > 1


def _gap(point: Array, lanes: Array) -> float:
    return float(_gaps(point[None], lanes)[0])


def _gaps(points: Array, lanes: Array) -> Array:
    """Measure the distance ``(K,)`` [m] of points ``(K, 2)`` to the nearest of ``(L, 2, 2)``."""
    if not len(lanes):
        return np.full(len(points), np.inf)
    return np.asarray(shapely.distance(shapely.multilinestrings(lanes), shapely.points(points)))
