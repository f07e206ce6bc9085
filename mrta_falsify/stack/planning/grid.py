"""The costmap as the searches see it: prices, blocked cells, map points and back."""

from __future__ import annotations

import functools
from collections import OrderedDict
from dataclasses import dataclass

import numpy as np

from mrta_falsify.core.arrays import Array, ByteArray
from mrta_falsify.core.costmap import INSCRIBED, LETHAL, UNKNOWN, Costmap
from mrta_falsify.stack.planning import search_kernels as kernels

_BLOCKED = 2**16 - 1  # while pooling: dearer than any price
KEPT_KINDS = 2  # robots and people may plan on grids of different prices


@dataclass(frozen=True, slots=True, eq=False)
class PlanningGrid:
    """Price grid of a costmap, with a border of one blocked cell all around.

    ``prices`` must not be written to. It is left writable all the same, because compiled code
    would be built once more for read-only arrays.
    """

    prices: kernels.Prices  #: (rows + 2, cols + 2), 0: must not be entered
    resolution: float  #: [m]
    corner: Array  #: (2,) south-west corner of the border cell [m], map frame

    def coordinates(self, point: Array) -> Array:
        """``(2,)`` column and row coordinate of a map point [m]; whole parts are the cell."""
        return (point - self.corner) / self.resolution

    def points(self, cells: kernels.Cells) -> Array:
        """Centres ``(n, 2)`` [m] of flat cells ``(n,)``."""
        row, col = np.divmod(np.asarray(cells), self.prices.shape[1])
        return self.corner + (np.stack([col, row], axis=-1) + 0.5) * self.resolution

    def free_cell(self, coordinates: Array) -> int:
        """Flat cell that holds a point given in cells; -1 if it is blocked or outside."""
        rows, width = self.prices.shape
        if not np.isfinite(coordinates).all():
            return -1
        col, row = np.floor(coordinates)
        if not (0 <= row < rows and 0 <= col < width):
            return -1
        return int(row) * width + int(col) if self.prices[int(row), int(col)] else -1


@functools.lru_cache(maxsize=8)  # robots and people share the grids of a map
def build_grid(
    costmap: Costmap, *, resolution: float, cost_weight: float, allow_unknown: bool
) -> PlanningGrid:
    """Build the price grid of ``costmap``.

    Args:
        costmap: Nav2 bytes.
        resolution: cell size wanted [m]; rounded to a multiple of the costmap's. A coarser
            cell takes the largest price of its cells and is blocked if one of them is.
        cost_weight: a cell of cost c is ``1 + cost_weight * c / 252`` times as dear as a
            free one (Nav2's ``cost_travel_multiplier``).
        allow_unknown: unknown cells may be entered, at the price of cost 252.

    Returns:
        The grid; cells of cost 253 and 254 are blocked.
    """
    factor = max(1, round(resolution / costmap.resolution))
    table, size = _price_table(cost_weight, allow_unknown), factor * costmap.resolution
    corner = costmap.origin - size
    if factor > 1:
        pooled = _pool(table[costmap.cost], factor)
        return PlanningGrid(_bordered(np.where(pooled == _BLOCKED, 0, pooled)), size, corner)
    table[table == _BLOCKED] = 0
    like = costmap.cost.shape, table.tobytes()
    last = _last_built.pop(like, None)
    if last is not None:
        before, prices = last
        prices = prices.copy()
        changed = np.flatnonzero(costmap.cost != before)
        row, col = np.divmod(changed, before.shape[1])
        prices[row + 1, col + 1] = table[costmap.cost.ravel()[changed]]
    else:
        prices = _bordered(table[costmap.cost])
    _last_built[like] = costmap.cost.copy(), prices  # a source may write into its map again
    if len(_last_built) > KEPT_KINDS:
        _last_built.popitem(last=False)
    return PlanningGrid(prices, size, corner)


#: by shape and prices: the costs and prices of the grid that was built last; most maps of an
#: episode differ from it in a few windows only
_last_built: OrderedDict[tuple[tuple[int, ...], bytes], tuple[ByteArray, kernels.Prices]] = (
    OrderedDict()
)


def _price_table(cost_weight: float, allow_unknown: bool) -> kernels.Prices:
    """Give the price of each cost (256,)."""
    cost = np.arange(256)
    cost[UNKNOWN] = INSCRIBED - 1 if allow_unknown else LETHAL
    scaled = kernels.PRICE * (1.0 + cost_weight * cost / (INSCRIBED - 1))
    return np.where(cost < INSCRIBED, np.rint(scaled), _BLOCKED).astype(np.uint16)


def _bordered(values: kernels.Prices) -> kernels.Prices:
    prices = np.zeros((values.shape[0] + 2, values.shape[1] + 2), dtype=np.uint16)
    prices[1:-1, 1:-1] = values
    return prices


def lethal_cells(costmap: Costmap, grid: PlanningGrid) -> kernels.Marks:
    """Flat marks of the grid's cells that meet an obstacle; the border does not."""
    factor = max(1, round(grid.resolution / costmap.resolution))
    pooled = _pool((costmap.cost == LETHAL).astype(np.uint8), factor)
    marks: ByteArray = np.zeros(grid.prices.shape, dtype=np.uint8)
    marks[1:-1, 1:-1] = pooled
    return marks.ravel()


def _pool(values: np.ndarray, factor: int) -> np.ndarray:
    if factor == 1:
        return values
    rows, cols = values.shape
    padding = ((0, -rows % factor), (0, -cols % factor))
    padded = np.pad(values, padding, constant_values=np.iinfo(values.dtype).max)
    blocks = padded.reshape(padded.shape[0] // factor, factor, padded.shape[1] // factor, factor)
    pooled: np.ndarray = blocks.max(axis=(1, 3))
    return pooled
