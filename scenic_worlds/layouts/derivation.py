"""From a user's floor to a layout: what the user left out is derived.

Lanes follow the middle of what is free, moved to the right; robots wait along walls near
the doors, where lanes still pass; parking keeps away from all of it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
from shapely.geometry import MultiLineString, MultiPolygon, Polygon

from mrta_falsify.core.arrays import Array, frozen_array
from mrta_falsify.core.world import Lane, Resource, Room, World
from scenic_worlds.layouts.assembly import lane_travel_times
from scenic_worlds.layouts.entrances import FRONT, Entrance, find_entrance
from scenic_worlds.layouts.frontages import corners
from scenic_worlds.layouts.passing import (
    Passers,
    is_outside_rooms,
    rooms_driven_through,
    spaces_off_ways,
    ways_of,
)
from scenic_worlds.layouts.queues import Sites, choose_parking, choose_queue, standing_places
from scenic_worlds.layouts.reach import check_reachable, check_spots, with_points
from scenic_worlds.layouts.routes import (
    ROBOT_RADIUS,
    STEP,
    MiddleWays,
    RouteMap,
    evenly,
    right_of,
)
from scenic_worlds.layouts.stops import ASK_AROUND
from simulator_interface.formats.floor_yaml import Floor, FloorLane, FloorRoom

SPOT_DISC = 0.30  # m around a waiting robot that lanes keep away from as from a wall
DRIVEN_THROUGH = 0.3  # share of its clearance that floor counts for in a room of others
LEAST_TO_LANE = 0.62  # m; a spot nearer to traffic is given up
MOST_PARKING = 12
MOST_TURN_OFFS = 40  # places on a lane where robots may turn off to a waiting spot
TURN_OFF_STEP = 5  # samples of the lane from one of them to the next


def derive_layout(floor: Floor, *, radius: float = ROBOT_RADIUS, off_ways: bool = True) -> World:
    """Derive the layout of a user's floor.

    Args:
        floor: walls, rooms, and any traffic that the user gave; that is kept as it is.
        radius: of the largest robot [m]. Above the default, robots keep as much farther
            from walls and each other; below, distances stay those of the default.
        off_ways: a room that others drive through has only as much space of its own as keeps off
            their ways. False: it has its surroundings, whoever comes through.

    Returns:
        A world without robots, humans, tasks and events.

    Raises:
        WorldError: a room point stands in an obstacle, or cannot be reached.
    """
    solid = World(
        name=floor.name, bounds=floor.bounds, walls=floor.walls, furniture=floor.furniture
    )
    routes = RouteMap(solid, radius)
    floor = with_points(routes, floor)
    part = check_reachable(routes, floor)
    check_spots(routes, floor, part)
    points = [np.asarray(room.point) for room in floor.rooms]
    entrances, middles = _entrances(routes, floor, points)
    queues, sites = _queues(routes, floor, entrances, middles, part)
    given = {(lane.start, lane.end): lane for lane in floor.lanes}
    lanes = _Lanes(routes, floor, entrances, queues)
    apart = LEAST_TO_LANE + 2.0 * routes.extra
    through: list[int] = []
    for look in range(2):  # spots that stand in the way are given up, once
        derived = lanes.build(given)
        if look == 0 and off_ways:
            ways = ways_of(floor, derived, only_derived=True)
            through = rooms_driven_through(entrances, Passers(floor, ways, []))
            if through:
                lanes = _Lanes(routes, floor, entrances, queues, off=through)
                derived = lanes.build(given)
        shorter = [
            _kept(queue, derived, i, least=0.0 if len(floor.rooms[i].queue) else apart)
            if len(floor.rooms[i].queue) or lanes.reaches_spots(i)
            else queue[:0]
            for i, queue in enumerate(queues)
        ]
        if all(len(a) == len(b) for a, b in zip(shorter, queues, strict=True)):
            break
        queues = shorter
        lanes = _Lanes(routes, floor, entrances, queues, off=through)
    if off_ways:
        passers = Passers(floor, ways_of(floor, derived), queues)
        entrances = spaces_off_ways(routes, floor, entrances, passers)
    parking = floor.parking
    if not len(parking):
        legs = [evenly(np.vstack([points[lane.start], lane.to_room])) for lane in derived]
        legs += [evenly(lane.to_queue) for lane in derived if len(lane.to_queue) > 1]
        driven = np.vstack([*legs, *points, *(e.front[None] for e in entrances)])
        taken = np.vstack([*queues, *(e.front[None] for e in entrances)])
        gap = routes.gap(sites.points, routes.distance_to(driven))
        wanted = min(MOST_PARKING, len(points) + 2)
        open_floor = ~shapely.contains_xy(_areas(floor), sites.points)
        if off_ways:
            open_floor &= is_outside_rooms(routes, entrances, driven, sites.points)
        parking = choose_parking(
            sites.taking(open_floor), gap[open_floor], taken, wanted, farther=2.0 * routes.extra
        )
    times = floor.travel_times if floor.travel_times.size else lane_travel_times(derived, points)
    return World(
        name=floor.name,
        bounds=floor.bounds,
        walls=floor.walls,
        furniture=floor.furniture,
        rooms=tuple(
            Room(name=room.name, point=room.point, door=entrance.door, area=entrance.area)
            for room, entrance in zip(floor.rooms, entrances, strict=True)
        ),
        lanes=tuple(derived),
        resources=(
            *(_resource(floor, i, entrance, queues[i]) for i, entrance in enumerate(entrances)),
            *floor.resources,
        ),
        parking=frozen_array(parking.reshape(-1, 2)),
        travel_times=frozen_array(times),
    )


def _areas(floor: Floor) -> MultiPolygon:
    """Collect the areas of corridors, doors, lifts and chargers."""
    return MultiPolygon([Polygon(resource.release_area) for resource in floor.resources])


def _entrances(routes: RouteMap, floor: Floor, points: list[Array]) -> tuple[list[Entrance], Array]:
    """Find every room's entrance, and all points of the middle ways between rooms."""
    ways = MiddleWays(routes, routes.clearance)
    out: list[Array] = [np.zeros((0, 2)) for _ in points]
    seen: list[Array] = [np.zeros((0, 2))]
    for goal, point in enumerate(points):
        others = [i for i in range(len(points)) if i != goal]
        found = ways.to(point, [points[i] for i in others])
        seen += [way[2:-2] for way in found]
        for i, way in zip(others, found, strict=True):
            # The way to the nearest other room shows the door.
            if not len(out[i]) or len(way) < len(out[i]):
                out[i] = way
    entrances = [
        find_entrance(routes, room, out[i], [p for k, p in enumerate(points) if k != i])
        for i, room in enumerate(floor.rooms)
    ]
    return entrances, np.vstack(seen)


