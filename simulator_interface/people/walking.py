"""People on foot: planned ways between the points of a route, and progress on them."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from mrta_falsify.core.arrays import Array, BoolArray, ByteArray, IntArray
from mrta_falsify.core.compiled import njit
from mrta_falsify.core.costmap import INSCRIBED, Costmap
from mrta_falsify.core.protocols import CostmapSource, Planner

LOOK_AHEAD = 0.8  # m along the way to the point that a person walks towards, at least
SEEN_FROM = 0.3  # m; who was pushed to a wall still sees what lies ahead
SEEN_STEP = 0.1  # m between two looks along a line of sight
ARRIVAL = 0.3  # m, goal switch distance of MRTA-Sim's people
LOST = 1.5  # m off the way: look for a new one
FREE_REACH = 2.0  # m, how far a route point inside an obstacle may be moved
STUCK_AFTER = 8.0  # s without progress before a person turns to the next point of the route
PROGRESS = 0.2  # m nearer to the end of the way is progress
PEOPLES_RADIUS = 0.3  # m; people plan with more room than a robot's disc needs
WINDOW = 40  # points of the way that are searched; they are about 0.1 m apart
ROUNDED_UP = 1.0 + 1e-9  # squares that are larger by this belong to larger distances
NO_ROBOTS = np.zeros((0, 2))
NO_WAY = np.zeros((0, 2))


#: how far a person is on a way
PROGRESS_ROW = np.dtype(
    (
        np.record,
        [
            ("passed", np.int64),  # points of the way already passed
            ("closest", np.float64),  # least distance to the end of the way so far [m]
            ("closest_at", np.float64),  # when that was [s]
        ],
    )
)
ProgressRows: TypeAlias = NDArray[np.void]  #: of PROGRESS_ROW
GOES_ON, STANDS_STILL, HAS_ARRIVED, IS_LOST = range(4)


def fresh_rows(count: int, time: float = 0.0) -> ProgressRows:
    """Make rows of ``count`` people who set out at ``time`` [s]."""
    return np.array([(0, np.inf, time)] * count, dtype=PROGRESS_ROW)


class Ground(NamedTuple):
    """Where people may walk, for compiled code."""

    cost: ByteArray  #: (rows, cols) of a costmap, row 0 in the south
    origin: Array  #: (2,) south-west corner [m]
    resolution: float  #: [m]
    sight: float  #: to the farthest point of a way that a person walks straight towards [m]


@dataclass(slots=True)
class Walker:
    """Where one person stands on a route."""

    route: Array  #: (K, 2) [m]
    repeat: bool
    speed: float  #: desired [m/s]
    next_point: int  #: index into the route
    way: Array  #: (L, 2) planned points to the next route point, empty: stands
    rows: ProgressRows = field(default_factory=lambda: fresh_rows(1))  #: one of them is its own
    row: int = 0  #: of ``rows``
    pause: float = 0.0  #: at each point of the route [s]
    rests_until: float = np.inf  #: while it pauses [s]

    def take_way(self, way: Array, time: float) -> None:
        """Set out along another way at ``time`` [s]."""
        self.way = way
        self.rows[self.row] = fresh_rows(1, time)[0]


@dataclass(slots=True)
class Walking:
    """Ways on the costmap of the moment."""

    planner: Planner
    source: CostmapSource
    sight: float = LOOK_AHEAD  #: [m], see :class:`Ground`
    map: Costmap | None = field(default=None)
    ground: Ground = field(init=False)  #: of ``map``

    def look(self, time: float) -> bool:
        """Take in the costmap of the moment; say whether it changed."""
        costmap = self.source.costmap(time, NO_ROBOTS)
        if costmap is self.map:
            return False
        self.map = costmap
        self.ground = Ground(costmap.cost, costmap.origin, costmap.resolution, self.sight)
        self.planner.use(costmap)
        return True

    def free_point(self, point: Array) -> Array:
        """Find the free place nearest to ``point``, mostly the point itself."""
        assert self.map is not None
        if self.map.cost_at(point) < INSCRIBED:
            return np.asarray(point)
        reach = int(FREE_REACH / self.map.resolution)
        offsets = np.arange(-reach, reach + 1)
        grid = np.stack(np.meshgrid(offsets, offsets, indexing="ij"), axis=-1).reshape(-1, 2)
        grid = grid[np.argsort((grid**2).sum(axis=1), kind="stable")]
        centers = self.map.centers(self.map.cells(point) + grid)
        free = self.map.cost_at(centers) < INSCRIBED
        return centers[int(np.argmax(free))] if free.any() else np.asarray(point)

    def way(self, start: Array, goal: Array) -> Array:
        """Plan a way ``(L, 2)`` [m]; it is empty if there is none."""
        plan = self.planner.plan(np.asarray(start), np.asarray(goal))
        return plan.path if plan.found else NO_WAY

    def set_out(self, route: Array, *, repeat: bool, speed: float, start: Array) -> Walker:
        """Send a walker at ``start`` ``(2,)`` [m] to the first point of ``route``."""
        walker = Walker(route=route, repeat=repeat, speed=speed, next_point=0, way=NO_WAY)
        walker.way = self.way(start, self.free_point(route[0]))
        return walker

    def begin(
        self, route: Array, *, repeat: bool, speed: float, share: float, pause: float = 0.0
    ) -> tuple[Array, Walker]:
        """Place a walker at ``share`` of a route; its point ``(2,)`` [m] comes first."""
        points = [self.free_point(point) for point in route]
        standing = Walker(
            route=route, repeat=repeat, speed=speed, next_point=0, way=NO_WAY, pause=pause
        )
        if len(points) < 2:
            return points[0], standing
        last = len(points) if repeat else len(points) - 1
        legs = [self.way(points[i], points[(i + 1) % len(points)]) for i in range(last)]
        lengths = [way_length(leg) for leg in legs]
        walked = share * math.fsum(lengths)
        for i, (leg, length) in enumerate(zip(legs, lengths, strict=True)):
            if len(leg) and (walked <= length or i == len(legs) - 1):
                point, rest = _cut(leg, min(walked, length))
                standing.next_point, standing.way = (i + 1) % len(points), rest
                return point, standing
            walked -= length
        return points[0], standing

    def target(self, walker: Walker, position: Array, time: float) -> Array:
        """Choose the point ``(2,)`` [m] to walk towards; ``position`` itself: stand."""
        fate, point = walk_on(walker.way, walker.rows, walker.row, position, time, self.ground)
        if fate in (HAS_ARRIVED, IS_LOST):
            if fate == HAS_ARRIVED:
                self._turn_to_next_point(walker, position, time)
            else:
                self._find_way(walker, position, time)
            if not len(walker.way):
                return position
            ahead = look_ahead(walker.way, walker.rows["passed"][walker.row], position)
            walker.rows["passed"][walker.row] = ahead.passed
            point = seen_point(walker.way, ahead.point, position, self.ground)
        return position if fate == STANDS_STILL else np.asarray(walker.way[point])

    def _turn_to_next_point(self, walker: Walker, position: Array, time: float) -> None:
        points = len(walker.route)
        is_last = walker.next_point == (0 if walker.repeat else points - 1)
        if is_last and not walker.repeat:
            walker.way = NO_WAY
            return
        walker.next_point = (walker.next_point + 1) % points
        is_there = np.hypot(*(walker.way[-1] - position)) < ARRIVAL  # else stuck on the way
        if walker.pause > 0.0 and is_there:
            walker.take_way(NO_WAY, time)
            walker.rests_until = time + walker.pause
            return
        self._find_way(walker, position, time)

    def go_on(self, walker: Walker, position: Array, time: float) -> None:
        """Send a walker on that has paused; without a way it pauses again."""
        walker.rests_until = np.inf
        self._find_way(walker, position, time)
        if not len(walker.way):
            walker.rests_until = time + walker.pause

    def _find_way(self, walker: Walker, position: Array, time: float) -> None:
        """A way to the next route point, or to the first after it that can be reached."""
        points = len(walker.route)
        way = NO_WAY
        for _ in range(points):
            way = self.way(position, self.free_point(walker.route[walker.next_point]))
            if len(way) or not walker.repeat:
                break
            walker.next_point = (walker.next_point + 1) % points
        if not len(way):  # shut in for now: keep the old way and ask again later
            way = walker.way[walker.rows["passed"][walker.row] :]
        walker.take_way(way, time)


class Ahead(NamedTuple):
    """Where a person is on a way."""

    off_way: float  #: distance to the next stretch of the way [m]
    passed: int  #: closest point not yet passed
    point: int  #: the point to walk towards


@njit(cache=True)
def look_ahead(way: Array, passed: int, position: Array) -> Ahead:
    """Find where a person at ``position`` ``(2,)`` [m] is on a way, and what to walk towards.

    Args:
        way: ``(L, 2)`` [m].
        passed: earlier points are left out.
        position: ``(2,)`` [m].
    """
    closest, best, stop = passed, np.inf, min(passed + WINDOW, len(way))
    for i in range(passed, stop):
        dx, dy = way[i, 0] - position[0], way[i, 1] - position[1]
        if dx * dx + dy * dy > ROUNDED_UP * best * best:
            continue
        distance = np.hypot(dx, dy)
        if distance < best:
            closest, best = i, distance
    for i in range(closest, stop):
        if np.hypot(way[i, 0] - position[0], way[i, 1] - position[1]) >= LOOK_AHEAD:
            return Ahead(best, closest, i)
    return Ahead(best, closest, stop - 1)


@njit(cache=True)
def _is_seen(position: Array, point: Array, length: float, ground: Ground) -> bool:
    """Whether a straight line of ``length`` [m] from a person to a point leads over free ground."""
    dx, dy = point[0] - position[0], point[1] - position[1]
    rows, cols = ground.cost.shape
    for k in range(int(SEEN_FROM / SEEN_STEP), int(length / SEEN_STEP) + 1):
        share = k * SEEN_STEP / length
        x, y = position[0] + share * dx, position[1] + share * dy
        col = int(np.floor((x - ground.origin[0]) / ground.resolution))
        row = int(np.floor((y - ground.origin[1]) / ground.resolution))
        outside = row < 0 or row >= rows or col < 0 or col >= cols
        if outside or ground.cost[row, col] >= INSCRIBED:
            return False
    return True


@njit(cache=True)
def seen_point(way: Array, point: int, position: Array, ground: Ground) -> int:
    """Find the farthest point of a way within sight that a person may walk straight towards.

    People who look far ahead on one way walk beside each other, not in single file.

    Args:
        way: ``(L, 2)`` [m].
        point: of the way, from which it is looked for.
        position: ``(2,)`` [m].
        ground: where one may walk.
    """
    if ground.sight <= LOOK_AHEAD:
        return point
    for i in range(point + 1, min(point + WINDOW, len(way))):
        away = np.hypot(way[i, 0] - position[0], way[i, 1] - position[1])
        if away > ground.sight or not _is_seen(position, way[i], away, ground):
            return i - 1
    return max(point, min(point + WINDOW, len(way)) - 1)


@njit(cache=True)
def walk_on(
    way: Array, rows: ProgressRows, row: int, position: Array, time: float, ground: Ground
) -> tuple[int, int]:
    """Note how far a person is on a way, and find the point to walk towards.

    Args:
        way: ``(L, 2)`` [m], empty: none.
        rows: of which one is brought up to date.
        row: that is.
        position: ``(2,)`` [m].
        time: [s].
        ground: where one may walk.

    Returns:
        What becomes of the person, and the point of the way, if it goes on.
    """
    if not len(way):
        return STANDS_STILL, 0
    own = rows[row]
    end = np.hypot(way[-1, 0] - position[0], way[-1, 1] - position[1])
    if end < own.closest - PROGRESS:
        own.closest, own.closest_at = end, time
    if end < ARRIVAL or time - own.closest_at > STUCK_AFTER:
        return HAS_ARRIVED, 0
    ahead = look_ahead(way, own.passed, position)
    if ahead.off_way > LOST:
        return IS_LOST, 0
    own.passed = ahead.passed
    return GOES_ON, seen_point(way, ahead.point, position, ground)


@njit(cache=True)
def all_walk_on(
    ways: Array,
    first: IntArray,
    rows: ProgressRows,
    position: Array,
    time: float,
    ground: Ground,
    target: Array,
    needs_way: BoolArray,
) -> bool:
    """Bring all people on routes to a tick.

    Args:
        ways: ``(P, 2)`` [m], one after the other.
        first: ``(H + 1,)`` point of each.
        rows: ``(H,)``.
        position: ``(H, 2)`` [m].
        time: [s].
        ground: where one may walk.
        target: ``(H, 2)`` [m] receives the points to walk towards.
        needs_way: ``(H,)`` receives who needs another way first.

    Returns:
        Whether anybody does.
    """
    is_any = False
    for i in range(len(rows)):
        way = ways[first[i] : first[i + 1]]
        fate, point = walk_on(way, rows, i, position[i], time, ground)
        target[i] = way[point] if fate == GOES_ON else position[i]
        needs_way[i] = fate in (HAS_ARRIVED, IS_LOST)
        is_any = is_any or needs_way[i]
    return is_any


def way_length(points: Array) -> float:
    """Measure the length [m] of a way ``(L, 2)``."""
    if len(points) < 2:
        return 0.0
    return float(np.hypot(*np.diff(points, axis=0).T).sum())


def _cut(points: Array, distance: float) -> tuple[Array, Array]:
    """Point ``distance`` [m] along ``points`` and what follows it."""
    steps = np.hypot(*np.diff(points, axis=0).T)
    reached = np.concatenate([[0.0], np.cumsum(steps)])
    i = int(np.searchsorted(reached, distance, side="right")) - 1
    i = min(max(i, 0), len(points) - 2)
    share = (distance - reached[i]) / steps[i] if steps[i] > 0.0 else 0.0
    point = points[i] + min(share, 1.0) * (points[i + 1] - points[i])
    return point, np.vstack([point, points[i + 1 :]])
