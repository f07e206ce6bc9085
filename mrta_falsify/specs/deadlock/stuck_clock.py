"""Since when has a robot been stuck?"""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from mrta_falsify.core.arrays import Array
from mrta_falsify.specs.deadlock.blocked_by import STANDS_AFTER

REOPENED_FOR = 0.6  # s a robot may look free before its time of being stuck starts anew
#: shuffling, a new path or a turn on the spot does not start a robot's time of shuffling anew
SHUFFLE_RADIUS = 0.3  # m
SHUFFLE_FREE_FOR = 4.0  # s of looking free


class StuckClock:
    """Clock of the times since which robots have been stuck; one object per episode.

    Args:
        robots: number of robots.
    """

    def __init__(self, robots: int) -> None:
        self._since = np.full(robots, np.inf)
        self._last = np.full(robots, -np.inf)
        self._shuffles_since = np.full(robots, np.inf)
        self._shuffles_at = np.full((robots, 2), np.inf)

    def update(self, stuck: Collection[int], position: Array, time: float) -> None:
        """Take in who is stuck, and where, ``(N, 2)`` [m], at ``time`` [s]."""
        for i in stuck:
            free_for = time - self._last[i]
            if free_for > REOPENED_FOR:
                self._since[i] = time
            moved = not np.hypot(*(position[i] - self._shuffles_at[i])) <= SHUFFLE_RADIUS
            if moved or free_for > SHUFFLE_FREE_FOR:
                self._shuffles_since[i], self._shuffles_at[i] = time, position[i]
            self._last[i] = time

    def stuck_for(self, time: float) -> Array:
        """Tell for how long each robot has been stuck, ``(N,)`` [s]; -inf: never was."""
        return np.asarray(time - self._since + STANDS_AFTER)

    def shuffled_for(self, members: Collection[int], time: float) -> float:
        """Tell for how long all ``members`` have been stuck on the spot, shuffling or not [s]."""
        return time - float(self._shuffles_since[list(members)].max())

    def onset(self, members: Collection[int], stands_since: Array) -> float:
        """Find when the last of ``members`` stopped and began to wait for the others [s].

        Args:
            members: robots.
            stands_since: ``(N,)`` since when each robot stands on its spot [s].
        """
        chosen = list(members)
        since = self._since[chosen]
        began = since[np.isfinite(since)].max(initial=STANDS_AFTER) - STANDS_AFTER
        return float(max(stands_since[chosen].max(), began))
