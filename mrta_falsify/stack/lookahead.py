"""Every robot's way ahead at one tick: what is left of its path, and the point to steer for."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.plane import NO_POINTS
from mrta_falsify.core.polyline import cut_path, look_along
from mrta_falsify.stack.cruising import Cruise, look_ahead_of, pace_of
from mrta_falsify.stack.route import LOOK_AHEAD, Way


@dataclass(frozen=True, slots=True, eq=False)
class Views:
    """Every robot's way ahead at one tick."""

    rest: Sequence[Array]  #: N polylines (L, 2) [m], empty: none
    target: Array  #: (N, 2) point to steer for [m], nan: none
    length: Array  #: (N,) of ``rest`` [m], inf: none
    pace: Array  #: (N,) speed that the way ahead allows [m/s]
    cruise: Sequence[Cruise]  #: what the N robots do on a straight way

    def shortened(self, limits: Mapping[int, float], pose: Array) -> Views:
        """End the ways of some robots after their limits [m]; ``pose`` is ``(N, 3)``."""
        cut = [
            robot
            for robot, limit in limits.items()
            if len(self.rest[robot]) and limit < self.length[robot]
        ]
        if not cut:
            return self
        rest, target = list(self.rest), self.target.copy()
        length, pace = self.length.copy(), self.pace.copy()
        for robot in cut:
            kept = cut_path(rest[robot], limits[robot])
            x, y = pose[robot, 0], pose[robot, 1]
            sight = _see(kept, x, y, self.cruise[robot])
            rest[robot], target[robot] = sight.rest, sight.target
            length[robot], pace[robot] = sight.length, sight.pace
        return Views(rest, target, length, pace, self.cruise)


@dataclass(frozen=True, slots=True, eq=False)
class _Sight:
    """What was seen of one path from one place."""

    path: Array
    x: float
    y: float
    rest: Array
    target: tuple[float, float]
    length: float
    pace: float


NOTHING = _Sight(NO_POINTS, math.nan, math.nan, NO_POINTS, (math.nan, math.nan), math.inf, 0.0)


def _see(path: Array, x: float, y: float, cruise: Cruise) -> _Sight:
    """Look along a path ``(L, 2)`` [m] from (x, y) [m]: the faster the way, the farther ahead."""
    rest, target_x, target_y, length = look_along(path, x, y, LOOK_AHEAD)
    pace = pace_of(rest, x, y, cruise)
    ahead = look_ahead_of(pace)
    if ahead > LOOK_AHEAD:
        _, target_x, target_y, _ = look_along(path, x, y, ahead)
    return _Sight(path, x, y, rest, (target_x, target_y), length, pace)


class Outlook:
    """Looks along the robots' paths, and remembers what a robot saw that stands still."""

    def __init__(self, cruise: Sequence[Cruise]) -> None:
        """Look for robots that drive as ``cruise`` says on a straight way."""
        self._cruise = tuple(cruise)
        self._last = [NOTHING] * len(self._cruise)

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
            pace=np.array([sight.pace for sight in sights]),
            cruise=self._cruise,
        )

    def _look(self, robot: int, path: Array, x: float, y: float) -> _Sight:
        last = self._last[robot]
        if last.path is not path or last.x != x or last.y != y:
            last = _see(path, x, y, self._cruise[robot])
            self._last[robot] = last
        return last
