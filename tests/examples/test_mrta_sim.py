"""MRTA-Sim's own nodes on trial; needs a checkout of theirs and what they import."""

from __future__ import annotations

import dataclasses
import importlib.util
import os
import sys
from pathlib import Path

import numpy as np
import pytest

from mrta_falsify.commands.worlds import find_world
from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.core.external import ExternalStack
from mrta_falsify.core.stack_failure import StackLimits
from mrta_falsify.core.world import Task
from mrta_falsify.process.budget import Budget
from mrta_falsify.process.watch import Watch, under
from mrta_falsify.specs.library import build_specifications
from scenic_worlds.layouts import load_world
from simulator_interface.simulate import simulate

ROOT = Path(__file__).resolve().parents[2]
SOURCE = Path(os.environ.get("MRTA_SIM", ROOT.parent / "shared" / "stacks"))
#: of a virtual environment that has what they import
PYTHON = os.environ.get("MRTA_SIM_PYTHON", sys.executable)
HAS_JAX = "MRTA_SIM_PYTHON" in os.environ or importlib.util.find_spec("jax") is not None

pytestmark = [
    pytest.mark.long,  # JAX compiles for a quarter of a minute in each run
    pytest.mark.skipif(not SOURCE.is_dir(), reason="there is no checkout of MRTA-Sim"),
    pytest.mark.skipif(not HAS_JAX, reason="JAX is not installed"),
]


def case(horizon: float, *, people: int = 0):
    """Give their published case."""
    world = load_world("aws_hospital_day")
    return dataclasses.replace(world, humans=world.humans[:people], horizon=horizon)


def judged(world, *names: str, branch: str = "never", engine: str = "kinematic", **params):
    stack = ExternalStack(
        command=(PYTHON, str(ROOT / "examples" / "mrta_sim" / "mrta_sim_stack.py")),
        env={"PYTHONPATH": str(ROOT), "MRTA_SIM": str(SOURCE)},
        params=params,
        branch=branch,
        tasks_ahead=True,
        tick_limit=120.0,
        start_limit=300.0,
    )
    config = dataclasses.replace(StackConfig(), engine=Choice(engine), stack=stack)
    with under(Watch(budget=Budget.of_stack(StackLimits(memory=4.0)))):
        return simulate(world, config, specifications=build_specifications(list(names)))


def test_a_third_person_ends_the_controllers():
    (verdict,) = judged(case(2.0, people=3), "stack_runs", people=3).verdicts
    assert verdict.violated
    assert "IndexError" in " ".join(verdict.evidence["frames"])
    assert not judged(case(2.0, people=3), "stack_runs", people=2).verdicts[0].violated


def test_a_late_first_batch_ends_the_dispatcher():
    world = case(5.0)
    late = tuple(dataclasses.replace(task, arrival=task.arrival + 3.0) for task in world.tasks)
    (verdict,) = judged(dataclasses.replace(world, tasks=late), "stack_runs").verdicts
    assert verdict.violated
    assert "plans_list" in " ".join(verdict.evidence["frames"])


def test_a_fourth_robot_that_waits_for_a_room_ends_its_goal_setter():
    """All stand where the room is asked for; one is let in, and the room has three spots."""
    world = case(10.0)
    starts = [(3.6, -25.1), (2.4, -25.1), (1.2, -25.1), (0.0, -25.1), (1.2, -23.8), (2.6, -23.8)]
    robots = tuple(
        dataclasses.replace(robot, pose=np.array([x, y, 0.0]))
        for robot, (x, y) in zip(world.robots, starts, strict=True)
    )
    tasks = tuple(Task(arrival=0.0, start=3, end=k, deadline=900.0) for k in (2, 1, 0, 4, 5, 2))
    crowded = dataclasses.replace(world, robots=robots, tasks=tasks)
    (verdict,) = judged(crowded, "stack_runs").verdicts
    assert verdict.violated
    frames = " ".join(verdict.evidence["frames"])
    assert "queue_callback" in frames
    assert "IndexError" in frames


def test_a_robot_that_has_finished_frees_the_room_in_which_it_stays():
    """robot1 delivers to a room and stays there; robot2 is let in to fetch something."""
    world = case(70.0)
    robots = (
        dataclasses.replace(world.robots[2], name="robot1"),
        dataclasses.replace(world.robots[0], name="robot2"),
    )
    tasks = (
        Task(arrival=0.0, start=2, end=3, deadline=60.0),
        Task(arrival=0.0, start=3, end=2, deadline=120.0),
    )
    exclusive, honest = judged(
        dataclasses.replace(world, robots=robots, tasks=tasks), "exclusive_use", "honest_events"
    ).verdicts
    assert exclusive.violated
    assert exclusive.evidence["resource"] == "day_surgery"
    assert not honest.violated, "robots are held until they have loaded"


def test_two_robots_meet_beside_the_mop_cart_for_ever():
    (verdict,) = judged(case(30.0), "no_deadlock", branch="replay").verdicts
    assert verdict.violated
    assert verdict.evidence["confirmed"]
    assert "robot6" in verdict.evidence["members"]
    assert 20.0 <= verdict.violated_at <= 30.0


@pytest.mark.parametrize(
    ("name", "specification", "members", "at_latest"),
    [
        ("rests_in_the_room", "exclusive_use", {"robot1", "robot2"}, 24.0),
        ("beside_the_mop_cart", "progress{window: 8}", {"robot1", "robot3"}, 24.0),
        ("spot_beside_the_door", "progress{window: 20}", {"robot1", "robot2"}, 55.0),
    ],
)
def test_its_smallest_failures_come_again(name, specification, members, at_latest):
    world = find_world(ROOT / "examples" / "mrta_sim" / "smallest" / f"{name}.scenic")
    world = dataclasses.replace(world, horizon=at_latest)
    (verdict,) = judged(world, specification).verdicts
    assert verdict.violated
    assert set(verdict.who) == members


@pytest.mark.parametrize("engine", ["kinematic", "bullet"])
def test_the_same_schedule_gives_the_same_run(engine):
    first, second = (judged(case(10.0), "stack_runs", engine=engine) for _ in range(2))
    assert first.trace.digest == second.trace.digest
    other = judged(case(10.0), "stack_runs", engine=engine, latency_most=0.005)
    assert other.trace.digest != first.trace.digest
