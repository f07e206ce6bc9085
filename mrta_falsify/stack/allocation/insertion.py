"""Regret insertion: a task that would suffer most from waiting is placed first.

Places are tried in constant time each; tasks that fit nowhere start a ruin-and-recreate
search; what fits nowhere even then is served late where it spoils no other deadline. The
methods work on a :class:`RouteTable`, which may live on from batch to batch.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mrta_falsify.core.allocation_problem import Allocation, AllocationProblem
from mrta_falsify.core.arrays import IntArray
from mrta_falsify.core.codec import quantity
from mrta_falsify.stack.allocation.objective import Objective, late_weights_of, weights_of
from mrta_falsify.stack.allocation.route_kernels import construct
from mrta_falsify.stack.allocation.ruin_and_recreate import place_late, ruin_and_recreate
from mrta_falsify.stack.allocation.table import RouteTable
from mrta_falsify.stack.allocation.timing import (
    append_only,
    timed_allocation,
    with_kept_plans,
    without_fleet,
)

WORK = 2_000_000  # places that one rescue may try; a step tries about open tasks x robots
NO_TASKS = np.empty(0, np.int64)


@dataclass(frozen=True, slots=True, kw_only=True)
class InsertionOptions:
    """What is minimised, and how long is searched."""

    objective: Objective = "completion"
    improvement_steps: int = quantity(low=0, high=1_000_000, default=0)  #: ruins after a success
    rescue_steps: int = quantity(low=0, high=1_000_000, default=1000)  #: ruins if tasks are left
    seed: int = quantity(low=0, default=0)  #: of the ruins


class Insertion:
    """Regret insertion with ruin and recreate; keeps what earlier calls promised."""

    Options = InsertionOptions

    def __init__(self, options: InsertionOptions) -> None:
        self._options = options
        self._weights = weights_of(options.objective)

    def allocate(self, problem: AllocationProblem) -> Allocation:
        """See :class:`~mrta_falsify.core.protocols.Allocator`."""
        if not problem.robots:
            return without_fleet(problem)
        if problem.commitment == "keep":
            return with_kept_plans(problem, self.allocate(append_only(problem)))
        table = RouteTable.of(problem)
        self.settle(table)
        return timed_allocation(problem, [table.stops(r) for r in range(table.n)])

    def settle(self, table: RouteTable, *, rescue: bool = True) -> None:
        """Give every pending task of the table a place, in time or late."""
        self.serve_late(table, self.insert(table, rescue=rescue))
        self.polish(table)

    def polish(self, table: RouteTable) -> None:
        """Improve by as many steps as the options say."""
        if self._options.improvement_steps:
            self.improve(table, self._options.improvement_steps)

    @property
    def incremental(self) -> Insertion:
        """Itself: its routes may live on from batch to batch."""
        return self

    def insert(self, table: RouteTable, *, rescue: bool = True) -> IntArray:
        """Give pending tasks places in time, and return those for which none was found."""
        table.relieve(range(table.n), self._weights)
        left = construct(table.w, table.pending(), self._weights, False, 0.0, self._seed())
        if len(left) == 0 or not rescue:
            return left
        size = len(table.tasks) + 10 * table.n
        steps = min(self._options.rescue_steps, WORK // (10 * size))
        return self._search(table, left, steps, only_until_served=True)

    def serve_late(self, table: RouteTable, left: IntArray) -> None:
        """Give tasks that cannot be in time the places that cost the others least."""
        weights = late_weights_of(self._options.objective)
        for k in sorted(left.tolist(), key=lambda k: (table.tasks[k].deadline, k)):
            place_late(table.w, k, weights)

    def improve(self, table: RouteTable, steps: int) -> None:
        """Ruin and recreate for the objective; loses no deadline that is kept."""
        self._search(table, NO_TASKS, steps, only_until_served=False)

    def _search(
        self, table: RouteTable, left: IntArray, steps: int, *, only_until_served: bool
    ) -> IntArray:
        spare, best = table.copy_of_routes(), table.copy_of_routes()
        return ruin_and_recreate(
            table.w, spare, best, left, self._weights, steps, only_until_served, self._seed()
        )

    def _seed(self) -> NDArray[np.uint64]:
        return np.array([(self._options.seed << 8) + 0x9E3779B97F4A7C15 & (2**64 - 1)], np.uint64)
