"""Deals the tasks out in turn, like cards: the baseline that looks at nothing.

Task k goes to robot k modulo the number of robots, and each robot serves its tasks in order of
their numbers, one at a time. Robots of opposite ends get opposite ways, so they meet often.
"""

from __future__ import annotations

from mrta_falsify.core.allocation_problem import Allocation, AllocationProblem, OpenTask, Stop
from mrta_falsify.core.registry import WithoutOptions
from mrta_falsify.stack.allocation.timing import (
    append_only,
    dropoff_of,
    pickup_of,
    timed_allocation,
    with_kept_plans,
    without_fleet,
)


class InTurn(WithoutOptions):
    """Every robot gets every n-th task."""

    def allocate(self, problem: AllocationProblem) -> Allocation:
        """See :class:`~mrta_falsify.core.protocols.Allocator`."""
        if not problem.robots:
            return without_fleet(problem)
        if problem.commitment == "keep":
            return with_kept_plans(problem, self.allocate(append_only(problem)))
        routes: list[list[Stop]] = [[] for _ in problem.robots]
        carrier = {k: r for r, plan in enumerate(problem.robots) for k in plan.onboard}
        for task in sorted(
            problem.tasks, key=lambda task: (task.number not in carrier, task.number)
        ):
            if task.number in carrier:
                routes[carrier[task.number]].append(dropoff_of(task))
            else:
                routes[_turn_of(task, problem)] += [pickup_of(task), dropoff_of(task)]
        return timed_allocation(problem, routes)


def _turn_of(task: OpenTask, problem: AllocationProblem) -> int:
    """Position of the robot whose turn it is; a task that names its robot goes to that one."""
    numbers = [plan.robot for plan in problem.robots]
    return task.number % len(numbers) if task.robot < 0 else numbers.index(task.robot)
