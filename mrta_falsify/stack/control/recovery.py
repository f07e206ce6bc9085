"""Back up: what a robot does that stands before a solid and would drive on.

A nose 0.1 m from a door post leaves no room to turn, and none to drive. Where no robot and no
person is near, the robot drives backwards until it has made progress again, and then plans anew.

Reference: the behaviour ``backup`` of Nav2, Macenski et al., "The Marathon 2", IROS 2020.
"""

from __future__ import annotations

import numpy as np

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.compiled import njit
from mrta_falsify.stack.control.conflicts import is_clear_of_points
from mrta_falsify.stack.control.manoeuvres import BACK, GO, Choices
from mrta_falsify.stack.control.obstacles import People
from mrta_falsify.stack.control.predicted_motions import StraightLeg
from mrta_falsify.stack.control.state import Crew

STUCK_AFTER = 3.0  # s without progress
STILL = 0.02  # m/s, a robot that is slower forwards stands
STILL_TURN = 0.06  # rad/s, a robot that turns faster is not stuck
COMPANY = 1.2  # m centre to centre, robots and people this near have their own rules
BEFORE = 0.6  # m from the centre, solids this near and ahead are backed away from
LENGTH = 0.4  # m that must be clear behind, more than what counts as progress
SPEED = 0.2  # m/s


@njit(cache=True)
def back_up_where_stuck(
    choices: Choices, crew: Crew, points: Array, people: People, obstacle_gap: float, now: float
) -> None:
    """Let robots back up that would go on, stand before a solid and have nobody near.

    Args:
        choices: ``(N,)`` manoeuvres; those of stuck robots are replaced.
        crew: robots, surveyed.
        points: ``(N, S, 2)`` obstacle points [m], inf: none.
        people: who is about.
        obstacle_gap: to keep behind; where less is left, not to come nearer [m].
        now: [s].
    """
    for i in range(crew.shape[0]):
        robot, choice = crew[i], choices[i]
        goes = choice.kind == GO and robot.joint and now - robot.anchor_at >= STUCK_AFTER
        if not goes or robot.twist[0] > STILL:
            continue
        if robot.twist[0] > -STILL and abs(robot.twist[2]) > STILL_TURN:
            continue
        x, y, yaw = robot.pose[0], robot.pose[1], robot.pose[2]
        back = StraightLeg(x, y, -np.cos(yaw), -np.sin(yaw), LENGTH)
        if _has_company(i, crew, people) or not _is_before_solid(back, points[i]):
            continue
        if is_clear_of_points(back, points[i], obstacle_gap):
            choice.kind, choice.reverse, choice.speed = BACK, True, SPEED
            choice.point[0] = x + LENGTH * back.ux
            choice.point[1] = y + LENGTH * back.uy


@njit(cache=True)
def _has_company(i: int, crew: Crew, people: People) -> bool:
    x, y = crew[i].pose[0], crew[i].pose[1]
    for j in range(crew.shape[0]):
        dx, dy = crew[j].pose[0] - x, crew[j].pose[1] - y
        if j != i and crew[j].present and dx * dx + dy * dy < COMPANY * COMPANY:
            return True
    for k in range(people.radius.shape[0]):
        dx, dy = people.position[k, 0] - x, people.position[k, 1] - y
        if dx * dx + dy * dy < COMPANY * COMPANY:
            return True
    return False


@njit(cache=True)
def _is_before_solid(back: StraightLeg, points: Array) -> bool:
    """Whether a point ``(S, 2)`` is near and not behind."""
    for k in range(points.shape[0]):
        dx, dy = points[k, 0] - back.x, points[k, 1] - back.y
        if dx * dx + dy * dy < BEFORE * BEFORE and dx * back.ux + dy * back.uy < 0.0:
            return True
    return False
