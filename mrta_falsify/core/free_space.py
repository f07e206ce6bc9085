"""Free space of a disc: where its centre can go between walls and things, and what shuts a way.

Exact up to rounding, without cells: every solid is grown by the half width of the disc, and a
connected part of what remains of the floor is a set of places that the disc can travel between.
Corners are rounded by chords, so that solids are grown by 0.5 % of the half width too little at
most: where the answer is wrong, it calls a way open.
"""

from __future__ import annotations

import functools
import heapq
import itertools
import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray

from mrta_falsify.core.arrays import Array, BoolArray
from mrta_falsify.core.geometry import transform
from mrta_falsify.core.shapes import polygons

SLACK = 0.002  # m by which a disc is thought smaller
START_SLACK = 0.03  # m between a disc and the next place where it fits; farther, nothing is said
TOUCHES = 1e-7  # m between neighbouring shapes, by rounding
GAP_ERROR = 0.005  # m of a measured gap

#: polygons or multipolygons of shapely, which has no types
Shapes = NDArray[np.object_]


class Disc(NamedTuple):
    """A disc around a point that moves with a robot."""

    offset: tuple[float, float]  #: of its centre, in the robot's frame [m]
    half_width: float  #: [m]

    def at(self, pose: Array) -> Array:
        """Place its centre ``(2,)`` [m] for a robot at ``pose`` ``(3,)`` [m, m, rad]."""
        return transform(np.array(self.offset), pose)

    @property
    def width(self) -> float:
        """Full width [m]."""
        return 2.0 * self.half_width

    @property
    def away(self) -> float:
        """Distance [m] of its centre from the robot's point."""
        return math.hypot(*self.offset)

    def is_within(self, other: Disc) -> bool:
        """Whether it lies inside another disc of the same robot."""
        between = math.dist(self.offset, other.offset)
        return between + self.half_width <= other.half_width


