"""Where a robot's body fits in a world: the oracle's own coarse map.

The oracle judges the stack, so it must not borrow the stack's costmap. It needs little: is
this spot inside a solid, and is there any way from here to there. A grid of 0.1 m does.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numba
import numpy as np
from numpy.typing import NDArray

from mrta_falsify.core.arrays import Array, BoolArray
from mrta_falsify.core.world import Blockage, Furniture, World

CELL = 0.1  # m
MOVED = 0.03  # m or rad; furniture that has moved less is not drawn anew
#: a cell is solid if its centre is this near to a solid [m]: less than any planner's clearance
#: (0.22 m) minus half a cell's diagonal, so that no valid path ever looks blocked
CLEARANCE = 0.15
START_REACH = 0.35  # m, a robot stands on any free cell this near
GOAL_REACH = 0.3  # m, the same at the goal

Owners = NDArray[np.int16]  #: (rows, cols) 0 free, else 1 + number of a solid


@dataclass(slots=True)
class FreeSpace:
    """Free cells of one world; the grid is built at the first question."""

    world: World
    cell: float = CELL  #: [m]
    clearance: float = CLEARANCE  #: of a cell's centre [m]
    names: tuple[str, ...] = ()  #: of walls, furniture, blockages; ``owner - 1`` indexes it
    _owner: Owners | None = None
    _blockages: tuple[tuple[Blockage, int], ...] = ()
    _active: tuple[int, ...] = ()
    _pieces: tuple[tuple[Furniture, int], ...] = ()
    _furniture_pose: Array | None = None  #: (F, 3) as far as told
    _drawn_pose: Array | None = None  #: (F, 3) as it is on ``_current``
    _current: Owners | None = None
    _origin: Array = field(default_factory=lambda: np.zeros(2))

    def furnish(self, poses: Array) -> None:
        """Say where the movable furniture stands; until then it is left out.

        Args:
            poses: ``(F, 3)`` centre x, y [m] and turn since the start [rad], in the world's
                order; other lengths say nothing.
        """
        if len(poses) and len(poses) == len(self.world.movable_furniture()):
            self._furniture_pose = poses

    def solid_at(self, points: Array, time: float) -> tuple[int, str]:
        """The first of ``points`` ``(L, 2)`` [m] inside a solid: its index and the solid's name.

        Returns:
            ``(-1, "")`` if all are free.
        """
        owner = self._grid(time)
        cells = np.floor((points - self._origin) / self.cell).astype(np.int64)
        rows, cols = owner.shape
        col, row = cells[:, 0], cells[:, 1]
        inside = (row >= 0) & (row < rows) & (col >= 0) & (col < cols)
        found = np.where(inside, owner[row.clip(0, rows - 1), col.clip(0, cols - 1)], 0)
        hits = np.flatnonzero(found)
        if not len(hits):
            return -1, ""
        return int(hits[0]), self.names[found[hits[0]] - 1]

    def reachable(
        self,
        start: Array,
        goal: Array,
        time: float,
        *,
        others: Array,
        gap: float,
        ignore_temporary: bool = False,
    ) -> bool:
        """Whether some way leads from ``start`` to ``goal``, both ``(2,)`` [m].

        Args:
            start: where the robot stands.
            goal: where it wants to go; ending within 0.3 m counts.
            time: which blockages stand [s].
            others: ``(M, 2)`` bodies at rest that must be passed at distance ``gap``.
            gap: centre to centre [m].
            ignore_temporary: leave out blockages that end before the horizon.
        """
        owner = self._grid(time)
        if ignore_temporary:
            owner = self._without_temporary(owner)
        blocked = owner != 0
        flat = np.ascontiguousarray(others, dtype=np.float64).reshape(-1, 2) - self._origin
        _fill_discs(blocked, flat, gap, self.cell)
        sx, sy = start - self._origin
        gx, gy = goal - self._origin
        return bool(_flood(blocked, sx, sy, START_REACH, gx, gy, GOAL_REACH, self.cell))

    def lasting_free(self) -> BoolArray:
        """``(rows, cols)`` cells free of all that is fixed; cell (0, 0) at the map's corner."""
        self._grid(-np.inf)
        assert self._owner is not None
        return np.asarray(self._owner == 0)

    def is_temporary(self, name: str) -> bool:
        """Whether the solid ``name`` is a blockage that ends before the horizon."""
        return any(
            event.name == name and event.end < self.world.horizon
            for event in self.world.events
            if isinstance(event, Blockage)
        )

    def _without_temporary(self, owner: Owners) -> Owners:
        assert self._owner is not None
        lasting = self._owner.copy()
        for event, number in self._blockages:
            if number in self._active and event.end >= self.world.horizon:
                self._fill(lasting, event.polygon, number)
        self._fill_furniture(lasting)
        return lasting

    def _grid(self, time: float) -> Owners:
        if self._owner is None:
            self._owner = self._build()
            self._current = self._owner
        active = tuple(n for event, n in self._blockages if event.start <= time < event.end)
        if active != self._active or self._has_moved():
            current = self._owner.copy()
            for event, number in self._blockages:
                if number in active:
                    self._fill(current, event.polygon, number)
            self._fill_furniture(current)
            self._current, self._active = current, active
            self._drawn_pose = self._furniture_pose
        assert self._current is not None
        return self._current

    def _has_moved(self) -> bool:
        told, drawn = self._furniture_pose, self._drawn_pose
        if told is None or told is drawn:
            return False
        return drawn is None or bool(np.abs(told - drawn).max() > MOVED)

    def _fill_furniture(self, owner: Owners) -> None:
        if self._furniture_pose is None:
            return
        for (item, number), pose in zip(self._pieces, self._furniture_pose, strict=True):
            self._fill(owner, item.outline_at(pose), number)

    def _fill(self, owner: Owners, polygon: Array, number: int) -> None:
        outline = polygon - self._origin
        _fill_polygon(owner, outline, number, self.clearance, self.cell)

    def _build(self) -> Owners:
        world = self.world
        self._origin = np.array(world.bounds[:2])
        cols, rows = np.ceil((world.bounds[2:] - world.bounds[:2]) / self.cell).astype(int)
        owner = np.zeros((rows, cols), dtype=np.int16)
        names = []
        solids = [(wall.name, wall.polygon) for wall in world.walls]
        solids += [(item.name, item.polygon) for item in world.furniture if not item.movable]
        for name, polygon in solids:
            names.append(name)
            self._fill(owner, polygon, len(names))
        blockages = []
        for event in world.events:
            if isinstance(event, Blockage):
                names.append(event.name)
                blockages.append((event, len(names)))
        pieces = []
        for item in world.movable_furniture():
            names.append(item.name)
            pieces.append((item, len(names)))
        self.names, self._blockages = tuple(names), tuple(blockages)
        self._pieces = tuple(pieces)
        return owner


