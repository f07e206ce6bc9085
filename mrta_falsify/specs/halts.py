"""Since when robots have been standing where they are, from motion alone."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from mrta_falsify.core.arrays import Array, BoolArray
from mrta_falsify.core.compiled import njit

#: m; a robot that stays this near is still at its place. Robots that load step back from people:
#: by 0.2 m when two walk through one at 1 m/s.
PLACE_RADIUS = 0.5
STOPPED = 0.15  # m/s; stacks load from 0.1 m/s along each axis on, which is 0.14 m/s in all
TRAIL_STEP = 0.5 * PLACE_RADIUS  # m between two points of a trail
TRAIL_POINTS = 16  # kept per robot; five times what leads out of a place on a straight way
SHOVED_FOR = 0.5  # s after a touch in which motion may still come from it


class _Trails(NamedTuple):
    """What is remembered of each robot's places."""

    trail: Array  #: (N, P, 3)
    last: Array  #: (N, 2)
    touched: Array  #: (N,)


@dataclass(slots=True)
class Halts:
    """The last places of each of N robots, and when each came to rest there.

    A robot that is touched may be shoved. What it moves then, and until it has rolled out, is
    not its own motion: its trail moves along.
    """

    robots: int
    _trail: Array = field(init=False)  #: (N, P, 3) x, y [m], first stop there [s]; newest first
    _last: Array = field(init=False)  #: (N, 2) where each was at the last tick [m]
    _touched: Array = field(init=False)  #: (N,) last time each was touched [s]
    _trails: _Trails = field(init=False)  #: the three of them
    _before: float = (
        0.0  #: time of the last tick [s]; who rests now may have stopped right after it
    )

    def __post_init__(self) -> None:
        self._trail = np.full((self.robots, TRAIL_POINTS, 3), np.inf)
        self._last = np.full((self.robots, 2), np.nan)
        self._touched = np.full(self.robots, -np.inf)
        self._trails = _Trails(self._trail, self._last, self._touched)

    def update(self, pose: Array, velocity: Array, contact: BoolArray, time: float) -> None:
        """Take in a tick.

        Args:
            pose: ``(N, 3)`` [m, m, rad].
            velocity: ``(N, 2)`` forward and left [m/s].
            contact: ``(N, 3)`` touched a robot, a person, a solid.
            time: [s].
        """
        _fill_trail(self._trails, pose, velocity, contact, time, self._before)
        self._before = time

    def may_be_shoved(self, robot: int, time: float) -> bool:
        """Whether what ``robot`` does at ``time`` [s] may come from a touch."""
        return bool(time - self._touched[robot] <= SHOVED_FOR)

    def since(self, robot: int) -> float:
        """Find when ``robot`` came to rest at the place where it still is [s], inf: it has not."""
        points = self._trail[robot]
        away = np.hypot(*(points[:, :2] - self._last[robot]).T)
        left = np.flatnonzero(~(away <= PLACE_RADIUS))
        here = points[: int(left[0]) if len(left) else TRAIL_POINTS]
        return float(here[:, 2].min(initial=np.inf))


@njit(cache=True)
def _fill_trail(
    trails: _Trails, pose: Array, velocity: Array, contact: BoolArray, time: float, before: float
) -> None:
    """Bring trails to ``time`` [s]; the last tick was at ``before`` [s]."""
    trail, last, touched = trails.trail, trails.last, trails.touched
    for i in range(len(pose)):
        if contact[i, 0] or contact[i, 1] or contact[i, 2]:
            touched[i] = time
        x, y = pose[i, 0], pose[i, 1]
        if time - touched[i] <= SHOVED_FOR:
            trail[i, :, 0] += x - last[i, 0]
            trail[i, :, 1] += y - last[i, 1]
        last[i, 0], last[i, 1] = x, y
        dx, dy = x - trail[i, 0, 0], y - trail[i, 0, 1]
        if not dx * dx + dy * dy <= TRAIL_STEP * TRAIL_STEP:
            trail[i, 1:] = trail[i, :-1].copy()
            trail[i, 0, 0], trail[i, 0, 1], trail[i, 0, 2] = x, y, np.inf
        if np.hypot(velocity[i, 0], velocity[i, 1]) <= STOPPED:
            trail[i, 0, 2] = min(trail[i, 0, 2], before)
