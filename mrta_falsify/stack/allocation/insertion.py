"""Regret insertion: a task that would suffer most from waiting is placed first.

Greedy construction of the dynamic pickup-and-delivery problem after Potvin & Rousseau, "A
parallel route building algorithm for the vehicle routing and scheduling problem with time
windows", EJOR 1993; the objective is the sum of completion times plus weighted lateness.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mrta_falsify.core.allocation import (
    Action,
    Allocation,
    AllocationProblem,
    OpenTask,
    RobotPlan,
    Stop,
)
from mrta_falsify.core.codec import quantity


@dataclass(frozen=True, slots=True)
class _Visit:
    """A stop without its time."""

    task: OpenTask
    is_pickup: bool


@dataclass(frozen=True, slots=True)
class _Placement:
    """The cheapest way to add a task to one robot's route."""

    increase: float
    robot: int
    route: tuple[_Visit, ...]


class Insertion:
    """Greedy regret insertion; keeps what earlier calls promised and adds the new tasks."""

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Options:
        """What the objective weighs."""

        lateness_weight: float = quantity(low=0.0, default=20.0)  #: per second of lateness

    def __init__(self, options: Options) -> None:
        self._options = options

    def allocate(self, problem: AllocationProblem) -> Allocation:
        """See :class:`~mrta_falsify.core.protocols.Allocator`."""
        tasks = {task.number: task for task in problem.tasks}
        routes = [self._kept_route(problem, plan, tasks) for plan in problem.robots]
        taken = {visit.task.number for route in routes for visit in route}
        pending = [task for task in problem.tasks if task.number not in taken]
        while pending and problem.robots:
            choices = [self._choices(problem, routes, task) for task in pending]
            regrets = [_regret(choice) for choice in choices]
            worst = max(range(len(pending)), key=lambda i: (regrets[i], -pending[i].number))
            best = choices[worst][0]
            routes[best.robot] = list(best.route)
            del pending[worst]
        itineraries = tuple(
            _timed(problem, plan, route) for plan, route in zip(problem.robots, routes, strict=True)
        )
        late = tuple(
            sorted(
                stop.task
                for itinerary in itineraries
                for stop in itinerary
                if stop.action == "dropoff" and stop.time > tasks[stop.task].deadline
            )
        )
        unserved = tuple(sorted(task.number for task in pending))
        return Allocation(
            itineraries=itineraries, late=late, unserved=unserved, reason=_reason(late, unserved)
        )

    def _kept_route(
        self, problem: AllocationProblem, plan: RobotPlan, tasks: dict[int, OpenTask]
    ) -> list[_Visit]:
        """The earlier plan, and drop-offs for whatever is on board without one."""
        route = [
            _Visit(tasks[stop.task], stop.action == "pickup")
            for stop in plan.planned
            if stop.task in tasks
        ]
        planned = {visit.task.number for visit in route}
        for number in plan.onboard:
            if number in tasks and number not in planned:
                drop = _Visit(tasks[number], False)
                options = [[*route[:i], drop, *route[i:]] for i in range(len(route) + 1)]
                route = min(options, key=lambda option: self._cost(problem, plan, option))
        return route

    def _choices(
        self, problem: AllocationProblem, routes: Sequence[Sequence[_Visit]], task: OpenTask
    ) -> list[_Placement]:
        placements = [
            self._cheapest(problem, robot, plan, routes[robot], task)
            for robot, plan in enumerate(problem.robots)
        ]
        return sorted(placements, key=lambda placement: (placement.increase, placement.robot))

    def _cheapest(
        self,
        problem: AllocationProblem,
        robot: int,
        plan: RobotPlan,
        route: Sequence[_Visit],
        task: OpenTask,
    ) -> _Placement:
        before = self._cost(problem, plan, route)
        pick, drop = _Visit(task, True), _Visit(task, False)
        best = _Placement(np.inf, robot, (*route, pick, drop))
        for i in range(len(route) + 1):
            for j in range(i, len(route) + 1):
                candidate = (*route[:i], pick, *route[i:j], drop, *route[j:])
                increase = self._cost(problem, plan, candidate) - before
                if increase < best.increase:
                    best = _Placement(increase, robot, candidate)
        return best

    def _cost(self, problem: AllocationProblem, plan: RobotPlan, route: Sequence[_Visit]) -> float:
        """Sum of completion times [s] plus weighted lateness; inf if the load is too much."""
        time, room, load = max(plan.free_at, problem.now), plan.room, len(plan.onboard)
        cost = 0.0
        for visit in route:
            task = visit.task
            place = task.start if visit.is_pickup else task.end
            time += problem.travel_times[room, place]
            room = place
            if visit.is_pickup:
                time = max(time, task.arrival) + task.pickup_time
                load += 1
                if load > plan.capacity:
                    return np.inf
            else:
                time += task.dropoff_time
                load -= 1
                cost += time + self._options.lateness_weight * max(0.0, time - task.deadline)
        return cost


def _regret(choices: Sequence[_Placement]) -> float:
    return choices[1].increase - choices[0].increase if len(choices) > 1 else 0.0


def _timed(
    problem: AllocationProblem, plan: RobotPlan, route: Sequence[_Visit]
) -> tuple[Stop, ...]:
    time, room = max(plan.free_at, problem.now), plan.room
    stops = []
    for visit in route:
        task = visit.task
        place = task.start if visit.is_pickup else task.end
        time += float(problem.travel_times[room, place])
        room = place
        if visit.is_pickup:
            time = max(time, task.arrival) + task.pickup_time
        else:
            time += task.dropoff_time
        action: Action = "pickup" if visit.is_pickup else "dropoff"
        stops.append(Stop(task=task.number, action=action, room=place, time=time))
    return tuple(stops)


def _reason(late: Sequence[int], unserved: Sequence[int]) -> str:
    parts = []
    if late:
        names = ", ".join(map(str, late))
        parts.append(f"tasks {names} miss their deadlines in the cheapest plan found")
    if unserved:
        names = ", ".join(map(str, unserved))
        parts.append(f"tasks {names} wait because no robot can be reached")
    return "; ".join(parts)