def _queues(
    routes: RouteMap, floor: Floor, entrances: list[Entrance], middles: Array, part: int
) -> tuple[list[Array], Sites]:
    sites = standing_places(routes, entrances, middles, part)
    if floor.driven_past and floor.lanes:  # robots keep to the lanes of a building
        gaps = shapely.distance(_lanes_of(floor), shapely.points(sites.points))
        sites = sites.taking(gaps >= LEAST_TO_LANE + 2.0 * routes.extra)
    queues = [room.queue.reshape(-1, 2) for room in floor.rooms]
    for i, entrance in enumerate(entrances):
        if len(queues[i]) or not floor.spots:
            continue
        fronts = [e.front[None] for e in entrances]
        taken = np.vstack([*queues, *fronts])
        queues[i] = choose_queue(routes, sites, entrance, taken, floor.spots)
    return queues, sites


def _lanes_of(floor: Floor) -> MultiLineString:
    """Collect the lanes that a floor's file gives."""
    begin = {room.name: room.point for room in floor.rooms}
    ways = [np.vstack([begin[lane.start], lane.to_room]) for lane in floor.lanes]
    legs = np.concatenate([np.stack([way[:-1], way[1:]], axis=1) for way in ways])
    return MultiLineString(list(np.unique(np.round(legs, 3), axis=0)))


