"""Batches of tasks over time: commitments, late feedback, and re-planning.

What has begun is kept: every stop whose leg started before a batch arrives, and the leg in
progress. Later stops may change (``free``) or are only appended to (``keep``). Actual times
come back as feedback and shift what follows; what cannot be in time any more is late, and
nothing else fails for it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from mrta_falsify.core.allocation_problem import (
    Allocation,
    AllocationProblem,
    Commitment,
    Infeasible,
    OpenTask,
    RobotPlan,
    Stop,
)
from mrta_falsify.core.arrays import Array
from mrta_falsify.core.errors import HarnessError
from mrta_falsify.core.protocols import Allocator
from mrta_falsify.stack.allocation.insertion import Insertion
from mrta_falsify.stack.allocation.table import RouteTable
from mrta_falsify.stack.allocation.timing import lost_in_words, timed_allocation
from mrta_falsify.stack.allocation.verification import Fault, verify


@runtime_checkable
class Replanner(Protocol):
    """An allocator that begins with insertion, whose routes may live on between batches."""

    @property
    def incremental(self) -> Insertion:
        """The insertion that it begins with."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Batch:
    """Tasks that become known together."""

    arrival: float  #: [s]
    tasks: tuple[OpenTask, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class StreamOutcome:
    """What a stream of batches came to."""

    answer: Allocation  #: whole itineraries, executed part first
    faults: tuple[Fault, ...]  #: what the strict checker found; empty for a valid outcome


class Stream:
    """A fleet that gets tasks batch by batch.

    With insertion, alone or as the first link of the chain, the routes live on as arrays; any
    other allocator is asked with the open part as an :class:`AllocationProblem` per batch.
    """

    def __init__(
        self,
        travel_times: Array,
        rooms: Sequence[int],
        capacity: int,
        allocator: Allocator,
        *,
        commitment: Commitment = "free",
        room_for: int = 64,
        expects_feedback: bool = False,
    ) -> None:
        """A fleet at rest at time 0.

        Args:
            travel_times: ``(R, R)`` [s], closed under shortest paths.
            rooms: start room per robot.
            capacity: of every robot.
            allocator: asked for each batch.
            commitment: what may happen to stops that have not begun.
            room_for: tasks that are expected.
            expects_feedback: have the code for late robots ready now, instead of compiling or
                loading it when the first one is late.
        """
        self.now = 0.0
        self._rooms, self._capacity = tuple(rooms), capacity
        self._allocator, self._commitment = allocator, commitment
        self._table = RouteTable(
            travel_times, rooms, [capacity] * len(self._rooms), room_for=room_for
        )
        self._incremental: Insertion | None = None
        if commitment == "free" and isinstance(allocator, Replanner):
            self._incremental = allocator.incremental
            if expects_feedback:
                _compile_for_a_late_robot(self._incremental)
        self._proof: Infeasible | None = None
        self._reasons: list[str] = []
        self._least_lost: int | None = None
        self._batches = 0

    def advance(self, now: float) -> list[list[Stop]]:
        """Move on to time ``now`` [s], and return all stops that are committed, per robot."""
        self._table.commit(now)
        self.now = now
        return self._table.committed()

    def feedback(self, arrivals: Mapping[int, float]) -> None:
        """Re-plan with what is known of the committed part.

        Args:
            arrivals: robot to the time [s] at which its last committed stop ends.
        """
        for robot, time in sorted(arrivals.items()):
            self._table.report(robot, time)
        if self._incremental is not None:
            self._incremental.settle(self._table, rescue=False)
        elif self._commitment == "free":
            self._ask()

    def take(self, batch: Batch) -> None:
        """Give the tasks of a batch to robots; time must have come to its arrival."""
        self._batches += 1
        self._table.add(batch.tasks)
        if self._incremental is None:
            self._ask()
            return
        left = self._incremental.insert(self._table)
        if len(left) and self._incremental is not self._allocator:
            self._ask()
        else:
            self._incremental.serve_late(self._table, left)
            if not len(left):
                self._incremental.polish(self._table)

    def _ask(self) -> None:
        problem = self._table.problem(self.now, commitment=self._commitment)
        answer = self._allocator.allocate(problem)
        carried_out = [fault for fault in verify(answer, problem) if not fault.promise]
        if carried_out:
            raise HarnessError(f"the allocator's plan cannot be carried out: {carried_out[0]}")
        self._table.adopt(timed_allocation(problem, answer.itineraries))
        if answer.reason:
            self._reasons.append(answer.reason)
        if answer.infeasible is not None and self._proof is None:
            self._proof = answer.infeasible
        self._least_lost = answer.least_lost

    # --- the whole ------------------------------------------------------------------------

    def whole_problem(self) -> AllocationProblem:
        """All tasks, and all robots where they started: what the outcome is judged against."""
        return AllocationProblem(
            now=0.0,
            robots=tuple(
                RobotPlan(robot=r, room=room, free_at=0.0, onboard=(), capacity=self._capacity)
                for r, room in enumerate(self._rooms)
            ),
            tasks=tuple(self._table.tasks),
            travel_times=self._table.w.travel,
        )

    def itineraries(self) -> list[tuple[Stop, ...]]:
        """Executed and planned stops per robot, with their times."""
        done = self._table.committed()
        return [(*done[r], *self._table.stops(r)) for r in range(self._table.n)]

    def outcome(self) -> StreamOutcome:
        """The plan as it stands, judged by the strict checker."""
        problem, itineraries = self.whole_problem(), self.itineraries()
        deadline = {task.number: task.deadline for task in problem.tasks}
        drops = [s for stops in itineraries for s in stops if s.action == "dropoff"]
        late = tuple(sorted(s.task for s in drops if s.time > deadline[s.task]))
        unserved = tuple(sorted(deadline.keys() - {stop.task for stop in drops}))
        # A proof about one batch binds the whole only if nothing was decided before it.
        proof = self._proof if self._batches == 1 and (late or unserved) else None
        reasons = dict.fromkeys(self._reasons) if late or unserved else {}
        answer = Allocation(
            itineraries=tuple(itineraries),
            late=late,
            unserved=unserved,
            reason="; ".join(reasons) or lost_in_words(late, unserved),
            infeasible=proof,
            least_lost=self._least_lost if proof is not None else None,
        )
        return StreamOutcome(answer=answer, faults=verify(answer, problem))


def _compile_for_a_late_robot(insertion: Insertion) -> None:
    """Let one robot be late for what it carries and for what it does not: compiles all of it."""
    times = np.array([[0.0, 1.0], [1.0, 0.0]])
    table = RouteTable(times, [0], [1], room_for=2)
    table.add([OpenTask(number=k, start=0, end=1, arrival=0.0, deadline=9.0 + k) for k in range(2)])
    insertion.settle(table, rescue=False)
    table.commit(1.0)
    table.report(0, 100.0)
    insertion.settle(table, rescue=False)


def run_stream(stream: Stream, batches: Sequence[Batch]) -> StreamOutcome:
    """Take batches in order of arrival; everything happens as it was planned."""
    for batch in sorted(batches, key=lambda batch: batch.arrival):
        stream.advance(batch.arrival)
        stream.take(batch)
    return stream.outcome()
