"""What every grid-based planner does at the ends of a path, and how it hands one over."""

from __future__ import annotations

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
    """Free cell of ``prices`` nearest to a blocked ``start`` ``(2,)`` [m]; -1: none.

    It lies within ``ESCAPE``, and the straight way there does not run into an obstacle.
    """
    col, row = grid.coordinates(start)
    lethal = lethal_cells(costmap, grid)
    radius = ESCAPE / grid.resolution
    return int(kernels.nearest_free(prices, lethal, col, row, radius, True))


def goal_cell(grid: PlanningGrid, goal: Array, tolerance: float) -> tuple[int, Array]:
    """Cell to plan to and the point ``(2,)`` [m] the path ends at; cell -1 if all is blocked."""
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


def no_plan(reason: str) -> Plan:
    """A plan that says why there is none."""
    return Plan(path=frozen_array(np.zeros((0, 2))), length=float("inf"), reason=reason)


def finished_plan(corners: Array) -> Plan:
    """Plan along the polyline ``(K, 2)`` [m], points at most ``SPACING`` apart."""
    return Plan(path=frozen_array(_resampled(corners)), length=path_length(corners))


def _resampled(corners: Array) -> Array:
    """``corners`` ``(K, 2)`` [m] with points between them, each leg in equal steps."""
    leg = np.diff(corners, axis=0)
    pieces = np.maximum(np.ceil(np.hypot(leg[:, 0], leg[:, 1]) / SPACING - 1e-9), 1).astype(int)
    of_leg = np.repeat(np.arange(len(leg)), pieces)
    step = np.arange(len(of_leg)) - (np.cumsum(pieces) - pieces)[of_leg]
    between = corners[of_leg] + leg[of_leg] * (step / pieces[of_leg])[:, None]
    return np.concatenate([between, corners[-1:]])


def joined(
    grid: PlanningGrid, start: Array, corners: Array, end: Array, *, keep_first: bool
) -> Array:
    """``corners`` (cell centres) with ``start`` and ``end`` in place of its ends where possible.

    The end cells are convex and free, so the way by their centres is always possible.
    """
    inner = corners
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
