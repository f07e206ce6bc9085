"""The dispatcher: tasks in, itineraries out, arrival times back.

It calls the allocator in three cases:

- Tasks arrive.
- Tasks wait and a robot can be reached.
- A robot runs late, and moving its later stops may help.

Its memory holds open tasks only, so a long shift costs no more than a short one.
"""

from __future__ import annotations

import bisect
import dataclasses
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from mrta_falsify.core.allocation_problem import (
    Allocation,
    AllocationProblem,
    OpenTask,
    RobotPlan,
    Stop,
)
from mrta_falsify.core.arrays import frozen_array
from mrta_falsify.core.fleet import StackEvent
from mrta_falsify.core.protocols import Allocator
from mrta_falsify.core.words import number_text
from mrta_falsify.core.world import World
from mrta_falsify.stack.allocation.timing import closed_travel_times, timed_allocation
from mrta_falsify.stack.allocation.verification import verify

LATE_FEEDBACK = 15.0  # s behind its predicted time: the free part may be planned again
REPLAN_PERIOD = 10.0  # s, at most one such re-plan per period
LOOK_PERIOD = 0.5  # s between looks at waiting tasks and late robots, 2 Hz as MRTA-Sim's queues
GAIN = 5.0  # s, a re-plan must save this much, so that plans do not flutter
ROUNDING = 1e-6  # s, what float arithmetic may add to a whole number of seconds
LATENESS_WEIGHT = 20.0  # one second too late weighs as much as this many seconds of work


@dataclass(slots=True)
class DispatcherState:
    """What the dispatcher remembers."""

    known: int = 0  #: tasks of the arrival order that have arrived
    delivered: int = 0  #: how many
    open: list[int] = field(default_factory=list)  #: arrived, not delivered; task numbers, sorted
    waiting: list[int] = field(default_factory=list)  #: open tasks that no robot has, sorted
    due: list[tuple[float, int]] = field(default_factory=list)  #: deadlines to watch, sorted
    look_at: float = 0.0  #: next look at waiting tasks and late robots [s]
    replan_at: float = 0.0  #: no re-plan for late robots before this [s]
    gave_up: str = ""  #: why nothing is allocated until the next task arrives

    def deliver(self, task: int) -> None:
        """Take in that ``task`` has been dropped off."""
        self.open.remove(task)
        self.delivered += 1


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RobotReport:
    """What the dispatcher knows of one robot."""

    itinerary: tuple[Stop, ...]
    onboard: tuple[int, ...]
    room: int  #: room it was in last
    first_ends: float  #: when its first stop will be done, from where it is now [s]
    reachable: bool  #: joined, and the dispatcher link is up


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Orders:
    """New itineraries by robot number (nothing if nothing changed), and what happened."""

    itineraries: dict[int, tuple[Stop, ...]]
    events: Sequence[StackEvent]


NO_ORDERS = Orders(itineraries={}, events=())  #: nothing changed, and nothing happened


