"""Task files to plans: what ``mrta-falsify allocate`` does."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mrta_falsify.core import registry
from mrta_falsify.core.allocation_problem import Allocation, Commitment, Status
from mrta_falsify.core.config import Choice
from mrta_falsify.core.errors import ConfigError, HarnessError
from mrta_falsify.stack.allocation.stream import Batch, Stream, run_stream
from simulator_interface.formats.smrta import (
    SmrtaCase,
    read_case,
    read_travel_times,
    smrta_plan,
)

#: the default; :mod:`mrta_falsify.stack.allocation.chain`
DEFAULT_ALLOCATOR = "chain"
MOST_CAPACITY = 1000


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Answer:
    """A plan for a whole task file, checked."""

    case: SmrtaCase
    allocation: Allocation  #: tasks by their position in the file
    smrta: dict[str, Any]  #: the same plan as SMrTa would give it
    shortened: int  #: travel times that had to be closed
    wall_s: float  #: of the allocator's calls

    @property
    def status(self) -> Status:
        """``plan``, ``partial`` or ``infeasible``."""
        return self.allocation.status


def allocate_file(
    tasks: Path,
    travel_times: Path,
    *,
    allocator: Choice | None = None,
    capacity: int = 2,
    commitment: Commitment = "free",
) -> Answer:
    """Allocate the tasks of a file, batch by batch as they arrive.

    Args:
        tasks: SMrTa's or MRTA-Sim's task JSON (``agents``, ``tasks_stream``).
        travel_times: JSON ``{units, rooms, statistic, travel_time}``.
        allocator: by default the chain: insertion, exact within a limit, best subset.
        capacity: loads that a robot carries at once.
        commitment: what may happen to stops that have not begun when a batch arrives.

    Returns:
        A plan that passed the strict checker.

    Raises:
        InputError: a file, the allocator or the capacity is not what it must be.
        HarnessError: the allocator's plan breaks a condition.
    """
    if not 1 <= capacity <= MOST_CAPACITY:
        raise ConfigError(f"capacity is {capacity}; it must be from 1 to {MOST_CAPACITY}")
    travel = read_travel_times(travel_times)
    case = read_case(tasks, rooms=len(travel.times))
    chosen = registry.build("allocator", allocator or Choice(DEFAULT_ALLOCATOR), where="allocate")
    batches = [
        Batch(arrival=arrival, tasks=group)
        for arrival, group in zip(case.arrivals, case.batches, strict=True)
        if group
    ]
    began = time.perf_counter()
    count = sum(len(batch.tasks) for batch in batches)
    stream = Stream(
        np.array(travel.times), case.rooms, capacity, chosen, commitment=commitment, room_for=count
    )
    outcome = run_stream(stream, batches)
    wall_s = time.perf_counter() - began
    if outcome.faults:
        raise HarnessError(f"the plan does not pass the checker: {outcome.faults[0]}")
    return Answer(
        case=case,
        allocation=outcome.answer,
        smrta=smrta_plan(case, outcome.answer.itineraries, travel.times),
        shortened=travel.shortened,
        wall_s=wall_s,
    )


def as_data(answer: Answer) -> dict[str, Any]:
    """The object that ``allocate --format json`` prints."""
    plan, place = answer.allocation, answer.case.position

    def named(number: int) -> dict[str, int]:
        batch, task = place(number)
        return {"batch": batch, "task": task}

    robots = [
        {
            "robot": r,
            "stops": [
                {**named(s.task), "action": s.action, "room": s.room, "time_s": s.time}
                for s in stops
            ],
        }
        for r, stops in enumerate(plan.itineraries)
    ]
    lost = sorted({*plan.late, *plan.unserved})
    core = plan.infeasible.core if plan.infeasible is not None else ()
    return {
        "status": answer.status,
        "wall_s": answer.wall_s,
        "robots": robots,
        "late": [named(number) for number in lost],
        "unserved": [named(number) for number in plan.unserved],
        "conflict": [named(number) for number in core],
        "least_lost": plan.least_lost,
        "reason": plan.reason,
    }
