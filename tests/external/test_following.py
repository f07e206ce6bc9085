"""Robots that a foreign stack sends to goals or along paths are driven by the shipped layers."""

from __future__ import annotations

import dataclasses
import sys
from pathlib import Path

import numpy as np
import pytest

from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.core.external import ExternalStack
from mrta_falsify.core.world import World
from mrta_falsify.specs.library import build_specifications
from simulator_interface.simulate import Outcome, simulate

ROOT = Path(__file__).resolve().parents[2]
SPECS = ("all_tasks_done", "no_deadlock", "progress", "no_robot_robot_contact")

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="processes are kept on Linux")


@pytest.fixture
def ward(hall) -> World:
    """The hall without its person."""
    return dataclasses.replace(hall, humans=(), horizon=120.0)


def run(world: World, how: str, specs=SPECS[3:], **more) -> Outcome:
    stack = ExternalStack(
        command=(sys.executable, str(Path(__file__).with_name("goal_stack.py")), how),
        env={"PYTHONPATH": str(ROOT)},
        tick_limit=60.0,
        **more,
    )
    config = dataclasses.replace(StackConfig(), engine=Choice("kinematic"), stack=stack)
    return simulate(world, config, specifications=build_specifications(specs))


def test_robots_are_driven_to_their_goals_past_each_other_and_furniture(ward):
    outcome = run(ward, "goals", SPECS)
    assert [verdict.outcome for verdict in outcome.verdicts[: len(SPECS)]] == ["holds"] * len(SPECS)
    assert {change.robot for change in outcome.trace.paths} == {0, 1}  # told for the stack
    again = run(ward, "goals", SPECS, branch="replay")
    assert again.trace.digest == outcome.trace.digest
    assert again.transcript.forecasts == outcome.transcript.forecasts


def test_a_robot_keeps_to_the_path_that_it_was_given(ward):
    world = dataclasses.replace(ward, tasks=ward.tasks[:1], horizon=25.0)
    outcome = run(world, "path")
    places = outcome.trace.columns["pose"][:, 0, :2]
    assert places[-1] == pytest.approx((6.0, 7.0), abs=0.2)
    corner = np.hypot(*(places - (1.5, 7.0)).T)
    assert corner.min() < 0.5


def test_twists_and_goals_mix(ward):
    world = dataclasses.replace(ward, tasks=ward.tasks[1:], horizon=5.0)
    outcome = run(world, "mixed")
    assert np.all(outcome.trace.columns["command"][:, 0] == (0.2, 0.0, 0.4))


def test_a_robot_without_twist_that_is_not_followed_is_an_answer_that_is_wrong(ward):
    outcome = run(ward, "nobody")
    (verdict,) = (v for v in outcome.verdicts if v.spec == "stack_runs")
    assert verdict.evidence["message"] == "twist is missing, and robot1 is not in `follow`"
