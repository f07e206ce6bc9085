"""How fast a robot may drive along its path, and how far ahead it then steers.

The nominal law drives at a speed that is proportional to the distance of the point a robot steers
for: :data:`CRUISE` for a point :data:`LOOK_AHEAD` ahead, as MRTA-Sim. A robot that may cruise
faster looks farther ahead, as long as its path is straight and long enough to brake before the
next bend, or the path's end, is :data:`LOOK_AHEAD` away.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.compiled import njit
from mrta_falsify.core.world import CRUISE
from mrta_falsify.stack.route import LOOK_AHEAD

BRAKING_SHARE = 0.4  # of the acceleration limit: the law lags a third of a second behind
STRAIGHT = 0.1  # m, a path that stays this near to a straight line is straight


class Cruise(NamedTuple):
    """What a robot does on a straight way."""

    speed: float  #: largest speed [m/s]
    braking: float  #: with which it slows down before a bend [m/s^2]


@njit(cache=True)
def straight_reach(rest: Array, x: float, y: float, most: float) -> float:
    """Find how far a path leads straight on.

    Every point of the path up to there lies within :data:`STRAIGHT` of the straight line from the
    robot to the last of them.

    Args:
        rest: ``(L, 2)`` path ahead [m], L >= 1.
        x: of the robot [m], map frame.
        y: of the robot [m], map frame.
        most: how far to look [m].

    Returns:
        Distance [m] from the robot to a corner of the path, at most ``most``.
    """
    reach, heading = 0.0, np.nan
    low, high = -np.pi, np.pi  # of the directions that all corners so far allow
    for i in range(rest.shape[0]):
        dx, dy = rest[i, 0] - x, rest[i, 1] - y
        distance = np.sqrt(dx * dx + dy * dy)
        if distance <= STRAIGHT:
            continue
        angle = np.arctan2(dy, dx)
        if np.isnan(heading):
            heading = angle
        turned = (angle - heading + np.pi) % (2.0 * np.pi) - np.pi
        if turned < low or turned > high or distance < reach:
            break
        spread = np.arcsin(STRAIGHT / distance)
        low, high = max(low, turned - spread), min(high, turned + spread)
        reach = distance
        if reach >= most:
            break
    return min(reach, most)


@njit(cache=True)
def pace_of(rest: Array, x: float, y: float, cruise: Cruise) -> float:
    """Speed [m/s] that a robot at (x, y) [m] may have with ``rest`` ``(L, 2)`` [m] ahead."""
    if cruise.speed <= CRUISE:
        return cruise.speed
    way = (cruise.speed**2 - CRUISE**2) / (2.0 * cruise.braking)
    spare = straight_reach(rest, x, y, LOOK_AHEAD + way) - LOOK_AHEAD
    square = CRUISE**2 + 2.0 * cruise.braking * max(spare, 0.0)
    return float(min(cruise.speed, np.sqrt(square)))


@njit(cache=True)
def look_ahead_of(pace: float) -> float:
    """Distance [m] of the point to steer for, with which the nominal law drives at ``pace``."""
    return float(LOOK_AHEAD * max(1.0, pace / CRUISE))
