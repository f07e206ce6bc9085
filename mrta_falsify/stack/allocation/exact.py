"""The complete allocator: a plan that keeps all deadlines, or a proof that there is none."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mrta_falsify.core.allocation_problem import (
    Allocation,
    AllocationProblem,
    Infeasible,
    Stop,
)
from mrta_falsify.core.codec import quantity
from mrta_falsify.core.words import number_text
from mrta_falsify.stack.allocation.insertion import Insertion, InsertionOptions
from mrta_falsify.stack.allocation.objective import Objective
from mrta_falsify.stack.allocation.proving import Proof, Prover
from mrta_falsify.stack.allocation.single_robots import LimitReachedError
from mrta_falsify.stack.allocation.table import RouteTable
from mrta_falsify.stack.allocation.timing import (
    NO_ROBOT,
    append_only,
    timed_allocation,
    with_kept_plans,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class ExactOptions:
    """How long is searched, and what is minimised among the plans that keep all deadlines."""

    node_limit: int = quantity(low=1, default=100_000_000)  #: of route searches; about 20 s
    objective: Objective = "completion"
    improvement_steps: int = quantity(low=0, high=1_000_000, default=200)  #: ruins after a success
    fewest_lost: bool = True  #: search for the largest set of tasks that can be in time


class Exact:
    """Plan, or proof of infeasibility with a minimal core; never a wrong "impossible"."""

    Options = ExactOptions

    def __init__(self, options: ExactOptions) -> None:
        self._options = options
        self._insertion = Insertion(InsertionOptions(objective=options.objective))

    def allocate(self, problem: AllocationProblem) -> Allocation:
        """See :class:`~mrta_falsify.core.protocols.Allocator`."""
        if problem.commitment == "keep":
            return with_kept_plans(problem, self.allocate(append_only(problem)))
        if not problem.tasks:
            return timed_allocation(problem, [()] * len(problem.robots))
        if not problem.robots:
            return without_robots(problem)
        guess = self._insertion.allocate(problem)
        if guess.status == "plan":
            return self._improved(problem, guess.itineraries, lost=())
        try:
            prover = Prover(problem, self._options.node_limit)
            prover.suggest(_owners(problem, guess))
            found = prover.prove()
            if isinstance(found, Proof):
                return self._refused(problem, prover, found, guess)
            return self._serve(problem, prover, found)
        except LimitReachedError:
            limit = self._options.node_limit
            undecided = f"within {limit} nodes neither a plan nor a proof was found"
            return dataclasses.replace(guess, reason=f"{undecided}; {guess.reason}")

    def _refused(
        self, problem: AllocationProblem, prover: Prover, found: Proof, guess: Allocation
    ) -> Allocation:
        """The plan that loses the fewest deadlines, as far as it was found, with the proof."""
        proof = Infeasible(
            core=tuple(sorted(problem.tasks[k].number for k in found.core)),
            reason=core_in_words(problem, found),
            minimal=found.minimal,
        )
        sets, least = prover.fewest_lost() if self._options.fewest_lost else (None, 1)
        answer = guess if sets is None else self._serve(problem, prover, sets)
        return dataclasses.replace(
            answer,
            reason=f"{answer.reason}: {proof.reason}",
            infeasible=proof,
            least_lost=max(1, least),
        )

    def _serve(self, problem: AllocationProblem, prover: Prover, sets: Sequence[int]) -> Allocation:
        """Plan of the prover's sets, improved; the other tasks are late."""
        served = 0
        for tasks in sets:
            served |= tasks
        lost = [k for k in range(len(problem.tasks)) if not served >> k & 1]
        plans = [prover.itinerary(r, sets[r]) for r in range(prover.n)]
        return self._improved(problem, plans, lost)

    def _improved(
        self, problem: AllocationProblem, plans: Sequence[Sequence[Stop]], lost: Sequence[int]
    ) -> Allocation:
        """Better plans; the ``lost`` tasks, by position, are served late."""
        table = RouteTable.of(without_plans(problem))
        for k in lost:
            table.w.node["due"][table.n + 2 * k + 1] = np.inf
        table.reload(plans)
        self._insertion.serve_late(table, table.pending())
        if self._options.improvement_steps:
            self._insertion.improve(table, self._options.improvement_steps)
        return timed_allocation(problem, [table.stops(r) for r in range(table.n)])


def _owners(problem: AllocationProblem, answer: Allocation) -> dict[int, int]:
    """Robots by task, both as positions, where an answer has the task in time."""
    position = {task.number: k for k, task in enumerate(problem.tasks)}
    return {
        position[stop.task]: r
        for r, stops in enumerate(answer.itineraries)
        for stop in stops
        if stop.task not in answer.late
    }


def without_plans(problem: AllocationProblem) -> AllocationProblem:
    """The problem without the old plans."""
    robots = tuple(dataclasses.replace(plan, planned=()) for plan in problem.robots)
    return dataclasses.replace(problem, robots=robots)


def without_robots(problem: AllocationProblem) -> Allocation:
    """Answer of a problem without robots."""
    core = (problem.tasks[0].number,)
    return Allocation(
        itineraries=(),
        unserved=tuple(sorted(task.number for task in problem.tasks)),
        reason=NO_ROBOT,
        infeasible=Infeasible(core=core, reason=NO_ROBOT),
        least_lost=len(problem.tasks),
    )


def core_in_words(problem: AllocationProblem, proof: Proof) -> str:
    """Why the tasks of a core cannot all be in time."""
    tasks = [problem.tasks[k] for k in proof.core]
    if len(tasks) > 1:
        names = ", ".join(str(task.number) for task in tasks)
        last = max(task.deadline for task in tasks)
        least = " of them" if proof.minimal else " (there may be a smaller such set)"
        return (
            f"no plan of {len(problem.robots)} robots has tasks {names} in time (last deadline "
            f"{number_text(last)} s); all but any one{least} can be"
            if proof.minimal
            else f"no plan of {len(problem.robots)} robots has tasks {names} in time{least}"
        )
    task, travel = tasks[0], problem.travel_times
    carriers = [plan for plan in problem.robots if task.number in plan.onboard]
    ends = []
    able = [plan for plan in problem.robots if task.allows(plan.robot)]
    for plan in carriers or able:
        time, room = max(plan.free_at, problem.now), plan.room
        if not carriers:
            time = max(time, task.arrival) + float(travel[room, task.start]) + task.pickup_time
            room = task.start
        ends.append((time + float(travel[room, task.end]) + task.dropoff_time, plan.robot))
    end, robot = min(ends)
    if end <= task.deadline:  # the load on board is in the way
        return (
            f"task {task.number} cannot be in room {task.end} by {number_text(task.deadline)} s, "
            "since every robot must first make room for it"
        )
    who = "the robot that could be first" if not carriers and task.robot < 0 else "its robot"
    return (
        f"task {task.number} cannot be in room {task.end} by {number_text(task.deadline)} s: "
        f"{who}, {robot}, is there at {number_text(end)} s"
    )
