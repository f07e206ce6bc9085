"""Sequential single-item auction: the decentralised baseline.

Every robot bids what a task would add to its own route; the lowest bid of all wins, then the
robots bid again. A robot needs to know its own route and the winners only.

Reference: Koenig et al., "The power of sequential single-item auctions for agent
coordination", AAAI 2006.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mrta_falsify.core.allocation_problem import Allocation, AllocationProblem
from mrta_falsify.stack.allocation.objective import Objective, late_weights_of, weights_of
from mrta_falsify.stack.allocation.route_kernels import construct
from mrta_falsify.stack.allocation.ruin_and_recreate import place_late
from mrta_falsify.stack.allocation.table import RouteTable
from mrta_falsify.stack.allocation.timing import (
    append_only,
    timed_allocation,
    with_kept_plans,
    without_fleet,
)


class Auction:
    """The task with the lowest bid of all robots is given away first."""

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Options:
        """What bids minimise."""

        objective: Objective = "completion"

    def __init__(self, options: Options) -> None:
        self._options = options

    def allocate(self, problem: AllocationProblem) -> Allocation:
        """See :class:`~mrta_falsify.core.protocols.Allocator`."""
        if not problem.robots:
            return without_fleet(problem)
        if problem.commitment == "keep":
            return with_kept_plans(problem, self.allocate(append_only(problem)))
        weights = weights_of(self._options.objective)
        table = RouteTable.of(problem)
        table.relieve(range(table.n), weights)
        unused = np.ones(1, np.uint64)
        left = construct(table.w, table.pending(), weights, True, 0.0, unused)
        for k in sorted(left.tolist(), key=lambda k: (table.tasks[k].deadline, k)):
            place_late(table.w, k, late_weights_of(self._options.objective))
        return timed_allocation(problem, [table.stops(r) for r in range(table.n)])
