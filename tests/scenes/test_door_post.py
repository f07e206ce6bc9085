"""A robot whose nose is 0.1 m from a door post, with a delivery to make: it must get away."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from mrta_falsify.core.arrays import frozen_array
from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.core.world import RobotSpec, Task, World
from mrta_falsify.testing.planted import STANDS
from mrta_falsify.testing.wards import ward_layout
from mrta_falsify.trial import Job, judge, on_kinematic_engine

NOSE = 0.22 + 0.1  # m, from the robot's centre to its nose, and on to the post
CORRIDOR = 4.0  # m, width; the posts are the ends of its northern wall


def at_the_post(door: float, side: int, heading: float, beside: float) -> World:
    """A robot before a door, which has to fetch something inside.

    Args:
        door: its width [m].
        side: of the post: -1 west, 1 east.
        heading: of the robot [degrees].
        beside: of the post, eastwards, the point that its nose points at [m].
    """
    layout = ward_layout(rooms=3, door_width=door)
    yaw = np.radians(heading)
    post = np.array([layout.rooms[1].point[0] + side * door / 2.0 + beside, CORRIDOR])
    place = post - NOSE * np.array([np.cos(yaw), np.sin(yaw)])
    return dataclasses.replace(
        layout,
        robots=(RobotSpec(name="robot1", pose=frozen_array([*place, yaw])),),
        tasks=(Task(arrival=0.0, start=1, end=2, deadline=100.0),),
        horizon=60.0,
    )


def violated_by(config: StackConfig, world: World) -> list[str]:
    names = (STANDS, "all_tasks_done", "no_robot_static_contact")
    job = Job(
        world=world, config=on_kinematic_engine(config), specifications=names, early_stop=True
    )
    verdicts = judge(job, keep_trace=False).verdicts
    return [verdict.spec for verdict in verdicts if verdict.violated]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("door", "side", "heading", "beside"),
    [
        (1.2, -1, 90, 0.08),
        (1.2, 1, 135, 0.08),
        (1.0, -1, 45, 0.08),
        (0.9, -1, 60, 0.0),
    ],
)
def test_a_robot_at_a_door_post_gets_away(door, side, heading, beside):
    assert violated_by(StackConfig(), at_the_post(door, side, heading, beside)) == []


@pytest.mark.slow
def test_a_robot_at_a_door_post_stays_there_if_it_may_not_back_up():
    stays = StackConfig(controller=Choice("cluster_cbf", {"recovery": False}))
    assert "no_deadlock" in violated_by(stays, at_the_post(0.9, -1, 60, 0.0))