class _Lanes:
    """Right-hand ways between all rooms, for one choice of waiting spots.

    Ways of others keep off the rooms ``off``, where there is room.
    """

    def __init__(
        self,
        routes: RouteMap,
        floor: Floor,
        entrances: list[Entrance],
        queues: list[Array],
        off: Sequence[int] = (),
    ) -> None:
        self._behind: set[int] = set()  # rooms whose spots are reached through others
        self._off = off
        self._rooms = shapely.STRtree([Polygon(entrance.area) for entrance in entrances])
        self._shunned = np.zeros(routes.free.shape, dtype=np.bool_)
        for i in off:
            self._shunned |= routes.cells_in(entrances[i].area)
        self._routes = routes
        self._floor = floor
        self._entrances = entrances
        self._queues = queues

    def build(self, given: dict[tuple[str, str], FloorLane]) -> list[Lane]:
        """Build the lanes of all ordered pairs; given ones stay as they are."""
        names = [room.name for room in self._floor.rooms]
        to_room = self._ways_between_fronts()
        to_queue = self._ways_to_tails()
        lanes = []
        for start in range(len(names)):
            for end in range(len(names)):
                if start == end:
                    continue
                known = given.get((names[start], names[end]))
                room_way = to_room[start, end] if known is None else np.asarray(known.to_room)
                queue_way = to_queue[start, end]
                if known is not None and len(known.to_queue):
                    queue_way = np.asarray(known.to_queue)
                elif known is not None and self._floor.driven_past:
                    queue_way = self._along(start, end, room_way, otherwise=queue_way)
                lanes.append(
                    Lane(
                        start=start,
                        end=end,
                        to_queue=frozen_array(queue_way),
                        to_room=frozen_array(room_way),
                    )
                )
        return lanes

    def _along(self, start: int, end: int, way: Array, *, otherwise: Array) -> Array:
        """Lead along a building's lanes to a room's last waiting spot, or to before the room.

        Args:
            start: room number.
            end: room number.
            way: ``(K, 2)`` along the lanes to the room's point [m].
            otherwise: the way where none leads from the lanes to the spot.
        """
        driven = evenly(np.vstack([self._floor.rooms[start].point, way]))
        room = Polygon(self._entrances[end].release_area).buffer(FRONT)
        outside = np.flatnonzero(~shapely.contains_xy(room, driven))
        driven = driven[: max(int(outside[-1]) if len(outside) else 0, 1) + 1]
        queue = self._queues[end]
        if not len(queue):
            return _corners(driven)[1:]
        places = np.arange(len(driven))[::TURN_OFF_STEP]
        gaps = np.hypot(*(driven[places] - queue[-1]).T)
        best = otherwise
        is_behind = self._leads_through(otherwise, {start, end})
        for k in places[np.lexsort((places, np.round(gaps, 2)))][:MOST_TURN_OFFS].tolist():
            leg = np.stack([driven[k], queue[-1]])
            if not self._routes.is_clear(*leg) or self._leads_through(leg, {start}):
                continue
            is_past = self._leads_past_waiting(leg)
            if is_behind or not is_past:
                best = _joined([_corners(driven[: k + 1])[1:], queue[-1:]])
            is_behind = False
            if not is_past:
                break
        if is_behind:
            self._behind.add(end)
        return best

    def reaches_spots(self, room: int) -> bool:
        """Whether ways lead to a room's spots without leading through other rooms."""
        return room not in self._behind

    def _leads_through(self, way: Array, own: set[int]) -> bool:
        """Whether a way leads through rooms that are not its own."""
        line = shapely.linestrings(np.vstack([way[:1], way]))
        return bool(set(self._rooms.query(line, "intersects").tolist()) - own)

    def _leads_past_waiting(self, way: Array) -> bool:
        """Whether a way to a waiting spot leads closely past robots at others."""
        waiting = np.vstack([np.zeros((0, 2)), *self._queues])
        waiting = waiting[np.hypot(*(waiting - way[-1]).T) > 0.0]
        gaps = shapely.distance(shapely.linestrings(way), shapely.points(waiting))
        return bool(gaps.min(initial=np.inf) < LEAST_TO_LANE + 2.0 * self._routes.extra)

    def _clearance(self, without: int = -1) -> Array:
        """Measure the distance to walls and waiting robots, without one room's last spot."""
        spots = [q[:-1] if i == without else q for i, q in enumerate(self._queues)]
        spots += [self._floor.rooms[i].point[None] for i in self._off]
        waiting = np.vstack([np.zeros((0, 2)), *spots])
        clear = self._routes.clearance
        if not len(waiting):
            return clear
        return np.minimum(clear, self._routes.distance_to(waiting) - SPOT_DISC - self._routes.extra)

    def _middle_ways(self, clear: Array) -> MiddleWays:
        """Prepare the search for ways, that shun the rooms they need not lead through."""
        return MiddleWays(self._routes, np.where(self._shunned, DRIVEN_THROUGH * clear, clear))

    def _ways_between_fronts(self) -> dict[tuple[int, int], Array]:
        clear = self._clearance()
        middle = self._middle_ways(clear)
        fronts = [entrance.front for entrance in self._entrances]
        found = {}
        for end, front in enumerate(fronts):
            # One middle for both directions, so that their lanes lie on its two sides.
            ways = middle.to(front, fronts[:end])
            for start, found_way in enumerate(ways):
                way = found_way if len(found_way) else np.vstack([fronts[start], front])
                found[start, end] = self._from_door_to_door(start, end, way, clear)
                found[end, start] = self._from_door_to_door(end, start, way[::-1], clear)
        return found

    def _from_door_to_door(self, start: int, end: int, way: Array, clear: Array) -> Array:
        lane = right_of(self._routes, way, clear, before=0.6, after=0.6)
        return _joined(
            [self._entrances[start].entry[::-1][1:], lane[1:-1], self._entrances[end].entry]
        )

    def _ways_to_tails(self) -> dict[tuple[int, int], Array]:
        fronts = [entrance.front for entrance in self._entrances]
        found = {}
        for end, queue in enumerate(self._queues):
            goal = queue[-1] if len(queue) else fronts[end]
            clear = self._clearance(without=end)
            starts = [i for i in range(len(fronts)) if i != end]
            ways = self._middle_ways(clear).to(goal, [fronts[i] for i in starts])
            for start, found_way in zip(starts, ways, strict=True):
                way = found_way if len(found_way) else np.vstack([fronts[start], goal])
                lane = right_of(self._routes, way, clear, before=0.6, after=1.0)
                found[start, end] = _joined(
                    [self._entrances[start].entry[::-1][1:], lane[1:-1], goal[None]]
                )
        return found


