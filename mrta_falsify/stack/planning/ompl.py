"""OMPL's geometric planners on the same grid as A*.

OMPL's random numbers come from one seed per process, which this door sets before every
query from the query's points. Everything that draws numbers is built anew for the query and
ends by counting, never by the clock; so a plan is a function of map and points. OMPL logs
an error when it is seeded a second time, although the objects built afterwards do follow
the new seed; its log is switched off while a query runs.

Reference: Sucan, Moll & Kavraki, "The Open Motion Planning Library", RAM 2012; Gammell,
Srinivasa & Barfoot, "Batch Informed Trees", ICRA 2015.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from ompl import base, geometric
from ompl import util as ompl_util
from scipy import ndimage

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

AMPLE = 10  # times the iterations, for the last attempt at a goal known to be connected
NEAR_ENDS = 1.0  # m; this close to its ends a path may always use inflated cells


@dataclass(frozen=True, slots=True, kw_only=True)
class OmplOptions:
    """Options of the OMPL planner."""

    algorithm: Literal["BITstar", "RRTConnect", "RRTstar", "InformedRRTstar"] = "BITstar"
    iterations: int = quantity(low=100, high=10_000_000, default=3000)  #: limit of one attempt
    resolution: float = quantity(above=0.0, high=1.0, unit="m", default=0.05)
    allow_unknown: bool = True
    tolerance: float = quantity(low=0.0, high=5.0, unit="m", default=0.25)  #: blocked goals only


Options = OmplOptions


class Ompl:
    """Planner of this name; see the module.

    It looks for a way outside all inflation first (near the ends inflated cells are
    allowed), then for any way. Connectivity is decided exactly beforehand, so an
    unreachable goal costs no sampling.
    """

    Options = OmplOptions

    def __init__(self, options: OmplOptions) -> None:
        self._options = options
        self._costmap: Costmap | None = None
        self._grid: PlanningGrid | None = None

    def use(self, costmap: Costmap) -> None:
        """Plan on ``costmap`` from now on."""
        if costmap is self._costmap:
            return
        self._costmap = costmap
        self._grid = build_grid(
            costmap,
            resolution=self._options.resolution,
            cost_weight=1.0,  # only tells inflated cells from free ones
            allow_unknown=self._options.allow_unknown,
        )

    def plan(self, start: Array, goal: Array) -> Plan:
        """Path from ``start`` to ``goal``, both ``(2,)`` [m], map frame.

        Ends are treated as by ``astar.AStar.plan``. "unreachable" is also the answer for a
        goal that is connected but not found within ``AMPLE * iterations``.

        Raises:
            HarnessError: no costmap was given yet.
        """
        if self._costmap is None or self._grid is None:
            raise HarnessError("Ompl.plan: no costmap; call use(costmap) first")
        grid = self._grid
        ends = path_ends(self._costmap, grid, start, goal, self._options.tolerance)
        if ends.blocked:
            return no_plan(ends.blocked)
        first = ends.first
        connected = _connected(grid.prices, ends.last)
        if ends.way_out and not connected.flat[first]:
            first = exit_cell(self._costmap, grid, grid.prices * connected, ends.start)
        if first < 0 or not connected.flat[first]:
            return no_plan("unreachable")
        corners = self._corners(grid, first, ends.last)
        if corners is None:
            return no_plan("unreachable")
        return finished_plan(joined(grid, ends, grid.corner + corners * grid.resolution))

    def _corners(self, grid: PlanningGrid, first: int, last: int) -> Array | None:
        """Corners ``(K, 2)`` in cells of a way between connected cells, None: not found."""
        ends = grid.coordinates(grid.points(np.array([first, last])))
        corners = self._search(_preferred(grid, ends), ends, first, last, 1)
        for patience in (1, AMPLE):
            if corners is None:
                corners = self._search(grid.prices, ends, first, last, patience)
        return corners

    def _search(
        self, prices: kernels.Prices, ends: Array, first: int, last: int, patience: int
    ) -> Array | None:
        """Corners ``(K, 2)`` in cells of a way over non-zero ``prices``, None: not found."""
        if first == last:
            return ends[:1]
        if not _connected(prices, last).flat[first]:
            return None
        with _seeded(ends):
            return _sample_path(
                prices, ends, self._options.algorithm, patience * self._options.iterations
            )


def _connected(prices: kernels.Prices, cell: int) -> np.ndarray:
    """Mask of the cells that are connected to a free ``cell`` over shared edges.

    Diagonal steps need both neighbours free, so they connect nothing else.
    """
    labels, _ = ndimage.label(prices > 0)
    mask: np.ndarray = labels == labels.flat[cell]
    return mask


def _preferred(grid: PlanningGrid, ends: Array) -> kernels.Prices:
    """Prices without inflated cells, except near the two ``ends`` ``(2, 2)`` (col, row)."""
    radius = NEAR_ENDS / grid.resolution
    preferred: kernels.Prices = np.where(grid.prices == kernels.PRICE, grid.prices, 0)
    for col, row in ends:
        low_col, low_row = max(0, math.floor(col - radius)), max(0, math.floor(row - radius))
        area = np.s_[low_row : math.ceil(row + radius), low_col : math.ceil(col + radius)]
        preferred[area] = grid.prices[area]
    return preferred


@contextmanager
def _seeded(ends: Array) -> Iterator[None]:
    """OMPL's global seed and log level set for one query; the log level is restored."""
    seed = int.from_bytes(hashlib.sha256(ends.tobytes()).digest()[:4], "little") % (2**31 - 1) + 1
    ompl_util.noOutputHandler()
    try:
        ompl_util.RNG.setSeed(seed)
        yield
    finally:
        ompl_util.restorePreviousOutputHandler()


