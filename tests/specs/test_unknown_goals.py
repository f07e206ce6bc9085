"""A deadlock of a stack that does not tell its goals is suspected, by copies without the others."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from mrta_falsify.core.fleet import Frame
from mrta_falsify.core.protocols import Watch
from mrta_falsify.process.child import can_fork
from mrta_falsify.specs.deadlock.unknown_goals import UnknownGoals
from mrta_falsify.specs.library import build_specifications
from mrta_falsify.testing.planted import CREEPS
from simulator_interface.simulate import simulate
from tests.simulator_interface.test_forecast import head_on_in_a_lane, on
from tests.specs.frames import DT, Robot, Script

pytestmark = [
    pytest.mark.slow,  # whole runs
    pytest.mark.skipif(not can_fork(), reason="processes are copied on Linux"),
]


def judged(**more):
    world, config = head_on_in_a_lane()
    config = dataclasses.replace(on("kinematic", config), **more)
    specs = build_specifications([CREEPS])
    world = dataclasses.replace(world, horizon=90.0)
    outcome = simulate(world, config, specifications=specs, stop=lambda _: _end_of(specs[0]))
    return outcome.verdicts[0]


def _end_of(judge) -> str:
    return "decided" if judge.verdict().who else ""


def test_the_members_are_those_of_a_stack_that_tells_its_goals():
    told, silent = judged(), judged(withheld=("goals", "paths"))
    assert told.outcome == "violated"
    assert silent.outcome == "not_judged"
    assert set(silent.who) == set(told.who)
    assert silent.not_judged == (
        "a deadlock is suspected, but the stack does not tell where its robots are going"
    )
    assert silent.evidence["confirmed"] is False


class Alone:
    """Forecasts in which the first robot drives 3 m to the east, and the second one stays."""

    def __init__(self, frame: Frame) -> None:
        self.frame = frame
        self.asked: list[tuple[int, ...]] = []

    def __call__(self, watch: Watch, *, without=(), nudge=0):
        self.asked.append(tuple(without))
        sensed = self.frame.sensed
        for tick in range(400):
            pose = sensed.pose.copy()
            pose[0, 0] += min(3.0, 0.05 * tick)
            now = dataclasses.replace(sensed, pose=pose, time=0.1 * tick)
            if watch.update(dataclasses.replace(self.frame, sensed=now)):
                break
        return watch.answer()


def test_each_robot_that_stands_is_asked_about_once_without_all_others():
    robots = [Robot(at=(2.0, 2.0), goal=(8.0, 8.0)), Robot(at=(5.0, 5.0), goal=(8.0, 8.0))]
    script = Script(robots=robots, seconds=30.0)
    world = script.world()
    frames = list(script.frames(world))
    untold, alone = UnknownGoals(world, DT), Alone(frames[0])
    for frame in frames:
        seen = untold.with_goals(frame, alone)
    assert alone.asked == [(1,), (0,)]
    assert seen.intent.goal[0] == pytest.approx((5.0, 2.0), abs=0.1)
    assert np.isnan(seen.intent.goal[1]).all()
    assert seen.intent.tasks_left.tolist() == [1, 0]