@dataclass(frozen=True, slots=True, eq=False)
class FreeSpace:
    """Where the centre of a disc can be, past walls and named things.

    Build one with :func:`free_space` and query it as often as needed. A start is a point
    ``(2,)`` [m]; a goal is an area, a shape of shapely's (see :func:`around`).
    """

    half_width: float  #: of the disc [m]
    floor: Any  #: places past the walls, were there no things
    names: tuple[str, ...]  #: n, of the things
    grown: Shapes  #: (n,) the things, grown by the half width
    parts: Shapes  #: (p,) connected parts of the free space

    def at(self, start: ArrayLike) -> BoolArray:
        """Say in which parts ``(p,)`` a disc may be that stands at ``start`` ``(2,)`` [m].

        None: walls or things are on the disc, and it fits nowhere within ``START_SLACK``.
        """
        return _are_near(self.parts, _point(start))

    def reaching(self, goal: Any) -> BoolArray:
        """Say which parts ``(p,)`` reach into the area ``goal``."""
        return _meets(self.parts, goal)

    def is_open(self, start: ArrayLike, goal: Any) -> bool:
        """Whether the disc can get from ``start`` into the area ``goal``.

        True as well where the disc does not fit at ``start``: nothing can be said of it.
        """
        here = self.at(start)
        return not here.any() or bool((here & self.reaching(goal)).any())

    def shut_by(self, start: ArrayLike, goal: Any) -> tuple[str, ...] | None:
        """Name the things that shut the way from ``start`` into the area ``goal``.

        Returns:
            None: it is open. Else each thing that opens it when it alone is taken away, in order
            of name; where none does, a smallest set that does together (irreducible: none of it
            can stay). Empty: walls alone shut it.
        """
        here, there = self.at(start), self.reaching(goal)
        if not here.any() or (here & there).any():
            return None
        if not _connects(_parts(self.floor), _point(start), goal):
            return ()
        is_beside_goal = _touch(self.grown, self.parts[there]) | _meets(self.grown, goal)
        beside = _touch(self.grown, self.parts[here]) & is_beside_goal
        alone = [i for i in np.flatnonzero(beside) if self._opens({int(i)}, start, goal)]
        return tuple(sorted(self.names[i] for i in alone or self._together(start, goal)))

    def _opens(self, removed: Collection[int], start: ArrayLike, goal: Any) -> bool:
        """Whether the way is open without the things of these numbers."""
        kept = [i for i in range(len(self.names)) if i not in removed]
        return _connects(_cut(self.floor, self.grown[kept]), _point(start), goal)

    def _together(self, start: ArrayLike, goal: Any) -> list[int]:
        """Find things that open the way if all of them are taken away, and no fewer of them."""
        found = self._fewest_between(start, goal)
        if not self._opens(set(found), start, goal):
            found = list(range(len(self.names)))
        for i in list(found):
            fewer = [k for k in found if k != i]
            if self._opens(set(fewer), start, goal):
                found = fewer
        return found

    def _fewest_between(self, start: ArrayLike, goal: Any) -> list[int]:
        """Find the things on a way from part to part that goes through fewest things."""
        inside = [_parts(shapely.intersection(one, self.floor)) for one in self.grown]
        shapes = np.concatenate([self.parts, *inside])
        owners = [-1] * len(self.parts)
        owners += [i for i, pieces in enumerate(inside) for _ in pieces]
        ends = set(np.flatnonzero(_meets(shapes, goal)).tolist())
        first = np.flatnonzero(self.at(start)).tolist()
        neighbours = _neighbours(shapes)
        order = itertools.count()  # of equally many things, those found first
        queue: list[tuple[int, int, int, tuple[int, ...]]]
        queue = [(0, next(order), node, ()) for node in first]
        seen: set[int] = set()
        while queue:
            count, _, node, things = heapq.heappop(queue)
            if node in ends:
                return sorted(set(things))
            if node in seen:
                continue
            seen.add(node)
            for other in neighbours[node]:
                owner = owners[other]
                is_new = owner >= 0 and owner not in things
                through = (*things, owner) if is_new else things
                heapq.heappush(queue, (count + is_new, next(order), other, through))
        return list(range(len(self.names)))


def free_space(
    bounds: ArrayLike,
    walls: Sequence[Array],
    things: Sequence[tuple[str, Array]],
    half_width: float,
) -> FreeSpace:
    """Find where a disc can be.

    The floor past the walls is kept for the last few sets of walls, bounds and half widths.

    Args:
        bounds: ``(4,)`` x min, y min, x max, y max [m] for the centre of the disc.
        walls: outlines ``(V, 2)`` [m].
        things: name and outline ``(V, 2)`` [m] of all else that stands in the way.
        half_width: of the disc [m], > 0; it is thought smaller by ``SLACK``.
    """
    edges = tuple(np.ascontiguousarray(wall, dtype=np.float64).tobytes() for wall in walls)
    corners = np.asarray(bounds, dtype=np.float64).tobytes()
    radius = max(half_width - SLACK, TOUCHES)
    floor = _floor(corners, edges, radius)
    grown = _grown([outline for _, outline in things], radius)
    return FreeSpace(
        half_width=half_width,
        floor=floor,
        names=tuple(name for name, _ in things),
        grown=grown,
        parts=_cut(floor, grown),
    )


def shut_by(
    bounds: ArrayLike,
    walls: Sequence[Array],
    things: Sequence[tuple[str, Array]],
    start: ArrayLike,
    goal: ArrayLike,
    *,
    half_width: float,
    reach: float,
) -> tuple[str, ...] | None:
    """Name the things that shut the way of a disc; see :meth:`FreeSpace.shut_by`.

    Args:
        bounds: as for :func:`free_space`, like ``walls``, ``things`` and ``half_width``.
        walls: outlines.
        things: names and outlines.
        start: ``(2,)`` [m] where the centre of the disc is.
        goal: ``(2,)`` [m] to which it is to come.
        half_width: of the disc [m].
        reach: how near to the goal is near enough [m].
    """
    return free_space(bounds, walls, things, half_width).shut_by(start, around(goal, reach))


