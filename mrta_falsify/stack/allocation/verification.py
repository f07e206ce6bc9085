"""The strict checker: judges an answer from the problem alone, by no code of an allocator."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from mrta_falsify.core.allocation_problem import (
    Allocation,
    AllocationProblem,
    OpenTask,
    RobotPlan,
    Stop,
)
from mrta_falsify.core.words import number_text

TOLERANCE = 1e-6  # s, sums of floats in another order


@dataclass(frozen=True, slots=True, kw_only=True)
class Fault:
    """One violated condition."""

    what: str  #: in words
    robot: int = -1  #: robot number, -1: none
    task: int = -1  #: task number, -1: none
    promise: bool = False  #: only a predicted time or a list is wrong: can be carried out

    def __str__(self) -> str:
        return f"robot {self.robot}: {self.what}" if self.robot >= 0 else self.what


def verify(answer: Allocation, problem: AllocationProblem) -> tuple[Fault, ...]:
    """List the conditions of the problem that the answer violates; empty for a valid answer.

    A valid answer keeps these conditions:

    - There is one itinerary per robot, with stops of open tasks in the right rooms.
    - Each task is served by one robot, picked up once before it is dropped once.
    - A task that names its robot is served by that one.
    - Loads on board are dropped by their robot, and no robot carries more than its capacity.
    - No time is earlier than travel, service and arrival allow.
    - The kept plan of a ``keep`` problem is part of the answer.
    - Late and unserved tasks are exactly the ones listed, with a reason.
    - A proved core is made of tasks and agrees with what is lost.
    """
    if len(answer.itineraries) != len(problem.robots):
        what = f"{len(answer.itineraries)} itineraries for {len(problem.robots)} robots"
        return (Fault(what=what),)
    tasks = {task.number: task for task in problem.tasks}
    faults: list[Fault] = []
    owner: dict[int, int] = {}
    late: set[int] = set()
    for plan, itinerary in zip(problem.robots, answer.itineraries, strict=True):
        faults += _order_faults(plan, itinerary, tasks)
        faults += _time_faults(problem, plan, itinerary, tasks)
        if problem.commitment == "keep":
            faults += _kept_faults(plan, itinerary)
        for stop in itinerary:
            is_new = stop.task not in owner
            first = owner.setdefault(stop.task, plan.robot)
            if first != plan.robot:
                what = f"task {stop.task} is given to robots {first} and {plan.robot}"
                faults.append(Fault(what=what, task=stop.task))
            if is_new and stop.task in tasks and not tasks[stop.task].allows(plan.robot):
                named = tasks[stop.task].robot
                what = f"task {stop.task} is given to robot {plan.robot}; it names robot {named}"
                faults.append(Fault(what=what, task=stop.task))
            is_drop = stop.action == "dropoff" and stop.task in tasks
            if is_drop and stop.time > tasks[stop.task].deadline:
                late.add(stop.task)
    return (*faults, *_list_faults(answer, tasks, set(owner), late))


def _order_faults(
    plan: RobotPlan, itinerary: Sequence[Stop], tasks: dict[int, OpenTask]
) -> list[Fault]:
    """Faults of the sequence of stops, times apart."""
    faults: list[Fault] = []

    def note(task: int, what: str) -> None:
        faults.append(Fault(what=what, robot=plan.robot, task=task))

    load, done = set(plan.onboard), set[int]()
    for stop in itinerary:
        number = stop.task
        if number not in tasks:
            note(number, f"task {number} is not open")
            continue
        place = tasks[number].start if stop.action == "pickup" else tasks[number].end
        if stop.room != place:
            note(
                number, f"{stop.action} of task {number} in room {stop.room}; it is in room {place}"
            )
        misplaced = _misplaced(stop, load, done)
        if misplaced:
            note(number, f"task {number} {misplaced}")
        if stop.action == "pickup":
            load.add(number)
            if len(load) > plan.capacity:
                note(number, f"carries {len(load)} at task {number}; at most {plan.capacity}")
        elif not misplaced:
            load.remove(number)
            done.add(number)
    for number in sorted(load & tasks.keys()):
        note(number, f"never drops task {number}")
    return faults


def _misplaced(stop: Stop, load: set[int], done: set[int]) -> str:
    """What is wrong with a stop after the stops before it, in words; empty if nothing is."""
    if stop.action == "pickup":
        return "is picked up twice" if stop.task in load or stop.task in done else ""
    if stop.task in done:
        return "is dropped twice"
    return "" if stop.task in load else "is dropped without having been picked up"


def _time_faults(
    problem: AllocationProblem,
    plan: RobotPlan,
    itinerary: Sequence[Stop],
    tasks: dict[int, OpenTask],
) -> list[Fault]:
    """Stops that are promised earlier than they can be done after the stop before."""
    faults = []
    room, ready = plan.room, max(plan.free_at, problem.now)
    for stop in itinerary:
        task = tasks.get(stop.task)
        if task is None or not 0 <= stop.room < len(problem.travel_times):
            continue
        if stop.action == "pickup":
            leaves, service = max(ready, task.arrival), task.pickup_time
        else:
            leaves, service = ready, task.dropoff_time
        earliest = leaves + float(problem.travel_times[room, stop.room]) + service
        if not stop.time >= earliest - TOLERANCE:  # also catches nan
            what = (
                f"{stop.action} of task {stop.task} at {number_text(stop.time)} s; not before "
                f"{number_text(earliest)} s"
            )
            faults.append(Fault(what=what, robot=plan.robot, task=stop.task, promise=True))
        room, ready = stop.room, max(stop.time, earliest)
    return faults


def _kept_faults(plan: RobotPlan, itinerary: Sequence[Stop]) -> list[Fault]:
    wanted = [(stop.task, stop.action) for stop in plan.planned]
    given = [(stop.task, stop.action) for stop in itinerary[: len(wanted)]]
    if wanted == given:
        return []
    return [Fault(what="its old plan is not kept", robot=plan.robot)]


def _list_faults(
    answer: Allocation, tasks: dict[int, OpenTask], planned: set[int], late: set[int]
) -> list[Fault]:
    """Check that late and unserved tasks are named, and nothing else."""
    faults = []
    for what, given, found in (
        ("late", set(answer.late), late),
        ("unserved", set(answer.unserved), tasks.keys() - planned),
    ):
        for number in sorted(found - given):
            text = f"task {number} is {what} and not named so"
            faults.append(Fault(what=text, task=number, promise=True))
        for number in sorted(given - found):
            text = f"task {number} is named {what} and is not"
            faults.append(Fault(what=text, task=number, promise=True))
    if (late or tasks.keys() - planned) and not answer.reason:
        faults.append(Fault(what="tasks are lost without a reason", promise=True))
    proof = answer.infeasible
    if proof is not None:
        if not proof.core or not set(proof.core) <= tasks.keys():
            faults.append(
                Fault(what=f"the core {proof.core} is not made of open tasks", promise=True)
            )
        elif not set(proof.core) & (late | (tasks.keys() - planned)):
            what = f"tasks {proof.core} are proved not to be all in time, and the plan serves them"
            faults.append(Fault(what=what, promise=True))
    return faults
