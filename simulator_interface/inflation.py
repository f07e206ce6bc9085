"""Inflation of a costmap: costs from the distance to the nearest lethal cell.

Squared distances are whole numbers of cells, so equal worlds give equal bytes on every machine,
and a map updated in a window equals one built anew.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mrta_falsify.core.arrays import ByteArray
from mrta_falsify.core.compiled import njit
from mrta_falsify.core.costmap import LETHAL


class Window(NamedTuple):
    """Block of cells, ends excluded."""

    row: int
    end_row: int
    col: int
    end_col: int


def whole(cost: ByteArray) -> Window:
    """Make the window of all cells of ``cost`` ``(rows, cols)``."""
    return Window(0, cost.shape[0], 0, cost.shape[1])


def inflate(cost: ByteArray, window: Window, prices: ByteArray) -> None:
    """Write the costs of a window by the distance to the nearest lethal cell.

    Args:
        cost: ``(rows, cols)``; only its lethal cells are read.
        window: cells to write; lethal cells outside count as well.
        prices: ``(n,)`` cost by squared distance [cells^2], the last one for all beyond.
    """
    if window.row >= window.end_row or window.col >= window.end_col:
        return  # wholly outside the grid
    _fill_window(cost, window, prices, math.isqrt(len(prices) - 2))


@njit(cache=True)
def _fill_window(
    cost: ByteArray, window: Window, prices: ByteArray, reach: int
) -> None:  # pragma: no cover - compiled
    """Exact bounded Euclidean distance transform of a window, then distance to cost.

    First the distance along the column to a lethal cell, then the smallest sum of squares
    along the row.
    """
    row, end_row, col, end_col = window
    left = max(0, col - reach)
    along = _column_distances(cost, window, reach)
    width = along.shape[1]
    beyond = np.int32(len(prices) - 1)
    squared = np.full(width + 2 * reach, beyond, np.int32)
    nearest = np.empty(end_col - col, np.int32)
    shift = reach + col - left
    for r in range(end_row - row):
        for c in range(width):
            squared[reach + c] = min(along[r, c] * along[r, c], beyond)
        for c in range(end_col - col):
            nearest[c] = beyond
        for offset in range(-reach, reach + 1):
            beside = squared[shift + offset : shift + offset + len(nearest)]
            for c in range(len(nearest)):
                nearest[c] = min(nearest[c], beside[c] + offset * offset)
        for c in range(end_col - col):
            cost[row + r, col + c] = prices[nearest[c]]


@njit(cache=True)
def _column_distances(
    cost: ByteArray, window: Window, reach: int
) -> NDArray[np.int32]:  # pragma: no cover - compiled
    """Distances [cells] along the column to a lethal cell, at most ``reach`` + 1.

    One row for each of the window, and columns to ``reach`` on both sides of it.
    """
    rows, cols = cost.shape
    row, end_row, col, end_col = window
    top, bottom = min(rows, end_row + reach), max(0, row - reach)
    left, right = max(0, col - reach), min(cols, end_col + reach)
    width = right - left
    far = np.int32(reach + 1)
    along = np.empty((end_row - row, width), np.int32)
    run = np.full(width, far, np.int32)
    for r in range(bottom, end_row):
        for c in range(width):
            run[c] = 0 if cost[r, left + c] == LETHAL else min(run[c] + 1, far)
            if r >= row:
                along[r - row, c] = run[c]
    run[:] = far
    for r in range(top - 1, row - 1, -1):
        for c in range(width):
            run[c] = 0 if cost[r, left + c] == LETHAL else min(run[c] + 1, far)
            if r < end_row:
                along[r - row, c] = min(along[r - row, c], run[c])
    return along
