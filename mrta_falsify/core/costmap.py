"""The costmap type; building one is the business of ``simulator_interface.costmap_layers``."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mrta_falsify.core.arrays import Array, ByteArray, IntArray
from mrta_falsify.core.compiled import njit

FREE = 0
INSCRIBED = 253  #: a disc robot centred here touches an obstacle
LETHAL = 254  #: the cell meets an obstacle
UNKNOWN = 255


@dataclass(frozen=True, slots=True, eq=False)
class Costmap:
    """Grid of Nav2 cost bytes.

    Row 0 is the southernmost row: cell ``(row, col)`` covers
    ``origin + resolution * [col, row]`` to ``origin + resolution * [col + 1, row + 1]``.
    """

    cost: ByteArray  #: (rows, cols) Nav2 bytes: 0 free, 1-252 scaled, 253, 254, 255
    resolution: float  #: cell size [m]
    origin: Array  #: (2,) south-west corner [m], map frame

    def cells(self, points: Array) -> IntArray:
        """Find the cells (row, col) of map points, both ``(..., 2)`` [m]; may lie outside."""
        col_row = np.floor((np.asarray(points) - self.origin) / self.resolution)
        return col_row[..., ::-1].astype(np.int64)

    def centers(self, cells: IntArray) -> Array:
        """Find the centres ``(..., 2)`` [m] of cells ``(..., 2)`` (row, col)."""
        return self.origin + (np.asarray(cells)[..., ::-1] + 0.5) * self.resolution

    def axes(self, low: IntArray, high: IntArray) -> tuple[Array, Array]:
        """Find x ``(cols,)`` and y ``(rows,)`` [m] of the centres in a window of cells.

        Args:
            low: ``(2,)`` first row and column.
            high: ``(2,)`` behind the last ones.
        """
        x, y = (
            self.origin[axis] + (np.arange(low[1 - axis], high[1 - axis]) + 0.5) * self.resolution
            for axis in range(2)
        )
        return x, y

    def cost_at(self, points: Array) -> IntArray:
        """Look up the cost of map points ``(..., 2)`` [m]; outside the grid it is ``LETHAL``."""
        cells = self.cells(points)
        rows, cols = self.cost.shape
        row, col = cells[..., 0], cells[..., 1]
        inside = (row >= 0) & (row < rows) & (col >= 0) & (col < cols)
        values = self.cost[np.clip(row, 0, rows - 1), np.clip(col, 0, cols - 1)].astype(np.int64)
        return np.where(inside, values, LETHAL)


@njit(cache=True)
def cell_at(
    x: float, y: float, cost: ByteArray, resolution: float, west: float, south: float
) -> tuple[int, int]:
    """Find the cell (row, col) of a point [m] in compiled code; (-1, -1): outside the grid.

    Args:
        x: of the point [m].
        y: of the point [m].
        cost: ``(rows, cols)`` of a :class:`Costmap`.
        resolution: cell size [m].
        west: x of the grid's origin [m].
        south: y of the grid's origin [m].
    """
    row, col = int(np.floor((y - south) / resolution)), int(np.floor((x - west) / resolution))
    if row < 0 or col < 0 or row >= cost.shape[0] or col >= cost.shape[1]:
        return -1, -1
    return row, col
