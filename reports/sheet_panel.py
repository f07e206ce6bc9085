"""One panel of a contact sheet: a small map on which sampled furniture stands out."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
import shapely.geometry.polygon
from matplotlib.axes import Axes
from matplotlib.collections import PathCollection
from matplotlib.path import Path as MplPath

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.world import Blockage, Furniture, World
from reports.body_plot import BodyStyle, paint_bodies
from reports.colours import PAINTS
from reports.floor_plot import AreaStyle, draw_label, paint_areas, set_extent
from reports.floor_scene import Extent, Role, Shape, extent_of, floor_scene
from reports.moving_scene import starting_scene

SURROUNDINGS = 2.5  # m, shown around what a run is about
SOLID = "#d5d9e2"  # inside of walls: those that fill a space stay light
NUMBER = "#7a5c00"  # of a room
TAKEN = 0.6  # m; a robot this near to a room's point hides its number
SMALL_AREAS = {
    Role.FURNITURE: AreaStyle(0.25, 2),
    Role.SAMPLED_FURNITURE: AreaStyle(0.7, 5),
    Role.BLOCKAGE: AreaStyle(0.8, 6, hatch="/////"),
}
SMALL_BODIES = BodyStyle(person=3.6, route=0.7, scale=1.5, edge=0.4)


def fixed_furniture(worlds: Sequence[World]) -> frozenset[bytes]:
    """Keys of the furniture that all worlds have in common; none of a single world."""
    keys = [frozenset(map(furniture_key, world.furniture)) for world in worlds]
    return frozenset.intersection(*keys) if len(keys) > 1 else frozenset()


def furniture_key(item: Furniture) -> bytes:
    """Tell two pieces apart by name and place."""
    return item.name.encode() + item.polygon.tobytes()


def common_extent(worlds: Sequence[World], fixed: frozenset[bytes]) -> Extent:
    """Rectangle with everything that a run is about, the same for all worlds."""
    points = np.concatenate([part for world in worlds for part in _places(world, fixed)])
    boxes = np.array([extent_of(world) for world in worlds])
    low = np.maximum(points.min(axis=0) - SURROUNDINGS, boxes[:, :2].min(axis=0))
    high = np.minimum(points.max(axis=0) + SURROUNDINGS, boxes[:, 2:].max(axis=0))
    return Extent(*map(float, (*low, *high)))


def _places(world: World, fixed: frozenset[bytes]) -> list[Array]:
    """List points ``(n, 2)`` [m] of rooms, lanes, robots, people and what was sampled."""
    return [
        np.asarray(world.bounds).reshape(2, 2) if not world.rooms else world.rooms[0].point[None],
        *(room.point[None] for room in world.rooms),
        *(room.door for room in world.rooms if len(room.door)),
        *(way for lane in world.lanes for way in (lane.to_queue, lane.to_room) if len(way)),
        *(robot.pose[None, :2] for robot in world.robots),
        *(human.route for human in world.humans),
        *(item.polygon for item in world.furniture if fixed and furniture_key(item) not in fixed),
        *(event.polygon for event in world.events if isinstance(event, Blockage)),
    ]


def draw_small_map(axes: Axes, world: World, extent: Extent, fixed: frozenset[bytes]) -> None:
    """Draw a world as it begins; furniture that is not ``fixed`` is in colour."""
    set_extent(axes, extent)
    axes.set_xticks([])
    axes.set_yticks([])
    axes.set_facecolor("#fbfbf8")
    for spine in axes.spines.values():
        spine.set_color("#cccccc")
    sampled = [item.polygon for item in world.furniture if furniture_key(item) not in fixed]
    known = [item.polygon for item in world.furniture if furniture_key(item) in fixed]
    scene = floor_scene(world, known)
    coloured = [Shape(role=Role.SAMPLED_FURNITURE, points=outline) for outline in sampled]
    paint_areas(axes, (*scene, *coloured), SMALL_AREAS)
    _paint_walls(axes, [shape.points for shape in scene if shape.role is Role.WALL])
    for shape in scene:
        if shape.role is Role.DOOR:
            axes.plot(*shape.points.T, color=PAINTS[Role.DOOR].edge, linewidth=1.5, zorder=4)
        elif shape.role is Role.ROOM:
            _write_number(axes, shape, world)
    paint_bodies(axes, starting_scene(world), SMALL_BODIES)


def _write_number(axes: Axes, room: Shape, world: World) -> None:
    """Write the number of a room at its point, or above the robot that stands there."""
    (point,) = room.points
    taken = any(np.hypot(*(robot.pose[:2] - point)) < TAKEN for robot in world.robots)
    at = point + np.array([0.0, 1.1 if taken else 0.0])
    draw_label(axes, at, str(room.number), size=7, colour=NUMBER, weight="bold")


def _paint_walls(axes: Axes, outlines: Sequence[Array]) -> None:
    """Paint walls as one shape: thin ones look dark, those that fill a space stay light."""
    if not outlines:
        return
    solid = shapely.unary_union([shapely.Polygon(outline) for outline in outlines])
    paths = [
        MplPath.make_compound_path(
            *(MplPath(np.asarray(ring.coords), closed=True) for ring in _rings(part))
        )
        for part in shapely.get_parts(solid)
    ]
    edge = PAINTS[Role.WALL].edge
    axes.add_collection(
        PathCollection(paths, facecolor=SOLID, edgecolor=edge, linewidth=0.8, zorder=3)
    )


def _rings(polygon: shapely.Polygon) -> list[shapely.LinearRing]:
    upright = shapely.geometry.polygon.orient(polygon)  # holes run the other way, so stay open
    return [upright.exterior, *upright.interiors]
