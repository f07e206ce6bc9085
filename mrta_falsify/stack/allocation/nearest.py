"""The nearest robot takes the task: needs no travel times at all.

Where the rooms have location points, near is meant in a straight line; without them a robot
that ends in the task's room is nearest, then the one with the fewest stops. Travel times only
predict when things happen, not what happens.
"""

from __future__ import annotations

import itertools

import numpy as np

from mrta_falsify.core.allocation_problem import Allocation, AllocationProblem, OpenTask, Stop
from mrta_falsify.core.registry import WithoutOptions
from mrta_falsify.stack.allocation.timing import (
    dropoff_of,
    kept_routes,
    pickup_of,
    timed_allocation,
    without_fleet,
)


class Nearest(WithoutOptions):
    """Tasks in order of deadline, each behind the route that ends nearest to it."""

    def allocate(self, problem: AllocationProblem) -> Allocation:
        """See :class:`~mrta_falsify.core.protocols.Allocator`."""
        if not problem.robots:
            return without_fleet(problem)
        routes = kept_routes(problem)
        given = {stop.task for route in routes for stop in route}
        for task in sorted(problem.tasks, key=lambda task: (task.deadline, task.number)):
            if task.number in given:
                continue
            allowed = [r for r, plan in enumerate(problem.robots) if task.allows(plan.robot)]
            r = min(allowed, key=lambda r: self._distance(problem, r, routes[r], task))
            routes[r] += [pickup_of(task), dropoff_of(task)]
        return timed_allocation(problem, routes)

    @staticmethod
    def _distance(
        problem: AllocationProblem, r: int, route: list[Stop], task: OpenTask
    ) -> tuple[float, int, int]:
        """Distance from where the robot ends, in metres or hops; then stops; then number."""
        room = route[-1].room if route else problem.robots[r].room
        if problem.points is None:
            return float(room != task.start), len(route), r
        points = problem.points
        ways = [room, task.start]
        on_the_way = [problem.robots[r].room, *(stop.room for stop in route)]
        metres = float(np.hypot(*(points[ways[0]] - points[ways[1]])))
        for a, b in itertools.pairwise(on_the_way):
            metres += float(np.hypot(*(points[a] - points[b])))
        return metres, len(route), r
