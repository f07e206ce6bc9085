"""A floor as plain shapes with roles, and what moves on it at one moment.

What stands still is painted by :mod:`reports.floor_plot` (matplotlib),
:mod:`reports.floor_drawings` (SVG), :mod:`reports.animation` (pixels) and ``templates/replay.js``
(canvas). What moves is painted as shapes by the second and the third; the picture of a run draws
tracks (:mod:`reports.run_picture`), and the replay takes columns of the trace
(:mod:`reports.packing`). All colours are those of :mod:`reports.colours`.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple

import numpy as np

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.costmap import Costmap
from mrta_falsify.core.trace import Trace
from mrta_falsify.core.world import Blockage, HumanSpec, Resource, World

FLOOR_MARGIN = 0.6  # m of floor shown around everything that is drawn


class Role(StrEnum):
    """What a shape of the floor is."""

    LANE = "lane"
    ROOM_AREA = "room-area"
    FURNITURE = "furniture"
    SAMPLED_FURNITURE = "sampled-furniture"  #: differs between worlds of one program
    WALL = "wall"
    BLOCKAGE = "blockage"
    DOOR = "door"
    QUEUE_SPOT = "queue-spot"
    PARKING = "parking"
    ROOM = "room"
    ROUTE = "route"  #: of a person
    TRAIL = "trail"  #: where a robot was
    PATH = "path"  #: where a robot plans to go
    PERSON = "person"
    BLIND_PERSON = "blind-person"  #: ignores robots
    ROBOT = "robot"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Shape:
    """One thing to paint: an area, a line or a place, depending on its role."""

    role: Role
    points: Array  #: (n, 2) [m], map frame: corners, points of a line, or one place
    text: str = ""  #: name or label
    number: int = -1  #: of the robot or person
    radius: float = 0.0  #: of a body [m]
    yaw: float = 0.0  #: of a body [rad]
    start: float = -np.inf  #: when it appears [s]
    end: float = np.inf  #: when it goes [s]
    blind: bool = False  #: belongs to a person who ignores robots


class Extent(NamedTuple):
    """A rectangle of the floor [m], map frame."""

    x_min: float
    y_min: float
    x_max: float
    y_max: float

    @property
    def width(self) -> float:
        """From west to east [m]."""
        return self.x_max - self.x_min

    @property
    def height(self) -> float:
        """From south to north [m]."""
        return self.y_max - self.y_min


def extent_of(world: World) -> Extent:
    """Rectangle that holds everything drawn, plus a margin, within the bounds of the world."""
    parts = [
        *(wall.polygon for wall in world.walls),
        *(item.polygon for item in world.furniture),
        *(room.point[None] for room in world.rooms),
        *(robot.pose[None, :2] for robot in world.robots),
    ]
    if not parts:
        return Extent(*map(float, world.bounds))
    points = np.concatenate(parts)
    low = np.maximum(points.min(axis=0) - FLOOR_MARGIN, world.bounds[:2])
    high = np.minimum(points.max(axis=0) + FLOOR_MARGIN, world.bounds[2:])
    return Extent(*map(float, (*low, *high)))


def costmap_extent(costmap: Costmap) -> Extent:
    """Rectangle that the cells of a costmap cover."""
    rows, cols = costmap.cost.shape
    x, y = map(float, costmap.origin)
    return Extent(x, y, x + cols * costmap.resolution, y + rows * costmap.resolution)


def floor_scene(world: World, furniture: Sequence[Array] | None = None) -> tuple[Shape, ...]:
    """Describe everything that stands still, from the bottom of the picture to its top.

    Args:
        world: what to draw.
        furniture: outlines ``(V, 2)`` [m]; all furniture at its first places if None.
    """
    if furniture is None:
        furniture = [item.polygon for item in world.furniture]
    ways = [way for lane in world.lanes for way in (lane.to_queue, lane.to_room) if len(way) > 1]
    return (
        *(Shape(role=Role.LANE, points=way) for way in ways),
        *(Shape(role=Role.ROOM_AREA, points=r.area) for r in world.rooms if len(r.area) >= 3),
        *(Shape(role=Role.ROOM_AREA, points=r.release_area) for r in world.resources if _passed(r)),
        *(Shape(role=Role.FURNITURE, points=outline) for outline in furniture),
        *(Shape(role=Role.WALL, points=wall.polygon) for wall in world.walls),
        *(_blockage(event) for event in world.events if isinstance(event, Blockage)),
        *(Shape(role=Role.DOOR, points=r.door) for r in world.rooms if len(r.door) >= 2),
        *_places(world),
    )


def floor_at(world: World, trace: Trace, tick: int) -> tuple[Shape, ...]:
    """Describe the floor at a tick (-1: the last one), with furniture where it was pushed to."""
    furniture = fixed_outlines(world) + movable_outlines(world, trace, tick)
    return floor_scene(world, furniture)


def _passed(resource: Resource) -> bool:
    """Whether robots pass a resource on their way: a corridor, door, lift or charger."""
    return resource.kind != "room"


def _blockage(event: Blockage) -> Shape:
    return Shape(
        role=Role.BLOCKAGE,
        points=event.polygon,
        text=event.name,
        start=event.start,
        end=event.end,
    )


def _places(world: World) -> Iterable[Shape]:
    """Describe queue spots (1 is the head), parking spots and room points."""
    for resource in world.resources:
        for place, spot in enumerate(resource.spots, start=1):
            yield Shape(role=Role.QUEUE_SPOT, points=spot[None], text=f"{place}")
    for spot in world.parking:
        yield Shape(role=Role.PARKING, points=spot[None], text="P")
    for number, room in enumerate(world.rooms):
        text = f"{number}" if room.name in ("", f"{number}") else f"{number} {room.name}"
        yield Shape(role=Role.ROOM, points=room.point[None], text=text, number=number)


def shapes_at(shapes: Iterable[Shape], time: float) -> tuple[Shape, ...]:
    """Keep the shapes that are there at ``time`` [s]."""
    return tuple(shape for shape in shapes if shape.start <= time < shape.end)


# --- what moves -----------------------------------------------------------------------------


def starting_scene(world: World) -> tuple[Shape, ...]:
    """Describe people with their routes, and robots, before anything has moved."""
    routes = [
        Shape(role=Role.ROUTE, points=_closed_route(human), blind=not human.reacts_to_robots)
        for human in world.humans
    ]
    people = [
        _person(human, number, start_of(human.route, human.start, repeat=human.repeat))
        for number, human in enumerate(world.humans)
    ]
    robots = [
        _robot(robot.name, robot.radius, number, robot.pose)
        for number, robot in enumerate(world.robots)
    ]
    return (*routes, *people, *robots)


def moving_scene(world: World, trace: Trace, tick: int, *, trail: float) -> tuple[Shape, ...]:
    """Describe pushed furniture, trails, people and robots at a tick.

    Args:
        world: of the run.
        trace: of the run, kept.
        tick: when.
        trail: how much of a robot's way is shown [s].
    """
    poses = trace.columns["pose"]
    past = slice(max(0, tick - round(trail / trace.dt)), tick + 1, 4)
    robots = range(len(world.robots))
    places = trace.columns["human_position"][tick]
    return (
        *(
            Shape(role=Role.FURNITURE, points=outline)
            for outline in movable_outlines(world, trace, tick)
        ),
        *(Shape(role=Role.TRAIL, points=poses[past, i, :2], number=i) for i in robots),
        *(
            _person(human, number, place)
            for number, (human, place) in enumerate(zip(world.humans, places, strict=True))
            if np.isfinite(place).all()  # NaN: not in the building
        ),
        *(
            _robot(robot.name, robot.radius, number, poses[tick, number])
            for number, robot in enumerate(world.robots)
        ),
    )


def path_scene(trace: Trace, tick: int) -> tuple[Shape, ...]:
    """Describe the paths that robots follow at a tick."""
    return tuple(
        Shape(role=Role.PATH, points=points, number=robot)
        for robot, points in sorted(trace.paths_at(tick).items())
        if len(points)
    )


def _person(human: HumanSpec, number: int, place: Array) -> Shape:
    role = Role.PERSON if human.reacts_to_robots else Role.BLIND_PERSON
    return Shape(role=role, points=place[None], text=human.name, number=number, radius=human.radius)


def _robot(name: str, radius: float, number: int, pose: Array) -> Shape:
    return Shape(
        role=Role.ROBOT,
        points=pose[None, :2],
        text=name,
        number=number,
        radius=radius,
        yaw=float(pose[2]),
    )


def _closed_route(human: HumanSpec) -> Array:
    route = human.route
    return np.concatenate([route, route[:1]]) if human.repeat and len(route) > 1 else route


def start_of(route: Array, share: float, *, repeat: bool) -> Array:
    """Point ``(2,)`` at ``share`` of the length of a route of straight legs."""
    points = np.concatenate([route, route[:1]]) if repeat else route
    lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
    walked = np.concatenate([[0.0], np.cumsum(lengths)])
    if walked[-1] == 0.0:
        return np.asarray(route[0])
    at = share * walked[-1]
    return np.array([np.interp(at, walked, points[:, axis]) for axis in (0, 1)])


def robot_outline(pose: Array, radius: float) -> Array:
    """Arrow-shaped outline ``(5, 2)`` [m] at ``pose`` (x, y, yaw), pointing forward."""
    shape = (
        1.45 * radius * np.array([[1.2, 0.0], [0.1, 0.95], [-1.0, 0.8], [-1.0, -0.8], [0.1, -0.95]])
    )
    cos, sin = np.cos(pose[2]), np.sin(pose[2])
    return np.asarray(shape @ np.array([[cos, sin], [-sin, cos]]) + pose[:2])


def outline_of(robot: Shape, *, scale: float = 1.0) -> Array:
    """Arrow-shaped outline ``(5, 2)`` [m] of a robot, ``scale`` times as large as it is."""
    pose = np.array([*robot.points[0], robot.yaw])
    return robot_outline(pose, scale * robot.radius)


# --- where movable furniture stands in a run ------------------------------------------------


def furniture_poses(world: World, trace: Trace) -> Array:
    """Centre x, y [m] and turn since the start [rad] of the movable furniture.

    Returns:
        ``(K, F, 3)`` for the K ticks of the trace; where the trace does not say, the first places.
    """
    pieces = world.movable_furniture()
    ticks = len(trace) if "time" in trace.columns else 0
    known = trace.columns.get("furniture_pose")
    if known is not None and known.shape == (ticks, len(pieces), 3):
        return np.asarray(known)
    first = np.array([(*piece.center, 0.0) for piece in pieces]).reshape(-1, 3)
    return np.tile(first, (ticks, 1, 1))


def movable_outlines(world: World, trace: Trace, tick: int) -> list[Array]:
    """Footprints ``(V, 2)`` [m] of the movable furniture at ``tick`` (-1: the last one)."""
    pieces, poses = world.movable_furniture(), furniture_poses(world, trace)
    if not len(poses):
        return [piece.polygon for piece in pieces]
    return [piece.outline_at(pose) for piece, pose in zip(pieces, poses[tick], strict=True)]


def fixed_outlines(world: World) -> list[Array]:
    """Footprints ``(V, 2)`` [m] of the furniture that cannot be pushed."""
    return [item.polygon for item in world.furniture if not item.movable]
