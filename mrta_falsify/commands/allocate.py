"""Plan which robot serves which task of a task file."""

from __future__ import annotations

import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mrta_falsify.commands.folders import Place
from mrta_falsify.core import registry
from mrta_falsify.core.allocation_problem import Allocation, Status, Stop
from mrta_falsify.core.config import Choice, StackConfig, apply_setting
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
MAX_CAPACITY = 1000


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PlanAnswer:
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


def allocate(
    tasks: Place,
    travel_times: Place,
    *,
    allocator: Choice | str = DEFAULT_ALLOCATOR,
    capacity: int = 2,
    keep: bool = False,
    settings: Sequence[str] = (),
) -> PlanAnswer:
    """Allocate the tasks of a file, batch by batch as they arrive.

    Args:
        tasks: SMrTa's or MRTA-Sim's task JSON (``agents``, ``tasks_stream``).
        travel_times: JSON ``{units, rooms, statistic, travel_time}``.
        allocator: by default the chain: insertion, exact within a limit, best subset.
        capacity: loads that a robot carries at once.
        keep: only append to the plan when tasks arrive; without it everything that has not
            begun may change.
        settings: options of the allocator, as ``objective=makespan``.

    Returns:
        A plan that passed the strict checker.

    Raises:
        InputError: a file, the allocator or the capacity is not what it must be.
        HarnessError: the allocator's plan breaks a condition.
    """
    if not 1 <= capacity <= MAX_CAPACITY:
        raise ConfigError(f"capacity is {capacity}; it must be from 1 to {MAX_CAPACITY}")
    choice = _with_settings(allocator, settings)
    travel = read_travel_times(Path(travel_times))
    case = read_case(Path(tasks), rooms=len(travel.times))
    chosen = registry.build("allocator", choice, where="allocate")
    batches = [
        Batch(arrival=arrival, tasks=group)
        for arrival, group in zip(case.arrivals, case.batches, strict=True)
        if group
    ]
    began = time.perf_counter()
    count = sum(len(batch.tasks) for batch in batches)
    stream = Stream(
        np.array(travel.times),
        case.rooms,
        capacity,
        chosen,
        commitment="keep" if keep else "free",
        room_for=count,
    )
    outcome = run_stream(stream, batches)
    wall_s = time.perf_counter() - began
    if outcome.faults:
        raise HarnessError(f"the plan does not pass the checker: {outcome.faults[0]}")
    return PlanAnswer(
        case=case,
        allocation=outcome.answer,
        smrta=smrta_plan(case, outcome.answer.itineraries, travel.times),
        shortened=travel.shortened,
        wall_s=wall_s,
    )


def _with_settings(allocator: Choice | str, settings: Sequence[str]) -> Choice:
    choice = Choice(allocator) if isinstance(allocator, str) else allocator
    config = StackConfig(allocator=choice)
    for setting in settings:
        config = apply_setting(config, f"allocator.{setting}")
    return config.allocator


# --- what is printed ---------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class TaskPlace:
    """Position of a task in its file, from 0."""

    batch: int
    task: int


@dataclass(frozen=True, slots=True, kw_only=True)
class PlannedStop:
    """A stop of a robot, with the place of its task in the file."""

    batch: int
    task: int
    action: str  #: ``pickup`` or ``dropoff``
    room: int
    time_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotStops:
    """What one robot does."""

    robot: int
    stops: tuple[PlannedStop, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanSummary:
    """What ``allocate --format json`` prints."""

    status: Status
    wall_s: float
    robots: tuple[RobotStops, ...]
    late: tuple[TaskPlace, ...]  #: tasks that are late, those unserved included
    unserved: tuple[TaskPlace, ...]
    conflict: tuple[TaskPlace, ...]  #: a smallest set of tasks that cannot all be in time
    least_lost: int | None  #: fewest deadlines that are lost, if proved
    reason: str  #: why there is no plan, or only part of one


def summarise_plan(answer: PlanAnswer) -> PlanSummary:
    """Sum a plan up, tasks by their places in the file."""
    plan = answer.allocation

    def places(numbers: Iterable[int]) -> tuple[TaskPlace, ...]:
        return tuple(TaskPlace(*answer.case.position(number)) for number in numbers)

    return PlanSummary(
        status=answer.status,
        wall_s=answer.wall_s,
        robots=tuple(
            RobotStops(robot=r, stops=tuple(_planned_stop(answer.case, stop) for stop in stops))
            for r, stops in enumerate(plan.itineraries)
        ),
        late=places(sorted({*plan.late, *plan.unserved})),
        unserved=places(plan.unserved),
        conflict=places(plan.infeasible.core if plan.infeasible is not None else ()),
        least_lost=plan.least_lost,
        reason=plan.reason,
    )


def _planned_stop(case: SmrtaCase, stop: Stop) -> PlannedStop:
    batch, task = case.position(stop.task)
    return PlannedStop(batch=batch, task=task, action=stop.action, room=stop.room, time_s=stop.time)
