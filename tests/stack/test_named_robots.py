"""Tasks that name the robot that must serve them."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from mrta_falsify.core import codec
from mrta_falsify.core.allocation_problem import AllocationProblem, OpenTask, RobotPlan
from mrta_falsify.core.errors import UnknownNameError
from mrta_falsify.core.world import CommsOutage, World
from mrta_falsify.stack.allocation.exact import Exact, ExactOptions
from mrta_falsify.stack.allocation.in_turn import InTurn
from mrta_falsify.stack.allocation.insertion import Insertion, InsertionOptions
from mrta_falsify.stack.allocation.nearest import Nearest
from mrta_falsify.stack.allocation.verification import verify
from tests.stack.mission_course import run, ward

TIMES = np.array([[0.0, 20, 40], [20, 0, 20], [40, 20, 0]])


def problem(*named: int, deadline: float = 500.0) -> AllocationProblem:
    """Robots 0 and 1 in room 0; one task from room 1 to room 2 for each entry."""
    return AllocationProblem(
        now=0.0,
        robots=tuple(
            RobotPlan(robot=i, room=0, free_at=0.0, onboard=(), capacity=1) for i in range(2)
        ),
        tasks=tuple(
            OpenTask(number=k, start=1, end=2, arrival=0.0, deadline=deadline, robot=robot)
            for k, robot in enumerate(named)
        ),
        travel_times=TIMES,
    )


def named(world: World, *names: str) -> World:
    tasks = tuple(
        dataclasses.replace(task, robot=name) for task, name in zip(world.tasks, names, strict=True)
    )
    return dataclasses.replace(world, tasks=tasks)


# --- worlds ------------------------------------------------------------------------------------


def test_a_robot_that_is_not_there_is_refused_with_the_known_names():
    world = ward([0, 1], [(0, 0, 1)], rooms=2)
    with pytest.raises(UnknownNameError, match=r"tasks\[0\].robot: unknown robot 'robot7'.*robot1"):
        named(world, "robot7")


def test_a_world_whose_tasks_name_no_robot_is_written_as_before():
    world = ward([0, 1], [(0, 0, 1)], rooms=2)
    assert "robot" not in codec.encode(world)["tasks"][0]
    assert named(world, "").digest() == world.digest()
    assert named(world, "robot1").digest() != world.digest()


# --- the running stack -------------------------------------------------------------------------


def drops(result):
    return {(event.task, event.robot) for event in result.at("dropped-off")}


@pytest.mark.slow
def test_the_named_robot_delivers_though_another_one_is_nearer():
    world = ward([0, 2], [(0, 0, 1), (0, 0, 1)], rooms=3)
    assert drops(run(named(world, "robot1", "robot0"))) == {(0, 1), (1, 0)}


@pytest.mark.slow
def test_a_task_waits_for_its_robot_while_that_cannot_be_reached():
    world = named(ward([0, 1], [(0, 0, 2), (0, 1, 2)], rooms=3), "robot1", "")
    outage = CommsOutage(
        name="radio", robots=("robot1",), links=("dispatcher",), start=0.0, end=20.0
    )
    result = run(dataclasses.replace(world, events=(outage,)))
    assert drops(result) == {(0, 1), (1, 0)}
    assert 20.0 <= result.at("assigned", task=0)[0].time <= 30.5


# --- allocators and their judges ---------------------------------------------------------------


def test_the_checker_sees_a_task_with_the_wrong_robot():
    case = problem(1)
    stolen = Nearest(Nearest.Options()).allocate(problem(0))
    (fault,) = verify(stolen, case)
    assert str(fault) == "task 0 is given to robot 0; it names robot 1"
    assert verify(Nearest(Nearest.Options()).allocate(case), case) == ()


def test_the_prover_knows_that_only_the_named_robot_may_serve_a_task():
    exact = Exact(ExactOptions())
    # one task takes 40 s, a second one by the same robot 80 s
    assert exact.allocate(problem(-1, -1, deadline=45.0)).status == "plan"
    assert exact.allocate(problem(0, 1, deadline=45.0)).status == "plan"
    refused = exact.allocate(problem(1, 1, deadline=45.0))
    assert refused.status == "infeasible"
    assert refused.infeasible.core == (0, 1)
    assert refused.least_lost == 1


def test_the_reason_of_a_proof_is_about_the_named_robot():
    case = problem(1, deadline=100.0)
    far = dataclasses.replace(case.robots[1], free_at=90.0)
    answer = Exact(ExactOptions()).allocate(dataclasses.replace(case, robots=(case.robots[0], far)))
    assert "its robot, 1, is there at 130 s" in answer.reason


def test_insertion_loses_a_deadline_rather_than_give_a_named_task_away():
    answer = Insertion(InsertionOptions()).allocate(problem(1, 1, 1, deadline=45.0))
    assert [len(stops) for stops in answer.itineraries] == [0, 6]
    assert len(answer.late) == 2


def test_dealing_in_turn_goes_by_number_apart_from_named_tasks():
    answer = InTurn(InTurn.Options()).allocate(problem(-1, -1, -1, 0))
    given = [[stop.task for stop in stops[::2]] for stops in answer.itineraries]
    assert given == [[0, 2, 3], [1]]
