"""When each robot made progress last."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.compiled import njit

HEADWAY = 0.2  # m, moving this far counts as progress


@dataclass(frozen=True, slots=True, eq=False)
class Headway:
    """What is remembered of the progress of N robots; written in place."""

    anchor: Array  #: (N, 2) where each made progress last [m]
    moved_at: Array  #: (N,) last time it was HEADWAY away from where it was [s]

    @classmethod
    def of_fleet(cls, robots: int) -> Headway:
        """Begin with ``robots`` that have not been seen yet."""
        return cls(np.full((robots, 2), np.inf), np.zeros(robots))

    def note(self, pose: Array, time: float) -> None:
        """Take in where the robots are at ``time`` [s]; ``pose`` is ``(N, 3)``."""
        _fill_headway(self.anchor, self.moved_at, pose, time)

    def forget(self, robot: int) -> None:
        """Take a robot for one that has not been seen yet."""
        self.anchor[robot], self.moved_at[robot] = np.inf, 0.0


@njit(cache=True)
def _fill_headway(anchor: Array, moved_at: Array, pose: Array, time: float) -> None:
    for i in range(pose.shape[0]):
        dx, dy = pose[i, 0] - anchor[i, 0], pose[i, 1] - anchor[i, 1]
        if not dx * dx + dy * dy <= HEADWAY * HEADWAY:
            anchor[i, 0], anchor[i, 1] = pose[i, 0], pose[i, 1]
            moved_at[i] = time
