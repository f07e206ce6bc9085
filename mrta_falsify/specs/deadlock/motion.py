"""Who stands still, and what lies ahead on a path: small geometry for the specifications."""

from __future__ import annotations

from dataclasses import dataclass, field

import numba
import numpy as np

from mrta_falsify.core.arrays import Array

#: a robot that stays within this distance of one place makes no progress [m]; with 4 s of
#: patience anything faster than 0.025 m/s still counts as moving
STILL_RADIUS = 0.1
GOALS_KEPT = 8  # goals remembered per spot; later ones no longer count as new
SAME_GOAL = 0.3  # m, changes of goal below this are jitter
TURN_STEP = 0.5  # rad, turning this far on the spot counts as progress ...
TURN_LIMIT = 1.1 * np.pi  # rad, ... but more than faces any direction, on one spot, does not


@dataclass(slots=True)
class Standstill:
    """Since when each of N robots has not left its spot.

    A robot leaves its spot when it is more than ``radius`` from where it first stood; jitter
    and turning on the spot beyond half a circle are no progress. A goal that it has not had on
    this spot starts the time anew, so that time without a task, or in a queue, is not held
    against it; goals that come back do not.
    """

    robots: int
    radius: float = STILL_RADIUS
    since: Array = field(init=False)  #: (N,) [s]
    _anchor: Array = field(init=False)  #: (N, 3) pose at ``since``
    _turned: Array = field(init=False)  #: (N,) counted turning on this spot [rad]
    _last: Array = field(init=False)  #: (N,) yaw of the last tick [rad]
    _goals: Array = field(init=False)  #: (N, G, 2) goals had on this spot [m], nan: none

    def __post_init__(self) -> None:
        self.since = np.zeros(self.robots)
        self._anchor = np.full((self.robots, 3), np.inf)
        self._turned = np.zeros(self.robots)
        self._last = np.zeros(self.robots)
        self._goals = np.full((self.robots, GOALS_KEPT, 2), np.nan)

    def update(self, pose: Array, time: float, goal: Array | None = None) -> Array:
        """Take in a tick.

        Args:
            pose: ``(N, 3)`` [m, m, rad].
            time: [s].
            goal: ``(N, 2)`` [m], nan: none; leave out where goals do not matter.

        Returns:
            ``since`` ``(N,)`` [s], not a copy.
        """
        _fill_standstill(
            pose, time, self.radius, self._anchor, self.since, self._turned, self._last
        )
        if goal is not None:
            _fill_goals(goal, time, self.since, self._goals)
        return self.since


@numba.njit(cache=True)
def _fill_standstill(
    pose: Array,
    time: float,
    radius: float,
    anchor: Array,
    since: Array,
    turned: Array,
    last: Array,
) -> None:
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


@numba.njit(cache=True)
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
            if away <= SAME_GOAL:
                break


@numba.njit(cache=True)
def points_ahead(path: Array, x: float, y: float, reach: float, step: float) -> Array:
    """Points every ``step`` [m] along ``path`` ``(L, 2)``, from nearest (x, y) on, up to ``reach``.

    Returns:
        ``(P, 2)`` [m]; the first is the projection of (x, y); P >= 1 if L >= 1.
    """
    best, segment, px, py = np.inf, 0, path[0, 0], path[0, 1]
    for k in range(len(path) - 1):
        dx, dy = path[k + 1, 0] - path[k, 0], path[k + 1, 1] - path[k, 1]
        length2 = dx * dx + dy * dy
        share = 0.0
        if length2 > 0.0:
            share = ((x - path[k, 0]) * dx + (y - path[k, 1]) * dy) / length2
            share = min(1.0, max(0.0, share))
        qx, qy = path[k, 0] + share * dx, path[k, 1] + share * dy
        distance = (qx - x) ** 2 + (qy - y) ** 2
        if distance < best - 1e-9:
            best, segment, px, py = distance, k, qx, qy
    count = int(reach / step) + 1
    points = np.empty((count, 2))
    points[0, 0], points[0, 1] = px, py
    made = 1
    while made < count:
        need = step
        while segment < len(path) - 1:
            ex, ey = path[segment + 1, 0] - px, path[segment + 1, 1] - py
            left = np.sqrt(ex * ex + ey * ey)
            if left >= need:
                px, py = px + ex / left * need, py + ey / left * need
                need = 0.0
                break
            need -= left
            segment += 1
            px, py = path[segment, 0], path[segment, 1]
        if need > 0.0:
            break
        points[made, 0], points[made, 1] = px, py
        made += 1
    return points[:made]


@numba.njit(cache=True)
def remaining_length(path: Array, x: float, y: float) -> float:
    """Length [m] of ``path`` ``(L, 2)``, L >= 1, from the point nearest to (x, y) to its end.

    The distance to the path is added, so that leaving it sideways is no progress.
    """
    best, rest, tail = np.inf, 0.0, 0.0
    for k in range(len(path) - 2, -1, -1):
        dx, dy = path[k + 1, 0] - path[k, 0], path[k + 1, 1] - path[k, 1]
        length = np.sqrt(dx * dx + dy * dy)
        share = 0.0
        if length > 0.0:
            share = ((x - path[k, 0]) * dx + (y - path[k, 1]) * dy) / (length * length)
            share = min(1.0, max(0.0, share))
        ex, ey = path[k, 0] + share * dx - x, path[k, 1] + share * dy - y
        off = np.sqrt(ex * ex + ey * ey)
        if off < best:
            best, rest = off, tail + (1.0 - share) * length
        tail += length
    if len(path) == 1:
        return float(np.sqrt((path[0, 0] - x) ** 2 + (path[0, 1] - y) ** 2))
    return float(rest + best)


@numba.njit(cache=True)
def first_conflicts(
    ahead: Array, x: float, y: float, bodies: Array, clearance: Array, step: float
) -> Array:
    """Arc length [m] at which each body comes too near on the way ``ahead``; inf: never.

    A body counts only if going on brings the robot nearer to it than it is now, so one that
    stands beside or behind is not in the way.

    Args:
        ahead: ``(P, 2)`` points of the way [m], ``step`` apart.
        x: where the robot is [m].
        y: where the robot is [m].
        bodies: ``(M, 2)`` [m].
        clearance: ``(M,)`` centre distances not to undercut [m].
        step: distance of the points [m].
    """
    arcs = np.full(len(bodies), np.inf)
    for j in range(len(bodies)):
        now = np.sqrt((bodies[j, 0] - x) ** 2 + (bodies[j, 1] - y) ** 2)
        for k in range(len(ahead)):
            distance = np.sqrt(
                (bodies[j, 0] - ahead[k, 0]) ** 2 + (bodies[j, 1] - ahead[k, 1]) ** 2
            )
            if distance < clearance[j] and distance < now - 0.03:
                arcs[j] = k * step
                break
    return arcs
