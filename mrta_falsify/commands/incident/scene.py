"""A log's incident as a world: its floor, the places where robots went, and who went where when."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

import numpy as np

from mrta_falsify.commands.incident.legs import Leg
from mrta_falsify.core.arrays import Array, frozen_array
from mrta_falsify.core.errors import FormatError
from mrta_falsify.core.geometry import wrap_angle
from mrta_falsify.core.world import RobotSpec, Task, World
from scenic_worlds.layouts.derivation import derive_layout
from scenic_worlds.layouts.routes import RouteMap
from simulator_interface.formats.fleet_log import FleetLog
from simulator_interface.formats.floor_fields import FloorRoom
from simulator_interface.formats.floor_yaml import Floor
from simulator_interface.formats.map_walls import map_corners, walls_of_map

MARGIN = 2.0  # m around the poses, where there is no map
ONE_PLACE = 0.75  # m between stops that are one place
NAMED_WITHIN = 1.0  # m from a room of the floor, whose name a place then has
MAX_PLACES = 16
BEFORE = 120.0  # s before an incident that its scenario begins at most
LEAD = 5.0  # s that robots stand before the first of them sets out, so that it may come sooner
AFTER = 180.0  # s that its scenario goes on


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Scene:
    """The world of an incident."""

    world: World
    begin: float  #: when in the log it begins [s]
    notes: tuple[str, ...]


def floor_of_log(log: FleetLog, given: World | None, name: str) -> World:
    """Make the floor that a log's robots drove on, without rooms unless they were given.

    Args:
        log: of the fleet.
        given: the floor, instead of the log's map.
        name: of the floor.
    """
    places = np.vstack([robot.pose[:, :2] for robot in log.robots])
    low, high = places.min(axis=0) - MARGIN, places.max(axis=0) + MARGIN
    if given is not None:
        bounds = np.concatenate(
            [np.minimum(given.bounds[:2], low), np.maximum(given.bounds[2:], high)]
        )
        return dataclasses.replace(given, bounds=frozen_array(bounds))
    if log.grid is None:
        return World(name=name, bounds=frozen_array([*low, *high]))
    corners = map_corners(log.grid)
    low, high = np.minimum(corners.min(axis=0), low), np.maximum(corners.max(axis=0), high)
    return World(name=name, bounds=frozen_array([*low, *high]), walls=walls_of_map(log.grid))


def with_robots(floor: World, log: FleetLog, *, radius: float, at: float) -> World:
    """Put the log's robots on a floor, where they were at a time ``at`` [s]."""
    robots = []
    for robot in log.robots:
        x, y, yaw = robot.at(np.array([at]))[0].tolist()
        pose = frozen_array([x, y, float(wrap_angle(np.float64(yaw)))])
        robots.append(RobotSpec(name=robot.name, pose=pose, radius=radius))
    return dataclasses.replace(floor, robots=tuple(robots))


def scene_of(
    log: FleetLog,
    legs: tuple[tuple[Leg, ...], ...],
    floor: World,
    *,
    onset: float | None,
    who: tuple[str, ...],
    radius: float,
) -> Scene:
    """Make the world of an incident.

    It begins when the robots concerned set out, at most 120 s before the onset; they do so after
    5 s. Every leg becomes a task for its robot, from the place before to its goal.

    Args:
        log: of the fleet.
        legs: of its robots.
        floor: where they drove.
        onset: when the incident began [s]; None: there is none, and all of the log is taken.
        who: names of the robots concerned.
        radius: of the robots [m].

    Raises:
        InputError: no robot goes anywhere, or a place cannot be reached.
    """
    begin = 0.0 if onset is None else _begin(log, legs, onset, who)
    end = log.duration if onset is None else onset
    world = with_robots(floor, log, radius=radius, at=begin)
    stops, trips = _trips(world, legs, begin, end)
    if not trips:
        raise FormatError(
            f"{floor.name}: no robot goes anywhere, so there is no scenario to write (are the "
            "goals on other topics?)"
        )
    notes: list[str] = []
    routes = RouteMap(dataclasses.replace(floor, rooms=(), lanes=(), resources=()), radius)
    names = [room.name for room in floor.rooms]
    rooms = []
    for number, stop in enumerate(stops):
        point, moved = _on_free_floor(routes, stop)
        if moved > 0.3:
            notes.append(f"a stop at [{stop[0]:.2f}, {stop[1]:.2f}] was moved by {moved:.2f} m")
        rooms.append(FloorRoom(name=_name_of(point, floor, names, number), point=point))
    robots = tuple(_start(robot, routes, notes) for robot in world.robots)
    layout = derive_layout(
        Floor(
            name=floor.name,
            bounds=floor.bounds,
            walls=floor.walls,
            furniture=floor.furniture,
            rooms=tuple(rooms),
            resources=tuple(use for use in floor.resources if use.kind != "room"),
            parking=floor.parking,
            travel_times=np.zeros((0, 0)),
            spots=2,
        ),
        radius=radius,
    )
    horizon = float(math.ceil(LEAD + end - begin + AFTER))
    tasks = sorted(trips, key=lambda trip: trip[0])
    return Scene(
        world=dataclasses.replace(
            layout,
            robots=robots,
            tasks=tuple(
                Task(arrival=round(LEAD + when, 2), start=a, end=b, deadline=horizon, robot=name)
                for when, a, b, name in tasks
            ),
            horizon=horizon,
        ),
        begin=begin,
        notes=tuple(notes),
    )


