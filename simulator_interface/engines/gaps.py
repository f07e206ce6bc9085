"""Surface gaps between robots, people and solids; negative where bodies overlap.

Footprints are convex polygons, people are discs, solids are edges with the solid on the left
(counter-clockwise outlines). All kernels are plain loops for numba.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from mrta_falsify.core.arrays import Array, BoolArray, IntArray
from mrta_falsify.core.compiled import njit
from mrta_falsify.core.neighbours import Neighbours, neighbours_within
from simulator_interface.engines.rays import EdgeGrid

FAR = 5.0  # m; gaps beyond are reported as inf
ROUNDING = 1e-9  # m
ROBOT, HUMAN, STATIC = 0, 1, 2  # columns of ``gap``


class Footprints(NamedTuple):
    """Footprints of all robots; V corners at most."""

    outline: Array  #: (N, V, 2) in the robot frame [m]
    corners: IntArray  #: (N,) corners that count
    reach: Array  #: (N,) largest distance of a corner from the robot's origin [m]
    placed: Array  #: (N, V, 2) as placed last, map frame [m]
    near_robot: IntArray  #: (N,) that was nearest last, -1: none; it is measured first to save work
    near_edge: IntArray  #: (N,) of the grid, likewise


class Solids(NamedTuple):
    """What stands."""

    grid: EdgeGrid  #: all the time
    extra: Array  #: (E, 4) edges of what stands now: blockages, furniture that moves [m]


class Pedestrians(NamedTuple):
    """People as discs."""

    position: Array  #: (H, 2) [m]
    radius: Array  #: (H,) [m]
    present: BoolArray  #: (H,) who is in the building


class Obstructions(NamedTuple):
    """Everything that a robot may run into."""

    prints: Footprints
    solids: Solids
    people: Pedestrians


#: the same as plain tuples, which compiled code takes in three times as fast
PackedObstructions: TypeAlias = tuple[tuple[Any, ...], tuple[Any, ...], Array, tuple[Any, ...]]


def packed(prints: Footprints, solids: Solids, people: Pedestrians) -> PackedObstructions:
    """Pack obstructions for a call of compiled code, which begins with :func:`unpacked`."""
    return tuple(prints), tuple(solids.grid), solids.extra, tuple(people)


@njit(cache=True)
def unpacked(fields: PackedObstructions) -> Obstructions:
    """Undo :func:`packed`."""
    prints, grid, extra, people = fields
    solids = Solids(EdgeGrid(*grid), extra)
    return Obstructions(Footprints(*prints), solids, Pedestrians(*people))


@njit(cache=True)
def place_outline(outline: Array, corners: int, pose: Array, placed: Array) -> None:
    """Write the corners ``(V, 2)`` of a footprint at ``pose`` (x, y, yaw) to ``placed``."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    for k in range(corners):
        placed[k, 0] = pose[0] + c * outline[k, 0] - s * outline[k, 1]
        placed[k, 1] = pose[1] + s * outline[k, 0] + c * outline[k, 1]


@njit(cache=True)
def _square_from(px: float, py: float, ax: float, ay: float, bx: float, by: float) -> float:
    """Measure the squared distance of a point from a segment."""
    ex, ey = bx - ax, by - ay
    along, length = (px - ax) * ex + (py - ay) * ey, ex * ex + ey * ey
    t = 0.0
    if along >= length > 0.0:
        t = 1.0
    elif along > 0.0 and length > 0.0:
        t = along / length
    dx, dy = px - ax - t * ex, py - ay - t * ey
    return dx * dx + dy * dy


@njit(cache=True)
def _point_segment(px: float, py: float, ax: float, ay: float, bx: float, by: float) -> float:
    """Measure the distance of a point from a segment."""
    return math.sqrt(_square_from(px, py, ax, ay, bx, by))


@njit(cache=True)
def polygon_point_gap(polygon: Array, corners: int, px: float, py: float) -> float:
    """Measure the gap of a point to a convex polygon; negative depth if it is inside."""
    is_outside, depth, square = False, -np.inf, np.inf
    for k in range(corners):
        j = k + 1 if k + 1 < corners else 0
        ax, ay, bx, by = polygon[k, 0], polygon[k, 1], polygon[j, 0], polygon[j, 1]
        ex, ey = bx - ax, by - ay
        side = (px - ax) * ey - (py - ay) * ex
        is_outside = is_outside or side > 0.0
        if not is_outside:
            depth = max(depth, side / math.sqrt(ex * ex + ey * ey))
        square = min(square, _square_from(px, py, ax, ay, bx, by))
    return math.sqrt(square) if is_outside else depth


