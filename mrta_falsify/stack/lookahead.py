"""Every robot's way ahead at one tick: what is left of its path, and the point to steer for."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.plane import NO_POINTS
from mrta_falsify.core.polyline import cut_path, look_along
from mrta_falsify.stack.route import LOOK_AHEAD, Way


@dataclass(frozen=True, slots=True, eq=False)
class Views:
    """Every robot's way ahead at one tick."""

    rest: Sequence[Array]  #: N polylines (L, 2) [m], empty: none
    target: Array  #: (N, 2) point to steer for [m], nan: none
    length: Array  #: (N,) of ``rest`` [m], inf: none

    def shortened(self, limits: Mapping[int, float], pose: Array) -> Views:
        """End the ways of some robots after their limits [m]; ``pose`` is ``(N, 3)``."""
        cut = [
            robot
            for robot, limit in limits.items()
            if len(self.rest[robot]) and limit < self.length[robot]
        ]
        if not cut:
            return self
        rest, target, length = list(self.rest), self.target.copy(), self.length.copy()
        for robot in cut:
            kept = cut_path(rest[robot], limits[robot])
            x, y = pose[robot, 0], pose[robot, 1]
            rest[robot], *aim, length[robot] = look_along(kept, x, y, LOOK_AHEAD)
            target[robot] = aim
        return Views(rest, target, length)


@dataclass(frozen=True, slots=True, eq=False)
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
    """Looks along the robots' paths, and remembers what a robot saw that stands still."""

    def __init__(self, robots: int) -> None:
        self._last = [NOTHING] * robots

    def views(self, ways: Sequence[Way], pose: Array) -> Views:
        """Look along the paths of all robots from ``pose`` ``(N, 3)``."""
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
