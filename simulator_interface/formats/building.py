"""A level of an Open-RMF building as a floor file: walls, places, lanes, doors, mutex groups."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import shapely
from shapely.geometry import LineString, MultiLineString, Point, Polygon
from shapely.geometry.base import BaseGeometry

from mrta_falsify.core.arrays import Array, frozen_array
from mrta_falsify.core.errors import FormatError
from simulator_interface.formats.building_file import Edge, Level
from simulator_interface.formats.building_graph import LaneGraph, LaneUse
from simulator_interface.formats.floor_fields import (
    FloorFile,
    FloorLane,
    FloorResource,
    FloorRoom,
    FloorShape,
)
from simulator_interface.formats.outlines import outlines

WALL_THICKNESS = 0.1  # m, as Open-RMF builds walls
WALL_HEIGHT = 2.5  # m
DOOR_DEPTH = 0.6  # m before and behind a door that belong to it
LANE_HALF = 0.5  # m beside a lane that belong to its mutex group
LANE_FLOOR = 0.8  # m beside a lane that are floor, whatever outlines say
WAITS_WITHIN = 10.0  # m along lanes from a place to the spots where robots wait for it
AROUND = 0.5  # m around everything, in the bounds
NAMES_TOLD = 5  # of vertices that are left out
PASSED_WITHIN = 5.0  # m from a place, lanes that others drive are told


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BuildingFloor:
    """A level, and what of it a floor cannot hold."""

    described: FloorFile
    starts: tuple[tuple[str, Array], ...]  #: name and place ``(2,)`` [m] of robots
    driven_past: tuple[Array, ...]  #: by room: lanes ``(L, 2, 2)`` [m] near by that others drive
    left_out: tuple[str, ...]  #: what has no counterpart, in words
    no_rooms: tuple[str, ...]  #: which vertices are no rooms, and why, in words


def floor_of_level(level: Level, where: str) -> BuildingFloor:
    """Make a floor of a level.

    Named places become rooms, chargers too; chargers and parking spots without a name, parking;
    unnamed holding points, waiting spots of the nearest place. Where others drive over a parking
    spot or holding point it is neither. Between places robots drive along the lanes. Doors on lanes
    are passed one by one, all others stay shut. A mutex group is a corridor for one robot.

    Args:
        level: to convert.
        where: what errors begin with.

    Raises:
        FormatError: there are no lanes, or no places.
    """
    graph = LaneGraph(level)
    if not graph.lanes:
        raise FormatError(f"{where}: level {level.name!r} has no lanes; robots could not drive")
    open_doors, shut_doors = _doors(level, graph)
    places = _places(level, graph)
    if not places:
        raise FormatError(
            f"{where}: level {level.name!r} has no place for tasks; a place is a vertex with a "
            f"name and a lane{_because(_no_rooms(level, graph))}"
        )
    spots = _spots(level, graph, places)
    waiting, parking = spots.waiting, spots.parking
    rooms = tuple(
        FloorRoom(
            name=name,
            point=level.vertices[k].point,
            queue=frozen_array(_points_of(level, waiting[k])),
        )
        for name, k in places.items()
    )
    shapes = [_shape(level, wall) for wall in level.walls if wall.start != wall.end]
    shapes += [_shape(level, door, name=_name_of(door)) for door in shut_doors]
    outside, bounds = _outside(level, graph)
    described = FloorFile(
        name=f"{level.building}_{level.name}" if level.others else level.building,
        bounds=bounds,
        walls=(*shapes, *outside),
        rooms=rooms,
        lanes=_lanes(graph, places, waiting),
        resources=tuple(_named([*_door_uses(level, open_doors), *_mutexes(level, graph)], rooms)),
        parking=frozen_array(_points_of(level, parking)),
    )
    return BuildingFloor(
        described=described,
        starts=tuple(
            (str(vertex.parameters["spawn_robot_name"]), vertex.point)
            for vertex in level.vertices
            if vertex.has("spawn_robot_name")
        ),
        driven_past=tuple(_driven_past(level, spots.uses, k) for k in places.values()),
        left_out=(*_left_out(level, graph, places, shut_doors), *_passed(spots)),
        no_rooms=tuple(_no_rooms(level, graph)),
    )


def _points_of(level: Level, numbers: Iterable[int]) -> Array:
    return np.array([level.vertices[k].point for k in numbers]).reshape(-1, 2)


def _segment(level: Level, edge: Edge) -> LineString:
    return LineString([level.vertices[edge.start].point, level.vertices[edge.end].point])


def _name_of(edge: Edge) -> str:
    return str(edge.parameters.get("name", ""))


def _shape(level: Level, edge: Edge, name: str = "") -> FloorShape:
    height = float(edge.parameters.get("texture_height", WALL_HEIGHT))
    return FloorShape(
        name=name,
        line=frozen_array(_points_of(level, (edge.start, edge.end))),
        thickness=WALL_THICKNESS,
        height=height if height > 0.0 else WALL_HEIGHT,
    )


# --- places ----------------------------------------------------------------------------------


def _places(level: Level, graph: LaneGraph) -> dict[str, int]:
    """Find the vertices that tasks can name; a name that occurs again gets a number."""
    found: dict[str, int] = {}
    for k, vertex in enumerate(level.vertices):
        if not vertex.name.strip() or k not in graph.touched:
            continue
        name, number = vertex.name, 1
        while name in found:
            number += 1
            name = f"{vertex.name}_{number}"
        found[name] = k
    return found


@dataclass(frozen=True, slots=True, kw_only=True)
class _Spots:
    """Where robots wait and park, and which lanes they drive there and between places."""

    waiting: dict[int, list[int]]  #: of each place, nearest first
    parking: list[int]
    passed: list[int]  #: vertices that would be one of them, but others drive over them
    uses: dict[tuple[int, int], LaneUse]


def _spots(level: Level, graph: LaneGraph, places: dict[str, int]) -> _Spots:
    rooms = list(places.values())
    stands = [
        k
        for k, vertex in enumerate(level.vertices)
        if k in graph.touched
        and k not in places.values()
        and any(map(vertex.has, ("is_charger", "is_parking_spot", "is_holding_point")))
    ]
    ways = [(a, b) for a in rooms for b in (*rooms, *stands)]
    uses = graph.uses([*ways, *((b, a) for a in rooms for b in stands)])
    passed = {k for edge, use in uses.items() for k in edge if use.is_for_others(k)}
    waiting: dict[int, list[int]] = {k: [] for k in rooms}
    parking = []
    for k in stands:
        vertex = level.vertices[k]
        if k in passed:
            continue
        if not vertex.has("is_charger") and not vertex.has("is_parking_spot"):
            nearest = min(rooms, key=lambda room: graph.distance(k, room))
            if graph.distance(k, nearest) <= WAITS_WITHIN:
                waiting[nearest].append(k)
                continue
        parking.append(k)
    for room, spots in waiting.items():
        spots.sort(key=lambda k: graph.distance(k, room))
    return _Spots(
        waiting=waiting,
        parking=parking,
        passed=[k for k in stands if k in passed],
        uses=uses,
    )


def _driven_past(level: Level, uses: dict[tuple[int, int], LaneUse], place: int) -> Array:
    """Collect the lanes ``(L, 2, 2)`` [m] near a place on ways that neither start nor end there."""
    edges = [edge for edge, use in uses.items() if use.is_for_others(place)]
    lanes = np.array([_points_of(level, edge) for edge in edges]).reshape(-1, 2, 2)
    gap = shapely.distance(shapely.linestrings(lanes), Point(level.vertices[place].point))
    return frozen_array(lanes[gap <= PASSED_WITHIN])


def _lanes(
    graph: LaneGraph, places: dict[str, int], waiting: dict[int, list[int]]
) -> tuple[FloorLane, ...]:
    """Ways between all places along the lanes; what has none is derived later."""
    found = []
    for start, first in places.items():
        for end, last in places.items():
            way = graph.way(first, last) if first != last else np.zeros((0, 2))
            if len(way) < 2:
                continue
            to_queue = np.zeros((0, 2))
            if waiting[last]:
                to_queue = graph.way(first, waiting[last][-1])[1:]
            found.append(
                FloorLane(
                    start=start,
                    end=end,
                    to_room=frozen_array(way[1:]),
                    to_queue=frozen_array(to_queue.reshape(-1, 2)),
                )
            )
    return tuple(found)


# --- doors and mutex groups ------------------------------------------------------------------


def _doors(level: Level, graph: LaneGraph) -> tuple[list[Edge], list[Edge]]:
    """Split the doors in those that a lane leads through, and the others."""
    lanes = shapely.union_all([_segment(level, lane) for lane in graph.lanes])
    passed: list[Edge] = []
    shut: list[Edge] = []
    for door in level.doors:
        if door.start != door.end:
            (passed if _segment(level, door).intersects(lanes) else shut).append(door)
    return passed, shut


def _door_uses(level: Level, doors: list[Edge]) -> Iterable[FloorResource]:
    for number, door in enumerate(doors):
        area = _segment(level, door).buffer(DOOR_DEPTH, cap_style="flat", join_style="mitre")
        yield FloorResource(
            name=_name_of(door) or f"door_{number}", kind="door", area=outlines(area)[0]
        )


def _mutexes(level: Level, graph: LaneGraph) -> Iterable[FloorResource]:
    """Make a corridor of each connected piece of a mutex group."""
    for name, shape in _mutex_shapes(level, graph).items():
        for piece in outlines(shape, smallest_hole=1e9):
            yield FloorResource(name=name, kind="corridor", area=piece)


def _mutex_shapes(level: Level, graph: LaneGraph) -> dict[str, BaseGeometry]:
    groups: dict[str, list[BaseGeometry]] = {}
    for lane in graph.lanes:
        if lane.parameters.get("mutex"):
            groups.setdefault(str(lane.parameters["mutex"]), []).append(_segment(level, lane))
    found: dict[str, list[BaseGeometry]] = {
        name: [shapely.line_merge(MultiLineString(lines)).buffer(LANE_HALF, cap_style="flat")]
        for name, lines in groups.items()
    }
    for vertex in level.vertices:
        if vertex.parameters.get("mutex"):
            disc = Point(vertex.point).buffer(LANE_HALF, quad_segs=2)
            found.setdefault(str(vertex.parameters["mutex"]), []).append(disc)
    return {name: shapely.union_all(shapes) for name, shapes in found.items()}


def _named(uses: list[FloorResource], rooms: tuple[FloorRoom, ...]) -> Iterable[FloorResource]:
    """Number the names that occur again."""
    taken = {room.name for room in rooms}
    for use in uses:
        name, number = use.name, 1
        while name in taken:
            number += 1
            name = f"{use.name}_{number}"
        taken.add(name)
        yield dataclasses.replace(use, name=name)


# --- where there is no floor -----------------------------------------------------------------


def _outside(level: Level, graph: LaneGraph) -> tuple[list[FloorShape], Array]:
    """Make solid what is neither floor nor near a lane; and find the bounds ``(4,)`` [m]."""
    points = _points_of(
        level,
        {k for edge in (*level.walls, *graph.lanes) for k in (edge.start, edge.end)}
        | {k for ring in level.floors for k in ring},
    )
    low, high = points.min(axis=0) - AROUND, points.max(axis=0) + AROUND
    bounds = frozen_array([*low, *high])
    if not level.floors:
        return [], bounds
    holes = shapely.union_all([_polygon(level, ring) for ring in level.holes])
    floor = shapely.union_all([_polygon(level, ring) for ring in level.floors]).difference(holes)
    driven = shapely.union_all([_segment(level, lane) for lane in graph.lanes]).buffer(LANE_FLOOR)
    # 0.04 m: outlines that meet leave no gap between them, and walls hide it.
    solid = shapely.box(*bounds).difference(floor.buffer(0.04, join_style="mitre").union(driven))
    return [
        FloorShape(name="no_floor", polygon=ring, height=WALL_HEIGHT) for ring in outlines(solid)
    ], bounds


def _polygon(level: Level, ring: tuple[int, ...]) -> BaseGeometry:
    return shapely.make_valid(Polygon(_points_of(level, ring)))


# --- what has no counterpart -----------------------------------------------------------------


def _no_rooms(level: Level, graph: LaneGraph) -> Iterable[str]:
    """Say which vertices are no rooms, and why."""
    yield from _without_lanes(level, graph)
    unnamed = [k for k in graph.touched if not level.vertices[k].name.strip()]
    if unnamed:
        yield f"{_counted(len(unnamed), 'vertex', 'vertices')} on lanes without a name"
    if level.others:
        yield f"what is on the levels {', '.join(level.others)}"


def _without_lanes(level: Level, graph: LaneGraph) -> Iterable[str]:
    idle = [
        vertex.name
        for k, vertex in enumerate(level.vertices)
        if vertex.name.strip() and k not in graph.touched
    ]
    if idle:
        count = _counted(len(idle), "named vertex", "named vertices")
        more = ", ..." if len(idle) > NAMES_TOLD else ""
        yield f"{count} without a lane: {', '.join(sorted(idle)[:NAMES_TOLD])}{more}"


def _because(reasons: Iterable[str]) -> str:
    told = "; ".join(reasons)
    return f" (left out: {told})" if told else ""


def _counted(count: int, one: str, several: str) -> str:
    return f"{count} {one if count == 1 else several}"


def _passed(spots: _Spots) -> Iterable[str]:
    if spots.passed:
        what = ("parking spot or holding point", "parking spots and holding points")
        yield (
            f"{_counted(len(spots.passed), *what)} on lanes that others drive: robots wait and "
            "park beside the lanes"
        )


def _left_out(
    level: Level, graph: LaneGraph, places: dict[str, int], shut: list[Edge]
) -> Iterable[str]:
    if level.others:
        yield f"the levels {', '.join(level.others)}: a floor is one level"
    if level.lifts:
        lanes = len(level.lanes) - len(graph.lanes)
        yield f"the lifts {', '.join(level.lifts)} and {lanes} lanes into them"
    if level.models:
        yield f"{len(level.models)} models: the file does not hold their shapes (add furniture)"
    if shut:
        yield f"{len(shut)} doors without a lane: robots find them shut"
    if any(vertex.has("is_charger") for vertex in level.vertices):
        yield (
            "charging: chargers with a name are rooms, the others parking places, and robots have "
            "no battery"
        )
    graphs = sorted({int(lane.parameters.get("graph_idx", 0)) for lane in graph.lanes})
    if len(graphs) > 1:
        yield f"the fleets of the graphs {', '.join(map(str, graphs))}: one fleet drives all lanes"
    for field, what in (
        ("speed_limit", "speed limits"),
        ("orientation", "orientations"),
        ("dock_name", "docking"),
    ):
        count = sum(bool(lane.parameters.get(field)) for lane in graph.lanes)
        if count:
            yield f"{what} of {count} lanes"
    pieces = {
        n: len(outlines(s, smallest_hole=1e9)) for n, s in _mutex_shapes(level, graph).items()
    }
    for name, count in pieces.items():
        if count > 1:
            yield f"the unity of mutex group {name}: each of its {count} pieces is one for itself"
    yield from _without_lanes(level, graph)
    cut = sum(
        not np.isfinite(graph.distance(a, b)) for a in places.values() for b in places.values()
    )
    if cut:
        yield f"lanes between {cut} of {len(places) * (len(places) - 1)} pairs of places: derived"
    cleaned = sum(vertex.has("is_cleaning_zone") for vertex in level.vertices)
    if cleaned:
        yield f"cleaning in {cleaned} zones"
