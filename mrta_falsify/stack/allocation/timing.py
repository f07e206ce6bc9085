"""Predicted times of itineraries, and problems whose old plan must be kept."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from mrta_falsify.core.allocation_problem import (
    Allocation,
    AllocationProblem,
    OpenTask,
    RobotPlan,
    Stop,
)
from mrta_falsify.core.arrays import Array

NO_ROBOT = "there is no robot that can be reached"


def closed_travel_times(times: Array) -> Array:
    """Travel times ``(R, R)`` [s] closed under shortest paths (Floyd-Warshall)."""
    closed = np.array(times, dtype=np.float64)
    for k in range(len(closed)):
        closed = np.minimum(closed, closed[:, k : k + 1] + closed[k : k + 1, :])
    return closed


def timed_route(
    problem: AllocationProblem,
    plan: RobotPlan,
    stops: Sequence[Stop],
    tasks: dict[int, OpenTask],
) -> tuple[Stop, ...]:
    """``stops`` in their order, with the times that follow from travel and service.

    Args:
        problem: gives the travel times and the present time.
        plan: the robot.
        stops: of open tasks; their times are ignored.
        tasks: open tasks by number.
    """
    time, room = max(plan.free_at, problem.now), plan.room
    timed = []
    for stop in stops:
        task = tasks[stop.task]
        if stop.action == "pickup":
            time = max(time, task.arrival) + float(problem.travel_times[room, stop.room])
            time += task.pickup_time
        else:
            time += float(problem.travel_times[room, stop.room]) + task.dropoff_time
        room = stop.room
        timed.append(Stop(task=stop.task, action=stop.action, room=room, time=time))
    return tuple(timed)


def timed_allocation(
    problem: AllocationProblem, itineraries: Sequence[Sequence[Stop]], *, reason: str = ""
) -> Allocation:
    """Answer with predicted times, late and unserved tasks worked out from the stops alone.

    Args:
        problem: what was asked.
        itineraries: stops per robot of the problem; their times are ignored.
        reason: why tasks are lost; a plain sentence is added if it is empty and some are.
    """
    tasks = {task.number: task for task in problem.tasks}
    timed = tuple(
        timed_route(problem, plan, stops, tasks)
        for plan, stops in zip(problem.robots, itineraries, strict=True)
    )
    drops = [stop for stops in timed for stop in stops if stop.action == "dropoff"]
    late = tuple(sorted(stop.task for stop in drops if stop.time > tasks[stop.task].deadline))
    unserved = tuple(sorted(tasks.keys() - {stop.task for stop in drops}))
    if (late or unserved) and not reason:
        reason = lost_in_words(late, unserved)
    return Allocation(
        itineraries=timed,
        late=late,
        unserved=unserved,
        reason=reason if late or unserved else "",
    )


def without_fleet(problem: AllocationProblem) -> Allocation:
    """Answer that no task is served, since no robot can be reached."""
    return timed_allocation(problem, [], reason=NO_ROBOT)


def lost_in_words(late: Sequence[int], unserved: Sequence[int]) -> str:
    """Which tasks are late or wait; empty if none."""
    parts = []
    if late:
        parts.append(
            f"{_tasks(late)} {_verb(late, 'misses its', 'miss their')} in the best plan found"
        )
    if unserved:
        parts.append(f"{_tasks(unserved)} {'waits' if len(unserved) == 1 else 'wait'} for a robot")
    return "; ".join(parts)


def _tasks(numbers: Sequence[int]) -> str:
    return f"task{'s' if len(numbers) > 1 else ''} {', '.join(map(str, numbers))}"


def _verb(numbers: Sequence[int], one: str, many: str) -> str:
    return f"{one} deadline" if len(numbers) == 1 else f"{many} deadlines"


def pickup_of(task: OpenTask) -> Stop:
    """Pickup without a time."""
    return Stop(task=task.number, action="pickup", room=task.start, time=0.0)


def dropoff_of(task: OpenTask) -> Stop:
    """Drop-off without a time."""
    return Stop(task=task.number, action="dropoff", room=task.end, time=0.0)


def kept_routes(problem: AllocationProblem) -> list[list[Stop]]:
    """What every robot does if nothing new is given to it: its old plan, and all its drops.

    Stops of tasks that are not open any more, and pickups without their drop, are left out.
    """
    tasks = {task.number: task for task in problem.tasks}
    routes = []
    for plan in problem.robots:
        dropped = {stop.task for stop in plan.planned if stop.action == "dropoff"}
        picked = {stop.task for stop in plan.planned if stop.action == "pickup"} & dropped
        mine = (picked | set(plan.onboard)) & tasks.keys()
        kept = [stop for stop in plan.planned if stop.task in mine]
        first = [dropoff_of(tasks[k]) for k in plan.onboard if k in mine and k not in dropped]
        routes.append(first + kept)
    return routes


def append_only(problem: AllocationProblem) -> AllocationProblem:
    """The free problem that remains when every robot's old plan is kept to its end.

    Robots become free where and when their plans end; tasks in these plans are gone.
    """
    tasks = {task.number: task for task in problem.tasks}
    robots, gone = [], set()
    for plan in problem.robots:
        kept = timed_route(problem, plan, plan.planned, tasks)
        room, free_at = (kept[-1].room, kept[-1].time) if kept else (plan.room, plan.free_at)
        dropped = {stop.task for stop in kept if stop.action == "dropoff"}
        picked = {stop.task for stop in kept if stop.action == "pickup"}
        gone |= dropped
        onboard = tuple(sorted((set(plan.onboard) | picked) - dropped))
        robots.append(
            dataclasses.replace(plan, room=room, free_at=free_at, onboard=onboard, planned=())
        )
    return dataclasses.replace(
        problem,
        robots=tuple(robots),
        tasks=tuple(task for task in problem.tasks if task.number not in gone),
        commitment="free",
    )


def with_kept_plans(problem: AllocationProblem, answer: Allocation) -> Allocation:
    """Answer to a ``keep`` problem from the answer to its :func:`append_only` rest."""
    itineraries = [
        (*plan.planned, *rest)
        for plan, rest in zip(problem.robots, answer.itineraries, strict=True)
    ]
    whole = timed_allocation(problem, itineraries)
    kept_late = tuple(number for number in whole.late if number not in answer.late)
    parts = [answer.reason]
    if kept_late:
        parts.append(f"{_tasks(kept_late)} cannot be moved: the old plan is kept")
    return dataclasses.replace(
        whole,
        reason="; ".join(part for part in parts if part),
        infeasible=answer.infeasible,
        least_lost=answer.least_lost,
    )