def _corners(points: Array) -> Array:
    """Reduce samples ``(K, 2)`` of a polyline to its corners."""
    if len(points) < 2:
        return points
    return np.asarray(shapely.get_coordinates(shapely.simplify(shapely.linestrings(points), 0.01)))


def _joined(pieces: list[Array]) -> Array:
    """Join polylines; corners nearer than 0.1 m to the one before are dropped."""
    points = np.vstack(pieces)
    kept = [points[-1]]
    for point in points[-2::-1]:
        if np.hypot(*(point - kept[-1])) >= 0.1:
            kept.append(point)
    return np.array(kept[::-1])


def _kept(queue: Array, lanes: list[Lane], room: int, *, least: float) -> Array:
    """Keep the first spots of a queue that no traffic passes nearer than ``least`` [m]."""
    if least <= 0.0 or not len(queue) or not lanes:
        return queue
    driven = []
    for lane in lanes:
        way = np.vstack([lane.to_queue])
        if lane.end == room:
            way = evenly(way)[: -round(1.3 / STEP)] if len(way) > 1 else way[:0]
        elif len(way) > 1:
            way = evenly(way)
        driven += [evenly(np.asarray(lane.to_room)), way]
    ways = np.vstack(driven)
    for place, spot in enumerate(queue):
        if np.hypot(*(ways - spot).T).min() < least:
            return queue[:place]
    return queue


def _resource(floor: Floor, number: int, entrance: Entrance, queue: Array) -> Resource:
    room: FloorRoom = floor.rooms[number]
    near = np.vstack([queue.reshape(-1, 2), entrance.front[None], room.point[None]])
    x1, y1 = (near.min(axis=0) - ASK_AROUND).tolist()
    x2, y2 = (near.max(axis=0) + ASK_AROUND).tolist()
    return Resource(
        name=room.name,
        kind="room",
        room=number,
        capacity=room.capacity,
        spots=frozen_array(queue.reshape(-1, 2)),
        entry=room.entry if len(room.entry) else entrance.entry,
        request_area=room.request_area if len(room.request_area) else corners((x1, y1, x2, y2)),
        release_area=room.release_area if len(room.release_area) else entrance.release_area,
        hold=room.hold,
        service_time=room.service_time,
    )
