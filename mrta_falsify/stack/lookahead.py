"""Every robot's way ahead at one tick: what is left of its path, and the point to steer for."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mrta_falsify.core.arrays import Array, IntArray
from mrta_falsify.core.compiled import njit
from mrta_falsify.core.plane import NO_POINTS
from mrta_falsify.core.polyline import Polylines, cut_path, look_along
from mrta_falsify.stack.cruising import Cruise, look_ahead_of, pace_of
from mrta_falsify.stack.route import LOOK_AHEAD, Way


@dataclass(frozen=True, slots=True, eq=False)
class Views:
    """Every robot's way ahead at one tick."""

    rest: Polylines  #: N polylines (L, 2) [m], empty: none
    end: Array  #: (N, 2) of ``rest`` [m], nan: none
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
        rest, end, target = list(self.rest), self.end.copy(), self.target.copy()
        length, pace = self.length.copy(), self.pace.copy()
        for robot in cut:
            kept = cut_path(rest[robot], limits[robot])
            x, y = pose[robot, 0], pose[robot, 1]
            rest[robot], *seen = _see(kept, x, y, self.cruise[robot])
            target[robot, 0], target[robot, 1], length[robot], pace[robot] = seen
            end[robot] = rest[robot][-1]
        return replace(
            self, rest=Polylines.of(rest), end=end, target=target, length=length, pace=pace
        )


@njit(cache=True)
def _see(
    path: Array, x: float, y: float, cruise: Cruise
) -> tuple[Array, float, float, float, float]:
    """Look along a path ``(L, 2)`` [m] from (x, y) [m]: the faster the way, the farther ahead.

    Returns:
        What is left of the path; the point to steer for (x, y); the length that is left [m];
        the speed that it allows [m/s].
    """
    rest, target_x, target_y, length = look_along(path, x, y, LOOK_AHEAD)
    pace = pace_of(rest, x, y, cruise)
    ahead = look_ahead_of(pace)
    if ahead > LOOK_AHEAD:
        _, target_x, target_y, _ = look_along(path, x, y, ahead)
    return rest, target_x, target_y, length, pace


@njit(cache=True)
def _fill_views(
    paths: tuple[Array, IntArray],
    pose: Array,
    cruise: Array,
    rests: tuple[Array, IntArray],
    points: Array,
    figures: Array,
) -> None:
    """Look along all paths.

    Args:
        paths: points ``(sum L, 2)`` of all paths, one after the other, and where each begins
            ``(N + 1,)``.
        pose: ``(N, 3)``.
        cruise: ``(N, 2)`` the fields of each robot's :class:`Cruise`.
        rests: filled as ``paths`` are.
        points: ``(2, N, 2)`` filled with ends and points to steer for [m].
        figures: ``(2, N)`` filled with lengths [m] and paces [m/s].
    """
    path, first = paths
    rest, begins = rests
    points[:] = np.nan
    figures[0], figures[1] = np.inf, 0.0
    begins[0] = 0
    for i in range(pose.shape[0]):
        stop = begins[i]
        if first[i] < first[i + 1]:
            own = Cruise(cruise[i, 0], cruise[i, 1])
            ahead, x, y, length, pace = _see(
                path[first[i] : first[i + 1]], pose[i, 0], pose[i, 1], own
            )
            stop += ahead.shape[0]
            rest[begins[i] : stop] = ahead
            points[0, i] = ahead[-1]
            points[1, i, 0], points[1, i, 1] = x, y
            figures[0, i], figures[1, i] = length, pace
        begins[i + 1] = stop


class Outlook:
    """Looks along the robots' paths; keeps them packed for as long as the ways are the same."""

    def __init__(self, cruise: Sequence[Cruise]) -> None:
        """Look for robots that drive as ``cruise`` says on a straight way."""
        self._cruise = tuple(cruise)
        self._figures = np.array(cruise, dtype=np.float64).reshape(-1, 2)
        self._ways: list[Way] = []
        self._paths = Polylines.of([])

    def views(self, ways: list[Way], pose: Array) -> Views:
        """Look along the paths of all robots from ``pose`` ``(N, 3)``."""
        if ways != self._ways:  # by identity
            self._ways = list(ways)
            paths = [way.path if len(way.route) else NO_POINTS for way in ways]
            self._paths = Polylines.of(paths)
        n, path = len(ways), self._paths.points
        points, figures = np.empty((2, n, 2)), np.empty((2, n))
        rest, begins = np.empty(path.shape), np.empty(n + 1, dtype=np.int64)
        _fill_views((path, self._paths.first), pose, self._figures, (rest, begins), points, figures)
        return Views(
            rest=Polylines(rest, begins),
            end=points[0],
            target=points[1],
            length=figures[0],
            pace=figures[1],
            cruise=self._cruise,
        )
