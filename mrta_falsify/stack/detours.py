"""What a path leads around, if it can: rooms not held, and gaps that the controller shuns.

The planner takes a robot for a disc of its planning radius; a barrier keeps it farther from solids.
"""

from __future__ import annotations

import functools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from mrta_falsify.core.arrays import Array, ByteArray, IntArray
from mrta_falsify.core.compiled import njit
from mrta_falsify.core.costmap import INSCRIBED, LETHAL, Costmap, cell_at
from mrta_falsify.core.plane import inside, is_within

KEPT_MAPS = 4
NARROW = 0.6  # m between solids, twice what the barrier keeps from one
NEAR_END = 0.6  # m, so near to its ends a path may be as narrow as it likes


@dataclass(frozen=True, slots=True)
class Closed:
    """What a path must not lead through."""

    rooms: frozenset[int] = frozenset()
    gaps: frozenset[tuple[int, int]] = frozenset()  #: cells (row, col) in the middle

    def __or__(self, other: Closed) -> Closed:
        return Closed(self.rooms | other.rooms, self.gaps | other.gaps)

    def __le__(self, other: Closed) -> bool:
        return self.rooms <= other.rooms and self.gaps <= other.gaps


class Detours:
    """Rooms and gaps on the way; remembers maps, which only saves work.

    Args:
        outlines: ``(V, 2)`` [m] of rooms that robots must ask for; empty: not a room.
    """

    def __init__(self, outlines: Sequence[Array]) -> None:
        self._outlines = outlines
        #: the map on which no path leads through what is closed
        self.map_without = functools.lru_cache(maxsize=KEPT_MAPS)(self._map_without)

    def rooms(self, path: Array, ends: Array, rooms: Iterable[int]) -> Closed:
        """List the rooms that a path enters and that none of its ends is in.

        Args:
            path: ``(L, 2)`` [m].
            ends: ``(E, 2)`` the robot and the waypoints of its route [m].
            rooms: numbers of those that count.
        """
        return Closed(
            rooms=frozenset(
                room
                for room in rooms
                if _any_inside(self._outlines[room], path)
                and not _any_inside(self._outlines[room], ends)
            )
        )

    def gaps(self, costmap: Costmap, path: Array, ends: Array) -> Closed:
        """List the gaps narrower than NARROW that a path leads through, not near its ends.

        Args:
            costmap: which cells are solid; so is all outside it.
            path: ``(L, 2)`` [m].
            ends: ``(E, 2)`` as in :meth:`rooms` [m].
        """
        res, (west, south) = costmap.resolution, costmap.origin
        cells = _gaps(costmap.cost, res, west, south, path, ends)
        return Closed(gaps=frozenset(zip(cells[:, 0].tolist(), cells[:, 1].tolist(), strict=True)))

    def _map_without(self, costmap: Costmap, closed: Closed) -> Costmap:
        cost = costmap.cost.copy()
        for room in sorted(closed.rooms):
            _close(cost, (self._outlines[room] - costmap.origin) / costmap.resolution)
        for row, col in sorted(closed.gaps):
            _close_disc(cost, row, col, 0.5 * NARROW / costmap.resolution)
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


@njit(cache=True)
def _close_disc(cost: ByteArray, row: int, col: int, radius: float) -> None:
    """Let nobody enter the cells that are at most ``radius`` cells away."""
    reach = int(radius)
    for i in range(max(0, row - reach), min(cost.shape[0], row + reach + 1)):
        for k in range(max(0, col - reach), min(cost.shape[1], col + reach + 1)):
            if (i - row) ** 2 + (k - col) ** 2 <= radius * radius:
                cost[i, k] = max(cost[i, k], np.uint8(INSCRIBED))


@njit(cache=True)
def _gaps(
    cost: ByteArray, resolution: float, west: float, south: float, path: Array, ends: Array
) -> IntArray:
    """Find the cells ``(K, 2)`` of ``path`` ``(L, 2)`` [m] with solids close by on both sides."""
    found, count = np.empty((16, 2), dtype=np.int64), 0
    point = np.empty(2)
    for i in range(path.shape[0] - 1):
        dx, dy = path[i + 1, 0] - path[i, 0], path[i + 1, 1] - path[i, 1]
        steps = max(1, int(np.ceil(np.hypot(dx, dy) / resolution)))
        for k in range(steps):
            point[0], point[1] = path[i, 0] + dx * k / steps, path[i, 1] + dy * k / steps
            row, col = cell_at(point[0], point[1], cost, resolution, west, south)
            if row < 0:
                continue
            is_new = count == 0 or row != found[count - 1, 0] or col != found[count - 1, 1]
            if (
                is_new
                and _is_narrow(cost, row, col, dx, dy, NARROW / resolution)
                and not is_within(ends, point, NEAR_END)
            ):
                if count == found.shape[0]:
                    found = np.concatenate((found, np.empty_like(found)))
                found[count, 0], found[count, 1] = row, col
                count += 1
    return found[:count]


@njit(cache=True)
def _is_narrow(cost: ByteArray, row: int, col: int, dx: float, dy: float, width: float) -> bool:
    """Whether solids on the left and on the right of a cell are less than ``width`` cells apart.

    Left and right are those of the direction ``(dx, dy)``.
    """
    reach = int(width)
    left, right = np.inf, np.inf
    left_row, left_col, right_row, right_col = 0, 0, 0, 0
    for i in range(row - reach, row + reach + 1):
        for k in range(col - reach, col + reach + 1):
            is_on_map = 0 <= i < cost.shape[0] and 0 <= k < cost.shape[1]
            if is_on_map and cost[i, k] != LETHAL:
                continue
            distance = np.hypot(i - row, k - col)
            side = dx * (i - row) - dy * (k - col)
            if side > 0.0 and distance < left:
                left, left_row, left_col = distance, i - row, k - col
            if side < 0.0 and distance < right:
                right, right_row, right_col = distance, i - row, k - col
    opposite = left_row * right_row + left_col * right_col < 0
    return bool(opposite and left + right < width)
