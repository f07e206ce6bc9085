"""Since when robots have been standing where they are, from motion alone."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from mrta_falsify.core.arrays import Array, BoolArray
from mrta_falsify.core.compiled import njit
from mrta_falsify.specs.deadlock.standstill import SPOT_RADIUS

TRAIL_STEP = 0.5 * SPOT_RADIUS  # m between two places of a trail
TRAIL_PLACES = 16  # kept per robot; eight times what leads out of the spot on a straight way
SHOVED_FOR = 0.5  # s after a touch in which motion may still come from it


@dataclass(slots=True)
class Halts:
    """The last places of each of N robots, and since when each was at them.

    A robot that is touched may be shoved. What it moves then, and until it has rolled out, is
    not its own motion: its trail moves along.
    """

    robots: int
    _trail: Array = field(init=False)  #: (N, P, 3) time [s], x [m], y [m]; the newest first
    _last: Array = field(init=False)  #: (N, 2) where each was at the last tick [m]
    _touched: Array = field(init=False)  #: (N,) last time each was touched [s]

    def __post_init__(self) -> None:
        self._trail = np.full((self.robots, TRAIL_PLACES, 3), np.inf)
        self._last = np.full((self.robots, 2), np.nan)
        self._touched = np.full(self.robots, -np.inf)

    def update(self, pose: Array, contact: BoolArray, time: float) -> None:
        """Take in a tick.

        Args:
            pose: ``(N, 3)`` [m, m, rad].
            contact: ``(N, 3)`` touched a robot, a person, a solid.
            time: [s].
        """
        _fill_trail(pose, contact, time, self._trail, self._last, self._touched)

    def may_be_shoved(self, robot: int, time: float) -> bool:
        """Whether what ``robot`` does at ``time`` [s] may come from a touch."""
        return bool(time - self._touched[robot] <= SHOVED_FOR)

    def since(self, robot: int) -> float:
        """Find since when ``robot`` has been within 0.1 m of where it is now [s]."""
        places = self._trail[robot]
        away = np.hypot(*(places[:, 1:] - self._last[robot]).T)
        left = np.flatnonzero(~(away <= SPOT_RADIUS))
        newest_outside = int(left[0]) if len(left) else TRAIL_PLACES
        return float(places[max(newest_outside - 1, 0), 0])


@njit(cache=True)
def _fill_trail(
    pose: Array, contact: BoolArray, time: float, trail: Array, last: Array, touched: Array
) -> None:
    for i in range(len(pose)):
        x, y = pose[i, 0], pose[i, 1]
        if contact[i, 0] or contact[i, 1] or contact[i, 2]:
            touched[i] = time
        if time - touched[i] <= SHOVED_FOR:
            trail[i, :, 1] += x - last[i, 0]
            trail[i, :, 2] += y - last[i, 1]
        last[i, 0], last[i, 1] = x, y
        dx, dy = x - trail[i, 0, 1], y - trail[i, 0, 2]
        if not dx * dx + dy * dy <= TRAIL_STEP * TRAIL_STEP:
            trail[i, 1:] = trail[i, :-1].copy()
            trail[i, 0, 0], trail[i, 0, 1], trail[i, 0, 2] = time, x, y
