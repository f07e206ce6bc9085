"""Walls around people: the edges near a place, and steps that stay beside them."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from mrta_falsify.core.arrays import Array, IntArray
from mrta_falsify.core.compiled import njit

CELL = 1.0  # m, side of a cell of the wall grid
SIGHT = 1.5  # m, walls farther away do not push
SWEEPS = 3  # a step is pushed out of the edges near it so often
ROUNDING = 1e-9  # m, or m^2 of squared distances
OVERLAP = 1e-6  # m^2, of squared distances: what sliding leaves
ON_EDGE = 1e-12  # m^2, squared distance below which a person stands on an edge


class Walls(NamedTuple):
    """Edges, and which of them come within SIGHT of each cell of a uniform grid."""

    edges: Array  #: (S, 4) x1, y1, x2, y2 [m]
    origin: Array  #: (2,) south-west corner of the grid [m]
    shape: IntArray  #: (2,) columns, rows
    first: IntArray  #: (cells + 1,) where a cell's entries of ``members`` begin
    members: IntArray  #: edge numbers, cell after cell


class Stride(NamedTuple):
    """A displacement."""

    x: float  #: start [m], map frame
    y: float
    dx: float  #: [m]
    dy: float


class WallGrid:
    """The walls of a world, sorted; a pure function of them, so never copied."""

    def __init__(self, source: Array) -> None:
        self.source = source
        edges = np.ascontiguousarray(source, dtype=np.float64).reshape(-1, 4)
        if len(edges):
            low = np.minimum(edges[:, :2], edges[:, 2:]).min(axis=0) - SIGHT
            high = np.maximum(edges[:, :2], edges[:, 2:]).max(axis=0) + SIGHT
        else:
            low, high = np.zeros(2), np.ones(2)
        shape = np.maximum(np.ceil((high - low) / CELL), 1.0).astype(np.int64)
        self.walls = Walls(edges, low, shape, *_bin_edges(edges, low, shape))

    def __deepcopy__(self, memo: dict[int, Any]) -> WallGrid:
        return self


@njit(cache=True)
def _bin_edges(edges: Array, origin: Array, shape: IntArray) -> tuple[IntArray, IntArray]:
    """List the edges within SIGHT of each cell, as row starts and edge numbers."""
    count = np.zeros(shape[0] * shape[1] + 1, dtype=np.int64)
    members = np.empty(0, dtype=np.int64)
    radius = SIGHT + CELL * np.sqrt(0.5)
    for sweep in range(2):
        if sweep == 1:
            for c in range(len(count) - 1):
                count[c + 1] += count[c]
            members = np.empty(count[-1], dtype=np.int64)
            for c in range(len(count) - 1, 0, -1):
                count[c] = count[c - 1]
            count[0] = 0
        for e in range(edges.shape[0]):
            x1, y1, x2, y2 = edges[e]
            c1 = max(0, int((min(x1, x2) - radius - origin[0]) / CELL))
            c2 = min(shape[0] - 1, int((max(x1, x2) + radius - origin[0]) / CELL))
            r1 = max(0, int((min(y1, y2) - radius - origin[1]) / CELL))
            r2 = min(shape[1] - 1, int((max(y1, y2) + radius - origin[1]) / CELL))
            for r in range(r1, r2 + 1):
                for c in range(c1, c2 + 1):
                    x = origin[0] + (c + 0.5) * CELL
                    y = origin[1] + (r + 0.5) * CELL
                    nx, ny = nearest_on_edge(x, y, x1, y1, x2, y2)
                    if (nx - x) ** 2 + (ny - y) ** 2 > radius * radius:
                        continue
                    cell = r * shape[0] + c
                    if sweep == 1:
                        members[count[cell + 1]] = e
                    count[cell + 1] += 1
    return count, members


@njit(cache=True)
def cell_of(x: float, y: float, walls: Walls) -> int:
    """Find the cell number of a point, -1 outside."""
    origin, shape = walls.origin, walls.shape
    c, r = int(np.floor((x - origin[0]) / CELL)), int(np.floor((y - origin[1]) / CELL))
    if 0 <= c < shape[0] and 0 <= r < shape[1]:
        return int(r * shape[0] + c)
    return -1


@njit(cache=True)
def edge_at(k: int, walls: Walls) -> tuple[float, float, float, float]:
    """Give x1, y1, x2, y2 [m] of the edge at place ``k`` of ``members``."""
    edges, e = walls.edges, walls.members[k]
    return edges[e, 0], edges[e, 1], edges[e, 2], edges[e, 3]


@njit(cache=True)
def nearest_on_edge(
    x: float, y: float, x1: float, y1: float, x2: float, y2: float
) -> tuple[float, float]:
    """Find the point of an edge nearest to (x, y)."""
    dx, dy = x2 - x1, y2 - y1
    square = dx * dx + dy * dy
    t = 0.0
    if square > 0.0:
        t = min(1.0, max(0.0, ((x - x1) * dx + (y - y1) * dy) / square))
    return x1 + t * dx, y1 + t * dy


@njit(cache=True)
def _crosses(
    ax: float, ay: float, bx: float, by: float, x1: float, y1: float, x2: float, y2: float
) -> bool:
    """Whether segments a-b and 1-2 meet."""
    d1 = (x2 - x1) * (ay - y1) - (y2 - y1) * (ax - x1)
    d2 = (x2 - x1) * (by - y1) - (y2 - y1) * (bx - x1)
    d3 = (bx - ax) * (y1 - ay) - (by - ay) * (x1 - ax)
    d4 = (bx - ax) * (y2 - ay) - (by - ay) * (x2 - ax)
    return bool(d1 * d2 <= 0.0 and d3 * d4 <= 0.0 and (d1 != d2 or d3 != d4))


@njit(cache=True)
def _slid(step: Stride, radius: float, walls: Walls, cell: int) -> Stride:
    """Push a short step out of the edges near it, along the normals at its start."""
    px, py, mx, my = step
    for _sweep in range(SWEEPS):
        for k in range(walls.first[cell], walls.first[cell + 1]):
            x1, y1, x2, y2 = edge_at(k, walls)
            ox, oy = nearest_on_edge(px, py, x1, y1, x2, y2)
            before = np.sqrt((ox - px) ** 2 + (oy - py) ** 2)
            nx, ny = nearest_on_edge(px + mx, py + my, x1, y1, x2, y2)
            dx, dy = px + mx - nx, py + my - ny
            after = np.sqrt(dx * dx + dy * dy)
            allowed = min(radius, before)
            if after >= allowed - ROUNDING or before < ROUNDING:
                continue
            nx, ny = (px - ox) / before, (py - oy) / before
            inward = -(mx * nx + my * ny)
            if inward > 0.0:
                back = min(inward, allowed - after + ROUNDING)
                mx, my = mx + back * nx, my + back * ny
    return Stride(px, py, mx, my)


@njit(cache=True)
def _is_blocked(step: Stride, radius: float, walls: Walls, cell: int) -> bool:
    """Whether a short step would lead nearer to an edge than allowed, or through it."""
    px, py, mx, my = step
    for k in range(walls.first[cell], walls.first[cell + 1]):
        x1, y1, x2, y2 = edge_at(k, walls)
        ox, oy = nearest_on_edge(px, py, x1, y1, x2, y2)
        nx, ny = nearest_on_edge(px + mx, py + my, x1, y1, x2, y2)
        before = (ox - px) ** 2 + (oy - py) ** 2
        after = (px + mx - nx) ** 2 + (py + my - ny) ** 2
        if after < radius * radius - OVERLAP and after < before - ROUNDING:
            return True
        if before > ON_EDGE and _crosses(px, py, px + mx, py + my, x1, y1, x2, y2):
            return True
    return False


@njit(cache=True)
def step_beside_walls(step: Stride, radius: float, walls: Walls) -> tuple[float, float]:
    """Go a step as far as walls allow; gives the displacement.

    It is walked in pieces of at most half a radius; a piece that would come nearer to an
    edge than ``radius`` (or nearer than it is, if it is that near already) slides along it.
    """
    length = np.sqrt(step.dx * step.dx + step.dy * step.dy)
    pieces = max(1, int(np.ceil(length / (0.5 * radius))))
    px, py = step.x, step.y
    for _ in range(pieces):
        piece = Stride(px, py, step.dx / pieces, step.dy / pieces)
        cell = cell_of(px, py, walls)
        if cell >= 0:
            piece = _slid(piece, radius, walls, cell)
            if _is_blocked(piece, radius, walls, cell):
                break
        px, py = px + piece.dx, py + piece.dy
    return px - step.x, py - step.y
