"""What a robot would do in the next seconds: positions at equal steps of time."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.compiled import njit
from mrta_falsify.core.polyline import point_ahead, project_on_segment

STEP = 0.25  # s, between samples of a predicted motion
SAMPLES = 29  # 7 s ahead
LOOK = 0.5  # m, look-ahead of the pursuit, as the stack's
TURN_RATE = 1.0  # rad/s, a cautious mean of a turn on the spot
TURN_WHILE_DRIVING = 0.25 * np.pi  # rad, on a path a smaller heading error costs no time
TURN_WHILE_LEAVING = 0.5  # rad, on a straight leg a smaller turn costs no time
SEGMENTS_AHEAD = 4  # segments that lead away before the search for the closest one ends
ARRIVED = 1e-9  # m, nearer to its point than this a robot has no direction
DRIVING = 0.05  # m/s, slower robots are predicted to stop


class StraightLeg(NamedTuple):
    """A straight way."""

    x: float  #: start [m], map frame
    y: float
    ux: float  #: unit vector of travel
    uy: float
    length: float  #: [m]


@njit(cache=True)
def turn_between(angle: float, yaw: float) -> float:
    """Find the smallest turn between two headings [rad], >= 0."""
    return float(abs((angle - yaw + np.pi) % (2.0 * np.pi) - np.pi))


@njit(cache=True)
def _closest_ahead(
    path: Array, segment: int, share: float, x: float, y: float
) -> tuple[int, float]:
    """Move (segment, share) on to the closest point of ``path`` a little ahead."""
    best, since = np.inf, 0
    at = segment
    for i in range(segment, path.shape[0] - 1):
        t, gap = project_on_segment(path, i, x, y)
        if gap < best:
            best, at, share, since = gap, i, t, 0
        else:
            since += 1
            if since > SEGMENTS_AHEAD:
                break
    return at, share


@njit(cache=True)
def fill_pursuit(
    robot: np.record, path: Array, segment: int, share: float, cruise: float, motion: Array
) -> None:
    """Fill ``motion`` ``(SAMPLES, 2)`` with the way along ``path`` at up to ``cruise`` [m/s].

    The robot begins beside (segment, share) of the path.
    """
    x, y, yaw = robot.pose[0], robot.pose[1], robot.pose[2]
    acceleration = robot.max_acceleration
    motion[0, 0], motion[0, 1] = x, y
    tx, ty = point_ahead(path, segment, share, x, y, LOOK)
    error = turn_between(np.arctan2(ty - y, tx - x), yaw)
    delay = max(0.0, error - TURN_WHILE_DRIVING) / TURN_RATE
    v = max(robot.speed, 0.0)
    for k in range(1, SAMPLES):
        if k * STEP <= delay:
            v = max(0.0, v - acceleration * STEP)
        else:
            v = min(cruise, v + acceleration * STEP)
        segment, share = _closest_ahead(path, segment, share, x, y)
        tx, ty = point_ahead(path, segment, share, x, y, LOOK)
        dx, dy = tx - x, ty - y
        distance = np.sqrt(dx * dx + dy * dy)
        move = min(v * STEP, distance)
        if distance > ARRIVED:
            x, y = x + move * dx / distance, y + move * dy / distance
        motion[k, 0], motion[k, 1] = x, y


@njit(cache=True)
def fill_leg(leg: StraightLeg, turn: float, pace: float, motion: Array) -> None:
    """Fill ``motion``: turn by ``turn`` [rad] on the spot, drive the leg at ``pace`` [m/s]."""
    delay = max(0.0, turn - TURN_WHILE_LEAVING) / TURN_RATE
    for k in range(SAMPLES):
        way = min(leg.length, max(0.0, (k * STEP - delay) * pace))
        motion[k, 0], motion[k, 1] = leg.x + way * leg.ux, leg.y + way * leg.uy


@njit(cache=True)
def fill_stop(robot: np.record, motion: Array) -> None:
    """Fill ``motion``: brake along the heading and stay."""
    x, y, yaw, speed = robot.pose[0], robot.pose[1], robot.pose[2], robot.speed
    deceleration = robot.max_acceleration
    ux, uy = np.cos(yaw), np.sin(yaw)
    for k in range(SAMPLES):
        t = min(k * STEP, abs(speed) / deceleration)
        way = speed * t - 0.5 * deceleration * t * t * np.sign(speed)
        motion[k, 0], motion[k, 1] = x + way * ux, y + way * uy


@njit(cache=True)
def fill_drift(robot: np.record, motion: Array) -> None:
    """Fill ``motion``: keep the speed along the heading; a slow robot stops."""
    x, y, yaw, v = robot.pose[0], robot.pose[1], robot.pose[2], robot.speed
    if not abs(v) > DRIVING:
        fill_stop(robot, motion)
        return
    for k in range(SAMPLES):
        motion[k, 0] = x + k * STEP * v * np.cos(yaw)
        motion[k, 1] = y + k * STEP * v * np.sin(yaw)
