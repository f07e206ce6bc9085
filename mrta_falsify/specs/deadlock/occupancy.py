"""Occupancy grid: the oracle's own coarse map of where a robot fits.

The oracle judges the stack, so it must not borrow the stack's costmap. It needs to
know two things only: is a spot inside a solid, and does any way lead from here to there. A grid
of 0.1 m is fine enough for that.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.ndimage import binary_dilation, label

from mrta_falsify.core.arrays import Array, BoolArray, IntArray
from mrta_falsify.core.world import Blockage, Furniture, World
from mrta_falsify.specs.deadlock.occupancy_kernels import (
    Disc,
    Owners,
    fill_discs,
    fill_interior,
    fill_rim,
    flood,
)

GRID_CELL = 0.1  # m, of the grid
REDRAWN_BEYOND = 0.03  # m or rad; furniture that has moved less is not drawn anew
#: m; a cell is solid if its centre is this near to a solid. This is less than any planner's
#: clearance (0.22 m) minus half a cell's diagonal, so that no valid path ever looks blocked
SOLID_CLEARANCE = 0.15
START_REACH = 0.35  # m, a robot stands on any free cell this near
GOAL_REACH = 0.3  # m, the same at the goal


@dataclass(slots=True)
class SolidGrid:
    """Occupancy grid of one world; built at the first question."""

    world: World
    cell: float = GRID_CELL  #: [m]
    clearance: float = SOLID_CLEARANCE  #: of a cell's centre [m]
    names: tuple[str, ...] = ()  #: of walls, furniture, blockages; ``owner - 1`` indexes it
    _owner: Owners | None = None
    _blockages: tuple[tuple[Blockage, int], ...] = ()
    _active: tuple[int, ...] = ()
    _pieces: tuple[tuple[Furniture, int], ...] = ()
    _furniture_pose: Array | None = None  #: (F, 3) as last set
    _drawn_pose: Array | None = None  #: (F, 3) as it is on ``_current``
    _current: Owners | None = None
    _origin: Array = field(default_factory=lambda: np.zeros(2))

    def furnish(self, poses: Array) -> None:
        """Set where the movable furniture stands; until then it is left out.

        Args:
            poses: ``(F, 3)`` centre x, y [m] and turn since the start [rad], in the world's
                order; an array of another length is ignored.
        """
        if len(poses) and len(poses) == len(self.world.movable_furniture()):
            self._furniture_pose = poses

    def solid_at(self, points: Array, time: float) -> tuple[int, str]:
        """Find the first of ``points`` ``(L, 2)`` [m] in a solid: its index and the solid's name.

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
        fill_discs(blocked, flat, gap, self.cell)
        from_here = self._disc(start, START_REACH)
        to_there = self._disc(goal, GOAL_REACH)
        return bool(flood(blocked, from_here, to_there, self.cell))

    def closing(self, start: Array, goal: Array, time: float) -> str:
        """Name the piece of furniture or blockage that alone closes the way; empty: none.

        Args:
            start: where the robot stands ``(2,)`` [m].
            goal: where it wants to go ``(2,)`` [m].
            time: which blockages stand [s].
        """
        owner = self._grid(time)
        assert self._owner is not None
        places, _ = label(owner == 0, structure=np.ones((3, 3), dtype=np.int8))
        here = self._border_of(places, owner, start, START_REACH)
        there = self._border_of(places, owner, goal, GOAL_REACH)
        discs = self._disc(start, START_REACH), self._disc(goal, GOAL_REACH)
        for number in sorted(here & there):
            under = np.where(self._owner == number, 0, self._owner)
            blocked = np.where(owner == number, under, owner) != 0
            if number > len(self.world.walls) and flood(blocked, *discs, self.cell):
                return self.names[number - 1]
        return ""

    def _border_of(
        self, places: IntArray, owner: Owners, point: Array, reach: float
    ) -> frozenset[int]:
        """Find the solids around the free place that ``point`` is in, and those on the point."""
        rows, cols = np.indices(owner.shape)
        x, y = point - self._origin
        near = np.hypot((cols + 0.5) * self.cell - x, (rows + 0.5) * self.cell - y) <= reach
        inside = np.isin(places, np.unique(places[near & (places > 0)])) & (places > 0)
        grown = binary_dilation(inside | near, structure=np.ones((3, 3)))
        return frozenset(np.unique(owner[grown]).tolist()) - {0}

    def _disc(self, point: Array, radius: float) -> Disc:
        x, y = point - self._origin
        return Disc(x, y, radius)

    def lasting_free(self) -> BoolArray:
        """Mark the cells ``(rows, cols)`` free of fixed solids; (0, 0) is at the map's corner."""
        self._grid(-np.inf)
        assert self._owner is not None
        return np.asarray(self._owner == 0)

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
        now, drawn = self._furniture_pose, self._drawn_pose
        if now is None or now is drawn:
            return False
        return drawn is None or bool(np.abs(now - drawn).max() > REDRAWN_BEYOND)

    def _fill_furniture(self, owner: Owners) -> None:
        if self._furniture_pose is None:
            return
        for (item, number), pose in zip(self._pieces, self._furniture_pose, strict=True):
            self._fill(owner, item.outline_at(pose), number)

    def _fill(self, owner: Owners, polygon: Array, number: int) -> None:
        outline = polygon - self._origin
        fill_interior(owner, outline, number, self.cell)
        fill_rim(owner, outline, number, self.clearance, self.cell)

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


def is_temporary(world: World, name: str) -> bool:
    """Whether the solid ``name`` is a blockage that ends before the horizon."""
    return any(
        event.name == name and event.end < world.horizon
        for event in world.events
        if isinstance(event, Blockage)
    )
