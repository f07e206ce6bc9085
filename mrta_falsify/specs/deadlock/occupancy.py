"""Occupancy grid: the oracle's own coarse map of where a robot fits.

The oracle judges the stack, so it must not borrow the stack's costmap. It needs to
know two things only: is a spot inside a solid, and does any way lead from here to there. A grid
of 0.1 m is fine enough for that.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
from scipy.ndimage import binary_dilation, label

from mrta_falsify.core.arrays import Array, BoolArray, IntArray
from mrta_falsify.core.world import Blockage, Furniture, World
from mrta_falsify.specs.deadlock.occupancy_kernels import (
    Disc,
    Owners,
    Regions,
    count_discs,
    fill_discs,
    fill_interior,
    fill_rim,
    find_way,
    first_owned,
    is_way_without,
)

GRID_CELL = 0.1  # m, of the grid
ROUNDING = 1e-9  # m
REDRAWN_BEYOND = 0.03  # m or rad; furniture that has moved less is not drawn anew
#: m; a cell is solid if its centre is this near to a solid. This is less than any planner's
#: clearance (0.22 m) minus half a cell's diagonal, so that no valid path ever looks blocked
SOLID_CLEARANCE = 0.15
Pieces = dict[int, Array]  #: outlines ``(V, 2)`` [m] of furniture and blockages, by number
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
    _numbered: tuple[Owners, IntArray] | None = None  #: connected places, and of which grid
    _regions: Regions | None = None  #: among bodies, numbered last
    _among: Owners | None = None  #: of which grid
    _among_bodies: tuple[bytes, float] = (b"", 0.0)  #: of which bodies and gap
    _origin: Array = field(default_factory=lambda: np.zeros(2))
    _shape: tuple[int, int] = (0, 0)  #: rows, columns

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
        hit, owner = first_owned(self._grid(time), points, self._origin, self.cell)
        return hit, self.names[owner - 1] if hit >= 0 else ""

    def bodies_closing(
        self, start: Array, goal: Array, time: float, *, others: Array, gap: float
    ) -> list[int] | None:
        """Find the bodies at rest that close a way which solids leave open.

        Args:
            start: where the robot stands ``(2,)`` [m].
            goal: where it wants to go ``(2,)`` [m]; ending within 0.3 m counts.
            time: which blockages stand [s].
            others: ``(M, 2)`` bodies at rest that must be passed at distance ``gap``.
            gap: centre to centre [m].

        Returns:
            Numbers of those that close it alone, or of all if only together they do; None: it is
            open.
        """
        solid = self._grid(time) != 0
        bodies = np.ascontiguousarray(others, dtype=np.float64).reshape(-1, 2) - self._origin

        def is_closed_by(some: Array) -> bool:
            blocked = solid.copy()
            fill_discs(blocked, some, gap, self.cell)
            return not self._is_open(blocked, start, goal)

        if not is_closed_by(bodies):
            return None
        # A body that is not on one of the ways leaves that way open.
        centres = (self._way(solid, start, goal)[:, ::-1] + 0.5) * self.cell
        alone = [
            k
            for k, body in enumerate(bodies)
            if (np.hypot(*(centres - body).T) < gap + ROUNDING).any()
            and is_closed_by(bodies[k : k + 1])
        ]
        return alone or list(range(len(bodies)))

    def is_open_among(
        self, start: Array, goal: Array, time: float, *, bodies: Array, own: int, gap: float
    ) -> bool:
        """Whether solids and bodies at rest leave a way open, but for the body of the robot itself.

        Then :meth:`bodies_closing` finds nothing. The connected regions are numbered once for all
        robots that ask at the same time.

        Args:
            start: where the robot stands ``(2,)`` [m].
            goal: where it wants to go ``(2,)`` [m].
            time: which blockages stand [s].
            bodies: ``(M, 2)`` bodies at rest that must be passed at distance ``gap``.
            own: number of the robot's own among them.
            gap: centre to centre [m].
        """
        owner, places = self._grid(time), bodies - self._origin
        key = places.tobytes(), gap
        if self._among is not owner or self._among_bodies != key or self._regions is None:
            self._among, self._among_bodies = owner, key
            self._regions = self._regions_among(owner != 0, places, gap)
        x, y = places[own]
        from_here, to_there = self._disc(start, START_REACH), self._disc(goal, GOAL_REACH)
        own_disc = Disc(x, y, gap)
        return bool(is_way_without(own_disc, from_here, to_there, self._regions, self.cell))

    def _regions_among(self, solid: BoolArray, places: Array, gap: float) -> Regions:
        count = np.zeros(solid.shape, dtype=np.int16)
        count_discs(count, places, gap, self.cell)
        free = ~solid & (count == 0)
        number, total = label(free, structure=np.ones((3, 3), dtype=np.int8))
        return Regions(number, int(total), count, solid)

    def closing(self, start: Array, goal: Array, time: float) -> tuple[str, ...] | None:
        """Name the furniture and blockages that close the way.

        They are the pieces each of which opens the way if it alone is taken away. Where no
        piece does, they are a smallest set that opens it: none of them can be left out.

        Args:
            start: where the robot stands ``(2,)`` [m].
            goal: where it wants to go ``(2,)`` [m].
            time: which blockages stand [s].

        Returns:
            Names by their number, empty if walls alone close the way; ``None`` if it is open.
        """
        owner, places = self._grid(time), self._places(time)
        at_start = self._places_in(places, start, START_REACH)
        if at_start & self._places_in(places, goal, GOAL_REACH):
            return None
        pieces = self._pieces_at(time)
        bare = self._fixed(len(self.world.walls))
        if not self._is_open(bare != 0, start, goal):
            return ()
        here = self._border_of(places, owner, start, START_REACH)
        there = self._border_of(places, owner, goal, GOAL_REACH)
        alone = [
            number
            for number in sorted(here & there & pieces.keys())
            if self._is_open(self._with(bare, pieces, pieces.keys() - {number}) != 0, start, goal)
        ]
        found = alone or self._closing_together(bare, pieces, sorted(pieces), start, goal)
        return tuple(self.names[number - 1] for number in found)

    def _closing_together(
        self, grid: Owners, pieces: Pieces, group: list[int], start: Array, goal: Array
    ) -> list[int]:
        """Put back what leaves the way open, half by half, and keep the pieces that close it.

        Source: Junker, "QuickXplain", AAAI 2004. ``grid`` is drawn on.
        """
        tried = self._with(grid, pieces, group)
        if self._is_open(tried != 0, start, goal):
            grid[:] = tried
            return []
        if len(group) == 1:
            return group
        half = len(group) // 2
        first = self._closing_together(grid, pieces, group[:half], start, goal)
        return first + self._closing_together(grid, pieces, group[half:], start, goal)

    def _is_open(self, blocked: BoolArray, start: Array, goal: Array) -> bool:
        return len(self._way(blocked, start, goal)) > 0

    def _way(self, blocked: BoolArray, start: Array, goal: Array) -> IntArray:
        """Find the cells ``(K, 2)`` of a way, row and column; K is 0 if there is none."""
        from_here, to_there = self._disc(start, START_REACH), self._disc(goal, GOAL_REACH)
        way: IntArray = find_way(blocked, from_here, to_there, self.cell)
        return way

    def _places(self, time: float) -> IntArray:
        """Number the connected places ``(rows, cols)`` that solids leave free, from 1."""
        owner = self._grid(time)
        if self._numbered is None or self._numbered[0] is not owner:
            places, _ = label(owner == 0, structure=np.ones((3, 3), dtype=np.int8))
            self._numbered = owner, places
        return self._numbered[1]

    def _places_in(self, places: IntArray, point: Array, reach: float) -> set[int]:
        """Find the numbers of the places within ``reach`` [m] of ``point``."""
        return set(places[self._cells_near(point, reach)].tolist()) - {0}

    def _cells_near(self, point: Array, reach: float) -> tuple[IntArray, IntArray]:
        """Find rows and columns of the cells whose centres lie within ``reach`` [m]."""
        x, y = point - self._origin
        rows, cols = (
            np.arange(
                max(0, math.floor((at - reach) / self.cell)),
                min(count, math.floor((at + reach) / self.cell) + 1),
            )
            for at, count in zip((y, x), self._shape, strict=True)
        )
        dx, dy = (cols + 0.5) * self.cell - x, (rows + 0.5) * self.cell - y
        is_near = dx * dx + (dy * dy)[:, None] <= reach * reach
        row, col = is_near.nonzero()
        return rows[row], cols[col]

    def _pieces_at(self, time: float) -> Pieces:
        """Find the outlines of all furniture and blockages that stand now, by number."""
        first = len(self.world.walls) + 1
        fixed = [item.polygon for item in self.world.furniture if not item.movable]
        found = dict(enumerate(fixed, first))
        for event, number in self._blockages:
            if event.start <= time < event.end:
                found[number] = event.polygon
        if self._furniture_pose is not None:
            for (item, number), pose in zip(self._pieces, self._furniture_pose, strict=True):
                found[number] = item.outline_at(pose)
        return found

    def _with(self, grid: Owners, pieces: Pieces, numbers: Iterable[int]) -> Owners:
        """Draw some pieces on a copy of ``grid``."""
        drawn = grid.copy()
        for number in numbers:
            self._fill(drawn, pieces[number], number)
        return drawn

    def _border_of(
        self, places: IntArray, owner: Owners, point: Array, reach: float
    ) -> frozenset[int]:
        """Find the solids around the free place that ``point`` is in, and those on the point."""
        inside = np.isin(places, list(self._places_in(places, point, reach)))
        inside[self._cells_near(point, reach)] = True
        grown = binary_dilation(inside, structure=np.ones((3, 3)))
        return frozenset(np.unique(owner[grown]).tolist()) - {0}

    def _disc(self, point: Array, radius: float) -> Disc:
        x, y = point - self._origin
        return Disc(x, y, radius)

    def lasting_free(self) -> BoolArray:
        """Mark the cells ``(rows, cols)`` free of fixed solids; (0, 0) is at the map's corner."""
        self._grid(-np.inf)
        assert self._owner is not None
        return np.asarray(self._owner == 0)

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
        self._shape = int(rows), int(cols)
        owner = self._fixed()
        names = [name for name, _ in self._fixed_solids()]
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

    def _fixed(self, count: int | None = None) -> Owners:
        """Draw the first ``count`` fixed solids; walls come first."""
        owner = np.zeros(self._shape, dtype=np.int16)
        for number, (_, polygon) in enumerate(self._fixed_solids()[:count], 1):
            self._fill(owner, polygon, number)
        return owner

    def _fixed_solids(self) -> list[tuple[str, Array]]:
        solids = [(wall.name, wall.polygon) for wall in self.world.walls]
        return solids + [
            (item.name, item.polygon) for item in self.world.furniture if not item.movable
        ]