def around(point: ArrayLike, reach: float) -> Any:
    """Make the area within ``reach`` [m] of a point ``(2,)`` [m]."""
    # Chords cut the circle's area short; 64 of them by 0.12 % of the reach, which is added.
    return shapely.buffer(_point(point), reach / np.cos(np.pi / 64.0), quad_segs=16)


def widest_gap(is_open: Callable[[float], bool], *, low: float = 0.0, high: float = 1.0) -> float:
    """Measure the narrowest place [m] of the best way, within ``GAP_ERROR``, by bisection.

    Args:
        is_open: whether the way is open for a disc of this half width [m].
        low: half width [m] for which it is open, or 0.
        high: half width [m] for which it is shut.

    Returns:
        Full width of the widest disc that gets through; 0.0: there is no gap.
    """
    while 2.0 * (high - low) > GAP_ERROR:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if is_open(middle) else (low, middle)
    return 2.0 * low if low > GAP_ERROR else 0.0


# --- shapes ---------------------------------------------------------------------------------------


@functools.lru_cache(maxsize=64)
def _floor(bounds: bytes, walls: tuple[bytes, ...], radius: float) -> Any:
    outlines = [np.frombuffer(wall).reshape(-1, 2) for wall in walls]
    whole = shapely.box(*np.frombuffer(bounds))
    return shapely.difference(whole, shapely.union_all(_grown(outlines, radius)))


def _grown(outlines: Sequence[Array], radius: float) -> Shapes:
    """Grow the solids of outlines ``(V, 2)`` [m] by ``radius`` [m]."""
    solids = polygons(outlines)
    is_odd = ~shapely.is_valid(solids)
    if is_odd.any():
        solids[is_odd] = shapely.make_valid(solids[is_odd])
    return np.asarray(shapely.buffer(solids, radius, quad_segs=8), dtype=np.object_)


def _cut(floor: Any, grown: Shapes) -> Shapes:
    """List the connected parts of a floor without the grown things."""
    return _parts(shapely.difference(floor, shapely.union_all(grown)))


def _parts(shape: Any) -> Shapes:
    parts = shapely.get_parts(shape)
    return np.asarray(parts[shapely.get_dimensions(parts) == 2], dtype=np.object_)


def _point(place: ArrayLike) -> Any:
    return shapely.points(np.asarray(place, dtype=np.float64))


def _are_near(parts: Shapes, place: Any) -> BoolArray:
    return np.asarray(shapely.dwithin(parts, place, START_SLACK), dtype=np.bool_)


def _meets(parts: Shapes, area: Any) -> BoolArray:
    return np.asarray(shapely.intersects(parts, area), dtype=np.bool_)


def _connects(parts: Shapes, place: Any, goal: Any) -> bool:
    """Whether a part has both the place and something of the goal."""
    return bool((_are_near(parts, place) & _meets(parts, goal)).any())


def _touch(shapes: Shapes, others: Shapes) -> BoolArray:
    """Say which shapes touch one of the others, ``(n,)``."""
    found = np.zeros(len(shapes), dtype=np.bool_)
    for other in others:
        shapely.prepare(other)
        found |= shapely.dwithin(shapes, other, TOUCHES)
    return found


def _neighbours(shapes: Shapes) -> Mapping[int, list[int]]:
    """List for each shape the shapes that touch it."""
    one, other = shapely.STRtree(shapes).query(shapes, predicate="dwithin", distance=TOUCHES)
    found: dict[int, list[int]] = {i: [] for i in range(len(shapes))}
    for i, k in zip(one.tolist(), other.tolist(), strict=True):
        if i != k:
            found[i].append(k)
    return found
