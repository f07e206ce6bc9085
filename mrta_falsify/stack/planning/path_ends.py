"""What every grid-based planner does at the ends of a path, and how it returns the path."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mrta_falsify.core.arrays import Array, frozen_array
from mrta_falsify.core.costmap import Costmap
from mrta_falsify.core.polyline import path_length
from mrta_falsify.core.protocols import Plan
from mrta_falsify.stack.planning import search_kernels as kernels
from mrta_falsify.stack.planning.grid import PlanningGrid, lethal_cells

ESCAPE = 0.5  # m; a robot that stands closer to an obstacle than allowed may go this far
SPACING = 0.1  # m between points of a path


def exit_cell(costmap: Costmap, grid: PlanningGrid, prices: kernels.Prices, start: Array) -> int:
    """Find the free cell of ``prices`` nearest to a blocked ``start`` ``(2,)`` [m]; -1: none.

    It lies within ``ESCAPE``, and the straight way there does not run into an obstacle.
    """
    col, row = grid.coordinates(start)
    lethal = lethal_cells(costmap, grid)
    radius = ESCAPE / grid.resolution
    return int(kernels.nearest_free(prices, lethal, col, row, radius, True))


def goal_cell(grid: PlanningGrid, goal: Array, tolerance: float) -> tuple[int, Array]:
    """Find the cell to plan to, -1 if all is blocked, and the point ``(2,)`` [m] of its end."""
    if not np.isfinite(goal).all():
        return -1, goal
    col, row = coordinates = grid.coordinates(goal)
    cell = grid.free_cell(coordinates)
    if cell >= 0:
        return cell, goal
    anything = np.zeros(0, dtype=np.uint8)
    radius = tolerance / grid.resolution
    cell = int(kernels.nearest_free(grid.prices, anything, col, row, radius, False))
    return (cell, grid.points(np.array([cell]))[0]) if cell >= 0 else (-1, goal)


@dataclass(frozen=True, slots=True, eq=False)
class PathEnds:
    """The cells a search connects, and the points the path begins and ends at."""

    start: Array  #: (2,) [m]
    end: Array  #: (2,) [m]
    first: int  #: cell to search from, -1: none
    last: int  #: cell to search to, -1: none
    way_out: bool  #: the start is blocked: the path begins with a straight way to ``first``

    @property
    def blocked(self) -> str:
        """Why there can be no path; empty if there may be one."""
        if self.first < 0:
            return "start-blocked"
        return "goal-blocked" if self.last < 0 else ""


def path_ends(
    costmap: Costmap, grid: PlanningGrid, start: Array, goal: Array, tolerance: float
) -> PathEnds:
    """Find the cells to search between.

    Args:
        costmap: of the grid.
        grid: its prices.
        start: ``(2,)`` [m]; a blocked one gets a straight way out, at most ``ESCAPE`` long.
        goal: ``(2,)`` [m]; a blocked one is replaced by the nearest free cell.
        tolerance: how far away that cell may be [m].
    """
    start, goal = np.asarray(start, dtype=np.float64), np.asarray(goal, dtype=np.float64)
    if not np.isfinite(start).all():
        return PathEnds(start, goal, -1, -1, way_out=False)
    first = grid.free_cell(grid.coordinates(start))
    way_out = first < 0
    if way_out:
        first = exit_cell(costmap, grid, grid.prices, start)
    last, end = goal_cell(grid, goal, tolerance) if first >= 0 else (-1, goal)
    return PathEnds(start, end, first, last, way_out)


def no_plan(reason: str) -> Plan:
    """Say why there is no path."""
    return Plan(path=frozen_array(np.zeros((0, 2))), length=float("inf"), reason=reason)


def finished_plan(corners: Array) -> Plan:
    """Return the polyline ``(K, 2)`` [m] as a plan, with points at most ``SPACING`` apart."""
    return Plan(path=frozen_array(_resampled(corners)), length=path_length(corners))


def _resampled(corners: Array) -> Array:
    """Put points between ``corners`` ``(K, 2)`` [m], in equal steps on each leg."""
    leg = np.diff(corners, axis=0)
    pieces = np.maximum(np.ceil(np.hypot(leg[:, 0], leg[:, 1]) / SPACING - 1e-9), 1).astype(int)
    of_leg = np.repeat(np.arange(len(leg)), pieces)
    step = np.arange(len(of_leg)) - (np.cumsum(pieces) - pieces)[of_leg]
    between = corners[of_leg] + leg[of_leg] * (step / pieces[of_leg])[:, None]
    return np.concatenate([between, corners[-1:]])


def joined(grid: PlanningGrid, ends: PathEnds, corners: Array) -> Array:
    """Put start and end in place of the first and last of ``corners`` where that is possible.

    Corners ``(K, 2)`` [m] are centres of cells. The end cells are convex and free, so the way by
    their centres is always possible.
    """
    inner, start, end, keep_first = corners, ends.start, ends.end, ends.way_out
    if not keep_first:
        ahead = corners[1] if len(corners) > 1 else end
        if _is_clear(grid, start, ahead):
            inner = inner[1:]
    if len(inner):
        behind = inner[-2] if len(inner) > 1 else start
        # With one corner left behind a way out, that corner itself must stay.
        if (len(inner) > 1 or not keep_first) and _is_clear(grid, behind, end):
            inner = inner[:-1]
    return np.concatenate([start[None], inner, end[None]])


def _is_clear(grid: PlanningGrid, a: Array, b: Array) -> bool:
    x1, y1 = grid.coordinates(a)
    x2, y2 = grid.coordinates(b)
    return bool(np.isfinite(kernels.line_cost(grid.prices, x1, y1, x2, y2)))
