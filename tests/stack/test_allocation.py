"""What regret insertion decides, beyond the contract of all allocators."""

from __future__ import annotations

import numpy as np

from mrta_falsify.core.allocation import AllocationProblem, OpenTask, RobotPlan
from mrta_falsify.stack.allocation.insertion import Insertion

TIMES = np.array([[0.0, 10, 20], [10, 0, 10], [20, 10, 0]])


def allocate(tasks, *robots):
    problem = AllocationProblem(now=0.0, robots=robots, tasks=tuple(tasks), travel_times=TIMES)
    return Insertion(Insertion.Options()).allocate(problem)


def robot(number=0, room=0, capacity=2, onboard=()):
    return RobotPlan(robot=number, room=room, free_at=0.0, onboard=onboard, capacity=capacity)


def task(number, start, end, deadline=500.0):
    return OpenTask(number=number, start=start, end=end, arrival=0.0, deadline=deadline)


def visits(itinerary):
    return [(stop.task, stop.action) for stop in itinerary]


def test_loads_for_one_room_travel_together_where_there_is_room():
    both = [task(0, 0, 2), task(1, 0, 2)]
    assert allocate(both, robot()).itineraries[0][-1].time == 20.0
    assert allocate(both, robot(capacity=1)).itineraries[0][-1].time == 60.0


def test_the_urgent_task_goes_first():
    answer = allocate([task(0, 0, 1), task(1, 0, 2, deadline=20.0)], robot(capacity=1))
    assert visits(answer.itineraries[0])[:2] == [(1, "pickup"), (1, "dropoff")]
    assert answer.late == ()


def test_what_cannot_be_in_time_is_served_and_named():
    answer = allocate([task(4, 2, 0, deadline=5.0)], robot())
    assert answer.late == (4,)
    assert "4" in answer.reason


def test_what_is_on_board_is_dropped_by_its_robot():
    answer = allocate([task(0, 1, 2)], robot(0, room=2), robot(1, room=1, onboard=(0,)))
    assert visits(answer.itineraries[1]) == [(0, "dropoff")]