@njit(cache=True)
def _separation(one: Array, n_one: int, other: Array, n_other: int) -> float:
    """Find how far ``other`` is from the best side line of ``one``; negative: none separates."""
    best = -np.inf
    for k in range(n_one):
        j = k + 1 if k + 1 < n_one else 0
        ex, ey = one[j, 0] - one[k, 0], one[j, 1] - one[k, 1]
        length = math.sqrt(ex * ex + ey * ey)
        nearest = np.inf
        for m in range(n_other):
            side = (other[m, 0] - one[k, 0]) * ey - (other[m, 1] - one[k, 1]) * ex
            nearest = min(nearest, side)
        best = max(best, nearest / length)
    return best


@njit(cache=True)
def polygon_gap(one: Array, n_one: int, other: Array, n_other: int, cutoff: float) -> float:
    """Measure the gap of two convex polygons; negative: depth; from ``cutoff`` on not exact."""
    apart = max(_separation(one, n_one, other, n_other), _separation(other, n_other, one, n_one))
    if apart <= 0.0 or apart >= cutoff:
        return apart
    square = np.inf
    for k in range(n_one):
        j = k + 1 if k + 1 < n_one else 0
        ax, ay, bx, by = one[k, 0], one[k, 1], one[j, 0], one[j, 1]
        for m in range(n_other):
            i = m + 1 if m + 1 < n_other else 0
            cx, cy, dx, dy = other[m, 0], other[m, 1], other[i, 0], other[i, 1]
            square = min(square, _square_from(cx, cy, ax, ay, bx, by))
            square = min(square, _square_from(ax, ay, cx, cy, dx, dy))
    return math.sqrt(square)


@njit(cache=True)
def polygon_edge_gap(
    polygon: Array, corners: int, ax: float, ay: float, bx: float, by: float, cutoff: float
) -> float:
    """Measure the gap of a convex polygon to an edge, solid on its left; negative: depth.

    The edge leads from (ax, ay) to (bx, by). From ``cutoff`` [m] on the gap is not exact.
    """
    ex, ey = bx - ax, by - ay
    length = math.sqrt(ex * ex + ey * ey)
    if length == 0.0:
        return polygon_point_gap(polygon, corners, ax, ay)
    apart = np.inf  # least distance to the outer side of the edge, times its length
    farthest = -np.inf
    for k in range(corners):
        side = (polygon[k, 0] - ax) * ey - (polygon[k, 1] - ay) * ex
        apart = min(apart, side)
        farthest = max(farthest, side)
    beyond = max(apart, -farthest) / length  # of the line through the edge
    if beyond > max(cutoff, 0.0) + ROUNDING:
        return beyond
    separated = apart > 0.0 or farthest < 0.0
    depth, square = apart / length, np.inf
    for k in range(corners):
        j = k + 1 if k + 1 < corners else 0
        px, py = polygon[k, 0], polygon[k, 1]
        sx, sy = polygon[j, 0] - px, polygon[j, 1] - py
        side = min((ax - px) * sy - (ay - py) * sx, (bx - px) * sy - (by - py) * sx)
        separated = separated or side > 0.0
        if not separated:
            depth = max(depth, side / math.sqrt(sx * sx + sy * sy))
        square = min(square, _square_from(px, py, ax, ay, bx, by))
        square = min(square, _square_from(ax, ay, px, py, polygon[j, 0], polygon[j, 1]))
        square = min(square, _square_from(bx, by, px, py, polygon[j, 0], polygon[j, 1]))
    return math.sqrt(square) if separated else min(depth, 0.0)


@njit(cache=True)
def blocks_gap(edges: Array, placed: Array, corners: int, x: float, y: float) -> float:
    """Measure the gap [m] of a footprint around (x, y) to the ``edges`` ``(E, 4)`` of few solids.

    A robot in the middle of a solid, away from its edges, has the negative distance to them.
    """
    best, nearest, inside = np.inf, np.inf, False
    for e in range(len(edges)):
        ax, ay, bx, by = edges[e, 0], edges[e, 1], edges[e, 2], edges[e, 3]
        best = min(best, polygon_edge_gap(placed, corners, ax, ay, bx, by, best))
        nearest = min(nearest, _point_segment(x, y, ax, ay, bx, by))
        if (ay > y) != (by > y) and x < ax + (y - ay) / (by - ay) * (bx - ax):
            inside = not inside
    return min(best, -nearest) if inside else best


