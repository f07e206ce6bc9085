"""What allocators minimise, among plans that lose no more deadlines than they must."""

from __future__ import annotations

import math
from typing import Literal

from mrta_falsify.core.allocation_problem import Allocation, AllocationProblem
from mrta_falsify.stack.allocation.route_kernels import Weights

Objective = Literal["completion", "makespan", "travel", "lateness"]
TIE = 1e-3  # completion times decide between plans of equal makespan or travel

_WEIGHTS: dict[str, Weights] = {
    "completion": Weights(completion=1.0, travel=0.0, makespan=0.0, own=0.0),
    "makespan": Weights(completion=TIE, travel=0.0, makespan=1.0, own=0.0),
    "travel": Weights(completion=TIE, travel=1.0, makespan=0.0, own=0.0),
    "lateness": Weights(completion=1.0, travel=0.0, makespan=0.0, own=0.0),
}
LATE_OWN = 20.0  # a second of a late task counts as much as these of the others


def weights_of(objective: Objective) -> Weights:
    """Weights of the insertion kernels."""
    return _WEIGHTS[objective]


def late_weights_of(objective: Objective) -> Weights:
    """Weights for tasks whose deadline is lost: they are to be served soon all the same."""
    return _WEIGHTS[objective]._replace(completion=1.0, own=LATE_OWN)


def objective_value(problem: AllocationProblem, answer: Allocation, objective: Objective) -> float:
    """Value of the objective [s]; smaller is better.

    Sum of completion times, last completion, sum over robots of the time on the way, or sum
    of delays beyond deadlines.
    """
    deadline = {task.number: task.deadline for task in problem.tasks}
    drops = [s for stops in answer.itineraries for s in stops if s.action == "dropoff"]
    if objective == "completion":
        return math.fsum(stop.time for stop in drops)
    if objective == "makespan":
        return max((stop.time for stop in drops), default=problem.now)
    if objective == "lateness":
        return math.fsum(max(0.0, stop.time - deadline[stop.task]) for stop in drops)
    return math.fsum(
        stops[-1].time - max(plan.free_at, problem.now)
        for plan, stops in zip(problem.robots, answer.itineraries, strict=True)
        if stops
    )
