"""Ways along free space: how far a goal is, past walls and furniture that stay where they are.

Neither robots nor people nor what people push count, so that a way round is a way, and a distance
does not depend on who is in it.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np

from mrta_falsify.core.arrays import Array, BoolArray, IntArray
from mrta_falsify.core.compiled import njit
from mrta_falsify.core.world import World
from mrta_falsify.specs.deadlock.occupancy import GRID_CELL, SolidGrid

Point: TypeAlias = Sequence[float] | Array  # (2,) x, y [m], map frame

MAX_MAPS = 64  # that are kept, or two for each robot if that is more; 1 MB each of a hospital
DETOUR_FROM = 5 * GRID_CELL  # m; below this the straight distance is better than one in cells


@dataclass(slots=True)
class FreeDistance:
    """Distances along free space to goals of one world; keeps the maps of the last goals."""

    world: World
    free: BoolArray = field(init=False)  #: (rows, cols) cells free of fixed solids
    _west: float = field(init=False)  #: [m]
    _south: float = field(init=False)  #: [m]
    _maps: dict[tuple[int, int], Array] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.free = SolidGrid(self.world).lasting_free()
        self._west, self._south = self.world.bounds[:2].tolist()

    def cells_of(self, positions: Array) -> IntArray:
        """Number the cells of a map, as ``map_to`` gives it, in which positions ``(N, 2)`` lie."""
        cells = np.empty(len(positions), dtype=np.int64)
        _fill_cells(positions, self._west, self._south, self.free.shape, cells)
        return cells

    def way(self, position: Array, goal: Array, reach: float) -> Array:
        """Find the first ``reach`` metres of a shortest way, ``(L, 2)`` [m]; straight if none."""
        found = self.map_to(goal)
        row, col = self._cell(position)
        if not np.isfinite(found[row, col]) or found[row, col] <= DETOUR_FROM:
            return np.stack([position, goal])
        cells = _descend(found, row, col, reach / GRID_CELL)
        ahead = self.world.bounds[:2] + (cells[1:, ::-1] + 0.5) * GRID_CELL
        return np.concatenate([position[None], ahead])

    def map_to(self, goal: Point) -> Array:
        """Give the way from every cell ``(rows, cols)`` to ``goal`` ``(2,)`` [m]; inf: none."""
        cell = self._cell(goal)
        found = self._maps.pop(cell, None)
        if found is None:
            found = _distances(self.free, *cell, GRID_CELL)
            if len(self._maps) >= max(MAX_MAPS, 2 * len(self.world.robots)):
                del self._maps[next(iter(self._maps))]
        self._maps[cell] = found  # the last one used is the last one
        return found

    def _cell(self, point: Point) -> tuple[int, int]:
        number = int(self.cells_of(np.array([point], dtype=np.float64))[0])
        return divmod(number, int(self.free.shape[1]))


@functools.lru_cache(maxsize=1)
def free_distance(world: World) -> FreeDistance:
    """Give the distances of a world; all who ask share their maps."""
    return FreeDistance(world)


@njit(cache=True)
def _fill_cells(
    positions: Array, west: float, south: float, shape: tuple[int, int], cells: IntArray
) -> None:
    rows, cols = shape
    for i in range(len(positions)):
        row = int(np.floor((positions[i, 1] - south) / GRID_CELL))
        col = int(np.floor((positions[i, 0] - west) / GRID_CELL))
        cells[i] = min(max(row, 0), rows - 1) * cols + min(max(col, 0), cols - 1)


@njit(cache=True)
def _distances(free: BoolArray, goal_row: int, goal_col: int, cell: float) -> Array:
    """Measure the shortest way to the goal's cell from every cell [m]; inf: none.

    Cells whose distance became shorter wait in a line until it has been passed on. All steps are
    about as long, so that hardly any cell has to wait twice.

    Source: Moore, "The shortest path through a maze", 1959.
    """
    rows, cols = free.shape
    found = np.full(free.shape, np.inf)
    waits = np.zeros(free.shape, dtype=np.bool_)
    line = np.empty((rows * cols, 2), dtype=np.int64)
    first, count, aslant = 0, 1, cell * math.sqrt(2.0)
    found[goal_row, goal_col] = 0.0
    line[0, 0], line[0, 1] = goal_row, goal_col
    while count > 0:
        row, col = line[first]
        first, count = (first + 1) % len(line), count - 1
        waits[row, col] = False
        for up in range(-1, 2):
            for side in range(-1, 2):
                r, c = row + up, col + side
                if r < 0 or r >= rows or c < 0 or c >= cols or not free[r, c]:
                    continue
                total = found[row, col] + (aslant if up * side != 0 else cell)
                if total >= found[r, c] - 1e-9:
                    continue
                found[r, c] = total
                if not waits[r, c]:
                    waits[r, c] = True
                    last = (first + count) % len(line)
                    line[last, 0], line[last, 1] = r, c
                    count += 1
    return found


@njit(cache=True)
def _descend(found: Array, row: int, col: int, steps: float) -> Array:
    """Follow a map of distances downhill; cells ``(L, 2)`` row and column, the first one given."""
    rows, cols = found.shape
    made = np.empty((int(steps) + 2, 2))
    made[0, 0], made[0, 1] = row, col
    count = 1
    while count < len(made) and found[row, col] > 0.0:
        next_row, next_col = row, col
        for up in range(-1, 2):
            for side in range(-1, 2):
                r, c = row + up, col + side
                if 0 <= r < rows and 0 <= c < cols and found[r, c] < found[next_row, next_col]:
                    next_row, next_col = r, c
        row, col = next_row, next_col
        made[count, 0], made[count, 1] = row, col
        count += 1
    return made[:count]
