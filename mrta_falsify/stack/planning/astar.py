"""Cost-aware A* on the costmap grid, with a goal field per goal that later starts extend.

A plan is a pure function of (map, start, goal). The search runs from the goal towards the
start and keeps its exact costs; another start of the same goal continues it. Because every
cell on every best path is closed before a path is read off, the path never depends on what
was asked before (see ``search_kernels.expand``).
"""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass, field

import numpy as np

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.codec import quantity
from mrta_falsify.core.costmap import Costmap
from mrta_falsify.core.errors import HarnessError
from mrta_falsify.core.protocols import Plan
from mrta_falsify.stack.planning import search_kernels as kernels
from mrta_falsify.stack.planning.grid import PlanningGrid, build_grid
from mrta_falsify.stack.planning.path_ends import (
    exit_cell,
    finished_plan,
    joined,
    no_plan,
    path_ends,
)

KEPT_MAPS = 4  # maps whose grids and goal fields are kept


@dataclass(frozen=True, slots=True, kw_only=True)
class AStarOptions:
    """Options of the A* planner, preset as MRTA-Sim's Nav2 parameters."""

    resolution: float = quantity(above=0.0, high=1.0, unit="m", default=0.05)
    cost_weight: float = quantity(low=0.0, high=100.0, default=2.0)
    allow_unknown: bool = True
    tolerance: float = quantity(low=0.0, high=5.0, unit="m", default=0.25)  #: blocked goals only
    goal_cache: int = quantity(low=1, high=1000, default=16)  #: fields kept, 5 bytes a cell each


Options = AStarOptions


@dataclass(slots=True, eq=False)
class _GoalField:
    """Exact cost to one goal, as far as it was asked for."""

    cost: kernels.Costs
    marks: kernels.Marks
    frontier: kernels.Cells = field(default_factory=lambda: np.zeros(0, dtype=np.int32))

    def is_closed(self, cell: int) -> bool:
        """Whether the cost from a cell is known."""
        return bool(self.marks[cell] == kernels.CLOSED)


@dataclass(slots=True, eq=False)
class _MapMemory:
    """What was learned of one costmap."""

    costmap: Costmap
    grid: PlanningGrid
    fields: OrderedDict[int, _GoalField] = field(default_factory=OrderedDict)


class AStar:
    """Planner of this name; see the module."""

    Options = AStarOptions

    def __init__(self, options: AStarOptions) -> None:
        self._options = options
        self._maps: list[_MapMemory] = []  # the map in use is the last one
        self._spare: list[_GoalField] = []  # forgotten: new memory costs ten times a search

    def use(self, costmap: Costmap) -> None:
        """Plan on ``costmap`` from now on; goal fields of the last few maps are kept."""
        for i, known in enumerate(self._maps):
            if known.costmap is costmap:
                self._maps.append(self._maps.pop(i))
                return
        options = self._options
        grid = build_grid(
            costmap,
            resolution=options.resolution,
            cost_weight=options.cost_weight,
            allow_unknown=options.allow_unknown,
        )
        for forgotten in self._maps[: -(KEPT_MAPS - 1)]:
            self._spare += forgotten.fields.values()
        self._maps = [*self._maps[-(KEPT_MAPS - 1) :], _MapMemory(costmap, grid)]

    def plan(self, start: Array, goal: Array) -> Plan:
        """Path from ``start`` to ``goal``, both ``(2,)`` [m], map frame.

        A start closer to an obstacle than the robot's radius begins with a straight way
        out, at most ``ESCAPE`` long; a goal that close is replaced by the nearest free cell
        within ``tolerance``. Apart from that way out, no segment of the path enters a cell
        of cost 253 or more.

        Returns:
            Points at most ``SPACING`` apart, or the reason why there is no path.

        Raises:
            HarnessError: no costmap was given yet.
        """
        if not self._maps:
            raise HarnessError("AStar.plan: no costmap; call use(costmap) first")
        memory = self._maps[-1]
        grid = memory.grid
        ends = path_ends(memory.costmap, grid, start, goal, self._options.tolerance)
        if ends.blocked:
            return no_plan(ends.blocked)
        first = ends.first
        to_goal = self._extended_field(memory, ends.last, first)
        if ends.way_out and not to_goal.is_closed(first):
            # The nearest exit leads into a pocket: take the nearest that leads to the goal.
            is_closed = to_goal.marks == kernels.CLOSED
            reachable = grid.prices * is_closed.reshape(grid.prices.shape)
            first = exit_cell(memory.costmap, grid, reachable, ends.start)
        if first < 0 or not to_goal.is_closed(first):
            return no_plan("unreachable")
        cells = kernels.descend(grid.prices, to_goal.cost, to_goal.marks, first)
        corners = grid.points(kernels.pull_taut(grid.prices, to_goal.cost, cells))
        return finished_plan(joined(grid, ends, corners))

    def _extended_field(self, memory: _MapMemory, last: int, first: int) -> _GoalField:
        """Field of the goal cell ``last``, closed at ``first`` if that can be reached."""
        found = memory.fields.pop(last, None)
        if found is None:
            found = self._new_field(memory.grid.prices.size, last)
        if len(found.frontier):
            found.frontier = kernels.expand(
                memory.grid.prices, found.cost, found.marks, found.frontier, first
            )
        memory.fields[last] = found
        self._forget_fields()
        return found

    def _new_field(self, size: int, last: int) -> _GoalField:
        """Begin the field of the goal cell ``last``, in the memory of a forgotten one if any."""
        while self._spare and len(self._spare[-1].cost) != size:
            self._spare.pop()
        if self._spare:
            new = self._spare.pop()
            new.marks.fill(0)
        else:
            new = _GoalField(np.empty(size, dtype=np.int32), np.zeros(size, dtype=np.uint8))
        new.cost[last] = 0
        new.frontier = np.array([last], dtype=np.int32)
        return new

    def _forget_fields(self) -> None:
        kept = sum(len(memory.fields) for memory in self._maps)
        for memory in self._maps:  # the oldest maps first, and there the oldest goals
            while kept > self._options.goal_cache and memory.fields:
                self._spare.append(memory.fields.popitem(last=False)[1])
                kept -= 1