class _LineOfSight(base.MotionValidator):  # type: ignore[misc]
    """Exact motion check: no sampling along the segment."""

    def __init__(self, information: Any, prices: kernels.Prices) -> None:
        super().__init__(information)
        self._prices = prices

    def checkMotion(self, a: Any, b: Any) -> bool:  # noqa: N802 - OMPL's name
        """Whether the straight line between two states is free."""
        return bool(kernels.line_cost(self._prices, a[0], a[1], b[0], b[1]) < np.inf)


def _sample_path(
    prices: kernels.Prices, ends: Array, algorithm: str, iterations: int
) -> Array | None:
    rows, width = prices.shape
    space = base.RealVectorStateSpace(2)
    bounds = base.RealVectorBounds(2)
    bounds.setLow(1.0)  # the border cells are blocked
    bounds.setHigh(0, width - 1.0)
    bounds.setHigh(1, rows - 1.0)
    space.setBounds(bounds)
    information = base.SpaceInformation(space)
    information.setStateValidityChecker(lambda state: bool(prices[int(state[1]), int(state[0])]))
    validator = _LineOfSight(information, prices)
    information.setMotionValidator(validator)
    information.setup()
    problem = base.ProblemDefinition(information)
    states = [space.allocState(), space.allocState()]
    for state, (col, row) in zip(states, ends.tolist(), strict=True):
        state[0], state[1] = col, row
    problem.setStartAndGoalStates(*states)
    planner = getattr(geometric, algorithm)(information)
    if algorithm == "BITstar":
        # Where the ends are near in a large map, a first path makes nearly all samples useless, and
        # each one pruned may rebuild a tree of all the others: minutes for one plan.
        planner.setPruning(False)
    planner.setProblemDefinition(problem)
    planner.setup()
    counter = iter(range(iterations))
    planner.solve(base.PlannerTerminationCondition(lambda: next(counter, None) is None))
    if not problem.hasExactSolution():
        return None
    path = problem.getSolutionPath()
    simplifier = geometric.PathSimplifier(information)
    simplifier.reduceVertices(path)
    simplifier.partialShortcutPath(path)
    return np.array([[state[0], state[1]] for state in path.getStates()])