@numba.njit(cache=True)
def _fill_polygon(owner: Owners, polygon: Array, value: int, clearance: float, cell: float) -> None:
    # Interior by scan lines, rim by distance to each edge.
    rows, cols = owner.shape
    corners = len(polygon)
    crossings = np.empty(corners)
    low = max(0, int(np.floor(polygon[:, 1].min() / cell)))
    high = min(rows - 1, int(np.floor(polygon[:, 1].max() / cell)))
    for row in range(low, high + 1):
        y = (row + 0.5) * cell
        count = 0
        for k in range(corners):
            ax, ay = polygon[k - 1]
            bx, by = polygon[k]
            if (ay <= y) != (by <= y):
                crossings[count] = ax + (y - ay) * (bx - ax) / (by - ay)
                count += 1
        ordered = np.sort(crossings[:count])
        for k in range(0, count - 1, 2):
            first = max(0, int(np.ceil(ordered[k] / cell - 0.5)))
            last = min(cols - 1, int(np.floor(ordered[k + 1] / cell - 0.5)))
            for col in range(first, last + 1):
                owner[row, col] = value
    for k in range(corners):
        ax, ay = polygon[k - 1]
        bx, by = polygon[k]
        dx, dy = bx - ax, by - ay
        length2 = dx * dx + dy * dy
        row_low = max(0, int(np.floor((min(ay, by) - clearance) / cell)))
        row_high = min(rows - 1, int(np.floor((max(ay, by) + clearance) / cell)))
        col_low = max(0, int(np.floor((min(ax, bx) - clearance) / cell)))
        col_high = min(cols - 1, int(np.floor((max(ax, bx) + clearance) / cell)))
        for row in range(row_low, row_high + 1):
            for col in range(col_low, col_high + 1):
                px, py = (col + 0.5) * cell - ax, (row + 0.5) * cell - ay
                share = 0.0
                if length2 > 0.0:
                    share = min(1.0, max(0.0, (px * dx + py * dy) / length2))
                ex, ey = px - share * dx, py - share * dy
                if ex * ex + ey * ey <= clearance * clearance:
                    owner[row, col] = value


@numba.njit(cache=True)
def _fill_discs(blocked: BoolArray, centers: Array, radius: float, cell: float) -> None:
    rows, cols = blocked.shape
    for k in range(len(centers)):
        x, y = centers[k]
        for row in range(
            max(0, int((y - radius) / cell)), min(rows - 1, int((y + radius) / cell)) + 1
        ):
            for col in range(
                max(0, int((x - radius) / cell)), min(cols - 1, int((x + radius) / cell)) + 1
            ):
                dx, dy = (col + 0.5) * cell - x, (row + 0.5) * cell - y
                if dx * dx + dy * dy < radius * radius:
                    blocked[row, col] = True


@numba.njit(cache=True)
def _flood(
    blocked: BoolArray,
    sx: float,
    sy: float,
    start_reach: float,
    gx: float,
    gy: float,
    goal_reach: float,
    cell: float,
) -> bool:
    rows, cols = blocked.shape
    seen = blocked.copy()
    stack = np.empty((rows * cols, 2), dtype=np.int32)
    top = 0
    low, high = max(0, int((sy - start_reach) / cell)), int((sy + start_reach) / cell)
    left, right = max(0, int((sx - start_reach) / cell)), int((sx + start_reach) / cell)
    for row in range(low, min(rows - 1, high) + 1):
        for col in range(left, min(cols - 1, right) + 1):
            dx, dy = (col + 0.5) * cell - sx, (row + 0.5) * cell - sy
            if not seen[row, col] and dx * dx + dy * dy <= start_reach * start_reach:
                seen[row, col] = True
                stack[top, 0], stack[top, 1] = row, col
                top += 1
    while top > 0:
        top -= 1
        row, col = stack[top, 0], stack[top, 1]
        dx, dy = (col + 0.5) * cell - gx, (row + 0.5) * cell - gy
        if dx * dx + dy * dy <= goal_reach * goal_reach:
            return True
        for up in range(-1, 2):
            for side in range(-1, 2):
                r, c = row + up, col + side
                if 0 <= r < rows and 0 <= c < cols and not seen[r, c]:
                    seen[r, c] = True
                    stack[top, 0], stack[top, 1] = r, c
                    top += 1
    return False