class Dispatcher:
    """Calls the allocator when tasks arrive or robots run late."""

    def __init__(self, world: World, allocator: Allocator) -> None:
        """Serve a world.

        Args:
            world: tasks, robots, rooms and travel times.
            allocator: asked for itineraries.
        """
        self._tasks = world.tasks
        self._order = sorted(range(len(world.tasks)), key=lambda i: (world.tasks[i].arrival, i))
        self._allocator = allocator
        self._capacity = [robot.capacity for robot in world.robots]
        numbers = {robot.name: number for number, robot in enumerate(world.robots)}
        self._named = [numbers.get(task.robot, -1) for task in world.tasks]
        # The border of the allocators: whole seconds, rounded so that no promise is too early.
        self._times = np.ceil(closed_travel_times(world.travel_times) - ROUNDING)
        self._points = frozen_array([room.point for room in world.rooms]) if world.rooms else None

    def take_no_more(self, state: DispatcherState) -> None:
        """Let no further task arrive."""
        self._order = self._order[: state.known]

    def travel_time(self, start: int, end: int) -> float:
        """Time [s] from room to room."""
        return float(self._times[start, end])

    def dispatch(
        self, state: DispatcherState, time: float, reports: Callable[[], Sequence[RobotReport]]
    ) -> Orders:
        """Look for reasons to call the allocator, and do so.

        Args:
            state: memory, changed in place.
            time: [s].
            reports: gives a report of every robot; asked only when there is a reason.
        """
        arrived = self._take_arrivals(state, time)
        events = self._missed_deadlines(state, time)
        if not arrived and (time < state.look_at or not state.open):
            return Orders(itineraries={}, events=events) if events else NO_ORDERS
        state.look_at = time + LOOK_PERIOD
        if state.gave_up and not arrived:
            return Orders(itineraries={}, events=events)
        fleet = reports()
        robots = [i for i, report in enumerate(fleet) if report.reachable]
        if arrived or (state.waiting and robots):
            orders = self._allocate(state, time, fleet, robots, arrived=arrived)
        elif any(self._loses_a_deadline(time, fleet[i]) for i in robots) or (
            time >= state.replan_at and any(_runs_late(time, fleet[i]) for i in robots)
        ):
            state.replan_at = time + REPLAN_PERIOD
            orders = self._replan(state, time, fleet, robots)
        else:
            return Orders(itineraries={}, events=events)
        return Orders(itineraries=orders.itineraries, events=[*events, *orders.events])

    def _loses_a_deadline(self, time: float, report: RobotReport) -> bool:
        """Whether a later drop was to be in time and will not be, as far behind as the robot is."""
        if not report.itinerary:
            return False
        delay = max(time, report.first_ends) - report.itinerary[0].time
        if delay <= 0.0:
            return False
        for stop in report.itinerary[1:]:
            deadline = self._tasks[stop.task].deadline
            if stop.action == "dropoff" and stop.time <= deadline < stop.time + delay:
                return True
        return False

    # --- what is due ----------------------------------------------------------------------

    def _take_arrivals(self, state: DispatcherState, time: float) -> bool:
        before = state.known
        while (
            state.known < len(self._order) and self._tasks[self._order[state.known]].arrival <= time
        ):
            number = self._order[state.known]
            bisect.insort(state.open, number)
            bisect.insort(state.waiting, number)
            bisect.insort(state.due, (self._tasks[number].deadline, number))
            state.known += 1
        return state.known > before

    @staticmethod
    def _missed_deadlines(state: DispatcherState, time: float) -> list[StackEvent]:
        events = []
        while state.due and state.due[0][0] < time:
            _, number = state.due.pop(0)
            if number in state.open:
                events.append(StackEvent(time=time, kind="deadline-missed", task=number))
        return events

    # --- calls of the allocator -------------------------------------------------------------

    def _allocate(
        self,
        state: DispatcherState,
        time: float,
        fleet: Sequence[RobotReport],
        robots: Sequence[int],
        *,
        arrived: bool,
    ) -> Orders:
        problem = self._problem(state, time, fleet, robots, keep_plans=True)
        answer = self._ask(problem)
        fault = self._fault_of(state, time, fleet, problem, answer)
        if fault:
            # Nothing is lost: the robots keep what they have, the new tasks wait.
            state.look_at = time + REPLAN_PERIOD
            event = StackEvent(time=time, kind="allocation-refused", detail=fault)
            return Orders(itineraries={}, events=[event])
        before = tuple(state.waiting)
        itineraries = self._itineraries(problem, answer, fleet)
        state.waiting = sorted(set(state.open) - _taken(itineraries, fleet))
        if not arrived and tuple(state.waiting) == before:
            state.look_at = time + REPLAN_PERIOD  # the allocator does not want them yet
            return Orders(itineraries=itineraries, events=[])
        why = "tasks arrived" if arrived else "tasks waited"
        return Orders(
            itineraries=itineraries, events=_notes(time, why, answer.reason, itineraries, fleet)
        )

    def _replan(
        self,
        state: DispatcherState,
        time: float,
        fleet: Sequence[RobotReport],
        robots: Sequence[int],
    ) -> Orders:
        """Plan the stops that are not committed anew, and take the new plan if it is better."""
        kept = self._problem(state, time, fleet, robots, keep_plans=True)
        freed = self._problem(state, time, fleet, robots, keep_plans=False)
        old, new = self._ask(kept), self._ask(freed)
        if fault_of(kept, old):
            return Orders(itineraries={}, events=[])
        better = (
            not fault_of(freed, new)
            and len(new.unserved) <= len(old.unserved)
            and self._cost(new) < self._cost(old) - GAIN
        )
        problem, answer = (freed, new) if better else (kept, old)
        itineraries = self._itineraries(problem, answer, fleet)
        state.waiting = sorted(set(state.open) - _taken(itineraries, fleet))
        notes = _notes(time, "robots late", answer.reason, itineraries, fleet)
        # New times alone are not worth an event.
        return Orders(itineraries=itineraries, events=notes if better or len(notes) > 1 else [])

    def _ask(self, problem: AllocationProblem) -> Allocation:
        """Ask the allocator; work out times and lists anew where they are wrong."""
        answer = self._allocator.allocate(problem)
        if fault_of(problem, answer) or not verify(answer, problem):
            return answer
        right = timed_allocation(problem, answer.itineraries, reason=answer.reason)
        return dataclasses.replace(right, infeasible=answer.infeasible)

    def _fault_of(
        self,
        state: DispatcherState,
        time: float,
        fleet: Sequence[RobotReport],
        problem: AllocationProblem,
        answer: Allocation,
    ) -> str:
        """Say why an answer cannot be carried out; empty if it can."""
        del state, time, fleet
        return fault_of(problem, answer)

    def _cost(self, answer: Allocation) -> float:
        drops = [s for plan in answer.itineraries for s in plan if s.action == "dropoff"]
        late = math.fsum(max(0.0, s.time - self._tasks[s.task].deadline) for s in drops)
        return math.fsum(s.time for s in drops) + LATENESS_WEIGHT * late

    # --- the allocator's view ---------------------------------------------------------------

    def _problem(
        self,
        state: DispatcherState,
        time: float,
        fleet: Sequence[RobotReport],
        robots: Sequence[int],
        *,
        keep_plans: bool,
    ) -> AllocationProblem:
        gone: set[int] = set()
        for report in fleet:
            if not report.reachable:
                gone |= {stop.task for stop in report.itinerary}
            elif report.itinerary and report.itinerary[0].action == "dropoff":
                gone.add(report.itinerary[0].task)
        # A task whose robot cannot be reached waits for it.
        gone |= {k for k in state.open if self._named[k] not in (-1, *robots)}
        return AllocationProblem(
            now=_up(time),
            robots=tuple(self._plan(i, time, fleet[i], keep_plans) for i in robots),
            tasks=tuple(self._open_task(number) for number in state.open if number not in gone),
            travel_times=self._times,
            points=self._points,
        )

    def _plan(self, robot: int, time: float, report: RobotReport, keep_plans: bool) -> RobotPlan:
        onboard = list(report.onboard)
        room, free_at, rest = report.room, time, report.itinerary
        if report.itinerary:
            first, rest = report.itinerary[0], report.itinerary[1:]
            room, free_at = first.room, max(time, report.first_ends)
            if first.action == "pickup":
                onboard.append(first.task)
            else:
                onboard.remove(first.task)
        planned = rest if keep_plans else tuple(stop for stop in rest if stop.task in onboard)
        return RobotPlan(
            robot=robot,
            room=room,
            free_at=_up(free_at),
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
            arrival=_up(task.arrival),
            deadline=math.floor(task.deadline + ROUNDING),
            pickup_time=_up(task.pickup_time),
            dropoff_time=_up(task.dropoff_time),
            robot=self._named[number],
        )

    @staticmethod
    def _itineraries(
        problem: AllocationProblem, answer: Allocation, fleet: Sequence[RobotReport]
    ) -> dict[int, tuple[Stop, ...]]:
        """The committed first stop, with its expected time, and the allocator's rest."""
        new = {}
        for plan, rest in zip(problem.robots, answer.itineraries, strict=True):
            first = fleet[plan.robot].itinerary[:1]
            timed = tuple(dataclasses.replace(stop, time=plan.free_at) for stop in first)
            new[plan.robot] = (*timed, *rest)
        return new


