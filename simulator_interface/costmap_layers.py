"""World to costmap: walls, furniture, blockages in their time, parked robots, inflation.

Nav2 byte semantics (see ``docs/costmap.md``): a cell is lethal (254) iff the *closed* cell
meets a footprint. All other costs follow from the distance ``d`` [m] between the centre of
the cell and the centre of the nearest lethal cell, as in Nav2's inflation layer: 253 for
``d <= robot_radius``, ``floor(252 exp(-cost_scaling (d - robot_radius)))`` up to
``inflation_radius``, 0 beyond. Squared distances are whole numbers of cells, so equal worlds
give equal bytes on every machine, and a map updated in a window equals one built anew.
"""

from __future__ import annotations

import functools
import math
from collections import OrderedDict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit

from mrta_falsify.core.arrays import Array, ByteArray, frozen_array
from mrta_falsify.core.codec import quantity
from mrta_falsify.core.costmap import FREE, INSCRIBED, LETHAL, Costmap
from mrta_falsify.core.errors import ConfigError
from mrta_falsify.core.world import Blockage, World
from simulator_interface.staging import without_later

MAX_CELLS = 40_000_000  # 450 m x 225 m at 0.05 m; more is a mistake in bounds or resolution
TOUCH = 1e-9  # cells; a footprint this close to a cell touches it (rounding of coordinates)
KEPT_MAPS = 16  # maps of earlier moments; robots park and leave at the same places

_NOBODY = frozen_array(np.zeros((0, 2)))


@dataclass(frozen=True, slots=True, kw_only=True)
class CostmapOptions:
    """Options of the costmap, named and preset as MRTA-Sim's Nav2 parameters."""

    resolution: float = quantity(above=0.0, unit="m", default=0.05)
    inflation_radius: float = quantity(low=0.0, high=5.0, unit="m", default=0.5)
    cost_scaling: float = quantity(low=0.0, unit="1/m", default=3.0)
    robot_radius: float = quantity(above=0.0, high=5.0, unit="m", default=0.22)
    defects: tuple[str, ...] = ()  #: planted defects; ``costmap_blind_to_furniture`` is ours


Options = CostmapOptions


class LayeredCostmap:
    """The costmap layer of a stack; :meth:`bind` ties it to a world."""

    Options = CostmapOptions

    def __init__(self, options: CostmapOptions) -> None:
        self._options = options

    def bind(self, world: World) -> BoundCostmap:
        """Costmap source of one world; the static layer is built here, once."""
        return BoundCostmap(world, self._options)


