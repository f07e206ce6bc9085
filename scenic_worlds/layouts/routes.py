"""Ways over any floor: in the middle of what is free, then to the right of it."""

from __future__ import annotations

import copy

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy import ndimage

from mrta_falsify.core.arrays import Array, BoolArray, IntArray
from mrta_falsify.core.costmap import INSCRIBED, LETHAL, Costmap
from mrta_falsify.core.world import World
from mrta_falsify.stack.planning import search_kernels as kernels
from simulator_interface.costmap_layers import CostmapOptions, build_costmap

ROBOT_RADIUS = 0.22  # m, the waffle's; the distances below are for robots of this size
MAX_CELLS = 2_000_000  # finer than this takes coarser cells
WIDE = 1.5  # m; keeping farther away than this gains nothing
KEEP_MIDDLE = 6.0  # a cell beside a wall is this many times dearer, and once more
RIGHT = 0.40  # m, lane to the middle: 0.8 between lanes, as AWS
WALL_GAP = 0.42  # m, lane to anything solid, where there is room
LEAST_GAP = 0.30  # m, the default stack's barrier
SMOOTH = 0.4  # m, half the window that evens out the steps of grid paths
TOLERANCE = 0.06  # m, how far a lane may cut its own corners
STEP = 0.05  # m between samples of a way
COMPARED = 4  # of the nearest places, the one with the best way is taken
_NO_CELLS: IntArray = np.zeros(0, dtype=np.int64)


class RouteMap:
    """The floor of one layout as ways see it.

    Args:
        world: walls and furniture.
        radius: of the largest robot [m].
    """

    def __init__(self, world: World, radius: float = ROBOT_RADIUS) -> None:
        self.radius = radius
        self.extra = max(radius - ROBOT_RADIUS, 0.0)  #: [m], on top of every distance to walls
        self.costmap = _costmap(world, radius)
        self.resolution = self.costmap.resolution
        lethal = self.costmap.cost == LETHAL
        self.lethal: BoolArray = lethal
        padded = np.pad(~lethal, 1)
        #: (rows, cols) from cell centre to what is solid [m]
        self.clearance: Array = (
            ndimage.distance_transform_edt(padded)[1:-1, 1:-1] - 0.5
        ) * self.resolution
        self.free: BoolArray = self.costmap.cost < INSCRIBED
        steps = ndimage.generate_binary_structure(2, 1)
        #: (rows, cols) number of the connected part of the floor, 0: not free
        self.part: IntArray = ndimage.label(self.free, structure=steps)[0].astype(np.int64)

    def cell(self, point: Array) -> tuple[int, int]:
        """Find row and column of a map point [m], clipped to the map."""
        row, col = self.costmap.cells(point).tolist()
        rows, cols = self.free.shape
        return min(max(row, 0), rows - 1), min(max(col, 0), cols - 1)

    def window(self, low: Array, high: Array) -> tuple[slice, slice]:
        """Find the rows and columns of a box between two map points [m], clipped to the map."""
        (first, left), (last, right) = self.cell(low), self.cell(high)
        return slice(first, last + 1), slice(left, right + 1)

    def cells_in(self, area: Array) -> BoolArray:
        """Mark the cells ``(rows, cols)`` whose centres lie in an outline ``(V, 2)`` [m]."""
        marks = np.zeros(self.free.shape, dtype=np.bool_)
        rows, cols = self.window(area.min(axis=0), area.max(axis=0))
        grid = np.moveaxis(np.mgrid[rows, cols], 0, -1)
        centers = self.costmap.centers(grid.reshape(-1, 2))
        marks[rows, cols] = shapely.contains_xy(shapely.polygons(area), centers).reshape(
            grid.shape[:2]
        )
        return marks

    def flat_cell(self, point: Array) -> int:
        """Number the cell of a map point [m], clipped to the map."""
        row, col = self.cell(point)
        return row * int(self.free.shape[1]) + col

    def gap(self, points: Array, clearance: Array | None = None) -> Array:
        """Measure the distance ``(K,)`` [m] of points ``(K, 2)`` to what is solid, 0 outside."""
        return self.gap_at(points[:, 0], points[:, 1], clearance)

    def gap_at(self, x: Array, y: Array, clearance: Array | None = None) -> Array:
        """Measure as :meth:`gap` for coordinates [m] of any shape."""
        field = self.clearance if clearance is None else clearance
        rows, cols = field.shape
        if not x.size:
            return np.zeros(x.shape)
        west, south = self.costmap.origin.tolist()
        x, y = (x - west) / self.resolution, (y - south) / self.resolution
        # Truncation is the floor of what is not negative; what is, lies outside.
        col, row = x.astype(np.int64), y.astype(np.int64)
        if x.min() >= 0.0 and y.min() >= 0.0 and col.max() < cols and row.max() < rows:
            return np.asarray(field[row, col])
        inside = (x >= 0.0) & (y >= 0.0) & (col < cols) & (row < rows)
        values = field[np.clip(row, 0, rows - 1), np.clip(col, 0, cols - 1)]
        return np.where(inside, values, 0.0)

    def is_clear(self, start: Array, end: Array) -> bool:
        """Whether a robot can drive a straight leg."""
        return bool(self.are_clear(np.stack([start, end])[None])[0])

    def are_clear(self, legs: Array) -> BoolArray:
        """Whether a robot can drive each of some straight legs ``(K, 2, 2)`` [m]."""
        points, leg = shapely.get_coordinates(
            shapely.segmentize(shapely.linestrings(legs), STEP), return_index=True
        )
        least = np.full(len(legs), np.inf)
        np.minimum.at(least, leg, self.gap(points))
        return np.asarray(least >= LEAST_GAP + self.extra)

    def distance_to(self, points: Array) -> Array:
        """Measure each cell's distance ``(rows, cols)`` [m] to the nearest of ``(K, 2)`` points."""
        marked = np.zeros(self.free.shape, dtype=np.bool_)
        cells = self.costmap.cells(points)
        rows, cols = self.free.shape
        keep = ((cells >= 0) & (cells < [rows, cols])).all(axis=1)
        marked[cells[keep, 0], cells[keep, 1]] = True
        return self.distance_to_cells(marked)

    def distance_to_cells(self, marked: BoolArray) -> Array:
        """Measure each cell's distance ``(rows, cols)`` [m] to the nearest that is marked."""
        if not marked.any():
            return np.full(self.free.shape, np.inf)
        far: Array = ndimage.distance_transform_edt(~marked) * self.resolution
        return far


