"""World to costmap: walls, furniture, blockages in their time, parked robots, inflation.

Nav2 byte semantics (see ``docs/stack.md``): a cell is lethal (254) iff the *closed* cell
meets a footprint. All other costs follow from the distance ``d`` [m] between the centre of
the cell and the centre of the nearest lethal cell, as in Nav2's inflation layer: 253 for
``d <= robot_radius``, ``floor(252 exp(-cost_scaling (d - robot_radius)))`` up to
``inflation_radius``, 0 beyond.
"""

from __future__ import annotations

import functools
import math
from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mrta_falsify.core.arrays import Array, ByteArray, frozen_array
from mrta_falsify.core.codec import quantity
from mrta_falsify.core.costmap import FREE, INSCRIBED, LETHAL, Costmap
from mrta_falsify.core.errors import ConfigError
from mrta_falsify.core.world import Blockage, World
from simulator_interface.inflation import Window, inflate, whole
from simulator_interface.lethal_cells import mark_discs, mark_polygons
from simulator_interface.staging import without_later

MAX_CELLS = 40_000_000  # 450 m x 225 m at 0.05 m; more is a mistake in bounds or resolution
KEPT_MAPS = 16  # maps of earlier moments; robots park and leave at the same places

NO_ROBOTS = frozen_array(np.zeros((0, 2)))


@dataclass(frozen=True, slots=True, kw_only=True)
class CostmapOptions:
    """Options of the costmap, named and preset as MRTA-Sim's Nav2 parameters."""

    resolution: float = quantity(above=0.0, unit="m", default=0.05)
    inflation_radius: float = quantity(low=0.0, high=5.0, unit="m", default=0.5)
    cost_scaling: float = quantity(low=0.0, unit="1/m", default=3.0)
    robot_radius: float = quantity(above=0.0, high=5.0, unit="m", default=0.22)


Options = CostmapOptions


class LayeredCostmap:
    """The costmap layer of a stack; :meth:`bind` ties it to a world."""

    Options = CostmapOptions

    def __init__(self, options: CostmapOptions) -> None:
        self._options = options

    def bind(self, world: World) -> BoundCostmap:
        """Tie the layer to a world; the static layer is built here, once."""
        return BoundCostmap(world, self._options)


class BoundCostmap:
    """Costmaps of one world over time (see ``core.protocols.CostmapSource``)."""

    def __init__(self, world: World, options: CostmapOptions) -> None:
        self._options = options
        self._prices = _costs_by_squared_distance(options)
        self._blockages = [event for event in world.events if isinstance(event, Blockage)]
        self._static = _static_costmap(world, options)
        self._furniture = tuple(item.polygon for item in world.movable_furniture())
        self._maps: OrderedDict[tuple[tuple[int, ...], bytes, bytes], Costmap] = OrderedDict()

    def costmap(self, time: float, parked: Array = NO_ROBOTS) -> Costmap:
        """Compute the costmap at ``time`` [s] with robots parked at ``parked`` ``(P, 2)`` [m].

        A parked robot is a disc of ``robot_radius``. Only the surroundings of what is not
        static are computed; the same object is returned as long as nothing changed.
        """
        active: tuple[int, ...] = ()
        if self._blockages:
            numbered = enumerate(self._blockages)
            active = tuple(i for i, event in numbered if event.start <= time < event.end)
        if not active and len(parked) == 0 and not self._furniture:
            return self._static
        places = np.asarray(parked, dtype=np.float64).reshape(-1, 2)
        places = places[np.lexsort(places.T[::-1])]  # the order of the robots does not matter
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
        self._furniture = outlines

    def add_blockage(self, blockage: Blockage) -> None:
        """See :class:`simulator_interface.staging.StagedSource`."""
        self._blockages.append(blockage)

    def forget_after(self, time: float) -> None:
        """See :class:`simulator_interface.staging.ForgettingPart`."""
        self._blockages = without_later(self._blockages, time)

    def _overlay(self, polygons: Sequence[Array], places: Array) -> Costmap:
        options, static = self._options, self._static
        grid = Costmap(static.cost.copy(), static.resolution, static.origin)
        mark_polygons(grid, polygons)
        mark_discs(grid, places, options.robot_radius)
        reach = options.robot_radius
        boxes = [np.concatenate([p.min(axis=0), p.max(axis=0)]) for p in polygons]
        boxes += [np.concatenate([place - reach, place + reach]) for place in places]
        for box in boxes:
            inflate(grid.cost, self._window(box), self._prices)
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
    parked: Array = NO_ROBOTS,
    options: CostmapOptions | None = None,
) -> Costmap:
    """Build the costmap of ``world`` at one moment.

    Args:
        world: walls, furniture and blockages.
        time: [s]; a blockage stands from its start up to, not including, its end.
        parked: ``(P, 2)`` [m] robots at rest, map frame.
        options: resolution and inflation; the defaults if None.

    Returns:
        A costmap whose origin is the south-west corner of ``world.bounds`` and that covers
        the bounds (the last row and column may reach beyond them by less than a cell).

    Raises:
        ConfigError: bounds and resolution ask for more than ``MAX_CELLS`` cells.
    """
    return BoundCostmap(world, options or CostmapOptions()).costmap(time, parked)


@functools.lru_cache(maxsize=4)  # robots and people of one episode share it
def _static_costmap(world: World, options: CostmapOptions) -> Costmap:
    """Build the costmap of what never changes; worlds are frozen, so one serves each world."""
    solids = [wall.polygon for wall in world.walls]
    solids += [item.polygon for item in world.furniture if not item.movable]
    grid = _empty_grid(world, options.resolution)
    mark_polygons(grid, solids)
    inflate(grid.cost, whole(grid.cost), _costs_by_squared_distance(options))
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


# --- prices of distances ---------------------------------------------------------------


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


__all__ = ["BoundCostmap", "CostmapOptions", "LayeredCostmap", "Options", "build_costmap"]