class BoundCostmap:
    """Costmaps of one world over time (see ``core.protocols.CostmapSource``)."""

    def __init__(self, world: World, options: CostmapOptions) -> None:
        self._options = options
        self._prices = _costs_by_squared_distance(options)
        self._blockages = [event for event in world.events if isinstance(event, Blockage)]
        self._static = _static_costmap(world, options)
        movable = world.movable_furniture() if self._sees_furniture else ()
        self._furniture = tuple(item.polygon for item in movable)
        self._maps: OrderedDict[tuple[tuple[int, ...], bytes, bytes], Costmap] = OrderedDict()

    def costmap(self, time: float, parked: Array = _NOBODY) -> Costmap:
        """Costmap at ``time`` [s] with robots at rest at ``parked`` ``(P, 2)`` [m].

        A parked robot is a disc of ``robot_radius``. Only the surroundings of what is not
        static are computed; the same object is returned as long as nothing changed.
        """
        active = tuple(
            i for i, event in enumerate(self._blockages) if event.start <= time < event.end
        )
        if not active and len(parked) == 0 and not self._furniture:
            return self._static
        places = np.asarray(parked, dtype=np.float64).reshape(-1, 2)
        places = places[np.lexsort(places.T[::-1])]  # who parks where does not matter
        key = (active, places.tobytes(), b"".join(p.tobytes() for p in self._furniture))
        if key not in self._maps:
            polygons = [self._blockages[i].polygon for i in active]
            self._maps[key] = self._overlay([*polygons, *self._furniture], places)
            if len(self._maps) > KEPT_MAPS:
                self._maps.popitem(last=False)
        self._maps.move_to_end(key)
        return self._maps[key]

    def furnish(self, outlines: tuple[Array, ...]) -> None:
        """See :class:`simulator_interface.staging.StagedSource`."""
        self._furniture = outlines if self._sees_furniture else ()

    def add_blockage(self, blockage: Blockage) -> None:
        """See :class:`simulator_interface.staging.StagedSource`."""
        self._blockages.append(blockage)

    def forget_after(self, time: float) -> None:
        """See :class:`simulator_interface.staging.ForgettingPart`."""
        self._blockages = without_later(self._blockages, time)

    @property
    def _sees_furniture(self) -> bool:
        return "costmap_blind_to_furniture" not in self._options.defects

    def _overlay(self, polygons: Sequence[Array], places: Array) -> Costmap:
        options, static = self._options, self._static
        grid = Costmap(static.cost.copy(), static.resolution, static.origin)
        _fill_polygons(grid, polygons)
        _fill_discs(grid, places, options.robot_radius)
        reach = options.robot_radius
        boxes = [np.concatenate([p.min(axis=0), p.max(axis=0)]) for p in polygons]
        boxes += [np.concatenate([place - reach, place + reach]) for place in places]
        for box in boxes:
            _fill_costs(grid.cost, self._window(box), self._prices)
        grid.cost.setflags(write=False)
        return grid

    def _window(self, box: Array) -> Window:
        """Cells whose cost can depend on something inside ``box`` (x, y, x, y) [m]."""
        margin = math.isqrt(_reach_squared(self._options)) + 2
        (row, col), (last_row, last_col) = self._static.cells(box.reshape(2, 2))
        rows, cols = self._static.cost.shape
        return Window(
            max(int(row) - margin, 0),
            min(int(last_row) + margin + 1, rows),
            max(int(col) - margin, 0),
            min(int(last_col) + margin + 1, cols),
        )


def build_costmap(
    world: World,
    *,
    time: float = 0.0,
    parked: Array = _NOBODY,
    options: CostmapOptions | None = None,
) -> Costmap:
    """Costmap of ``world`` at one moment.

    Args:
        world: walls, furniture and blockages.
        time: [s]; a blockage stands from its start up to, not including, its end.
        parked: ``(P, 2)`` [m] robots at rest, map frame.
        options: resolution, inflation and planted defects; the defaults if None.

    Returns:
        A costmap whose origin is the south-west corner of ``world.bounds`` and that covers
        the bounds (the last row and column may reach beyond them by less than a cell).

    Raises:
        ConfigError: bounds and resolution ask for more than ``MAX_CELLS`` cells.
    """
    return BoundCostmap(world, options or CostmapOptions()).costmap(time, parked)


class Window(NamedTuple):
    """Block of cells, ends excluded."""

    row: int
    end_row: int
    col: int
    end_col: int


def _whole(cost: ByteArray) -> Window:
    return Window(0, cost.shape[0], 0, cost.shape[1])


@functools.lru_cache(maxsize=4)  # robots and people of one episode share it
def _static_costmap(world: World, options: CostmapOptions) -> Costmap:
    """Costmap of what never changes; worlds are frozen, so one is built per world."""
    solids = [wall.polygon for wall in world.walls]
    if "costmap_blind_to_furniture" not in options.defects:
        solids += [item.polygon for item in world.furniture if not item.movable]
    grid = _empty_grid(world, options.resolution)
    _fill_polygons(grid, solids)
    _fill_costs(grid.cost, _whole(grid.cost), _costs_by_squared_distance(options))
    grid.cost.setflags(write=False)
    return grid


def _empty_grid(world: World, resolution: float) -> Costmap:
    extent = (world.bounds[2:] - world.bounds[:2]) / resolution
    cols, rows = (max(1, math.ceil(length - 1e-6)) for length in extent)
    if rows * cols > MAX_CELLS:
        raise ConfigError(
            f"costmap.resolution is {resolution} m; the bounds {world.bounds.tolist()} would "
            f"need {rows} x {cols} cells, at most {MAX_CELLS} are allowed (take larger cells)"
        )
    cost = np.full((rows, cols), FREE, dtype=np.uint8)
    return Costmap(cost, resolution, frozen_array(world.bounds[:2]))