def _begin(
    log: FleetLog, legs: tuple[tuple[Leg, ...], ...], onset: float, who: tuple[str, ...]
) -> float:
    """Find when the robots concerned set out on the legs that they were on at the onset [s]."""
    begins = [
        max((leg.begin for leg in rows if leg.begin <= onset), default=onset)
        for robot, rows in zip(log.robots, legs, strict=True)
        if robot.name in who
    ]
    return max(min(begins, default=0.0), onset - BEFORE, 0.0)


def _trips(
    world: World, legs: tuple[tuple[Leg, ...], ...], begin: float, end: float
) -> tuple[list[Array], list[tuple[float, int, int, str]]]:
    """Find the places of a scene, and its trips: when, from, to, by whom."""
    stops: list[Array] = []

    def number_of(point: Array) -> int:
        for number, stop in enumerate(stops):
            if math.dist(stop, point) <= ONE_PLACE:
                return number
        stops.append(point)
        return len(stops) - 1

    trips = []
    for robot, rows in zip(world.robots, legs, strict=True):
        running = [k for k, leg in enumerate(rows) if leg.begin <= begin]
        ahead = [leg for leg in rows[running[-1] if running else 0 :] if leg.begin <= end]
        here = robot.pose[:2]
        for leg in ahead:
            if math.dist(here, leg.goal) <= ONE_PLACE or len(stops) >= MAX_PLACES - 1:
                continue
            first, last = number_of(here), number_of(leg.goal)
            if first != last:
                trips.append((max(leg.begin - begin, 0.0), first, last, robot.name))
            here = leg.goal
    return stops, trips


def _on_free_floor(routes: RouteMap, point: Array) -> tuple[Array, float]:
    """Find the nearest place where robots can be, and how far it is [m]."""
    if routes.free[routes.cell(point)]:
        return frozen_array(point), 0.0
    cells = np.argwhere(routes.free)
    if not len(cells):
        raise FormatError("no robot of this size has room on the log's map (give --radius)")
    centres = routes.costmap.centers(cells)
    away = np.hypot(*(centres - point).T)
    nearest = int(np.argmin(away))
    return frozen_array(centres[nearest]), float(away[nearest])


def _start(robot: RobotSpec, routes: RouteMap, notes: list[str]) -> RobotSpec:
    point, moved = _on_free_floor(routes, robot.pose[:2])
    if moved > 0.0:
        notes.append(f"the start of {robot.name} was moved by {moved:.2f} m, off what is solid")
    return dataclasses.replace(robot, pose=frozen_array([*point, robot.pose[2]]))


def _name_of(point: Array, floor: World, names: list[str], number: int) -> str:
    """Name a place as the floor's room that it is, once."""
    for room in floor.rooms:
        if room.name in names and math.dist(room.point, point) <= NAMED_WITHIN:
            names.remove(room.name)
            return room.name
    return f"place_{number + 1}"
