"""From a user's floor to a layout: what the user left out is derived.

Lanes follow the middle of what is free, moved to the right; robots wait along walls near
the doors, where lanes still pass; parking keeps away from all of it.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Sequence

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry import MultiLineString, MultiPolygon, Polygon

from mrta_falsify.core.arrays import Array, BoolArray, IntArray, frozen_array
from mrta_falsify.core.polyline import cut_path, path_length
from mrta_falsify.core.world import Lane, Resource, Room, World
from scenic_worlds.layouts.assembly import lane_travel_times
from scenic_worlds.layouts.enclosures import FRONT
from scenic_worlds.layouts.entrances import Entrance, find_entrance
from scenic_worlds.layouts.frontages import corners
from scenic_worlds.layouts.passing import (
    LEAST_TO_LANE,
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
    WIDE,
    MiddleWays,
    RouteMap,
    both_sides,
    evenly,
    right_of,
)
from scenic_worlds.layouts.stops import ASK_AROUND
from simulator_interface.formats.floor_yaml import Floor, FloorLane, FloorRoom

SPOT_DISC = 0.30  # m around a waiting robot that lanes keep away from as from a wall
DRIVEN_THROUGH = 0.3  # share of its clearance that floor counts for in a room of others
MAX_PARKING = 12
MAX_TURN_OFFS = 40  # places on a lane where robots may turn off to a waiting spot
TURN_OFF_STEP = 5  # samples of the lane from one of them to the next
DRIVEN_STEP = 0.5  # m between points of lanes that say which floor is driven on
OWN_END = 1.3  # m of the lane to a room's last spot that pass the room's other spots


def derive_layout(
    floor: Floor,
    *,
    radius: float = ROBOT_RADIUS,
    off_ways: bool = True,
    on_progress: Callable[[float, float], None] | None = None,
) -> World:
    """Derive the layout of a user's floor.

    Args:
        floor: walls, rooms, and any traffic that the user gave; that is kept as it is.
        radius: of the largest robot [m]. Above the default, robots keep as much farther
            from walls and each other; below, distances stay those of the default.
        off_ways: a room that others drive through has only as much space of its own as keeps off
            their ways. False: it has its surroundings, whoever comes through.
        on_progress: called with how many rooms are done, and of how many, each being looked
            at several times.

    Returns:
        A world without robots, humans, tasks and events.

    Raises:
        WorldError: a room point stands in an obstacle, or cannot be reached.
    """
    solid = World(
        name=floor.name, bounds=floor.bounds, walls=floor.walls, furniture=floor.furniture
    )
    routes = RouteMap(solid, radius)
    steps = _Steps(on_progress, len(floor.rooms))
    floor = with_points(routes, floor)
    part = check_reachable(routes, floor)
    check_spots(routes, floor, part)
    points = [np.asarray(room.point) for room in floor.rooms]
    entrances = _entrances(routes, floor, points, steps)
    middles = _middle_ways(routes, points, entrances, steps)
    queues, sites = _queues(routes, floor, entrances, middles, part)
    given = {(lane.start, lane.end): lane for lane in floor.lanes}
    lanes = _Lanes(routes, floor, entrances, queues)
    apart = LEAST_TO_LANE + 2.0 * routes.extra
    least = [0.0 if len(room.queue) else apart for room in floor.rooms]
    through: list[int] = []
    for look in range(2):  # spots that stand in the way are given up, once
        derived = lanes.build(given, steps.next)
        if look == 0 and off_ways:
            ways = ways_of(floor, derived, only_derived=True)
            through = rooms_driven_through(entrances, Passers(floor, ways, []))
            if through:
                lanes = _Lanes(routes, floor, entrances, queues, off=through)
                derived = lanes.build(given, steps.next)
        shorter = [
            queue if len(floor.rooms[i].queue) or lanes.reaches_spots(i) else queue[:0]
            for i, queue in enumerate(_kept(queues, derived, least))
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
        legs = [np.vstack([points[lane.start], lane.to_room]) for lane in derived]
        legs += [lane.to_queue for lane in derived if len(lane.to_queue) > 1]
        legs += [np.vstack([point, e.front]) for point, e in zip(points, entrances, strict=True)]
        taken = np.vstack([*queues, *(e.front[None] for e in entrances)])
        driven, _ = _segments(legs)
        tree = shapely.STRtree(driven)
        places = shapely.points(sites.points)
        _, gap = tree.query_nearest(places, return_distance=True, all_matches=False)
        wanted = min(MAX_PARKING, len(points) + 2)
        open_floor = ~shapely.contains_xy(_areas(floor), sites.points)
        if off_ways:
            on_lanes = shapely.get_coordinates(shapely.segmentize(driven, DRIVEN_STEP))
            open_floor &= is_outside_rooms(routes, entrances, on_lanes, sites.points)
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


class _Steps:
    """How far a derivation is: each room is looked at three times, or once more."""

    def __init__(self, show: Callable[[float, float], None] | None, rooms: int) -> None:
        self._show = show
        self._done, self._total, self._rooms = 0, 3 * rooms, rooms

    def next(self) -> None:
        """Count one room."""
        self._done += 1
        if self._done > self._total:  # lanes are built again, around fewer waiting spots
            self._total += self._rooms
        if self._show is not None:
            self._show(float(self._done), float(self._total))


def _entrances(
    routes: RouteMap, floor: Floor, points: list[Array], steps: _Steps
) -> list[Entrance]:
    """Find every room's entrance."""
    ways = MiddleWays(routes, routes.clearance)
    all_points = np.array(points)
    found = []
    for i, room in enumerate(floor.rooms):
        others = [other for k, other in enumerate(floor.rooms) if k != i]
        taken = [Polygon(other.area) for other in others if len(other.area)]
        found.append(find_entrance(routes, ways, room, np.delete(all_points, i, axis=0), taken))
        steps.next()
    return found


