"""Where a room ends: its door, its area, and the place before the door."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import shapely
from scipy import ndimage
from shapely.geometry import LineString, Polygon

from mrta_falsify.core.arrays import Array, BoolArray, frozen_array
from scenic_worlds.layouts.routes import STEP, RouteMap, evenly
from scenic_worlds.layouts.stops import APRON
from simulator_interface.formats.floor_yaml import FloorRoom
from simulator_interface.formats.outlines import mask_outlines, outlines

DOOR_WITHIN = 12.0  # m of the way out of a room that are searched for its door
NEAR_DOOR = 4.0  # m, a narrow place this near is the door even if the room has another
DOOR_GAP = 0.95  # m, a door's middle is at most this far from its posts
DOOR_EDGE = 0.15  # m, floor beside a door is wider by this
OPEN_ROOM = 1.2  # m around the point of a room without door and area
ROBOT_REACH = 0.3  # m, robots do not drive nearer to walls, and a cell
LARGEST_ROOM = 250.0  # m^2, more is a hall
FRONT = 0.6  # m, from the door to the point before it


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


def find_entrance(routes: RouteMap, room: FloorRoom, way: Array, others: list[Array]) -> Entrance:
    """Find the entrance of a room.

    Args:
        routes: the floor.
        room: as the user describes it; what is given is kept.
        way: ``(K, 2)`` the way out of the room [m], from its point on; may be empty.
        others: points ``(2,)`` of the other rooms.
    """
    door, mouth, outwards = _door(routes, room, way, others)
    area = room.area if len(room.area) else _area(routes, room.point, door, others)
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
    inside = LineString([room.point, mouth]).buffer(0.5, cap_style="square", join_style="mitre")
    whole = shapely.union_all([Polygon(area).buffer(0.05, join_style="mitre"), apron, inside])
    if not isinstance(whole, Polygon):
        whole = whole.buffer(0.3, join_style="mitre").buffer(-0.25, join_style="mitre")
    parts = sorted(outlines(_filled(whole)), key=lambda ring: -Polygon(ring).area)
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
        release_area=parts[0],
    )


def _filled(shape: shapely.Geometry) -> shapely.Geometry:
    largest = max(getattr(shape, "geoms", [shape]), key=lambda part: part.area)
    return Polygon(largest.exterior)


def _front(routes: RouteMap, mouth: Array, outwards: Array) -> Array:
    """Choose the point before a door that is clearest of walls."""
    reaches = np.array([FRONT, 0.5, 0.7, 0.4, 0.3])
    points = mouth + reaches[:, None] * outwards
    gaps = np.minimum(routes.gap(points), 0.45 + routes.extra)
    return frozen_array(points[int(np.argmax(np.round(gaps, 3)))])


def _door(
    routes: RouteMap, room: FloorRoom, way: Array, others: list[Array]
) -> tuple[Array, Array, Array]:
    """Find the door segment (may be empty), its middle, and the direction out of the room."""
    if len(room.door) == 2:
        middle = room.door.mean(axis=0)
        along = room.door[1] - room.door[0]
        across = np.array([-along[1], along[0]]) / max(float(np.hypot(*along)), 1e-9)
        outwards = across if (middle - room.point) @ across >= 0.0 else -across
        return np.asarray(room.door), middle, outwards
    if len(way) < 2:
        return np.zeros((0, 2)), room.point + np.array([OPEN_ROOM, 0.0]), np.array([1.0, 0.0])
    points = evenly(way)[: round(DOOR_WITHIN / STEP)]
    heading = np.gradient(points, axis=0)
    heading = ndimage.uniform_filter1d(heading, 9, axis=0, mode="nearest")
    heading /= np.maximum(np.hypot(*heading.T), 1e-9)[:, None]
    if len(room.area):
        inside = shapely.contains_xy(Polygon(room.area), points)
        k = int(np.argmin(inside)) if not inside.all() else len(points) - 1
        return _posts(routes, points[k], heading[k]), points[k], heading[k]
    for narrow in _narrow_places(routes.gap(points)):
        door = _posts(routes, points[narrow], heading[narrow])
        if not len(door):
            continue
        is_near = narrow * STEP <= NEAR_DOOR
        if is_near or _closed_off(routes, room.point, door, others) is not None:
            return door, points[narrow], heading[narrow]
    k = min(round(OPEN_ROOM / STEP), len(points) - 1)
    return np.zeros((0, 2)), points[k], heading[k]


def _narrow_places(gap: Array) -> Iterator[int]:
    """Yield samples of narrow places with wider floor on both sides, in order."""
    last = len(gap)
    k = 0
    while k < last:
        if gap[k] > DOOR_GAP:
            k += 1
            continue
        end = k
        while end < last and gap[end] <= DOOR_GAP:
            end += 1
        lowest = k + int(np.argmin(gap[k:end]))
        wider_before = gap[: lowest + 1].max() >= gap[lowest] + DOOR_EDGE
        wider_after = gap[lowest:].max() >= gap[lowest] + DOOR_EDGE
        if wider_before and wider_after:
            # The middle of the passage, not its first cell.
            level = np.flatnonzero(gap[k:end] <= gap[lowest] + 0.03) + k
            yield int(level[len(level) // 2])
        k = end


def _posts(routes: RouteMap, middle: Array, heading: Array) -> Array:
    """Span a segment ``(2, 2)`` from solid to solid; empty if it is wider than a door."""
    side = np.array([-heading[1], heading[0]])
    reaches = np.arange(0.0, 1.5, routes.resolution / 2.0)
    posts = []
    for sign in (-1.0, 1.0):
        points = middle + sign * reaches[:, None] * side
        solid = np.flatnonzero(routes.gap(points) <= 0.0)
        if not len(solid):
            return np.zeros((0, 2))
        posts.append(points[solid[0]])
    return np.array(posts)


def _closed_off(
    routes: RouteMap, point: Array, door: Array, others: list[Array]
) -> BoolArray | None:
    """Find the cells that ``point`` reaches without the door; None if another room is there."""
    floor = routes.free.copy()
    along = door[1] - door[0]
    beyond = 0.3 * along / max(float(np.hypot(*along)), 1e-9)
    bar = routes.costmap.cells(evenly(np.vstack([door[0] - beyond, door[1] + beyond]), 0.02))
    rows, cols = floor.shape
    for row, col in np.unique(bar, axis=0).tolist():
        if 0 <= row < rows and 0 <= col < cols:
            floor[max(row - 1, 0) : row + 2, max(col - 1, 0) : col + 2] = False
    parts, _ = ndimage.label(floor)
    here = parts[routes.cell(point)]
    if not here or any(parts[routes.cell(other)] == here for other in others):
        return None
    return np.asarray(parts == here)


def _area(routes: RouteMap, point: Array, door: Array, others: list[Array]) -> Array:
    """Outline ``(V, 2)`` [m] the floor that the door closes off, or a piece around the point."""
    closed = _closed_off(routes, point, door, others) if len(door) == 2 else None
    if closed is not None and closed.sum() * routes.resolution**2 <= LARGEST_ROOM:
        # Robots reach the middle of cells; the floor goes on to the walls.
        reach = round(ROBOT_REACH / routes.resolution)
        grown = ndimage.binary_dilation(closed, iterations=reach) & ~routes.lethal
        rows, cols = np.flatnonzero(grown.any(axis=1)), np.flatnonzero(grown.any(axis=0))
        corner = np.array([cols[0], rows[0]]) * routes.resolution
        rings = mask_outlines(
            grown[rows[0] : rows[-1] + 1, cols[0] : cols[-1] + 1],
            resolution=routes.resolution,
            origin=routes.costmap.origin + corner,
            smallest_hole=1e9,
        )
        return max(rings, key=lambda ring: Polygon(ring).area)
    angle = np.pi / 8.0 + np.arange(8) * np.pi / 4.0
    return np.asarray(point + OPEN_ROOM * np.stack([np.cos(angle), np.sin(angle)], axis=1))
