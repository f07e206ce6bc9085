"""What every registered allocator keeps, judged by a checker that knows no allocator."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mrta_falsify.core import registry
from mrta_falsify.core.allocation_problem import AllocationProblem, OpenTask, RobotPlan
from mrta_falsify.core.config import Choice
from mrta_falsify.core.protocols import Allocator
from mrta_falsify.stack.allocation.timing import closed_travel_times
from mrta_falsify.stack.allocation.verification import verify
from mrta_falsify.stack.dispatcher import fault_of

NAMES = registry.names("allocator")
ROOMS = 4
FLEETS = st.integers(1, 4)


@st.composite
def problems(draw, robots=FLEETS):
    """Travel times, robots that may carry something already, and new tasks."""
    times = draw(
        st.lists(st.integers(1, 60), min_size=ROOMS * ROOMS, max_size=ROOMS * ROOMS).map(
            lambda values: np.array(values, dtype=float).reshape(ROOMS, ROOMS)
        )
    )
    np.fill_diagonal(times, 0.0)
    now = float(draw(st.integers(0, 100)))
    room = st.integers(0, ROOMS - 1)

    def task(number: int) -> OpenTask:
        return OpenTask(
            number=number,
            start=draw(room),
            end=draw(room),
            arrival=now,
            deadline=now + draw(st.integers(0, 300)),
            pickup_time=float(draw(st.integers(0, 5))),
            dropoff_time=float(draw(st.integers(0, 5))),
        )

    plans, tasks = [], []
    for robot in range(3, 3 + draw(robots)):  # numbers need not be positions
        capacity = draw(st.integers(1, 3))
        onboard = tuple(range(len(tasks), len(tasks) + draw(st.integers(0, capacity))))
        tasks += [task(number) for number in onboard]
        plans.append(
            RobotPlan(
                robot=robot,
                room=draw(room),
                free_at=now + draw(st.integers(0, 30)),
                onboard=onboard,
                capacity=capacity,
            )
        )
    new = draw(st.integers(0, 4))
    fresh = [task(number) for number in range(len(tasks), len(tasks) + new)]
    named = st.sampled_from([-1, -1, *(plan.robot for plan in plans)])
    tasks += [dataclasses.replace(task, robot=draw(named)) for task in fresh]
    return AllocationProblem(
        now=now,
        robots=tuple(plans),
        tasks=tuple(tasks),
        travel_times=closed_travel_times(times),
    )


def check_times(problem, answer):
    """Predicted times follow from travel and service times alone, and are never too early."""
    tasks = {task.number: task for task in problem.tasks}
    late = set()
    for plan, itinerary in zip(problem.robots, answer.itineraries, strict=True):
        room, time = plan.room, max(plan.free_at, problem.now)
        for stop in itinerary:
            task = tasks[stop.task]
            if stop.action == "pickup":
                time = max(time, task.arrival)
            time += problem.travel_times[room, stop.room]
            room = stop.room
            if stop.action == "pickup":
                time += task.pickup_time
            else:
                time += task.dropoff_time
                if time > task.deadline:
                    late.add(stop.task)
            assert stop.time == pytest.approx(time)
    assert set(answer.late) == late


@pytest.mark.parametrize("name", NAMES)
class TestAllocator:
    def build(self, name):
        return registry.build("allocator", Choice(name))

    def test_it_offers_the_protocol(self, name):
        assert isinstance(self.build(name), Allocator)

    @settings(suppress_health_check=list(HealthCheck), deadline=None, max_examples=25)
    @given(problem=problems())
    def test_answers_can_be_carried_out_and_account_for_every_task(self, name, problem):
        answer = self.build(name).allocate(problem)
        assert fault_of(problem, answer) == ""
        assert verify(answer, problem) == ()
        planned = {stop.task for plan in answer.itineraries for stop in plan}
        assert planned | set(answer.unserved) == {task.number for task in problem.tasks}
        assert not planned & set(answer.unserved)
        check_times(problem, answer)
        assert bool(answer.reason) == bool(answer.late or answer.unserved)
        robot_of = {
            stop.task: plan.robot
            for plan, itinerary in zip(problem.robots, answer.itineraries, strict=True)
            for stop in itinerary
        }
        for task in problem.tasks:
            assert task.robot in (-1, robot_of.get(task.number, task.robot))

    @settings(suppress_health_check=list(HealthCheck), deadline=None, max_examples=15)
    @given(problem=problems())
    def test_the_same_problem_has_the_same_answer(self, name, problem):
        assert self.build(name).allocate(problem) == self.build(name).allocate(problem)

    @settings(suppress_health_check=list(HealthCheck), deadline=None, max_examples=15)
    @given(problem=problems(robots=st.integers(1, 3)))
    def test_an_answer_is_a_plan_that_can_be_kept(self, name, problem):
        answer = self.build(name).allocate(problem)
        robots = tuple(
            dataclasses.replace(plan, planned=itinerary)
            for plan, itinerary in zip(problem.robots, answer.itineraries, strict=True)
        )
        again = self.build(name).allocate(dataclasses.replace(problem, robots=robots))
        assert fault_of(problem, again) == ""

    @settings(suppress_health_check=list(HealthCheck), deadline=None, max_examples=15)
    @given(problem=problems(robots=st.integers(1, 3)))
    def test_a_plan_to_be_kept_is_only_appended_to(self, name, problem):
        first = self.build(name).allocate(problem)
        robots = tuple(
            dataclasses.replace(plan, planned=itinerary)
            for plan, itinerary in zip(problem.robots, first.itineraries, strict=True)
        )
        new = OpenTask(number=99, start=1, end=2, arrival=problem.now, deadline=problem.now + 500)
        kept = dataclasses.replace(
            problem, robots=robots, tasks=(*problem.tasks, new), commitment="keep"
        )
        assert verify(self.build(name).allocate(kept), kept) == ()

    def test_a_task_goes_to_the_robot_that_it_names_however_far(self, name):
        robots = tuple(
            RobotPlan(robot=i, room=i - 5, free_at=0.0, onboard=(), capacity=1) for i in (5, 6, 7)
        )
        times = np.array([[0.0, 30, 30], [30, 0, 30], [30, 30, 0]])
        for named in (5, 6, 7):
            task = OpenTask(number=1, start=1, end=2, arrival=0.0, deadline=100.0, robot=named)
            problem = AllocationProblem(now=0.0, robots=robots, tasks=(task,), travel_times=times)
            answer = self.build(name).allocate(problem)
            assert [len(plan) for plan in answer.itineraries].index(2) == named - 5

    def test_without_robots_everything_is_unserved(self, name):
        task = OpenTask(number=3, start=0, end=1, arrival=0.0, deadline=50.0)
        problem = AllocationProblem(
            now=0.0, robots=(), tasks=(task,), travel_times=np.zeros((2, 2))
        )
        answer = self.build(name).allocate(problem)
        assert answer.itineraries == ()
        assert answer.unserved == (3,)

    def test_the_robot_at_hand_takes_a_single_task(self, name):
        if "in_turn" in name:
            pytest.skip("who deals in turn does not look where the robots are")
        robots = tuple(
            RobotPlan(robot=i, room=i, free_at=0.0, onboard=(), capacity=1) for i in range(3)
        )
        task = OpenTask(number=0, start=1, end=2, arrival=0.0, deadline=100.0)
        times = np.array([[0.0, 30, 30], [30, 0, 30], [30, 30, 0]])
        problem = AllocationProblem(now=0.0, robots=robots, tasks=(task,), travel_times=times)
        answer = self.build(name).allocate(problem)
        assert [len(plan) for plan in answer.itineraries] == [0, 2, 0]