# --- what is lethal --------------------------------------------------------------------


def _fill_polygons(grid: Costmap, polygons: Iterable[Array]) -> None:
    for polygon in polygons:
        _fill_polygon(grid.cost, (polygon - grid.origin) / grid.resolution)


def _fill_discs(grid: Costmap, centers: Array, radius: float) -> None:
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


# --- inflation -------------------------------------------------------------------------


def _reach_squared(options: CostmapOptions) -> int:
    """Largest squared distance [cells^2] at which a lethal cell has an influence."""
    reach = max(options.inflation_radius, options.robot_radius) / options.resolution
    return math.floor(reach * reach + 1e-6)


def _costs_by_squared_distance(options: CostmapOptions) -> ByteArray:
    """Cost ``(n,)`` of a cell by its squared distance [cells^2] to a lethal cell."""
    distance = np.sqrt(np.arange(_reach_squared(options) + 2)) * options.resolution
    decay = np.exp(-options.cost_scaling * np.maximum(distance - options.robot_radius, 0.0))
    cost: ByteArray = np.floor((INSCRIBED - 1) * decay).astype(np.uint8)
    rounding = 1e-6 * options.resolution
    cost[distance > options.inflation_radius + rounding] = FREE
    cost[distance <= options.robot_radius + rounding] = INSCRIBED
    cost[0] = LETHAL
    cost[-1] = FREE  # stands for everything farther away
    return cost


def _fill_costs(cost: ByteArray, window: Window, prices: ByteArray) -> None:
    if window.row >= window.end_row or window.col >= window.end_col:
        return  # wholly outside the grid
    reach = math.isqrt(len(prices) - 2)
    _fill_window(cost, window.row, window.end_row, window.col, window.end_col, prices, reach)


@njit(cache=True)
def _fill_window(
    cost: ByteArray,
    row: int,
    end_row: int,
    col: int,
    end_col: int,
    prices: ByteArray,
    reach: int,
) -> None:  # pragma: no cover - compiled
    """Exact bounded Euclidean distance transform of a window, then distance to cost.

    First the distance along the column to a lethal cell, then the smallest sum of squares
    along the row; only lethal cells of ``cost`` are read.
    """
    rows, cols = cost.shape
    top, bottom = min(rows, end_row + reach), max(0, row - reach)
    left, right = max(0, col - reach), min(cols, end_col + reach)
    width = right - left
    far = np.int32(reach + 1)
    along = np.empty((end_row - row, width), np.int32)
    run = np.empty(width, np.int32)
    for c in range(width):
        run[c] = far
    for r in range(bottom, end_row):
        for c in range(width):
            run[c] = 0 if cost[r, left + c] == LETHAL else min(run[c] + 1, far)
            if r >= row:
                along[r - row, c] = run[c]
    for c in range(width):
        run[c] = far
    for r in range(top - 1, row - 1, -1):
        for c in range(width):
            run[c] = 0 if cost[r, left + c] == LETHAL else min(run[c] + 1, far)
            if r < end_row:
                along[r - row, c] = min(along[r - row, c], run[c])
    beyond = np.int32(len(prices) - 1)
    squared = np.empty(width + 2 * reach, np.int32)
    for c in range(width + 2 * reach):
        squared[c] = beyond
    nearest = np.empty(end_col - col, np.int32)
    shift = reach + col - left
    for r in range(end_row - row):
        for c in range(width):
            squared[reach + c] = min(along[r, c] * along[r, c], beyond)
        for c in range(end_col - col):
            nearest[c] = beyond
        for offset in range(-reach, reach + 1):
            extra = np.int32(offset * offset)
            for c in range(end_col - col):
                nearest[c] = min(nearest[c], squared[shift + c + offset] + extra)
        for c in range(end_col - col):
            cost[row + r, col + c] = prices[nearest[c]]


__all__ = ["BoundCostmap", "CostmapOptions", "LayeredCostmap", "Options", "build_costmap"]
