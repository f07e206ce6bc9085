"""Exact casting of rays on the edges of solids, sorted into a uniform grid.

Both engines use it: for a floor of a few thousand edges it is faster than asking Bullet, and
the grid also serves the search for the nearest wall (:mod:`simulator_interface.engines.gaps`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from mrta_falsify.core.arrays import Array, BoolArray, IntArray
from mrta_falsify.core.compiled import njit

CELL = 0.5  # m; 0.25 to 1 m cost the same within noise on the AWS floor
MARGIN = 1.0  # m of grid around all edges
SMALL = 1e-9


class EdgeGrid(NamedTuple):
    """Edges and, for each square cell, which of them meet it."""

    edges: Array  #: (S, 4) x1, y1, x2, y2 [m], solid on the left
    origin: Array  #: (2,) south-west corner of the grid [m]
    cell: float  #: side of a cell [m]
    rows: int
    cols: int
    first: IntArray  #: (rows * cols + 1,) where a cell's entries of ``member`` begin
    member: IntArray  #: edge numbers, cell after cell


def next_corners(polygons: Sequence[Array]) -> IntArray:
    """For each corner of ``polygons``, one after the other, the number of the next corner."""
    counts = np.array([len(polygon) for polygon in polygons], dtype=np.int64)
    last = np.cumsum(counts) - 1
    following = np.arange(1, int(counts.sum()) + 1)
    following[last] = last - counts + 1
    return following


def polygon_edges(polygons: Sequence[Array]) -> Array:
    """Edges ``(S, 4)`` x1, y1, x2, y2 [m] of ``polygons`` ``(V, 2)``, in their order."""
    if not polygons:
        return np.zeros((0, 4))
    points = np.concatenate(polygons)
    return np.hstack([points, points[next_corners(polygons)]])


def build_edge_grid(edges: Array, bounds: Array, *, cell: float = CELL) -> EdgeGrid:
    """Sort ``edges`` ``(S, 4)`` [m] into a grid that covers them and ``bounds`` ``(4,)`` [m]."""
    points = np.concatenate([edges.reshape(-1, 2), np.asarray(bounds).reshape(-1, 2)])
    origin = points.min(axis=0) - MARGIN
    cols, rows = np.ceil((points.max(axis=0) + MARGIN - origin) / cell).astype(int)
    first, member = _sort_edges(edges, origin, cell, int(rows), int(cols))
    return EdgeGrid(edges, origin, cell, int(rows), int(cols), first, member)


@njit(cache=True)
def with_bodies(
    edges: Array, owner: IntArray, placed: Array, corners: IntArray, chosen: BoolArray
) -> tuple[Array, IntArray]:
    """Edges and their owners, and after them those of robots' footprints.

    Args:
        edges: ``(E, 4)`` [m].
        owner: ``(E,)``.
        placed: ``(N, V, 2)`` footprints, map frame [m].
        corners: ``(N,)`` corners that count.
        chosen: ``(N,)`` whose footprints.
    """
    k = len(edges)
    all_edges = np.empty((k + (corners * chosen).sum(), 4))
    all_owners = np.empty(len(all_edges), dtype=np.int64)
    all_edges[:k], all_owners[:k] = edges, owner
    for i in range(len(placed)):
        for c in range(corners[i] if chosen[i] else 0):
            following = c + 1 if c + 1 < corners[i] else 0
            all_edges[k, :2], all_edges[k, 2:] = placed[i, c], placed[i, following]
            all_owners[k] = i
            k += 1
    return all_edges, all_owners


@njit(cache=True)
def _meets_cell(edges: Array, i: int, origin: Array, cell: float, row: int, col: int) -> bool:
    """Whether edge ``i``, whose bounding box meets the cell, is not all on one side of it."""
    dx, dy = edges[i, 2] - edges[i, 0], edges[i, 3] - edges[i, 1]
    x = origin[0] + (col + 0.5) * cell - edges[i, 0]
    y = origin[1] + (row + 0.5) * cell - edges[i, 1]
    reach = 0.5 * cell * (abs(dx) + abs(dy))
    meets: bool = abs(dx * y - dy * x) <= reach * (1.0 + 1e-9) + 1e-12
    return meets


@njit(cache=True)
def _sort_edges(
    edges: Array, origin: Array, cell: float, rows: int, cols: int
) -> tuple[IntArray, IntArray]:
    """Members of the cells in compressed rows; edges of a cell in increasing order."""
    first = np.zeros(rows * cols + 1, dtype=np.int64)
    member = np.zeros(0, dtype=np.int64)
    for counting in (True, False):
        if not counting:
            for k in range(rows * cols):
                first[k + 1] += first[k]
            member = np.zeros(first[rows * cols], dtype=np.int64)
            filled = first[:-1].copy()
        else:
            filled = np.zeros(0, dtype=np.int64)
        for i in range(len(edges)):
            low_x, high_x = min(edges[i, 0], edges[i, 2]), max(edges[i, 0], edges[i, 2])
            low_y, high_y = min(edges[i, 1], edges[i, 3]), max(edges[i, 1], edges[i, 3])
            col_1 = max(int((low_x - origin[0] - SMALL) / cell), 0)
            col_2 = min(int((high_x - origin[0] + SMALL) / cell), cols - 1)
            row_1 = max(int((low_y - origin[1] - SMALL) / cell), 0)
            row_2 = min(int((high_y - origin[1] + SMALL) / cell), rows - 1)
            for row in range(row_1, row_2 + 1):
                for col in range(col_1, col_2 + 1):
                    if not _meets_cell(edges, i, origin, cell, row, col):
                        continue
                    k = row * cols + col
                    if counting:
                        first[k + 1] += 1
                    else:
                        member[filled[k]] = i
                        filled[k] += 1
    return first, member


@njit(cache=True)
def hit_distance(
    x: float, y: float, dx: float, dy: float, x1: float, y1: float, x2: float, y2: float
) -> float:
    """Distance [m] along the unit direction (dx, dy) to a segment, inf if it is missed."""
    ex, ey = x2 - x1, y2 - y1
    across = dx * ey - dy * ex
    if abs(across) < 1e-12:  # along the segment: its neighbours are hit instead
        return np.inf
    t = ((x1 - x) * ey - (y1 - y) * ex) / across
    s = ((x1 - x) * dy - (y1 - y) * dx) / across
    if t < 0.0 or s < -SMALL or s > 1.0 + SMALL:
        return np.inf
    return t


@njit(cache=True)
def _cast(grid: EdgeGrid, x: float, y: float, dx: float, dy: float, best: float) -> float:
    """Distance to the nearest edge of the grid below ``best``, else ``best``."""
    edges, cell = grid.edges, grid.cell
    gx, gy = (x - grid.origin[0]) / cell, (y - grid.origin[1]) / cell
    col, row = math.floor(gx), math.floor(gy)
    if not (0 <= col < grid.cols and 0 <= row < grid.rows):
        for i in range(len(edges)):  # outside the floor: rare, so plainly all edges
            t = hit_distance(x, y, dx, dy, edges[i, 0], edges[i, 1], edges[i, 2], edges[i, 3])
            best = min(best, t)
        return best
    step_col = 1 if dx > 0.0 else -1
    step_row = 1 if dy > 0.0 else -1
    per_col = cell / abs(dx) if abs(dx) > 1e-15 else np.inf
    per_row = cell / abs(dy) if abs(dy) > 1e-15 else np.inf
    next_col = np.inf
    if abs(dx) > 1e-15:
        next_col = ((col + 1 - gx) if dx > 0.0 else (gx - col)) * per_col
    next_row = np.inf
    if abs(dy) > 1e-15:
        next_row = ((row + 1 - gy) if dy > 0.0 else (gy - row)) * per_row
    entered = 0.0
    while 0 <= col < grid.cols and 0 <= row < grid.rows and entered <= best:
        k = row * grid.cols + col
        for m in range(grid.first[k], grid.first[k + 1]):
            i = grid.member[m]
            t = hit_distance(x, y, dx, dy, edges[i, 0], edges[i, 1], edges[i, 2], edges[i, 3])
            best = min(best, t)
        if next_col < next_row:
            entered = next_col
            next_col += per_col
            col += step_col
        else:
            entered = next_row
            next_row += per_row
            row += step_row
    return best


@njit(cache=True)
def cast_rays(
    grid: EdgeGrid,
    extra: Array,
    owner: IntArray,
    pose: Array,
    rays: int,
    max_range: float,
    turned: float = 0.0,
) -> Array:
    """Distances to the nearest solid along rays from each robot.

    Ray a leaves the robot's origin at yaw + turned + a * 2 pi / rays.

    Args:
        grid: edges that stand all the time.
        extra: ``(E, 4)`` further edges [m], few: all are tried.
        owner: ``(E,)`` robot that an extra edge belongs to and that does not see it, -1: none.
        pose: ``(N, 3)`` x [m], y [m], yaw [rad].
        rays: number A of rays per robot.
        max_range: [m].
        turned: of the first ray from the heading [rad].

    Returns:
        ``(N, A)`` [m]; inf: nothing within range.
    """
    out = np.empty((len(pose), rays))
    for n in range(len(pose)):
        x, y = pose[n, 0], pose[n, 1]
        yaw = pose[n, 2] + turned
        for a in range(rays):
            angle = yaw + a * (2.0 * math.pi / rays)
            dx, dy = math.cos(angle), math.sin(angle)
            best = max_range
            for e in range(len(extra)):
                if owner[e] != n:
                    t = hit_distance(
                        x, y, dx, dy, extra[e, 0], extra[e, 1], extra[e, 2], extra[e, 3]
                    )
                    best = min(best, t)
            best = _cast(grid, x, y, dx, dy, best)
            out[n, a] = best if best < max_range else np.inf
    return out


def ray_directions(yaw: Array, rays: int) -> Array:
    """Unit vectors ``(N, A, 2)`` of the rays of robots with headings ``yaw`` ``(N,)`` [rad]."""
    angles = yaw[:, None] + np.arange(rays) * (2.0 * np.pi / rays)
    return np.stack([np.cos(angles), np.sin(angles)], axis=-1)


@njit(cache=True)
def hit_points(pose: Array, distance: Array, turned: float = 0.0) -> Array:
    """Points ``(N, A, 2)`` [m] at ``distance`` ``(N, A)`` [m] along the rays of `cast_rays`."""
    n, rays = distance.shape
    out = np.full((n, rays, 2), np.inf)
    for i in range(n):
        yaw = pose[i, 2] + turned
        for a in range(rays):
            if distance[i, a] < np.inf:
                angle = yaw + a * (2.0 * math.pi / rays)
                out[i, a, 0] = pose[i, 0] + distance[i, a] * math.cos(angle)
                out[i, a, 1] = pose[i, 1] + distance[i, a] * math.sin(angle)
    return out