@njit(cache=True)
def static_gap(
    grid: EdgeGrid,
    extra: Array,
    polygon: Array,
    corners: int,
    x: float,
    y: float,
    reach: float,
    cutoff: float,
) -> float:
    """Measure the gap of a footprint to the nearest solid, if below ``cutoff``, else that.

    Args:
        grid: solids that stand all the time.
        extra: ``(E, 4)`` edges of further solids, few.
        polygon: ``(V, 2)`` placed footprint [m].
        corners: how many of V count.
        x: of the robot's origin [m].
        y: of the robot's origin [m].
        reach: largest distance of a corner from the origin [m].
        cutoff: [m].

    Returns:
        Gap [m], negative: depth.
    """
    best = cutoff
    if len(extra):
        best = min(best, blocks_gap(extra, polygon, corners, x, y))
    return _grid_gap(grid, polygon, corners, x, y, reach, best)[0]


@njit(cache=True)
def _grid_gap(
    grid: EdgeGrid, polygon: Array, corners: int, x: float, y: float, reach: float, best: float
) -> tuple[float, int]:
    """Do as :func:`static_gap` from ``best`` [m] on; gives the edge, too, -1: none."""
    edges, cell = grid.edges, grid.cell
    gx, gy = (x - grid.origin[0]) / cell, (y - grid.origin[1]) / cell
    col, row = math.floor(gx), math.floor(gy)
    if not (0 <= col < grid.cols and 0 <= row < grid.rows):
        for i in range(len(edges)):
            ax, ay, bx, by = edges[i, 0], edges[i, 1], edges[i, 2], edges[i, 3]
            best = min(best, polygon_edge_gap(polygon, corners, ax, ay, bx, by, best))
        return best, -1
    border = cell * min(gx - col, col + 1 - gx, gy - row, row + 1 - gy)
    nearest = -1  # an edge may lie in several cells
    for ring in range(max(grid.rows, grid.cols)):
        if ring > 0 and (ring - 1) * cell + border - reach >= best:
            break
        for r in range(max(row - ring, 0), min(row + ring, grid.rows - 1) + 1):
            at_end = r in (row - ring, row + ring)
            step = 1 if at_end or ring == 0 else 2 * ring
            for c in range(col - ring, col + ring + 1, step):
                if not 0 <= c < grid.cols:
                    continue
                k = r * grid.cols + c
                for m in range(grid.first[k], grid.first[k + 1]):
                    i = grid.member[m]
                    ax, ay, bx, by = edges[i, 0], edges[i, 1], edges[i, 2], edges[i, 3]
                    if i == nearest or _point_segment(x, y, ax, ay, bx, by) - reach >= best:
                        continue
                    found = polygon_edge_gap(polygon, corners, ax, ay, bx, by, best)
                    if found < best:
                        best, nearest = found, i
    return best, nearest


@njit(cache=True)
def _bound_by(gap: float) -> float:
    """Give what the least gap is surely below, since one thing is at ``gap``; inf: overlaps.

    Of depths, unlike of distances, circles around the bodies tell nothing.
    """
    return gap + ROUNDING * (1.0 + gap) if gap > 0.0 else np.inf


@njit(cache=True)
def _fill_robot_gaps(
    pose: Array, prints: Footprints, gap: Array, nearest: IntArray, near: Neighbours
) -> None:
    """Lower the gaps between robots.

    At the first look of a tick the gap to the robot that was nearest last bounds the least one from
    above, so that most others are known to be farther without being measured.
    """
    n, placed, corners, reach = len(pose), prints.placed, prints.corners, prints.reach
    bound = np.empty(n)
    for i in range(n):
        bound[i], j = gap[i, ROBOT], prints.near_robot[i]
        if j >= 0 and gap[i, ROBOT] >= FAR:
            found = polygon_gap(placed[i], corners[i], placed[j], corners[j], np.inf)
            bound[i] = min(bound[i], _bound_by(found))
    for i in range(n):
        body, count = placed[i], corners[i]
        for m in range(near.first[i], near.first[i + 1]):
            j = near.number[m]
            if j < i:
                continue
            cutoff = max(min(gap[i, ROBOT], bound[i]), min(gap[j, ROBOT], bound[j]))
            apart = math.hypot(pose[j, 0] - pose[i, 0], pose[j, 1] - pose[i, 1])
            if apart - reach[i] - reach[j] >= cutoff:
                continue
            found = polygon_gap(body, count, placed[j], corners[j], cutoff)
            if found >= cutoff:
                continue
            if found < gap[i, ROBOT]:
                gap[i, ROBOT], nearest[i, ROBOT], prints.near_robot[i] = found, j, j
            if found < gap[j, ROBOT]:
                gap[j, ROBOT], nearest[j, ROBOT], prints.near_robot[j] = found, i, i


