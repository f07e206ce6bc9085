"""Lethal cells of a costmap: every closed cell that meets a closed footprint."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from mrta_falsify.core.arrays import Array, ByteArray
from mrta_falsify.core.compiled import njit
from mrta_falsify.core.costmap import LETHAL, Costmap

TOUCH = 1e-9  # cells; a footprint this close to a cell touches it (rounding of coordinates)


def mark_polygons(grid: Costmap, polygons: Iterable[Array]) -> None:
    """Make every cell lethal that meets one of ``polygons`` ``(V, 2)`` [m]."""
    for polygon in polygons:
        _fill_polygon(grid.cost, (polygon - grid.origin) / grid.resolution)


def mark_discs(grid: Costmap, centers: Array, radius: float) -> None:
    """Make every cell lethal that meets a disc around one of ``centers`` ``(P, 2)`` [m]."""
    for center in (centers - grid.origin) / grid.resolution:
        _fill_disc(grid.cost, center[0], center[1], radius / grid.resolution)


@njit(cache=True)
def _fill_polygon(cost: ByteArray, polygon: Array) -> None:  # pragma: no cover - compiled
    """Mark every closed cell that meets the closed polygon ``(V, 2)``, x and y in cells."""
    rows, cols = cost.shape
    corners = len(polygon)
    low, high = polygon[0, 1], polygon[0, 1]
    for i in range(corners):
        low, high = min(low, polygon[i, 1]), max(high, polygon[i, 1])
        x1, y1 = polygon[i - 1, 0], polygon[i - 1, 1]
        _fill_segment(cost, x1, y1, polygon[i, 0], polygon[i, 1])
    first = max(0, math.floor(low - TOUCH))
    last = min(rows - 1, math.floor(high + TOUCH))
    crossing = np.empty(corners)
    turn = np.empty(corners, np.int64)
    for row in range(first, last + 1):
        middle = row + 0.5
        count = 0
        for i in range(corners):
            x1, y1, x2, y2 = polygon[i - 1, 0], polygon[i - 1, 1], polygon[i, 0], polygon[i, 1]
            if (y1 <= middle) == (y2 <= middle):
                continue
            x = x1 + (middle - y1) / (y2 - y1) * (x2 - x1)
            k = count
            while k > 0 and crossing[k - 1] > x:
                crossing[k] = crossing[k - 1]
                turn[k] = turn[k - 1]
                k -= 1
            crossing[k] = x
            turn[k] = 1 if y2 > y1 else -1
            count += 1
        winding = 0
        for k in range(count - 1):
            winding += turn[k]
            if winding == 0:
                continue
            start = max(0, math.ceil(crossing[k] - 0.5))
            end = min(cols - 1, math.floor(crossing[k + 1] - 0.5))
            for col in range(start, end + 1):
                cost[row, col] = LETHAL


@njit(cache=True)
def _fill_segment(
    cost: ByteArray, x1: float, y1: float, x2: float, y2: float
) -> None:  # pragma: no cover - compiled
    """Mark every closed cell that meets a segment, coordinates in cells."""
    rows, cols = cost.shape
    if y1 > y2:
        x1, y1, x2, y2 = x2, y2, x1, y1
    # A point on a grid line belongs to the cells on both sides of it.
    first = max(0, math.ceil(y1 - TOUCH) - 1)
    last = min(rows - 1, math.floor(y2 + TOUCH))
    for row in range(first, last + 1):
        low, high = x1, x2
        if y2 - y1 > TOUCH:
            low = x1 + (min(max(row - TOUCH, y1), y2) - y1) / (y2 - y1) * (x2 - x1)
            high = x1 + (min(max(row + 1 + TOUCH, y1), y2) - y1) / (y2 - y1) * (x2 - x1)
        if low > high:
            low, high = high, low
        start = max(0, math.ceil(low - TOUCH) - 1)
        end = min(cols - 1, math.floor(high + TOUCH))
        for col in range(start, end + 1):
            cost[row, col] = LETHAL


@njit(cache=True)
def _fill_disc(cost: ByteArray, x: float, y: float, radius: float) -> None:  # pragma: no cover
    """Mark every closed cell that meets the closed disc, lengths in cells."""
    rows, cols = cost.shape
    reach = radius + TOUCH
    for row in range(max(0, math.floor(y - reach) - 1), min(rows, math.floor(y + reach) + 2)):
        dy = max(row - y, y - (row + 1), 0.0)
        for col in range(max(0, math.floor(x - reach) - 1), min(cols, math.floor(x + reach) + 2)):
            dx = max(col - x, x - (col + 1), 0.0)
            if dx * dx + dy * dy <= reach * reach:
                cost[row, col] = LETHAL
