"""What a room's doors close off from the rest of the floor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from scipy import ndimage
from shapely.geometry import Point, Polygon

from mrta_falsify.core.arrays import Array, BoolArray, IntArray
from scenic_worlds.layouts.doorways import Doorway, doorway_of, find_doorways, find_stretches
from scenic_worlds.layouts.routes import MiddleWays, RouteMap, evenly
from simulator_interface.formats.outlines import mask_outlines

THICKEST = 0.6  # m; what is deeper is rather a gap between furniture than a door in a wall
NEAR = 1.5  # m along the way; the smallest of the stretches so near is the door
MAX_DOORS = 4  # of one room
SAME_REST = 0.9  # of the largest part of the floor behind a door is as good
LEAST_REST = 0.4  # of the floor that lies behind a room's door, at least
AROUND = 10.0  # m around a room that are looked at first
FRONT = 0.6  # m, from a door to the point before it
BEYOND = 0.4  # m beyond its posts that a doorway is closed, along the wall
LARGEST_ROOM = 250.0  # m^2, more is a hall
TO_WALL = 0.6  # m, over rows and columns, from where robots drive into the corner of a room


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Enclosure:
    """A part of the floor behind doorways."""

    main: Doorway  #: that leads to the rest of the floor
    doorways: tuple[Doorway, ...]  #: all
    cells: IntArray  #: (n,) flat indices of the cells where robots can be inside


def enclose(
    routes: RouteMap,
    ways: MiddleWays,
    point: Array,
    others: Array,
    given: Doorway | None = None,
    taken: Sequence[Polygon] = (),
) -> Enclosure | None:
    """Find the doors of a room and what they close off; None: it is open.

    Args:
        routes: the floor.
        ways: over it.
        point: ``(2,)`` in the room [m].
        others: ``(K, 2)`` points of the other rooms [m].
        given: a door that the room is known to have.
        taken: areas of other rooms; of several doors, the main one does not lead there.
    """
    way = ways.to_nearest(point, others)
    for doors in (True, False):
        stretches = find_stretches(routes, way, doors=doors) if given is None else []
        closing: list[Enclosure] = _closing(routes, point, others, given)
        for stretch in stretches:
            if closing and stretch.at > _in_a_wall([e.main for e in closing]).at + NEAR:
                break
            closing += _closing(routes, point, others, doorway_of(routes, stretch))
        if closing:
            best = _in_a_wall([e.main for e in closing])
            return next(e for e in closing if e.main is best)
        several = _closed_by_several(routes, ways, point, others, given, taken, openings=not doors)
        if several is not None:
            return several
    return None


def _in_a_wall(found: Sequence[Doorway]) -> Doorway:
    """Choose the first doorway in a wall, or else the first; of several near it, the least."""
    thin = [d for d in found if d.depth <= THICKEST] or found
    first = next((d for d in thin if d.is_framed), thin[0])
    near = [d for d in thin if 0.0 <= d.at - first.at <= NEAR]
    return min(near, key=lambda d: round(d.size, 2))


def _closed_by_several(
    routes: RouteMap,
    ways: MiddleWays,
    point: Array,
    others: Array,
    given: Doorway | None,
    taken: Sequence[Polygon],
    *,
    openings: bool,
) -> Enclosure | None:
    """Shut one doorway after the other until no other room can be reached."""
    shut = [] if given is None else [given]
    while True:
        bars = [doorway_cells(routes, doorway) for doorway in shut]
        way = ways.to_nearest(point, others, without=np.concatenate([np.zeros(0, np.int64), *bars]))
        if not len(way):
            break
        found = list(find_doorways(routes, way))
        if openings and not found:
            found = list(find_doorways(routes, way, doors=False))
        if not found or len(shut) == MAX_DOORS:
            return None
        shut.append(_in_a_wall(found))
    for doorway in shut[:-1]:
        rest = [d for d in shut if d is not doorway]
        if doorway is not given and not _holds_any(routes, others, _part(routes, point, rest)):
            shut = rest
    return _closed_by(routes, point, others, tuple(shut), taken) if shut else None


def _closing(
    routes: RouteMap, point: Array, others: Array, doorway: Doorway | None
) -> list[Enclosure]:
    enclosure = _closed_by(routes, point, others, (doorway,)) if doorway else None
    return [enclosure] if enclosure else []


def _closed_by(
    routes: RouteMap,
    point: Array,
    others: Array,
    doorways: tuple[Doorway, ...],
    taken: Sequence[Polygon] = (),
) -> Enclosure | None:
    """Find what doorways close off; None: another room is there, or it is most of the floor."""
    cells = _part(routes, point, doorways)
    if not len(cells) or _holds_any(routes, others, cells):
        return None
    floor = int(np.count_nonzero(routes.part == routes.part[routes.cell(point)]))
    count, area, main = len(others), floor - len(cells), doorways[0]
    if len(doorways) > 1:
        behind = []
        for doorway in doorways:
            opened = _part(routes, point, [d for d in doorways if d is not doorway])
            behind.append((_holds(routes, others, opened), len(opened) - len(cells)))
        most = max(behind)
        # Of doors to about the same part of the floor the first, which is nearest.
        same = [k for k, (n, a) in enumerate(behind) if n == most[0] and a >= SAME_REST * most[1]]
        k = next((k for k in same if not _leads_into(doorways[k], taken)), same[0])
        (count, area), main = behind[k], doorways[k]
    is_rest = count >= 2 and 2 * count > len(others)
    if not is_rest and area < LEAST_REST * floor:
        return None
    return Enclosure(main=main, doorways=doorways, cells=cells)


def _leads_into(doorway: Doorway, areas: Sequence[Polygon]) -> bool:
    before = Point(doorway.middle + FRONT * doorway.outwards)
    return any(area.contains(before) for area in areas)


def _holds(routes: RouteMap, points: Array, cells: IntArray) -> int:
    """Count the points ``(K, 2)`` [m] in some cells."""
    at = [routes.flat_cell(point) for point in points]
    return int(np.isin(at, cells).sum())


def _holds_any(routes: RouteMap, points: Array, cells: IntArray) -> bool:
    return _holds(routes, points, cells) > 0


def _part(routes: RouteMap, point: Array, shut: Sequence[Doorway]) -> IntArray:
    """Find the flat cells that a robot reaches from a point while doorways are shut."""
    rows, cols = routes.free.shape
    row, col = routes.cell(point)
    bars = np.concatenate([doorway_cells(routes, doorway) for doorway in shut])
    reach = round(AROUND / routes.resolution)
    while True:
        low = max(row - reach, 0), max(col - reach, 0)
        high = min(row + reach, rows), min(col + reach, cols)
        floor = routes.free[low[0] : high[0], low[1] : high[1]].copy()
        at = np.stack(np.divmod(bars, cols), axis=-1) - low
        at = at[((at >= 0) & (at < floor.shape)).all(axis=1)]
        floor[at[:, 0], at[:, 1]] = False
        parts, _ = ndimage.label(floor)
        here = parts[row - low[0], col - low[1]]
        if not here:
            return np.zeros(0, dtype=np.int64)
        inside = parts == here
        goes_on = (
            (low[0] > 0 and inside[0].any())
            or (low[1] > 0 and inside[:, 0].any())
            or (high[0] < rows and inside[-1].any())
            or (high[1] < cols and inside[:, -1].any())
        )
        if not goes_on:
            at_row, at_col = np.nonzero(inside)
            return np.asarray((at_row + low[0]) * cols + at_col + low[1], dtype=np.int64)
        reach = max(rows, cols)


def doorway_cells(routes: RouteMap, doorway: Doorway) -> IntArray:
    """Number the cells ``(n,)`` that shut a doorway at its outer end."""
    along = doorway.posts[1] - doorway.posts[0]
    along = along / max(float(np.hypot(*along)), 1e-9)
    shift = (doorway.reach + 1.5 * routes.resolution) * doorway.outwards
    ends = doorway.posts + shift + BEYOND * np.stack([-along, along])
    rows, cols = routes.free.shape
    bar = np.unique(routes.costmap.cells(evenly(ends, 0.02)), axis=0)
    thick = np.unique((bar[:, None] + _AROUND_A_CELL[None]).reshape(-1, 2), axis=0)
    thick = thick[((thick >= 0) & (thick < (rows, cols))).all(axis=1)]
    return np.asarray(thick[:, 0] * cols + thick[:, 1], dtype=np.int64)


_AROUND_A_CELL = np.argwhere(np.ones((3, 3))) - 1


# --- outlines --------------------------------------------------------------------------------


def outline_of(routes: RouteMap, enclosure: Enclosure) -> Array:
    """Outline ``(V, 2)`` [m] the floor of an enclosure up to its walls and doorways."""
    rows, cols = routes.free.shape
    steps = round((TO_WALL + 2.0 * routes.extra) / routes.resolution)
    shut = np.concatenate([doorway_cells(routes, doorway) for doorway in enclosure.doorways])
    at = np.stack(np.divmod(enclosure.cells, cols), axis=-1)
    low = np.maximum(at.min(axis=0) - steps, 0)
    high = np.minimum(at.max(axis=0) + steps + 1, (rows, cols))
    inside = np.zeros(high - low, dtype=np.bool_)
    inside[tuple((at - low).T)] = True
    floor = ~routes.lethal[low[0] : high[0], low[1] : high[1]]
    bar = np.stack(np.divmod(shut, cols), axis=-1) - low
    bar = bar[((bar >= 0) & (bar < floor.shape)).all(axis=1)]
    floor[bar[:, 0], bar[:, 1]] = False
    # Robots reach the middle of cells; the floor goes on to the walls, and not through them.
    grown = ndimage.binary_dilation(inside, iterations=steps, mask=floor)
    return _largest_outline(routes, grown, low)


def outline_around(routes: RouteMap, point: Array, ring: Array) -> Array:
    """Outline ``(V, 2)`` [m] the floor around a point, from wall to wall, within a ring [m]."""
    rows, cols = routes.free.shape
    low, high = routes.costmap.cells(np.stack([ring.min(axis=0), ring.max(axis=0)]))
    low, high = np.maximum(low, 0), np.minimum(high + 1, (rows, cols))
    cells = np.indices(high - low).reshape(2, -1).T + low
    inside = shapely.contains_xy(Polygon(ring), routes.costmap.centers(cells))
    floor = inside.reshape(high - low) & ~routes.lethal[low[0] : high[0], low[1] : high[1]]
    parts, _ = ndimage.label(floor)
    here = parts[tuple(np.clip(np.array(routes.cell(point)) - low, 0, high - low - 1))]
    if not here or (floor.sum() == inside.sum()):
        return ring
    return _largest_outline(routes, parts == here, low)


def _largest_outline(routes: RouteMap, cells: BoolArray, low: IntArray) -> Array:
    """Outline the cells of a piece of the map that begins at row and column ``low``."""
    at, ends = np.flatnonzero(cells.any(axis=1)), np.flatnonzero(cells.any(axis=0))
    corner = (low + np.array([at[0], ends[0]]))[::-1] * routes.resolution
    rings = mask_outlines(
        cells[at[0] : at[-1] + 1, ends[0] : ends[-1] + 1],
        resolution=routes.resolution,
        origin=routes.costmap.origin + corner,
        smallest_hole=1e9,
    )
    return max(rings, key=lambda ring: Polygon(ring).area)
