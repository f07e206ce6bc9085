"""Since when does a robot stand on its spot?"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.compiled import njit

#: a robot that stays within this distance of one place stands [m]; within 2 s anything
#: faster than 0.05 m/s leaves it
SPOT_RADIUS = 0.1
GOALS_KEPT = 8  # goals remembered per spot; later ones no longer count as new
GOAL_JITTER = 0.3  # m; smaller changes of goal are jitter
TURN_STEP = 0.5  # rad; turning this far on the spot counts as moving ...
TURN_LIMIT = 1.1 * np.pi  # rad; ... until the robot has turned enough to face any direction
NO_GOALS = np.zeros((0, 2))


class _Spots(NamedTuple):
    """What is remembered of each robot's spot."""

    anchor: Array  #: (N, 3) pose at ``since``
    since: Array  #: (N,) [s]
    turned: Array  #: (N,) counted turning on this spot [rad]
    last: Array  #: (N,) yaw of the last tick [rad]
    goals: Array  #: (N, G, 2) goals had on this spot [m], nan: none


@dataclass(slots=True)
class Standstill:
    """Since when each of N robots has not left its spot.

    A robot leaves its spot when it is more than ``radius`` from where it first stood. Jitter, and
    turning on the spot beyond half a circle, do not count as leaving it. A goal that the robot has
    not had on this spot starts the time anew, so time without a task, or in a queue, does not
    count against it. Goals that come back do not start it anew.
    """

    robots: int
    radius: float = SPOT_RADIUS
    since: Array = field(init=False)  #: (N,) [s]
    _spots: _Spots = field(init=False)

    def __post_init__(self) -> None:
        self.since = np.zeros(self.robots)
        self._spots = _Spots(
            anchor=np.full((self.robots, 3), np.inf),
            since=self.since,
            turned=np.zeros(self.robots),
            last=np.zeros(self.robots),
            goals=np.full((self.robots, GOALS_KEPT, 2), np.nan),
        )

    def update(self, pose: Array, time: float, goal: Array | None = None) -> Array:
        """Take in a tick.

        Args:
            pose: ``(N, 3)`` [m, m, rad].
            time: [s].
            goal: ``(N, 2)`` [m], nan: none; leave out where goals do not matter.

        Returns:
            ``since`` ``(N,)`` [s], not a copy.
        """
        goals = NO_GOALS if goal is None else goal
        _fill_standstill(tuple(self._spots), pose, time, self.radius, goals)
        return self.since


@njit(cache=True)
def _fill_standstill(
    spots: tuple[Array, ...], pose: Array, time: float, radius: float, goal: Array
) -> None:
    """Bring the fields of :class:`_Spots` to ``time``."""
    anchor, since, turned, last, goals = spots
    for i in range(len(pose)):
        dx, dy = pose[i, 0] - anchor[i, 0], pose[i, 1] - anchor[i, 1]
        if not dx * dx + dy * dy <= radius * radius:  # also true for the first, infinite anchor
            anchor[i] = pose[i]
            since[i] = time
            turned[i] = 0.0
            last[i] = pose[i, 2]
            continue
        step = (pose[i, 2] - last[i] + np.pi) % (2.0 * np.pi) - np.pi
        last[i] = pose[i, 2]
        turned[i] += abs(step)
        away = abs((pose[i, 2] - anchor[i, 2] + np.pi) % (2.0 * np.pi) - np.pi)
        if away > TURN_STEP and turned[i] < TURN_LIMIT:
            anchor[i, 2] = pose[i, 2]
            since[i] = time
    _fill_goals(goal, time, since, goals)


@njit(cache=True)
def _fill_goals(goal: Array, time: float, since: Array, goals: Array) -> None:
    for i in range(len(goal)):
        if since[i] == time:  # has just moved: forget
            goals[i] = np.nan
        if np.isnan(goal[i, 0]):
            continue
        for k in range(goals.shape[1]):
            if np.isnan(goals[i, k, 0]):
                goals[i, k] = goal[i]
                since[i] = time
                break
            away = abs(goals[i, k, 0] - goal[i, 0]) + abs(goals[i, k, 1] - goal[i, 1])
            if away <= GOAL_JITTER:
                break
