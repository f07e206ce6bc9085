"""Where a robot may stand for long without closing the only way between two rooms.

The map is that of time 0. It does not follow people, blockages that come later, or other robots.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from mrta_falsify.core.arrays import Array, BoolArray, IntArray
from mrta_falsify.core.compiled import njit
from mrta_falsify.core.costmap import INSCRIBED, Costmap
from mrta_falsify.core.plane import inside
from mrta_falsify.core.world import World

APART = 0.6  # m between robots, centre to centre, as far as controllers keep them from each other
OFF_WAY = 0.8  # m between a place to stand and a way, so that who drives there has room
AT_ROOM = 1.0  # m from a room's point: a robot that comes so near can get there
LATTICE = 0.5  # m between the places that are tried
MAX_TRIED = 100  # places that are judged in one search; each takes 0.1 to 4 ms
DETOUR = 0.6  # m around a robot in which a way past it is looked for before the whole map is
BLOCK = 4  # cells along a side of the blocks that wide ways are looked for in
SAME_PLACE = 0.1  # m; stands are rounded to this before they are judged


class ClearWays:
    """Judges places to stand; remembers only to save work.

    Args:
        world: rooms, lanes and resources.
        costmap: of time 0, without robots.
    """

    def __init__(self, world: World, costmap: Costmap) -> None:
        self._world = world
        self._map = costmap
        self._free: BoolArray = costmap.cost < INSCRIBED
        self._areas = [resource.release_area for resource in world.resources]
        self._points = np.array([room.point for room in world.rooms]).reshape(-1, 2)
        self._near_rooms = [self._disc(point, AT_ROOM) for point in self._points]
        self._is_near_room = np.zeros(self._free.shape, dtype=np.bool_)
        for near in self._near_rooms:
            self._is_near_room[near] = True
        self._blocks = _free_blocks(self._free)
        self._parts = _numbered_parts(self._free)
        self._at_rooms = self._parts_at_rooms(self._parts, self._free)
        self._joined = self._joined_pairs(self._at_rooms)
        self._known: dict[bytes, bool] = {}

    def leaves_open(self, stands: Array) -> bool:
        """Whether all rooms stay joined as they are with robots at ``stands`` ``(K, 2)`` [m]."""
        places = np.round(np.asarray(stands) / SAME_PLACE) * SAME_PLACE
        key = places.tobytes()
        if key not in self._known:
            self._known[key] = self._stay_joined(places)
        return self._known[key]

    def _stay_joined(self, places: Array) -> bool:
        free, blocks, can_be_passed = self._free.copy(), self._blocks.copy(), True
        for place in places:
            rows, cols = self._disc(place, APART)
            blocks[rows // BLOCK, cols // BLOCK] = False
            can_be_passed = can_be_passed and self._can_be_passed(free, blocks, place, rows, cols)
            free[rows, cols] = False
        if can_be_passed and all(
            self._parts_near(room, self._parts, free) == self._at_rooms[room]
            for room in np.flatnonzero(_gaps(self._points, places) <= AT_ROOM + APART).tolist()
        ):
            return True  # no part of the map falls apart, and each room has those that it had
        parts = _numbered_parts(free)
        return self._joined <= self._joined_pairs(self._parts_at_rooms(parts, free))

    def places_near(
        self, start: Array, *, beside: Array, off: Array, stands: Sequence[Array] = (), count: int
    ) -> list[Array]:
        """Find places to stand, the nearest by way first; those off the lanes before others.

        Args:
            start: ``(2,)`` [m] from which ways are measured.
            beside: ``(K, 2)`` robots, and where they drive to [m].
            off: ``(L, 2)`` points to keep clear of, for example of a way [m].
            stands: places ``(2,)`` [m] whose robots must leave the ways open together with the
                new ones.
            count: places at most.
        """
        candidates = self._lattice(start)
        is_clear = _gaps(candidates, np.vstack([self._points, beside])) >= APART
        is_clear &= _gaps(candidates, off) >= OFF_WAY
        is_clear &= ~np.array([self._is_guarded(place) for place in candidates], dtype=np.bool_)
        is_off = self._gaps_to_lanes(candidates) >= OFF_WAY
        found: list[Array] = []
        tried = (*candidates[is_clear & is_off], *candidates[is_clear & ~is_off])
        for place in tried[:MAX_TRIED]:
            if len(found) >= count:
                break
            together = np.array([*stands, *found, place])
            if _gaps(place[None, :], together[:-1])[0] >= APART and self.leaves_open(together):
                found.append(place)
        return found

    def _is_guarded(self, place: Array) -> bool:
        return any(inside(area, place) for area in self._areas)

    # --- the map ------------------------------------------------------------------------------

    def _disc(self, point: Array, radius: float) -> tuple[IntArray, IntArray]:
        """List the cells (rows, cols) whose centres are within ``radius`` [m] of ``point``."""
        low = np.maximum(self._map.cells(point - radius), 0)
        high = np.minimum(self._map.cells(point + radius) + 1, self._free.shape)
        high = np.maximum(high, low)
        x, y = self._map.axes(low, high)
        rows, cols = np.nonzero(np.hypot(x - point[0], (y - point[1])[:, None]) <= radius)
        return rows + low[0], cols + low[1]

    def _can_be_passed(
        self, free: BoolArray, blocks: BoolArray, place: Array, rows: IntArray, cols: IntArray
    ) -> bool:
        """Whether what is joined over ``free`` stays so without cells (rows, cols) of a place.

        Ways past the place are looked for around it, then over ``blocks`` that are wholly free
        without those cells. True is certain, False is not.
        """
        reach = APART + DETOUR
        low = np.maximum(self._map.cells(place - reach), 0)
        high = np.minimum(self._map.cells(place + reach) + 1, free.shape)
        if (high <= low).any():
            return True
        before = free[low[0] : high[0], low[1] : high[1]]
        after = before.copy()
        after[rows - low[0], cols - low[1]] = False
        matter = self._is_near_room[low[0] : high[0], low[1] : high[1]]
        if _stays_whole(before, after, np.zeros_like(before, dtype=np.int64), matter):
            return True
        rows, cols = np.arange(low[0], high[0]) // BLOCK, np.arange(low[1], high[1]) // BLOCK
        return bool(
            _stays_whole(before, after, _numbered_parts(blocks)[np.ix_(rows, cols)], matter)
        )

    def _parts_near(self, room: int, parts: IntArray, free: BoolArray) -> set[int]:
        """Find the parts of the map that are free near a room."""
        near = self._near_rooms[room]
        return set(parts[near][free[near]].tolist())

    def _parts_at_rooms(self, parts: IntArray, free: BoolArray) -> list[set[int]]:
        return [self._parts_near(room, parts, free) for room in range(len(self._points))]

    @staticmethod
    def _joined_pairs(at_rooms: Sequence[set[int]]) -> set[tuple[int, int]]:
        """Find the pairs of rooms between which there is a way, by the parts near each."""
        return {
            (i, k)
            for i, own in enumerate(at_rooms)
            for k in range(i)
            if not own.isdisjoint(at_rooms[k])
        }

    def _lattice(self, start: Array) -> Array:
        """List free points ``(C, 2)`` [m] that a way from ``start`` leads to, the nearest first."""
        stride = max(1, round(LATTICE / self._map.resolution))
        rows, cols = self._disc(start, AT_ROOM)
        is_free = self._free[rows, cols]
        if not is_free.any():
            return np.zeros((0, 2))
        cells = np.stack([rows, cols], axis=-1)[is_free]
        gaps = np.hypot(*(self._map.centers(cells) - start).T)
        row, col = cells[int(np.argmin(gaps))].tolist()
        steps = _steps_from(self._free, row, col)[::stride, ::stride]
        rows, cols = np.nonzero(steps >= 0)
        order = np.argsort(steps[rows, cols], kind="stable")
        return self._map.centers(np.stack([rows, cols], axis=-1)[order] * stride)

    def _gaps_to_lanes(self, points: Array) -> Array:
        """Measure the distances ``(C,)`` [m] of ``points`` from the nearest lane."""
        gaps = np.full(len(points), np.inf)
        for lane in self._world.lanes:
            for corners in (lane.to_queue, lane.to_room):
                for a, b in itertools.pairwise(corners):
                    leg = b - a
                    share = np.clip((points - a) @ leg / max(float(leg @ leg), 1e-12), 0.0, 1.0)
                    gaps = np.minimum(gaps, np.hypot(*(a + share[:, None] * leg - points).T))
        return gaps


def _gaps(points: Array, others: Array) -> Array:
    """Measure how far each of ``points`` ``(C, 2)`` is from the nearest other [m]; inf: none."""
    if not len(others):
        return np.full(len(points), np.inf)
    return np.asarray(np.hypot(*(points[:, None] - others[None]).transpose(2, 0, 1)).min(axis=1))


@njit(cache=True)
def _stays_whole(free: BoolArray, left: BoolArray, wide: IntArray, matter: BoolArray) -> bool:
    """Whether cells of one part of a window of which some are ``left`` are still joined.

    Args:
        free: ``(rows, cols)`` before.
        left: the same, after.
        wide: part of the whole map that a cell is joined to, 0: none.
        matter: cells that must stay joined. So must those at the rim, where ways lead on.
    """
    before, after = _numbered_parts(free), _numbered_parts(left)
    rows, cols = before.shape
    most = after.max() + 1
    counts, joined = np.zeros(most, dtype=np.bool_), -np.arange(most)
    for row in range(rows):
        for col in range(cols):
            now = after[row, col]
            is_rim = row == 0 or row == rows - 1 or col == 0 or col == cols - 1
            counts[now] = counts[now] or is_rim or matter[row, col]
            if wide[row, col] > 0:
                joined[now] = wide[row, col]
    part = np.zeros(before.max() + 1, dtype=np.int64)
    for row in range(rows):
        for col in range(cols):
            own, now = before[row, col], after[row, col]
            if now == 0 or not counts[now] or part[own] == joined[now]:
                continue
            if part[own] != 0:
                return False
            part[own] = joined[now]
    return True


@njit(cache=True)
def _free_blocks(free: BoolArray) -> BoolArray:
    """Say which blocks of cells are wholly free; those that reach beyond the map are not."""
    rows, cols = free.shape
    blocks = np.ones(((rows - 1) // BLOCK + 1, (cols - 1) // BLOCK + 1), dtype=np.bool_)
    for row in range(blocks.shape[0] * BLOCK):
        for col in range(blocks.shape[1] * BLOCK):
            if row >= rows or col >= cols or not free[row, col]:
                blocks[row // BLOCK, col // BLOCK] = False
    return blocks


@njit(cache=True)
def _numbered_parts(free: BoolArray) -> IntArray:
    """Number the parts of a map that hang together by sides, from 1; 0: cells not free.

    Two passes over the cells, with numbers joined in between (Rosenfeld & Pfaltz, 1966).
    """
    rows, cols = free.shape
    part = np.zeros((rows, cols), dtype=np.int64)
    same = np.zeros(rows * cols // 2 + 2, dtype=np.int64)  # a smaller number of the same part
    count = 0
    for row in range(rows):
        for col in range(cols):
            if not free[row, col]:
                continue
            below = part[row - 1, col] if row else 0
            left = part[row, col - 1] if col else 0
            if below and left and below != left:
                _fill_joined(same, below, left)
            own = below or left
            if not own:
                count += 1
                own = same[count] = count
            part[row, col] = own
    found = 0
    for number in range(1, count + 1):
        if same[number] == number:
            found += 1
            same[number] = found
        else:
            same[number] = same[same[number]]
    for row in range(rows):
        for col in range(cols):
            part[row, col] = same[part[row, col]]
    return part


@njit(cache=True)
def _fill_joined(same: IntArray, one: int, other: int) -> None:
    """Note that two numbers are of one part, the smallest one of which stands for it."""
    while same[one] != one:
        one = same[one]
    while same[other] != other:
        other = same[other]
    same[max(one, other)] = min(one, other)


@njit(cache=True)
def _steps_from(free: BoolArray, row: int, col: int) -> IntArray:
    """Count the steps from a cell to every free one, over side neighbours; -1: out of reach."""
    rows, cols = free.shape
    steps = np.full((rows, cols), -1, dtype=np.int64)
    queue = np.empty((rows * cols + 1, 2), dtype=np.int64)
    queue[0, 0], queue[0, 1] = row, col
    steps[row, col] = 0
    first, last = 0, 1
    while first < last:
        r, c = queue[first]
        first += 1
        for k in range(4):
            i = r + (k == 0) - (k == 1)
            j = c + (k == 2) - (k == 3)
            if 0 <= i < rows and 0 <= j < cols and free[i, j] and steps[i, j] < 0:
                steps[i, j] = steps[r, c] + 1
                queue[last, 0], queue[last, 1] = i, j
                last += 1
    return steps
