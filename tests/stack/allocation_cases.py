"""Allocation problems of our own, drawn by seed."""

from __future__ import annotations

import numpy as np

from mrta_falsify.core.allocation_problem import AllocationProblem, OpenTask, RobotPlan
from mrta_falsify.core.seeding import stream
from mrta_falsify.stack.allocation.timing import closed_travel_times


def floor(seed, rooms=12):
    """Asymmetric travel times ``(rooms, rooms)`` [s] of points in a 60 s x 60 s square."""
    random = stream(seed, "tests/allocation/floor")
    points = random.uniform(0, 60, (rooms, 2))
    away = np.abs(points[:, None] - points[None]).sum(axis=2)
    times = np.ceil(away * random.uniform(1.0, 1.2, away.shape))
    np.fill_diagonal(times, 0.0)
    return closed_travel_times(times)


def problem(seed, *, robots=3, tasks=6, slack=(60, 200), capacity=2, service=1.0):
    """A batch at time 0; deadlines are drawn from ``slack`` beyond the ride itself."""
    random = stream(seed, "tests/allocation/tasks")
    times = floor(seed)
    rooms = len(times)
    plans = tuple(
        RobotPlan(
            robot=i,
            room=int(random.integers(rooms)),
            free_at=0.0,
            onboard=(),
            capacity=capacity,
        )
        for i in range(robots)
    )
    new = []
    for number in range(tasks):
        start, end = (int(room) for room in random.choice(rooms, 2, replace=False))
        ride = times[start, end] + 2 * service
        new.append(
            OpenTask(
                number=number,
                start=start,
                end=end,
                arrival=0.0,
                deadline=float(round(ride + random.uniform(*slack))),
                pickup_time=service,
                dropoff_time=service,
            )
        )
    return AllocationProblem(now=0.0, robots=plans, tasks=tuple(new), travel_times=times)
