"""Every robot's way ahead at one tick: what is left of its path, and the point to steer for."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mrta_falsify.core.arrays import Array
from mrta_falsify.stack.planning_service import NO_POINTS, Way, cut_path, look_along

LOOK_AHEAD = 0.5  # m, MRTA-Sim


@dataclass(slots=True)
class Views:
    """Every robot's way ahead at one tick."""

    rest: list[Array]  #: N polylines (L, 2) [m], empty: none
    target: Array  #: (N, 2) point to steer for [m], nan: none
    length: Array  #: (N,) of ``rest`` [m], inf: none

    def shorten(self, robot: int, limit: float, pose: Array) -> None:
        """Let the way of ``robot`` end after ``limit`` [m]."""
        if limit >= self.length[robot]:
            return
        rest = cut_path(self.rest[robot], limit)
        self.rest[robot], x, y, self.length[robot] = look_along(rest, pose[0], pose[1], LOOK_AHEAD)
        self.target[robot] = x, y


@dataclass(slots=True, eq=False)
class _Sight:
    """What was seen of one path from one place."""

    path: Array
    x: float
    y: float
    rest: Array
    target: tuple[float, float]
    length: float


NOTHING = _Sight(NO_POINTS, math.nan, math.nan, NO_POINTS, (math.nan, math.nan), math.inf)


class Outlook:
    """Looks along the robots' paths; a robot that stands still is not looked for again."""

    def __init__(self, robots: int) -> None:
        self._last = [NOTHING] * robots

    def views(self, ways: Sequence[Way], pose: Array) -> Views:
        """Ways ahead of all robots at ``pose`` ``(N, 3)``."""
        sights = [
            self._look(robot, way.path, x, y) if len(way.path) and len(way.route) else NOTHING
            for robot, (way, (x, y, _)) in enumerate(zip(ways, pose.tolist(), strict=True))
        ]
        return Views(
            rest=[sight.rest for sight in sights],
            target=np.array([sight.target for sight in sights]).reshape(-1, 2),
            length=np.array([sight.length for sight in sights]),
        )

    def _look(self, robot: int, path: Array, x: float, y: float) -> _Sight:
        last = self._last[robot]
        if last.path is not path or last.x != x or last.y != y:
            rest, target_x, target_y, length = look_along(path, x, y, LOOK_AHEAD)
            last = _Sight(path, x, y, rest, (target_x, target_y), length)
            self._last[robot] = last
        return last