def _up(seconds: float) -> float:
    """The next whole second."""
    return float(math.ceil(seconds - ROUNDING))


def _runs_late(time: float, report: RobotReport) -> bool:
    """Whether the robot is behind its plan and has stops that could be served otherwise."""
    rest = report.itinerary[1:]
    movable = any(stop.action == "pickup" for stop in rest) or len(rest) > 1
    return movable and max(time, report.first_ends) - report.itinerary[0].time > LATE_FEEDBACK


def _taken(itineraries: dict[int, tuple[Stop, ...]], fleet: Sequence[RobotReport]) -> set[int]:
    """Tasks that a robot has under new ``itineraries``."""
    plans = [itineraries.get(i, report.itinerary) for i, report in enumerate(fleet)]
    return {stop.task for plan in plans for stop in plan}


def _notes(
    time: float,
    why: str,
    reason: str,
    itineraries: dict[int, tuple[Stop, ...]],
    fleet: Sequence[RobotReport],
) -> list[StackEvent]:
    events = []
    for robot, itinerary in itineraries.items():
        before = {stop.task for stop in fleet[robot].itinerary}
        for task in dict.fromkeys(stop.task for stop in itinerary):
            if task not in before:
                ends = [s.time for s in itinerary if s.task == task and s.action == "dropoff"]
                expected = f"expected at {number_text(ends[0])} s" if ends else ""
                events.append(
                    StackEvent(time=time, kind="assigned", robot=robot, task=task, detail=expected)
                )
    detail = "; ".join(part for part in (why, reason) if part)
    events.append(StackEvent(time=time, kind="allocated", detail=detail))
    return events


def fault_of(problem: AllocationProblem, answer: Allocation) -> str:
    """What is wrong with an allocator's answer, in words; empty if it can be carried out.

    Late or unserved tasks are no fault, and predicted times are not judged: the dispatcher
    works them out itself. A fault is what would lose a task or ask for the impossible.
    """
    if not isinstance(answer, Allocation):  # a user's allocator may say nothing
        return f"the allocator gave {type(answer).__name__}, no plan"
    return "; ".join(str(fault) for fault in verify(answer, problem) if not fault.promise)
