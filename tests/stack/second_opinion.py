"""A second, independent judge of cores: sets by dynamic programming, covering by HiGHS.

Nothing of the allocators is used: what one robot can serve in time is worked out level by
level over (tasks done, tasks on board, room), and HiGHS decides whether the robots' largest
sets cover all tasks.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse
from scipy.optimize import Bounds, LinearConstraint, milp

from mrta_falsify.core.allocation_problem import AllocationProblem, OpenTask, RobotPlan

MAX_STATES = 600_000  # of one robot, kept at once; more: not decided
NODES = 50_000  # of the integer program


class TooLargeError(Exception):
    """More states than this judge looks at."""


def can_be_covered(problem: AllocationProblem) -> bool | None:
    """Whether robots without load can have all tasks in time; None if that was not decided."""
    try:
        sets = [largest_sets(problem, plan) for plan in problem.robots]
    except TooLargeError:
        return None
    return _cover(sets, len(problem.tasks))


def largest_sets(problem: AllocationProblem, plan: RobotPlan) -> list[int]:
    """Largest sets of tasks, as bits, that a robot can pick up and drop in time."""
    tasks, travel = problem.tasks, problem.travel_times.tolist()
    begin = max(plan.free_at, problem.now)
    level: dict[tuple[int, int, int], float] = {(0, 0, plan.room): begin}
    served = {0}
    while level:
        following: dict[tuple[int, int, int], float] = {}
        for (done, aboard, room), time in level.items():
            for k, task in enumerate(tasks):
                bit = 1 << k
                if done & bit:
                    continue
                if aboard & bit:
                    ready = time + travel[room][task.end] + task.dropoff_time
                    if ready > task.deadline:
                        continue
                    state = (done | bit, aboard ^ bit, task.end)
                elif aboard.bit_count() < plan.capacity:
                    ready = max(time, task.arrival) + travel[room][task.start] + task.pickup_time
                    if not _can_be_dropped(tasks, travel, aboard | bit, task.start, ready):
                        continue
                    state = (done, aboard | bit, task.start)
                else:
                    continue
                if ready < following.get(state, float("inf")):
                    following[state] = ready
        if len(following) > MAX_STATES:
            raise TooLargeError
        level = following
        served.update(done for done, aboard, _ in level if not aboard)
    return [s for s in served if not any(s != t and s & t == s for t in _above(served, s))]


def _above(served: set[int], tasks: int) -> list[int]:
    """Sets with one task more: leaving a task out of a set never makes it impossible."""
    most = max(served).bit_length()
    return [tasks | 1 << k for k in range(most) if not tasks >> k & 1 and tasks | 1 << k in served]


def _can_be_dropped(
    tasks: tuple[OpenTask, ...], travel: list[list[float]], aboard: int, room: int, time: float
) -> bool:
    return all(
        time + travel[room][task.end] + task.dropoff_time <= task.deadline
        for k, task in enumerate(tasks)
        if aboard >> k & 1
    )


def _cover(sets: list[list[int]], m: int) -> bool | None:
    columns = [(r, tasks) for r, group in enumerate(sets) for tasks in group]
    bits = np.array([tasks for _, tasks in columns], np.int64)
    covers = scipy.sparse.csr_matrix((bits >> np.arange(m)[:, None]) & 1)
    robot = np.array([r for r, _ in columns])
    uses = scipy.sparse.csr_matrix(np.arange(len(sets))[:, None] == robot)
    answer = milp(
        np.zeros(len(columns)),
        constraints=[
            LinearConstraint(covers, lb=np.ones(m)),
            LinearConstraint(uses.astype(np.float64), ub=np.ones(len(sets))),
        ],
        integrality=np.ones(len(columns)),
        bounds=Bounds(0.0, 1.0),
        options={"node_limit": NODES},
    )
    return {0: True, 2: False}.get(answer.status)
