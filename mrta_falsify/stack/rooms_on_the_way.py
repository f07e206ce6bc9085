"""Rooms that a path leads through, and maps without them.

Whoever does not hold a room takes another way, if there is one.
"""

from __future__ import annotations

import functools
from collections.abc import Iterable, Sequence

import numpy as np

from mrta_falsify.core.arrays import Array, ByteArray
from mrta_falsify.core.compiled import njit
from mrta_falsify.core.costmap import INSCRIBED, Costmap
from mrta_falsify.core.plane import inside

KEPT_MAPS = 4


class RoomsOnTheWay:
    """Outlines of rooms that robots must ask for; remembers maps, which only saves work.

    Args:
        outlines: ``(V, 2)`` [m] each; empty: not a room.
    """

    def __init__(self, outlines: Sequence[Array]) -> None:
        self._outlines = outlines
        #: the map on which no path enters the rooms
        self.map_without = functools.lru_cache(maxsize=KEPT_MAPS)(self._map_without)

    def entered(self, path: Array, ends: Array, rooms: Iterable[int]) -> frozenset[int]:
        """List the rooms that ``path`` ``(L, 2)`` enters and that none of the ``ends`` is in."""
        return frozenset(
            room
            for room in rooms
            if _any_inside(self._outlines[room], path)
            and not _any_inside(self._outlines[room], ends)
        )

    def _map_without(self, costmap: Costmap, rooms: frozenset[int]) -> Costmap:
        cost = costmap.cost.copy()
        for room in sorted(rooms):
            _close(cost, (self._outlines[room] - costmap.origin) / costmap.resolution)
        cost.setflags(write=False)
        return Costmap(cost, costmap.resolution, costmap.origin)


@njit(cache=True)
def _any_inside(outline: Array, points: Array) -> bool:
    found = False
    for i in range(points.shape[0]):
        found = found or inside(outline, points[i])
    return found


@njit(cache=True)
def _close(cost: ByteArray, outline: Array) -> None:
    """Let nobody enter the cells whose centre lies in an outline ``(V, 2)`` given in cells."""
    rows, cols = cost.shape
    center = np.empty(2)
    for row in range(max(0, int(outline[:, 1].min())), min(rows, int(outline[:, 1].max()) + 1)):
        for col in range(max(0, int(outline[:, 0].min())), min(cols, int(outline[:, 0].max()) + 1)):
            center[0], center[1] = col + 0.5, row + 0.5
            if inside(outline, center):
                cost[row, col] = max(cost[row, col], np.uint8(INSCRIBED))
