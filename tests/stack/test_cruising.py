"""Robots that cruise faster than usual look farther ahead, and slow down in time."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from mrta_falsify.commands.run import run
from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.core.world import CRUISE, HumanSpec
from mrta_falsify.stack.cruising import Cruise, look_ahead_of, pace_of, straight_reach
from mrta_falsify.stack.lookahead import Outlook
from mrta_falsify.stack.route import LOOK_AHEAD, Way
from tests.stack.mission_course import ward

BEND = np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 3.0]])
FAST = Cruise(1.5, 0.4)


@pytest.mark.parametrize(
    ("path", "x", "reach"),
    [
        (BEND, 0.0, 4.0),
        (BEND, 3.0, 1.0),
        (np.array([[0.0, 0.0], [9.0, 0.0]]), 1.0, 6.0),  # no farther than it looks
        (np.array([[0.0, 0.0], [2.0, 0.05], [4.0, -0.05]]), 0.0, np.hypot(4.0, 0.05)),
        (np.array([[0.0, 0.0], [2.0, 0.4], [4.0, -0.4]]), 0.0, np.hypot(2.0, 0.4)),
        (np.array([[0.0, 0.0], [2.0, 0.0], [1.0, 0.0]]), 0.0, 2.0),  # comes back
        (np.zeros((1, 2)), 0.0, 0.0),
    ],
)
def test_a_way_is_straight_up_to_its_first_bend(path, x, reach):
    rest = np.vstack([[x, 0.0], path[path[:, 0] > x]]) if len(path) > 1 else path
    assert straight_reach(rest, x, 0.0, 6.0) == pytest.approx(reach)


@pytest.mark.parametrize("heading", [0.0, 1.0, 3.1, -3.1])
def test_which_way_a_path_leads_does_not_matter(heading):
    turn = np.array([[np.cos(heading), np.sin(heading)], [-np.sin(heading), np.cos(heading)]])
    assert straight_reach(BEND @ turn, 0.0, 0.0, 6.0) == pytest.approx(4.0)


def test_the_pace_falls_towards_a_bend_as_the_robot_can_brake():
    places = np.linspace(0.0, 3.5, 36)
    paces = np.array([pace_of(np.vstack([[x, 0.0], BEND[1:]]), x, 0.0, FAST) for x in places])
    assert paces[0] == 1.5
    assert paces[-1] == pytest.approx(CRUISE)
    assert (np.diff(paces) <= 0.0).all()
    braking = -np.diff(paces**2) / (2.0 * np.diff(places))
    assert braking.max() <= FAST.braking + 1e-9


@pytest.mark.parametrize("speed", [0.3, CRUISE])
def test_robots_that_cruise_no_faster_than_usual_steer_as_ever(speed):
    way, pose = Way(route=BEND[-1:], path=BEND), np.zeros((1, 3))
    views = Outlook([Cruise(speed, 0.4)]).views([way], pose)
    np.testing.assert_array_equal(views.target, [[LOOK_AHEAD, 0.0]])
    assert views.pace[0] == speed


def test_a_fast_robot_steers_for_a_point_farther_ahead_until_its_way_is_cut():
    way, pose = Way(route=BEND[-1:], path=BEND), np.zeros((1, 3))
    views = Outlook([FAST]).views([way], pose)
    assert look_ahead_of(1.5) == 2.0 * LOOK_AHEAD
    np.testing.assert_allclose(views.target, [[2.0 * LOOK_AHEAD, 0.0]])
    short = views.shortened({0: 0.6}, pose)
    assert short.pace[0] < 0.85
    assert short.target[0, 0] < 0.6
    assert views.pace[0] == 1.5


# --- driven ------------------------------------------------------------------------------------


def speeds(world, engine):
    outcome = run(world, StackConfig(engine=Choice(engine)))
    assert outcome.ended == "all-tasks-done"
    touched = {v.spec for v in outcome.verdicts if v.violated and v.spec.endswith("contact")}
    assert not touched
    return outcome.trace.columns["velocity"][:, :, 0]


@pytest.mark.slow
@pytest.mark.parametrize("engine", ["kinematic", "bullet"])
def test_a_robot_that_may_drives_one_and_a_half_metres_a_second(engine):
    world = ward([0], [(0, 0, 5)], rooms=6, robot={"cruise_speed": 1.5})
    fast = speeds(world, engine)
    assert fast.max() == pytest.approx(1.5, abs=0.02)
    assert (fast > 1.4).mean() > 0.3


@pytest.mark.slow
def test_the_limit_of_a_robot_counts_more_than_its_cruising_speed():
    robot = {"cruise_speed": 1.5, "max_speed": 1.1}
    assert speeds(ward([0], [(0, 0, 5)], rooms=6, robot=robot), "kinematic").max() <= 1.1 + 1e-9


@pytest.mark.slow
def test_robots_cruise_at_the_usual_speed_unless_they_are_told_to():
    assert speeds(ward([0], [(0, 0, 5)], rooms=6), "kinematic").max() <= CRUISE + 1e-9


@pytest.mark.slow
@pytest.mark.parametrize("engine", ["kinematic", "bullet"])
def test_fast_robots_stop_for_people_and_for_each_other(engine):
    world = ward(
        [0, 5], [(0, 0, 5), (0, 5, 0)], rooms=6, robot={"cruise_speed": 1.5}, horizon=200.0
    )
    people = tuple(
        HumanSpec(name=f"walker{i}", route=np.array([[x, 0.6], [x, 3.4]]), speed=0.8, start=0.3 * i)
        for i, x in enumerate((9.0, 16.0, 21.0))
    )
    assert speeds(dataclasses.replace(world, humans=people), engine).max() > 1.0
