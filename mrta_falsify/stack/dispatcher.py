"""The dispatcher: tasks in, itineraries out, arrival times back."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from mrta_falsify.core.allocation import (
    Allocation,
    AllocationProblem,
    OpenTask,
    RobotPlan,
    Stop,
)
from mrta_falsify.core.arrays import Array
from mrta_falsify.core.fleet import StackEvent
from mrta_falsify.core.protocols import Allocator
from mrta_falsify.core.world import World

LATE_FEEDBACK = 15.0  # s behind its predicted time: the free part is planned again
MEAN_SPEED = 0.69  # m/s, loaded travel times of MRTA-Sim over its road lengths
REPLAN_PERIOD = 10.0  # s, at most one such re-plan per period


@dataclass(slots=True)
class DispatcherState:
    """What the dispatcher remembers."""

    known: int = 0  #: tasks of the arrival order that have arrived
    delivered: set[int] = field(default_factory=set)
    picked_up: set[int] = field(default_factory=set)
    waiting: set[int] = field(default_factory=set)  #: tasks that no robot has yet
    missed: set[int] = field(default_factory=set)  #: deadlines reported as missed
    last_call: float = -np.inf  #: [s]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Report:
    """What the dispatcher knows of one robot."""

    itinerary: tuple[Stop, ...]
    onboard: tuple[int, ...]
    room: int  #: room it was in last
    distance: float  #: way left to its next stop [m]
    reachable: bool  #: joined, and the dispatcher link is up


class Dispatcher:
    """Calls the allocator when tasks arrive or robots run late."""

    def __init__(self, world: World, allocator: Allocator) -> None:
        self._tasks = world.tasks
        self._order = sorted(range(len(world.tasks)), key=lambda i: (world.tasks[i].arrival, i))
        self._allocator = allocator
        self._capacity = [robot.capacity for robot in world.robots]
        self._times = closed_travel_times(world.travel_times)

    def all_arrived(self, state: DispatcherState) -> bool:
        """Whether no task is still to come."""
        return state.known == len(self._order)

    def all_done(self, state: DispatcherState) -> bool:
        """Whether every task is delivered."""
        return len(state.delivered) == len(self._tasks)

    def dispatch(
        self, state: DispatcherState, time: float, reports: Sequence[Report]
    ) -> tuple[dict[int, tuple[Stop, ...]], list[StackEvent]]:
        """New itineraries by robot number (empty if nothing changed), and what happened."""
        arrived = self._take_arrivals(state, time)
        events = self._missed_deadlines(state, time)
        free = [r.reachable and not r.itinerary for r in reports]
        late = time - state.last_call >= REPLAN_PERIOD and self._runs_late(time, reports)
        retry = bool(state.waiting) and any(free)
        if not (arrived or late or retry):
            return {}, events
        state.last_call = time
        robots = [i for i, report in enumerate(reports) if report.reachable]
        problem = self._problem(state, time, reports, robots, keep_plans=not late)
        answer = self._allocator.allocate(problem)
        state.waiting = set(answer.unserved)
        new = self._accepted(answer, reports, robots)
        for robot, itinerary in new.items():
            before = {stop.task for stop in reports[robot].itinerary}
            for task in dict.fromkeys(stop.task for stop in itinerary):
                if task not in before and task not in reports[robot].onboard:
                    events.append(StackEvent(time=time, kind="assigned", robot=robot, task=task))
        why = "tasks arrived" if arrived else "robots late" if late else "tasks waiting"
        detail = "; ".join(part for part in (why, answer.reason) if part)
        events.append(StackEvent(time=time, kind="allocated", detail=detail))
        return new, events

    def _take_arrivals(self, state: DispatcherState, time: float) -> bool:
        before = state.known
        while (
            state.known < len(self._order) and self._tasks[self._order[state.known]].arrival <= time
        ):
            state.waiting.add(self._order[state.known])
            state.known += 1
        return state.known > before

    def _missed_deadlines(self, state: DispatcherState, time: float) -> list[StackEvent]:
        events = []
        for number in self._order[: state.known]:
            done = number in state.delivered or number in state.missed
            if not done and self._tasks[number].deadline < time:
                state.missed.add(number)
                events.append(StackEvent(time=time, kind="deadline-missed", task=number))
        return events

    @staticmethod
    def _runs_late(time: float, reports: Sequence[Report]) -> bool:
        return any(
            report.reachable
            and len(report.itinerary) > 1
            and time - report.itinerary[0].time > LATE_FEEDBACK
            for report in reports
        )

    def _problem(
        self,
        state: DispatcherState,
        time: float,
        reports: Sequence[Report],
        robots: Sequence[int],
        *,
        keep_plans: bool,
    ) -> AllocationProblem:
        elsewhere = {
            stop.task
            for i, report in enumerate(reports)
            if i not in robots
            for stop in report.itinerary
        }
        plans = [self._plan(i, time, reports[i], keep_plans) for i in robots]
        gone = state.delivered | elsewhere
        for i in robots:
            first = reports[i].itinerary[:1]
            gone |= {stop.task for stop in first if stop.action == "dropoff"}
        tasks = tuple(
            self._open_task(number)
            for number in sorted(self._order[: state.known])
            if number not in gone
        )
        return AllocationProblem(
            now=time, robots=tuple(plans), tasks=tasks, travel_times=self._times
        )

    def _plan(self, robot: int, time: float, report: Report, keep_plans: bool) -> RobotPlan:
        onboard = list(report.onboard)
        room, free_at, rest = report.room, time, report.itinerary
        if report.itinerary:
            first, rest = report.itinerary[0], report.itinerary[1:]
            room, free_at = first.room, time + report.distance / MEAN_SPEED
            if first.action == "pickup":
                onboard.append(first.task)
            else:
                onboard.remove(first.task)
        planned = rest if keep_plans else tuple(stop for stop in rest if stop.task in onboard)
        return RobotPlan(
            robot=robot,
            room=room,
            free_at=free_at,
            onboard=tuple(onboard),
            capacity=self._capacity[robot],
            planned=planned,
        )

    def _open_task(self, number: int) -> OpenTask:
        task = self._tasks[number]
        return OpenTask(
            number=number,
            start=task.start,
            end=task.end,
            arrival=task.arrival,
            deadline=task.deadline,
            pickup_time=task.pickup_time,
            dropoff_time=task.dropoff_time,
        )

    @staticmethod
    def _accepted(
        answer: Allocation, reports: Sequence[Report], robots: Sequence[int]
    ) -> dict[int, tuple[Stop, ...]]:
        """Committed first stop and the allocator's rest, for robots whose plan changed."""
        new = {}
        for place, robot in enumerate(robots):
            itinerary = (*reports[robot].itinerary[:1], *answer.itineraries[place])
            new[robot] = itinerary
        return new


def closed_travel_times(times: Array) -> Array:
    """Travel times ``(R, R)`` [s] closed under shortest paths (Floyd-Warshall)."""
    closed = np.array(times, dtype=np.float64)
    for k in range(len(closed)):
        closed = np.minimum(closed, closed[:, k : k + 1] + closed[k : k + 1, :])
    return closed