def _costmap(world: World, radius: float) -> Costmap:
    extent = world.bounds[2:] - world.bounds[:2]
    resolution = 0.05
    while extent.prod() / resolution**2 > MAX_CELLS and resolution < 0.1:
        resolution = 0.1
    return build_costmap(world, options=CostmapOptions(resolution=resolution, robot_radius=radius))


def _prices(clearance: Array) -> NDArray[np.uint16]:
    """Price cells by their distance ``(rows, cols)`` to what ways keep away from [m]."""
    near = 1.0 - np.minimum(np.maximum(clearance, 0.0), WIDE) / WIDE
    return np.rint(kernels.PRICE * (1.0 + KEEP_MIDDLE * near * (1.0 + near))).astype(np.uint16)


class _Search:
    """Exact costs to one cell of a price grid, continued as they are asked for."""

    def __init__(self, prices: NDArray[np.uint16], goal: int) -> None:
        self._prices = prices
        self._cost = np.empty(prices.size, dtype=np.int32)
        self._marks = np.zeros(prices.size, dtype=np.uint8)
        self._cost[goal] = 0
        self._frontier = np.array([goal], dtype=np.int32)

    def cost_of(self, start: int) -> float:
        """Cost from a cell to the goal; inf: there is no way."""
        if len(self._frontier) and self._marks[start] != kernels.CLOSED:
            self._frontier = kernels.expand(
                self._prices, self._cost, self._marks, self._frontier, start
            )
        return float(self._cost[start]) if self._marks[start] == kernels.CLOSED else np.inf

    def cells_from(self, start: int) -> NDArray[np.int32]:
        """List the cells of the best way, empty: there is none."""
        if not np.isfinite(self.cost_of(start)):
            return np.zeros(0, dtype=np.int32)
        return kernels.descend(self._prices, self._cost, self._marks, start)


