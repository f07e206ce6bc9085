"""Compiled work on the oracle's occupancy grid: fill polygons and discs, find ways.

Cell (0, 0) is at the corner of the grid; its centre is half a cell from either side.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mrta_falsify.core.arrays import Array, BoolArray, IntArray
from mrta_falsify.core.compiled import njit

Owners = NDArray[np.int16]  #: (rows, cols) 0 free, else 1 + number of a solid


@njit(cache=True)
def fill_interior(owner: Owners, polygon: Array, value: int, cell: float) -> None:
    """Give ``value`` to the cells whose centres lie in ``polygon`` ``(V, 2)``, by scan lines."""
    rows, cols = owner.shape
    corners = len(polygon)
    crossings = np.empty(corners)
    low = max(0, int(np.floor(polygon[:, 1].min() / cell)))
    high = min(rows - 1, int(np.floor(polygon[:, 1].max() / cell)))
    for row in range(low, high + 1):
        y = (row + 0.5) * cell
        count = 0
        for k in range(corners):
            ax, ay = polygon[k - 1]
            bx, by = polygon[k]
            if (ay <= y) != (by <= y):
                crossings[count] = ax + (y - ay) * (bx - ax) / (by - ay)
                count += 1
        ordered = np.sort(crossings[:count])
        for k in range(0, count - 1, 2):
            first = max(0, int(np.ceil(ordered[k] / cell - 0.5)))
            last = min(cols - 1, int(np.floor(ordered[k + 1] / cell - 0.5)))
            for col in range(first, last + 1):
                owner[row, col] = value


@njit(cache=True)
def first_owned(owner: Owners, points: Array, origin: Array, cell: float) -> tuple[int, int]:
    """Find the first of ``points`` ``(L, 2)`` [m] in a cell that is not free.

    Returns:
        Its number and the cell's value; -1 and 0 if all are free.
    """
    rows, cols = owner.shape
    for k in range(len(points)):
        col = int(np.floor((points[k, 0] - origin[0]) / cell))
        row = int(np.floor((points[k, 1] - origin[1]) / cell))
        if 0 <= row < rows and 0 <= col < cols and owner[row, col] != 0:
            return k, int(owner[row, col])
    return -1, 0


@njit(cache=True)
def fill_rim(owner: Owners, polygon: Array, value: int, clearance: float, cell: float) -> None:
    """Give ``value`` to the cells whose centres are within ``clearance`` [m] of an edge."""
    rows, cols = owner.shape
    for k in range(len(polygon)):
        ax, ay = polygon[k - 1]
        bx, by = polygon[k]
        dx, dy = bx - ax, by - ay
        length2 = dx * dx + dy * dy
        row_low = max(0, int(np.floor((min(ay, by) - clearance) / cell)))
        row_high = min(rows - 1, int(np.floor((max(ay, by) + clearance) / cell)))
        col_low = max(0, int(np.floor((min(ax, bx) - clearance) / cell)))
        col_high = min(cols - 1, int(np.floor((max(ax, bx) + clearance) / cell)))
        for row in range(row_low, row_high + 1):
            for col in range(col_low, col_high + 1):
                px, py = (col + 0.5) * cell - ax, (row + 0.5) * cell - ay
                share = 0.0
                if length2 > 0.0:
                    share = min(1.0, max(0.0, (px * dx + py * dy) / length2))
                ex, ey = px - share * dx, py - share * dy
                if ex * ex + ey * ey <= clearance * clearance:
                    owner[row, col] = value


@njit(cache=True)
def fill_discs(blocked: BoolArray, centers: Array, radius: float, cell: float) -> None:
    """Block the cells whose centres are nearer than ``radius`` [m] to one of ``centers`` (M, 2)."""
    rows, cols = blocked.shape
    for k in range(len(centers)):
        x, y = centers[k]
        for row in range(
            max(0, int((y - radius) / cell)), min(rows - 1, int((y + radius) / cell)) + 1
        ):
            for col in range(
                max(0, int((x - radius) / cell)), min(cols - 1, int((x + radius) / cell)) + 1
            ):
                dx, dy = (col + 0.5) * cell - x, (row + 0.5) * cell - y
                if dx * dx + dy * dy < radius * radius:
                    blocked[row, col] = True


Counts = NDArray[np.int16]  #: (rows, cols)


class Regions(NamedTuple):
    """Connected regions of the cells that neither solids nor bodies block."""

    number: IntArray  #: (rows, cols) from 1 on, 0: blocked
    total: int  #: regions
    bodies: Counts  #: (rows, cols) that block each cell
    solid: BoolArray  #: (rows, cols)


class Disc(NamedTuple):
    """A round place of the grid, in metres from its corner."""

    x: float  #: [m]
    y: float  #: [m]
    radius: float  #: [m]


@njit(cache=True)
def find_way(blocked: BoolArray, start: Disc, goal: Disc, cell: float) -> IntArray:
    """Find a shortest chain of neighbouring free cells from ``goal`` back to ``start``.

    Args:
        blocked: ``(rows, cols)``.
        start: the chain begins at any free cell whose centre lies in it.
        goal: the chain ends at any free cell whose centre lies in it.
        cell: size of a cell [m].

    Returns:
        ``(K, 2)`` row and column of its cells; K is 0 if there is no such chain.
    """
    rows, cols = blocked.shape
    seen = blocked.copy()
    reached = np.empty((rows * cols, 2), dtype=np.int32)
    before = np.empty(rows * cols, dtype=np.int32)  # that each was reached from
    first, count = 0, 0
    low, high = int((start.y - start.radius) / cell), int((start.y + start.radius) / cell)
    left, right = int((start.x - start.radius) / cell), int((start.x + start.radius) / cell)
    for row in range(max(0, low), min(rows - 1, high) + 1):
        for col in range(max(0, left), min(cols - 1, right) + 1):
            if not seen[row, col] and _is_inside(start, row, col, cell):
                seen[row, col] = True
                reached[count, 0], reached[count, 1] = row, col
                before[count] = -1
                count += 1
    while first < count:
        row, col = reached[first, 0], reached[first, 1]
        if _is_inside(goal, row, col, cell):
            return _chain(reached, before, first)
        for up in range(-1, 2):
            for side in range(-1, 2):
                r, c = row + up, col + side
                if 0 <= r < rows and 0 <= c < cols and not seen[r, c]:
                    seen[r, c] = True
                    reached[count, 0], reached[count, 1] = r, c
                    before[count] = first
                    count += 1
        first += 1
    return np.empty((0, 2), dtype=np.int64)


@njit(cache=True)
def count_discs(count: Counts, centers: Array, radius: float, cell: float) -> None:
    """Count for each cell the discs that :func:`fill_discs` would block it by; 0 so far."""
    rows, cols = count.shape
    for k in range(len(centers)):
        x, y = centers[k, 0], centers[k, 1]
        low, high = max(0, int((y - radius) / cell)), min(rows - 1, int((y + radius) / cell))
        left, right = max(0, int((x - radius) / cell)), min(cols - 1, int((x + radius) / cell))
        for row in range(low, high + 1):
            for col in range(left, right + 1):
                dx, dy = (col + 0.5) * cell - x, (row + 0.5) * cell - y
                if dx * dx + dy * dy < radius * radius:
                    count[row, col] += 1


@njit(cache=True)
def is_way_without(own: Disc, start: Disc, goal: Disc, regions: Regions, cell: float) -> bool:
    """Whether a way of free cells leads from ``start`` to ``goal`` once one body is taken away.

    Args:
        own: disc of the body.
        start: a way begins at any free cell whose centre lies in it.
        goal: it ends at any free cell whose centre lies in it.
        regions: with all bodies.
        cell: size of a cell [m].
    """
    number, bodies, solid = regions.number, regions.bodies, regions.solid
    rows, cols = number.shape
    low = max(0, int((own.y - own.radius) / cell))
    left = max(0, int((own.x - own.radius) / cell))
    height = min(rows - 1, int((own.y + own.radius) / cell)) + 1 - low
    width = min(cols - 1, int((own.x + own.radius) / cell)) + 1 - left
    # Cells that only this body blocks, and which of them and of the regions are reached.
    freed = np.zeros((max(height, 0), max(width, 0)), dtype=np.bool_)
    reached = np.zeros_like(freed)
    known = np.zeros(regions.total + 1, dtype=np.bool_)
    for row in range(height):
        for col in range(width):
            r, c = low + row, left + col
            dx, dy = (c + 0.5) * cell - own.x, (r + 0.5) * cell - own.y
            is_own = dx * dx + dy * dy < own.radius * own.radius
            freed[row, col] = is_own and bodies[r, c] == 1 and not solid[r, c]
    first, last = int((start.y - start.radius) / cell), int((start.y + start.radius) / cell)
    west, east = int((start.x - start.radius) / cell), int((start.x + start.radius) / cell)
    for r in range(max(0, first), min(rows - 1, last) + 1):
        for c in range(max(0, west), min(cols - 1, east) + 1):
            if _is_inside(start, r, c, cell):
                known[number[r, c]] = True
                row, col = r - low, c - left
                if 0 <= row < height and 0 <= col < width and freed[row, col]:
                    reached[row, col] = True
    known[0] = False
    grows = True
    while grows:
        grows = False
        for row in range(height):
            for col in range(width):
                if freed[row, col] and _spreads(row, col, low, left, freed, reached, known, number):
                    grows = True
    first, last = int((goal.y - goal.radius) / cell), int((goal.y + goal.radius) / cell)
    west, east = int((goal.x - goal.radius) / cell), int((goal.x + goal.radius) / cell)
    for r in range(max(0, first), min(rows - 1, last) + 1):
        for c in range(max(0, west), min(cols - 1, east) + 1):
            row, col = r - low, c - left
            is_reached = 0 <= row < height and 0 <= col < width and reached[row, col]
            if (is_reached or known[number[r, c]]) and _is_inside(goal, r, c, cell):
                return True
    return False


@njit(cache=True)
def _spreads(
    row: int,
    col: int,
    low: int,
    left: int,
    freed: BoolArray,
    reached: BoolArray,
    known: BoolArray,
    number: IntArray,
) -> bool:
    """Spread between a freed cell and the cells around it; says whether any is newly reached."""
    news = False
    for up in range(-1, 2):
        for side in range(-1, 2):
            a, b = row + up, col + side
            r, c = low + a, left + b
            if not (0 <= r < number.shape[0] and 0 <= c < number.shape[1]):
                continue
            place = number[r, c]
            is_freed = 0 <= a < freed.shape[0] and 0 <= b < freed.shape[1] and freed[a, b]
            if not reached[row, col] and ((is_freed and reached[a, b]) or known[place]):
                reached[row, col] = news = True
            if reached[row, col] and place > 0 and not known[place]:
                known[place] = news = True
    return news


@njit(cache=True)
def _chain(reached: IntArray, before: IntArray, last: int) -> IntArray:
    length, k = 0, last
    while k >= 0:
        length, k = length + 1, before[k]
    chain = np.empty((length, 2), dtype=np.int64)
    k = last
    for place in range(length):
        chain[place, 0], chain[place, 1] = reached[k, 0], reached[k, 1]
        k = before[k]
    return chain


@njit(cache=True)
def _is_inside(disc: Disc, row: int, col: int, cell: float) -> bool:
    dx, dy = (col + 0.5) * cell - disc.x, (row + 0.5) * cell - disc.y
    return bool(dx * dx + dy * dy <= disc.radius * disc.radius)
