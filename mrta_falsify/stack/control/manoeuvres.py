"""The manoeuvres of a robot that meets others: each tries to keep clear of what is settled.

A try replaces the choice so far, and the motion predicted for it, by a better one.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.compiled import njit
from mrta_falsify.core.polyline import project_on_path
from mrta_falsify.core.world import CRUISE
from mrta_falsify.stack.control.conflicts import (
    SharedPlaces,
    Traffic,
    enters_closed_place,
    first_conflict,
    is_clear_of_points,
    is_clear_of_undecided,
)
from mrta_falsify.stack.control.predicted_motions import (
    SAMPLES,
    StraightLeg,
    fill_leg,
    fill_pursuit,
    fill_stop,
    turn_between,
)
from mrta_falsify.stack.control.state import Crew

GO, SLOW, PASS, WAIT, ASIDE, STAY, BACK = 0, 1, 2, 3, 4, 5, 6  #: kinds of manoeuvres

#: what a robot does, one record a robot
CHOICE = np.dtype(
    (
        np.record,
        np.dtype(
            [
                ("kind", np.int64),  # one of the above
                ("point", np.float64, (2,)),  # to drive to [m], nan: brake
                ("speed", np.float64),  # not to be exceeded [m/s]
                ("conflict_at", np.float64),  # first conflict [s from now], inf: none
                ("reverse", np.bool_),  # drive backwards to the point
            ],
            align=True,
        ),
    )
)
Choices = NDArray[np.void]  #: (N,) of CHOICE

SLOW_SHARE = 0.4  # of CRUISE, when going on slowly
SOON = 4.5  # s, a robot on its way does not care about conflicts later than this
EARLIER = 1e-9  # s, conflicts that differ by less are at the same time

PASS_STEPS = 4  # directions tried on each side of the path's
PASS_ANGLE = np.pi / 8.0  # rad, between them
PASS_LENGTHS = (0.9, 0.4)  # m, the long leg first
PASS_SPEED, PASS_LIMIT = 0.5, 0.6  # of CRUISE: predicted, allowed
PASS_MARGIN = 0.03  # m, beyond the gap to obstacles, so that no barrier row stops it halfway
PASS_TURN_COST = 0.5  # per rad of turning on the spot; a rad of detour costs 1
SHORT_COST = 0.1  # rad, of the shorter leg: the long one is preferred
LEFT_COST = 0.02  # rad, passing on the left: of sides that are nearly equal, take the right

HEADINGS = 12  #: directions tried when moving aside, and straight back
ASIDE_LENGTHS = (0.5, 0.95, 1.4)  # m, tried for each direction
ASIDE_SPEED = 0.4  # m/s
ASIDE_MARGIN = 0.02  # m, beyond the gap to obstacles, like that of a pass
ASIDE_TURN_COST = 0.4  # per rad of turning on the spot
ASIDE_LENGTH_COST = 0.5  # per m
BACK_COST = 0.2  # of driving backwards: a small turn, up to 0.5 rad, is preferred to it
LONGEST_LEG = max(*PASS_LENGTHS, *ASIDE_LENGTHS)  # m
WORTH_MOVING = 0.3  # s, so much later a conflict must come for a robot to move aside


@njit(cache=True)
def fill_initial(choice: np.record, robot: np.record) -> None:
    """Choose to stay."""
    choice.kind, choice.reverse = STAY, False
    choice.point[0], choice.point[1] = np.nan, np.nan
    choice.speed, choice.conflict_at = robot.max_speed, np.inf


@njit(cache=True)
def _fill_point(choice: np.record, x: float, y: float, reverse: bool) -> None:
    choice.point[0], choice.point[1] = x, y
    choice.reverse = reverse


@njit(cache=True)
def try_continuing(
    choice: np.record, i: int, robot: np.record, path: Array, traffic: Traffic
) -> bool:
    """Go on, or go on slowly; says whether something that stands is in the way of going on."""
    trial = np.empty((SAMPLES, 2))
    stands = False
    segment, share = project_on_path(path, robot.pose[0], robot.pose[1], 0)
    for kind in (GO, SLOW):
        pace = robot.cruise if kind == GO else SLOW_SHARE * min(robot.max_speed, CRUISE)
        fill_pursuit(robot, path, segment, share, pace, trial)
        t, fixed = first_conflict(trial, traffic)
        if kind == GO and t >= SOON:
            t = np.inf
        if kind == GO:
            stands = fixed and t < np.inf
        if t > choice.conflict_at + EARLIER:
            _fill_point(choice, robot.target[0], robot.target[1], False)
            choice.kind, choice.conflict_at = kind, t
            choice.speed = robot.max_speed if kind == GO else pace
            traffic.motion[i, :, :] = trial
        if t == np.inf:
            break
    return stands


@njit(cache=True)
def try_passing(
    choice: np.record,
    i: int,
    robot: np.record,
    path: Array,
    points: Array,
    obstacle_gap: float,
    places: SharedPlaces,
    traffic: Traffic,
) -> None:
    """Pass beside something that stands, on the side that is the smaller detour.

    ``points`` ``(S, 2)`` [m] are the obstacle points that the robot has seen.
    """
    trial = np.empty((SAMPLES, 2))
    x, y, yaw = robot.pose[0], robot.pose[1], robot.pose[2]
    segment, _share = project_on_path(path, x, y, 0)
    tangent = np.arctan2(
        path[segment + 1, 1] - path[segment, 1], path[segment + 1, 0] - path[segment, 0]
    )
    cruise = min(robot.max_speed, CRUISE)
    cheapest = np.inf
    for k in range(2 * (2 * PASS_STEPS + 1)):
        step, short = k // 2 - PASS_STEPS, k % 2
        angle = tangent + step * PASS_ANGLE
        turn = turn_between(angle, yaw)
        cost = abs(step) * PASS_ANGLE + PASS_TURN_COST * turn + SHORT_COST * short
        cost += LEFT_COST if step > 0 else 0.0
        if cost >= cheapest:
            continue
        leg = StraightLeg(x, y, np.cos(angle), np.sin(angle), PASS_LENGTHS[short])
        if not is_clear_of_points(leg, points, obstacle_gap + PASS_MARGIN):
            continue
        if enters_closed_place(leg, places):
            continue
        fill_leg(leg, turn, PASS_SPEED * cruise, trial)
        t, _ = first_conflict(trial, traffic)
        if t < np.inf:
            continue
        cheapest = cost
        _fill_point(choice, x + leg.length * leg.ux, y + leg.length * leg.uy, False)
        choice.kind, choice.conflict_at = PASS, np.inf
        choice.speed = PASS_LIMIT * cruise
        traffic.motion[i, :, :] = trial


@njit(cache=True)
def try_waiting(choice: np.record, i: int, robot: np.record, traffic: Traffic) -> None:
    """Stop and stay."""
    trial = np.empty((SAMPLES, 2))
    fill_stop(robot, trial)
    t, _ = first_conflict(trial, traffic)
    if t > choice.conflict_at + EARLIER:
        _fill_point(choice, np.nan, np.nan, False)
        choice.kind, choice.conflict_at = WAIT if robot.wants else STAY, t
        traffic.motion[i, :, :] = trial


@njit(cache=True)
def try_moving_aside(
    choice: np.record,
    i: int,
    crew: Crew,
    min_gap_robot: float,
    points: Array,
    obstacle_gap: float,
    places: SharedPlaces,
    traffic: Traffic,
) -> None:
    """Move aside: backwards, or in one of twelve directions, by little turning if possible."""
    trial = np.empty((SAMPLES, 2))
    x, y, yaw = crew[i].pose[0], crew[i].pose[1], crew[i].pose[2]
    cheapest = np.inf
    for k in range((HEADINGS + 1) * len(ASIDE_LENGTHS)):
        direction, length = k // len(ASIDE_LENGTHS), ASIDE_LENGTHS[k % len(ASIDE_LENGTHS)]
        back = direction == HEADINGS
        turn = np.pi if back else direction * 2.0 * np.pi / HEADINGS
        leg = StraightLeg(x, y, np.cos(yaw + turn), np.sin(yaw + turn), length)
        turn = 0.0 if back else min(turn, 2.0 * np.pi - turn)
        cost = ASIDE_TURN_COST * turn + ASIDE_LENGTH_COST * length + (BACK_COST if back else 0.0)
        if choice.conflict_at == np.inf and cost >= cheapest:
            continue
        if not is_clear_of_points(leg, points, obstacle_gap + ASIDE_MARGIN):
            continue
        if not is_clear_of_undecided(leg, crew, traffic, min_gap_robot):
            continue
        if enters_closed_place(leg, places):
            continue
        fill_leg(leg, turn, ASIDE_SPEED, trial)
        t, _ = first_conflict(trial, traffic)
        better = t > choice.conflict_at + WORTH_MOVING
        if better or (t == choice.conflict_at and cost < cheapest):
            cheapest = cost
            _fill_point(choice, x + length * leg.ux, y + length * leg.uy, back)
            choice.kind, choice.speed, choice.conflict_at = ASIDE, ASIDE_SPEED, t
            traffic.motion[i, :, :] = trial