class MiddleWays:
    """Shortest ways that like the middle of corridors, by goal.

    Args:
        routes: the floor.
        clearance: ``(rows, cols)`` distance to what ways keep away from [m].
        floor: ``(rows, cols)`` cells that they may use; None: where robots can be.
    """

    def __init__(self, routes: RouteMap, clearance: Array, floor: BoolArray | None = None) -> None:
        self._routes = routes
        rows, cols = routes.free.shape
        self._prices = np.zeros((rows + 2, cols + 2), dtype=np.uint16)
        self._floor = routes.free if floor is None else floor
        self._prices[1:-1, 1:-1] = np.where(self._floor, _prices(clearance), 0)
        self._width = cols + 2

    def with_clearance(self, window: tuple[slice, slice], clearance: Array) -> MiddleWays:
        """Find ways with another clearance [m] in a window of rows and columns."""
        other = copy.copy(self)
        other._prices = self._prices.copy()
        inner = other._prices[1:-1, 1:-1]
        inner[window] = np.where(self._floor[window], _prices(clearance), 0)
        return other

    def to(self, goal: Array, starts: list[Array]) -> list[Array]:
        """Find ways ``(K, 2)`` [m] from every start to one goal, empty where there is none."""
        search = _Search(self._prices, self._flat(goal))
        return [self._way(search, start, goal) for start in starts]

    def to_nearest(self, point: Array, others: Array, without: IntArray = _NO_CELLS) -> Array:
        """Find the way ``(K, 2)`` [m] from a point to one near it; empty: there is none.

        Of the :data:`COMPARED` nearest as the crow flies, the one with the best way is taken.

        Args:
            point: where the way begins, ``(2,)`` [m].
            others: ``(K, 2)`` [m].
            without: flat cells of the map that the way must not use.
        """
        prices = self._prices
        if len(without):
            prices = prices.copy()
            prices[without // (self._width - 2) + 1, without % (self._width - 2) + 1] = 0
        search = _Search(prices, self._flat(point))
        nearest, cost, compared = np.zeros((0, 2)), np.inf, 0
        for k in np.argsort(np.hypot(*(others - point).T), kind="stable").tolist():
            way_cost = search.cost_of(self._flat(others[k]))
            compared += np.isfinite(way_cost)
            if way_cost < cost:
                nearest, cost = self._way(search, others[k], point), way_cost
            if compared == COMPARED:
                break
        return nearest[::-1]

    def _way(self, search: _Search, start: Array, goal: Array) -> Array:
        cells = search.cells_from(self._flat(start))
        if not len(cells):
            return np.zeros((0, 2))
        row, col = np.divmod(cells, self._width)
        inner = self._routes.costmap.centers(np.stack([row - 1, col - 1], axis=-1))
        return np.vstack([start, inner[1:-1], goal])

    def _flat(self, point: Array) -> int:
        """Number the nearest free cell to a point as the search does."""
        row, col = self._routes.cell(point)
        if not self._floor[row, col]:
            rows, cols = np.nonzero(self._floor)
            nearest = int(np.argmin((rows - row) ** 2 + (cols - col) ** 2))
            row, col = int(rows[nearest]), int(cols[nearest])
        return int((row + 1) * self._width + col + 1)


def _samples(points: Array, step: float) -> Array:
    """Sample a polyline ``(K, 2)`` at most every ``step`` [m], its corners included."""
    return np.asarray(
        shapely.get_coordinates(shapely.segmentize(shapely.linestrings(points), step))
    )


def evenly(points: Array, step: float = STEP) -> Array:
    """Sample a polyline ``(K, 2)`` at even distances of about ``step`` [m]."""
    steps = np.hypot(*np.diff(points, axis=0).T)
    arc = np.concatenate([[0.0], np.cumsum(steps)])
    count = max(2, int(np.ceil(arc[-1] / step)) + 1)
    at = np.linspace(0.0, arc[-1], count)
    return np.stack([np.interp(at, arc, points[:, 0]), np.interp(at, arc, points[:, 1])], axis=1)


def smoothed(values: Array, half: int) -> Array:
    """Average along axis 0 over ``2 half + 1`` samples; the ends stay."""
    if half < 1 or len(values) < 3:
        return values
    size = 2 * half + 1
    mean: Array = ndimage.uniform_filter1d(values, size, axis=0, mode="nearest")
    blend = np.minimum(np.minimum(np.arange(len(values)), np.arange(len(values))[::-1]) / half, 1.0)
    blend = blend.reshape(-1, *([1] * (values.ndim - 1)))
    return np.asarray(values + blend * (mean - values))


def right_of(
    routes: RouteMap, way: Array, clearance: Array, *, before: float, after: float
) -> Array:
    """Move a way to the right as far as ``RIGHT`` and the walls allow.

    Args:
        routes: the floor.
        way: ``(K, 2)`` in the middle [m].
        clearance: ``(rows, cols)`` [m] to what lanes keep away from.
        before: metres at the start over which the lane leaves the middle.
        after: metres at the end over which it comes back.

    Returns:
        Corners ``(L, 2)`` [m], the ends of ``way`` included.
    """
    points = smoothed(evenly(way), round(SMOOTH / STEP))
    return _beside(routes, points, _heading(points), clearance, before, after)


def both_sides(
    routes: RouteMap, way: Array, clearance: Array, *, ends: float
) -> tuple[Array, Array]:
    """Move a way to the right of who drives along it, and of who comes back; as :func:`right_of`.

    Args:
        routes: the floor.
        way: ``(K, 2)`` in the middle [m].
        clearance: ``(rows, cols)`` [m] to what lanes keep away from.
        ends: metres at both ends over which the lanes part and meet.

    Returns:
        Corners ``(L, 2)`` [m] of the way there, and of the way back.
    """
    points = smoothed(evenly(way), round(SMOOTH / STEP))
    heading = _heading(points)
    return (
        _beside(routes, points, heading, clearance, ends, ends),
        _beside(routes, points[::-1], -heading[::-1], clearance, ends, ends),
    )


def _heading(points: Array) -> Array:
    """Find the direction ``(K, 2)`` at each point of an even polyline, evened out."""
    if len(points) < 2:
        return np.zeros_like(points)
    heading = smoothed(np.gradient(points, axis=0), round(SMOOTH / STEP))
    length: Array = np.hypot(heading[:, 0], heading[:, 1])
    return np.asarray(heading / np.maximum(length, 1e-9)[:, None])


def _beside(
    routes: RouteMap, points: Array, heading: Array, clearance: Array, before: float, after: float
) -> Array:
    if len(points) < 4:
        return points[[0, -1]]
    half = round(SMOOTH / STEP)
    right = np.stack([heading[:, 1], -heading[:, 0]], axis=1)
    most_right = RIGHT + routes.extra
    shares = np.linspace(0.0, most_right, 9)
    moved = [points[:, axis] + np.multiply.outer(shares, right[:, axis]) for axis in (0, 1)]
    gaps = routes.gap_at(moved[0], moved[1], clearance)
    base = np.minimum(gaps[0], WALL_GAP + routes.extra)
    going = np.logical_and.accumulate(
        gaps[1:] >= np.maximum(base - 0.02, LEAST_GAP + routes.extra), axis=0
    )
    room = shares[going.sum(axis=0)]
    arc = np.arange(len(points)) * STEP
    ends = np.minimum(arc / max(before, 1e-6), arc[::-1] / max(after, 1e-6))
    room = np.minimum(room, most_right * np.minimum(ends, 1.0))
    shift = smoothed(ndimage.minimum_filter1d(room, 2 * half + 1, mode="nearest"), half)
    lane = points + shift[:, None] * right
    lane[0], lane[-1] = points[0], points[-1]
    return straightened(routes, lane, clearance)


def straightened(routes: RouteMap, lane: Array, clearance: Array) -> Array:
    """Reduce a lane to as few corners as keep its distance from what is solid."""
    line = shapely.linestrings(lane)
    least = min(LEAST_GAP + routes.extra, float(routes.gap(lane, clearance).min()))
    for tolerance in (TOLERANCE, TOLERANCE / 2.0, TOLERANCE / 6.0):
        corners = shapely.get_coordinates(
            shapely.simplify(line, tolerance, preserve_topology=False)
        )
        if routes.gap(_samples(corners, STEP), clearance).min() >= least - 0.02:
            return np.asarray(corners)
    return np.asarray(lane[:: max(1, round(0.5 / STEP))])