@njit(cache=True)
def _fill_static_gap(i: int, pose: Array, prints: Footprints, solids: Solids, gap: Array) -> None:
    """Lower the gap of robot ``i`` to solids, by way of the edge that was nearest last."""
    placed, corners, edge = prints.placed[i], prints.corners[i], prints.near_edge[i]
    edges, x, y = solids.grid.edges, pose[i, 0], pose[i, 1]
    best = gap[i, STATIC]
    if len(solids.extra):
        best = min(best, blocks_gap(solids.extra, placed, corners, x, y))
    bound = best
    if edge >= 0 and best >= FAR:
        ax, ay, bx, by = edges[edge, 0], edges[edge, 1], edges[edge, 2], edges[edge, 3]
        found = polygon_edge_gap(placed, corners, ax, ay, bx, by, np.inf)
        bound = min(bound, _bound_by(found))
    found, edge = _grid_gap(solids.grid, placed, corners, x, y, prints.reach[i], bound)
    if found < bound:
        best = found
    if edge >= 0:
        prints.near_edge[i] = edge
    gap[i, STATIC] = best


@njit(cache=True)
def fill_gaps(
    pose: Array,
    prints: Footprints,
    solids: Solids,
    people: Pedestrians,
    gap: Array,
    nearest: IntArray,
) -> float:
    """Lower the running least gaps of a tick to those of one sub-step.

    Args:
        pose: ``(N, 3)``.
        prints: footprints; they are placed at ``pose``.
        solids: what stands.
        people: who is about.
        gap: ``(N, 3)`` running least gap to robot, human, static; lowered.
        nearest: ``(N, 2)`` robot and human of these gaps; updated.

    Returns:
        The least entry of ``gap`` [m].
    """
    n = len(pose)
    least, widest = np.inf, 0.0
    placed, corners, reach = prints.placed, prints.corners, prints.reach
    for i in range(n):
        place_outline(prints.outline[i], corners[i], pose[i], placed[i])
        widest = max(widest, reach[i])
    near = neighbours_within(pose, FAR + 2.0 * widest + ROUNDING)
    _fill_robot_gaps(pose, prints, gap, nearest, near)
    for i in range(n):
        x, y = pose[i, 0], pose[i, 1]
        for h in range(len(people.position)):
            hx, hy = people.position[h, 0], people.position[h, 1]
            apart = math.hypot(hx - x, hy - y) - reach[i] - people.radius[h]
            if not people.present[h] or apart >= gap[i, HUMAN]:
                continue
            found = polygon_point_gap(placed[i], corners[i], hx, hy) - people.radius[h]
            if found < gap[i, HUMAN]:
                gap[i, HUMAN] = found
                nearest[i, HUMAN] = h
        _fill_static_gap(i, pose, prints, solids, gap)
    for i in range(n):
        least = min(least, gap[i, ROBOT], gap[i, HUMAN], gap[i, STATIC])
    return least


@njit(cache=True)
def forget(gap: Array, nearest: IntArray, contact: BoolArray) -> None:
    """Begin a tick: nothing is near yet, and nothing touched."""
    for i in range(len(gap)):
        for k in range(3):
            gap[i, k], contact[i, k] = FAR, False
        for k in range(2):
            nearest[i, k] = -1


@njit(cache=True)
def disc_clear(grid: EdgeGrid, extra: Array, x: float, y: float, radius: float) -> float:
    """Measure the distance of a point from the nearest edge, at most ``radius``."""
    best = radius
    for e in range(len(extra)):
        best = min(best, _point_segment(x, y, extra[e, 0], extra[e, 1], extra[e, 2], extra[e, 3]))
    col_1 = max(int((x - radius - grid.origin[0]) / grid.cell), 0)
    col_2 = min(int((x + radius - grid.origin[0]) / grid.cell), grid.cols - 1)
    row_1 = max(int((y - radius - grid.origin[1]) / grid.cell), 0)
    row_2 = min(int((y + radius - grid.origin[1]) / grid.cell), grid.rows - 1)
    for row in range(row_1, row_2 + 1):
        for col in range(col_1, col_2 + 1):
            k = row * grid.cols + col
            for m in range(grid.first[k], grid.first[k + 1]):
                edge = grid.edges[grid.member[m]]
                best = min(best, _point_segment(x, y, edge[0], edge[1], edge[2], edge[3]))
    return best