def _middle_ways(
    routes: RouteMap, points: list[Array], entrances: list[Entrance], steps: _Steps
) -> BoolArray:
    """Mark the cells ``(rows, cols)`` of the middle ways between all rooms."""
    # Out of a room with one door all ways are the same up to that door.
    starts = [e.front if e.is_dead_end else p for p, e in zip(points, entrances, strict=True)]
    floor = _thoroughfares(routes, entrances, np.zeros((0, 2)))
    for point in starts:
        floor[routes.cell(point)] = True
    ways = MiddleWays(routes, routes.clearance, floor=floor)
    marked = np.zeros(routes.free.shape, dtype=np.bool_)
    for goal, start in enumerate(starts):
        for way in ways.to(start, starts[:goal]):
            cells = routes.costmap.cells(way[1:-1])
            marked[cells[:, 0], cells[:, 1]] = True
        steps.next()
    return marked


def _queues(
    routes: RouteMap, floor: Floor, entrances: list[Entrance], middles: BoolArray, part: int
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
        self._rooms = shapely.STRtree([Polygon(entrance.area) for entrance in entrances])
        self._shunned = np.zeros(routes.free.shape, dtype=np.bool_)
        for i in off:
            self._shunned |= routes.cells_in(entrances[i].area)
        self._off = [floor.rooms[i].point[None] for i in off]
        self._routes = routes
        self._floor = floor
        self._entrances = entrances
        self._queues = queues
        self._fronts = [entrance.front for entrance in entrances]
        spots = np.vstack([np.zeros((0, 2)), *queues])
        self._spots, self._waiting = spots, shapely.STRtree(shapely.points(spots))
        #: of each room, its floor with that before its door
        self._before = [Polygon(e.release_area).buffer(FRONT) for e in entrances]
        shapely.prepare(self._before)
        taken = np.vstack([spots, *self._off])
        self._clear = routes.clearance
        if len(taken):
            waiting = routes.distance_to(taken) - SPOT_DISC - routes.extra
            self._clear = np.minimum(self._clear, waiting)
        priced = np.where(self._shunned, DRIVEN_THROUGH * self._clear, self._clear)
        self._ways = MiddleWays(routes, priced, floor=_thoroughfares(routes, entrances, spots))

    def build(
        self, given: dict[tuple[str, str], FloorLane], on_place: Callable[[], None]
    ) -> list[Lane]:
        """Build the lanes of all ordered pairs; given ones stay as they are.

        Args:
            given: by the names of start and end.
            on_place: called after each room.
        """
        names = [room.name for room in self._floor.rooms]
        pairs = list(itertools.permutations(range(len(names)), 2))
        known = {
            (names.index(start), names.index(end)): lane for (start, end), lane in given.items()
        }
        to_room = {pair: np.asarray(lane.to_room) for pair, lane in known.items()}
        to_queue = {p: np.asarray(k.to_queue) for p, k in known.items() if len(k.to_queue)}
        given_queues = set(to_queue)
        for end in range(len(names)):
            # One middle for both directions, so that their lanes lie on its two sides.
            starts = [i for i in range(end) if not {(i, end), (end, i)} <= to_room.keys()]
            for start, way in zip(starts, self._middles(end, starts), strict=True):
                there, back = both_sides(self._routes, way, self._clear, ends=0.6)
                to_room.setdefault((start, end), self._from_door_to_door(start, end, there))
                to_room.setdefault((end, start), self._from_door_to_door(end, start, back))
            starts = [i for i in range(len(names)) if i != end and (i, end) not in to_queue]
            to_queue.update({(start, end): way for start, way in self._ways_to_tail(end, starts)})
            on_place()
        if self._floor.driven_past:  # robots keep to the lanes of a building
            for start, end in sorted(known.keys() - given_queues):
                otherwise = to_queue[start, end]
                to_queue[start, end] = self._along(start, end, to_room[start, end], otherwise)
        return [
            Lane(
                start=start,
                end=end,
                to_queue=frozen_array(to_queue[start, end]),
                to_room=frozen_array(to_room[start, end]),
            )
            for start, end in pairs
        ]

    def _along(self, start: int, end: int, way: Array, otherwise: Array) -> Array:
        """Lead along a building's lanes to a room's last waiting spot, or to before the room.

        Args:
            start: room number.
            end: room number.
            way: ``(K, 2)`` along the lanes to the room's point [m].
            otherwise: the way where none leads from the lanes to the spot.
        """
        line = np.vstack([self._floor.rooms[start].point, way])
        driven = evenly(line)
        step = path_length(line) / (len(driven) - 1)
        outside = np.flatnonzero(~shapely.contains_xy(self._before[end], driven))
        last = max(int(outside[-1]) if len(outside) else 0, 1)
        queue = self._queues[end]
        if not len(queue):
            return _joined([cut_path(line, last * step)[1:]])
        places = np.arange(last + 1)[::TURN_OFF_STEP]
        gaps = np.hypot(*(driven[places] - queue[-1]).T)
        places = places[np.lexsort((places, np.round(gaps, 2)))][:MAX_TURN_OFFS]
        legs = np.stack([driven[places], np.tile(queue[-1], (len(places), 1))], axis=1)
        is_free = ~self._lead_through(legs, {start}) & self._routes.are_clear(legs)
        is_past = self._lead_past_waiting(legs, queue[-1])
        is_behind = bool(self._lead_through(_legs(otherwise), {start, end}).any())
        best = places[is_free & ~is_past][:1]
        if not len(best) and is_behind:
            best = places[is_free][:1]
            if not len(best):
                self._behind.add(end)
        if not len(best):
            return otherwise
        return _joined([cut_path(line, int(best[0]) * step)[1:], queue[-1:]])

    def reaches_spots(self, room: int) -> bool:
        """Whether ways lead to a room's spots without leading through other rooms."""
        return room not in self._behind

    def _lead_through(self, legs: Array, own: set[int]) -> BoolArray:
        """Whether straight legs ``(K, 2, 2)`` lead through rooms that are not their own."""
        leg, room = self._rooms.query(shapely.linestrings(legs), "intersects")
        through = np.zeros(len(legs), dtype=np.bool_)
        through[leg[~np.isin(room, list(own))]] = True
        return through

    def _lead_past_waiting(self, legs: Array, spot: Array) -> BoolArray:
        """Whether legs ``(K, 2, 2)`` to a waiting spot pass robots closely that wait at others."""
        lines = shapely.linestrings(legs)
        reach = LEAST_TO_LANE + 2.0 * self._routes.extra
        leg, other = self._waiting.query(lines, "dwithin", distance=reach)
        past = np.zeros(len(legs), dtype=np.bool_)
        past[leg[(self._spots[other] != spot).any(axis=1)]] = True
        return past

    def _middles(self, end: int, starts: list[int]) -> list[Array]:
        """Find the middle ways from the fronts of some rooms to that of another."""
        front = self._fronts[end]
        ways = self._ways.to(front, [self._fronts[i] for i in starts])
        return [
            way if len(way) else np.vstack([self._fronts[i], front])
            for i, way in zip(starts, ways, strict=True)
        ]

    def _from_door_to_door(self, start: int, end: int, lane: Array) -> Array:
        return _joined(
            [self._entrances[start].entry[::-1][1:], lane[1:-1], self._entrances[end].entry]
        )

    def _ways_to_tail(self, end: int, starts: list[int]) -> Iterator[tuple[int, Array]]:
        """Find the ways from other rooms to the last waiting spot of a room, or its front."""
        queue = self._queues[end]
        goal = queue[-1] if len(queue) else self._fronts[end]
        clear, search = self._clear, self._ways
        if starts and len(queue):  # no robot waits there yet
            window, part = self._clearance_without(end)
            clear = self._clear.copy()
            clear[window] = part
            priced = np.where(self._shunned[window], DRIVEN_THROUGH * part, part)
            search = self._ways.with_clearance(window, priced)
        ways = search.to(goal, [self._fronts[i] for i in starts])
        for start, found_way in zip(starts, ways, strict=True):
            way = found_way if len(found_way) else np.vstack([self._fronts[start], goal])
            lane = right_of(self._routes, way, clear, before=0.6, after=1.0)
            yield (
                start,
                _joined([self._entrances[start].entry[::-1][1:], lane[1:-1], goal[None]]),
            )

    def _clearance_without(self, room: int) -> tuple[tuple[slice, slice], Array]:
        """Measure the clearance around a room's last waiting spot as if nobody waited there."""
        routes, tail = self._routes, self._queues[room][-1]
        rows, cols = routes.free.shape
        row, col = routes.cell(tail)
        reach = int(np.ceil((WIDE + SPOT_DISC + routes.extra) / routes.resolution)) + 1
        window = (
            slice(max(row - reach, 0), min(row + reach + 1, rows)),
            slice(max(col - reach, 0), min(col + reach + 1, cols)),
        )
        spots = [q[:-1] if i == room else q for i, q in enumerate(self._queues)]
        spots += self._off
        at = routes.costmap.cells(np.vstack(spots))
        near = (np.abs(at - (row, col)) <= 2 * reach).all(axis=1)
        part = routes.clearance[window].copy()
        y, x = np.ogrid[window]
        for there in at[near].tolist():
            far = np.hypot(y - there[0], x - there[1]) * routes.resolution
            part = np.minimum(part, far - SPOT_DISC - routes.extra)
        return window, part


def _thoroughfares(routes: RouteMap, entrances: list[Entrance], spots: Array) -> BoolArray:
    """Find the free cells outside of rooms with one door, through which no way leads.

    Args:
        routes: the floor.
        entrances: of all rooms.
        spots: ``(K, 2)`` waiting spots [m]; a room with one in it stays.
    """
    floor = routes.free.copy()
    places = np.vstack([spots, *(entrance.front[None] for entrance in entrances)])
    needed = {routes.flat_cell(place) for place in places}
    for entrance in entrances:
        if entrance.is_dead_end and needed.isdisjoint(entrance.cells.tolist()):
            floor.flat[entrance.cells] = False
    return floor


def _legs(way: Array) -> Array:
    """Split a polyline ``(K, 2)`` into its straight legs ``(K - 1, 2, 2)``."""
    if len(way) < 2:
        way = np.vstack([way[:1], way[:1]])
    return np.stack([way[:-1], way[1:]], axis=1)


def _joined(pieces: list[Array]) -> Array:
    """Join polylines; corners nearer than 0.1 m to the one before are dropped."""
    points = np.vstack(pieces)
    kept = [len(points) - 1]
    places = points.tolist()
    for k in range(len(points) - 2, -1, -1):
        if math.dist(places[k], places[kept[-1]]) >= 0.1:
            kept.append(k)
    return np.asarray(points[kept[::-1]])


def _kept(queues: list[Array], lanes: list[Lane], least: list[float]) -> list[Array]:
    """Keep the first spots of each queue that no traffic passes nearer than ``least`` [m]."""
    if not lanes:
        return queues
    # A robot on its way to the last spot passes the others of its row at the end.
    ways = [(-1, lane.to_room) for lane in lanes]
    ways += [(-1, _without_end(lane.to_queue, OWN_END)) for lane in lanes]
    ways += [(lane.end, lane.to_queue) for lane in lanes]
    segments, owners = _segments([way for _, way in ways])
    ends = np.array([end for end, _ in ways], dtype=np.int64)[owners]
    tree = shapely.STRtree(segments)
    kept = []
    for room, (queue, gap) in enumerate(zip(queues, least, strict=True)):
        count = len(queue)
        if gap > 0.0 and count:
            spot, way = tree.query(shapely.points(queue), predicate="dwithin", distance=gap)
            count = min(spot[ends[way] != room].tolist(), default=count)
        kept.append(queue[:count])
    return kept


def _segments(ways: Sequence[Array]) -> tuple[NDArray[np.object_], IntArray]:
    """Split polylines ``(K, 2)`` into straight lines, with the number of the polyline of each."""
    ways = [way.reshape(-1, 2) for way in ways]
    starts = np.vstack([np.zeros((0, 2)), *(way[:-1] for way in ways)])
    ends = np.vstack([np.zeros((0, 2)), *(way[1:] for way in ways)])
    owners = np.repeat(np.arange(len(ways)), [max(len(way) - 1, 0) for way in ways])
    lines: NDArray[np.object_] = shapely.linestrings(np.stack([starts, ends], axis=1))
    return lines, owners


def _without_end(way: Array, length: float) -> Array:
    """Shorten a polyline ``(K, 2)`` by some metres of its end; empty: nothing is left."""
    way = np.array(way)
    rest = path_length(way) - length
    return cut_path(way, rest) if rest > 0.0 else way[:0]


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
