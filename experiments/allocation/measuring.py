"""What the allocation benchmarks share: instances from files, CPU times, streams."""

from __future__ import annotations

import dataclasses
import time
from pathlib import Path

import numpy as np

from mrta_falsify.core.allocation_problem import AllocationProblem, RobotPlan
from mrta_falsify.core.seeding import stream as random_stream
from mrta_falsify.stack.allocation.insertion import Insertion, InsertionOptions
from mrta_falsify.stack.allocation.stream import Batch, Stream
from simulator_interface.formats.smrta import SmrtaCase

INSERTION = Insertion(InsertionOptions())
IMPROVING = Insertion(InsertionOptions(improvement_steps=2000))


def family(path: Path) -> str:
    return path.stem.rpartition("_d_")[0] or path.stem.rpartition("-")[0]


def batch_problem(case: SmrtaCase, times, *, capacity=2, deadline=None) -> AllocationProblem:
    """All tasks of a file as one batch; ``deadline`` maps old deadlines to new ones."""
    tasks = tuple(
        dataclasses.replace(task, deadline=deadline(task.deadline) if deadline else task.deadline)
        for batch in case.batches
        for task in batch
    )
    robots = tuple(
        RobotPlan(robot=r, room=room, free_at=0.0, onboard=(), capacity=capacity)
        for r, room in enumerate(case.rooms)
    )
    return AllocationProblem(now=0.0, robots=robots, tasks=tasks, travel_times=np.array(times))


def cpu(work):
    began = time.process_time()
    result = work()
    return 1e3 * (time.process_time() - began), result


def best_of(work, repeats=3):
    found = [cpu(work) for _ in range(repeats)]
    return min(ms for ms, _ in found), found[-1][1]


def stream_ms(case: SmrtaCase, times, allocator, *, capacity=2, delay=None, seed=0):
    """CPU times [ms] per batch, times of re-plans, and the outcome."""
    stream = Stream(
        np.array(times),
        case.rooms,
        capacity,
        allocator,
        room_for=sum(map(len, case.batches)),
        expects_feedback=delay is not None,
    )
    spent, replans = [], []
    random = random_stream(seed, "experiments/allocation/delays")
    for arrival, tasks in zip(case.arrivals, case.batches, strict=True):
        began = time.process_time()
        stream._table.commit(arrival)
        stream.now = arrival
        spent.append(1e3 * (time.process_time() - began))
        if delay is not None:
            share, most = delay
            ends = stream._table.w.node["time"][: len(case.rooms)]
            busy = [r for r in range(len(case.rooms)) if ends[r] > arrival]
            hit = {
                r: ends[r] + random.integers(1, most + 1) for r in busy if random.random() < share
            }
            ms, _ = cpu(lambda hit=hit: stream.feedback(hit))
            replans.append(ms)
        ms, _ = cpu(
            lambda tasks=tasks, arrival=arrival: stream.take(Batch(arrival=arrival, tasks=tasks))
        )
        spent[-1] += ms
    return spent, replans, stream.outcome()
