"""Doorways on the way out of a room: narrow stretches between two wider places.

The width is measured *across* the way, on lines that are shifted along it. A door is therefore
told from the corridor behind it even where that corridor is narrower than the door.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from mrta_falsify.core.arrays import Array, BoolArray, IntArray, frozen_array
from scenic_worlds.layouts.routes import STEP, RouteMap, evenly

WITHIN = 12.0  # m of the way out of a room that are searched
WIDEST_DOOR = 2.0  # m
WIDEST_OPENING = 4.0  # m; where a room without a door may end
WIDER = 0.15  # m; before and behind a door there is more width by this
DEEPEST = 1.0  # m from the middle of a door to where it is wider
TURNED = np.deg2rad(60.0)  # a door may be passed at an angle
ANGLE_STEP = np.deg2rad(5.0)
FINE, FINE_STEP = np.deg2rad(24.0), np.deg2rad(3.0)  # the last turns of a door
SHIFTS = np.array([0.0, -0.05, 0.05, -0.1, 0.1, -0.15, 0.15])  # m, and its last moves
SAME_PLACE = 0.3  # m between samples of one doorway
SAME_ANGLE = np.deg2rad(30.0)
DEPTH_COUNTS = 0.1  # times as much as the width; more would tilt doors in thick walls
THIN_WALL = 0.75  # cells; at first walls are this much thicker, so that no ray passes thin ones
FRAMED = 0.12  # m of it at least; a speck is smaller
JAMB = 0.3  # m of wall on both sides of a door, in line with it


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Doorway:
    """A narrow stretch on a way."""

    posts: Array  #: (2, 2) from solid to solid, in the middle of the stretch [m]
    outwards: Array  #: (2,) unit vector, along the way
    reach: float  #: from the middle to where the stretch ends on the way out [m]
    depth: float  #: of the stretch [m]
    at: float  #: along the way [m]
    size: float  #: width and some of the depth, less the wall in line with it [m]
    is_framed: bool  #: in line with a wall
    is_door: bool  #: narrow enough, and wider on both sides

    @property
    def middle(self) -> Array:
        """Middle ``(2,)`` of the stretch [m]."""
        return np.asarray(self.posts.mean(axis=0))

    @property
    def width(self) -> float:
        """From post to post [m]."""
        return float(np.hypot(*(self.posts[1] - self.posts[0])))


def find_stretches(routes: RouteMap, way: Array, *, doors: bool = True) -> list[Stretch]:
    """Find where a way out of a room may pass a door, in order.

    Args:
        routes: the floor.
        way: ``(K, 2)`` from the room point on [m].
        doors: find doors; if not, other openings: wider than a door, or not wider behind.
    """
    if len(way) < 2:
        return []
    points = evenly(way)[: round(WITHIN / STEP)]
    heading = ndimage.uniform_filter1d(np.gradient(points, axis=0), 9, axis=0, mode="nearest")
    widest = WIDEST_DOOR if doors else WIDEST_OPENING
    near = np.flatnonzero(routes.gap(points) <= widest / 2.0)
    near = near[np.hypot(*heading[near].T) > 1e-9]
    course = np.arctan2(heading[near, 1], heading[near, 0])
    turns = np.arange(-TURNED, TURNED + 1e-9, ANGLE_STEP)
    wall = THIN_WALL * routes.resolution
    lines = _narrowest(routes, points[near], course, turns, wall=wall)
    narrow = lines.width <= widest
    near, lines = near[narrow], lines.taking(narrow)
    inner, outer = _wider_at(routes, lines, wall=wall)
    is_door = (lines.width <= WIDEST_DOOR) & np.isfinite(inner + outer)
    chosen = np.flatnonzero(is_door if doors else np.isfinite(inner) & ~is_door)
    near, lines = near[chosen], lines.taking(chosen)
    inner, outer = inner[chosen], outer[chosen] if doors else np.zeros(len(chosen))
    return [
        Stretch(lines.taking(run), inner[run], outer[run], STEP * near[run], doors)
        for run in _runs(near, lines)
    ]


def find_doorways(routes: RouteMap, way: Array, *, doors: bool = True) -> list[Doorway]:
    """Find the doors, or other openings, on a way out of a room; as :func:`find_stretches`."""
    return [doorway_of(routes, s) for s in find_stretches(routes, way, doors=doors)]


@dataclass(frozen=True, slots=True, eq=False)
class _Crossings:
    """The shortest line from solid to solid through each of some points."""

    middle: Array  #: (n, 2) [m]
    angle: Array  #: (n,) of the direction along the way [rad]
    width: Array  #: (n,) [m]

    def taking(self, keep: BoolArray | IntArray) -> _Crossings:
        """Keep some of the lines."""
        return _Crossings(self.middle[keep], self.angle[keep], self.width[keep])


@dataclass(frozen=True, slots=True, eq=False)
class Stretch:
    """Lines across a way that may belong to one doorway."""

    lines: _Crossings
    inner: Array  #: (n,) from each line back to where there is more width [m]
    outer: Array  #: (n,) on to where there is more width [m]
    places: Array  #: (n,) along the way [m]
    is_door: bool  #: narrow enough, and wider on both sides

    @property
    def at(self) -> float:
        """Where it begins along the way [m]."""
        return float(self.places[0])


def _narrowest(
    routes: RouteMap, points: Array, course: Array, turns: Array, *, wall: float = 0.0
) -> _Crossings:
    """Find the shortest lines across ``(n,)`` courses [rad], turned by any of ``turns``."""
    angles = course[:, None] + turns[None]
    across = np.stack([-np.sin(angles), np.cos(angles)], axis=-1)
    starts = np.broadcast_to(points[:, None], across.shape)
    left = _free_along(routes, starts, across, wall)
    right = _free_along(routes, starts, -across, wall)
    # Of equally short lines the one that is nearest to straight across the way.
    best = np.argmin(np.round(left + right, 3) + 1e-3 * np.abs(turns), axis=1)
    rows = np.arange(len(points))
    left, right = left[rows, best], right[rows, best]
    middle = points + (0.5 * (left - right))[:, None] * across[rows, best]
    return _Crossings(middle, angles[rows, best], left + right)


def _wider_at(
    routes: RouteMap,
    crossings: _Crossings,
    *,
    step: float = STEP,
    deepest: float = DEEPEST,
    wall: float = 0.0,
) -> tuple[Array, Array]:
    """Measure how far ``(n,)`` [m] before and behind a line there is more width; inf: nowhere."""
    steps = np.arange(1, round(deepest / step) + 1) * step
    along = np.stack([np.cos(crossings.angle), np.sin(crossings.angle)], axis=-1)
    across = np.stack([-along[:, 1], along[:, 0]], axis=-1)
    across = np.broadcast_to(across[:, None], (len(across), len(steps), 2))
    enough = np.repeat(crossings.width + WIDER, len(steps))
    found = []
    for sign in (-1.0, 1.0):
        centres = crossings.middle[:, None] + (sign * steps)[None, :, None] * along[:, None]
        left, right = (
            _free_along(routes, centres, side * across, wall, enough) for side in (1.0, -1.0)
        )
        width = left + right
        is_free = np.logical_and.accumulate(width > 0.0, axis=1)
        is_wider = is_free & (width >= crossings.width[:, None] + WIDER)
        first = np.where(is_wider.any(axis=1), steps[np.argmax(is_wider, axis=1)], np.inf)
        found.append(first)
    return found[0], found[1]


def _free_along(
    routes: RouteMap, starts: Array, directions: Array, wall: float, enough: Array | None = None
) -> Array:
    """Measure how far ``(...)`` [m] rays go before they come to something solid.

    Args:
        routes: the floor.
        starts: ``(..., 2)`` [m].
        directions: ``(..., 2)`` unit vectors.
        wall: what is nearer than this to something solid counts as solid [m].
        enough: ``(n,)`` a ray that has come so far need not go on [m], of all rays.
    """
    if enough is None:
        enough = np.full(starts.size // 2, WIDEST_OPENING + WIDER)
    flat, along = starts.reshape(-1, 2), directions.reshape(-1, 2)
    far = np.zeros(len(flat))
    going: IntArray = np.arange(len(flat))
    while len(going):
        gap = routes.gap(flat[going] + far[going, None] * along[going])
        is_free = gap > wall
        going, gap = going[is_free], gap[is_free]
        far[going] += gap
        going = going[far[going] < enough[going]]
    return far.reshape(starts.shape[:-1])


def _runs(place: IntArray, lines: _Crossings) -> list[IntArray]:
    """Split samples where they belong to another stretch."""
    samples = np.arange(len(place))
    if not len(samples):
        return []
    moved = np.hypot(*np.diff(lines.middle, axis=0).T) > SAME_PLACE
    turned = np.abs(np.sin(np.diff(lines.angle))) > np.sin(SAME_ANGLE)
    return np.split(samples, np.flatnonzero(moved | turned | (np.diff(place) > 2)) + 1)


def doorway_of(routes: RouteMap, stretch: Stretch) -> Doorway:
    """Measure the doorway of a stretch: the best line across, in the middle of the depth."""
    lines, inner, outer, is_door = stretch.lines, stretch.inner, stretch.outer, stretch.is_door
    k = int(np.argmin(np.round(_sizes(routes, lines, inner + outer), 3)))
    middle, angle, depth = lines.middle[k], float(lines.angle[k]), float(inner[k] + outer[k])
    if is_door:
        shift = 0.5 * (outer[k] - inner[k])
        middle = middle + shift * np.array([np.cos(angle), np.sin(angle)])
        middle, angle, depth = _straightened(routes, middle, angle, depth)
    outwards = frozen_array([np.cos(angle), np.sin(angle)])
    posts = posts_of(routes, middle, outwards)
    across = np.array([-outwards[1], outwards[0]])
    # A wall's end may be ragged: beside the line counts, too.
    beside = posts + routes.resolution * np.multiply.outer([-1.0, 0.0, 1.0], [outwards, outwards])
    jamb = float(_solid_beyond(routes, beside, np.stack([across] * 3)).max())
    return Doorway(
        posts=posts,
        outwards=outwards,
        reach=0.5 * depth if is_door else 0.0,
        depth=depth,
        size=float(np.hypot(*(posts[1] - posts[0]))) + DEPTH_COUNTS * depth - jamb,
        at=float(stretch.places[k]),
        is_framed=jamb >= FRAMED,
        is_door=is_door,
    )


def _straightened(
    routes: RouteMap, middle: Array, angle: float, depth: float
) -> tuple[Array, float, float]:
    """Turn a line as the wall is, where the stretch is least wide and deep.

    Returns:
        the middle ``(2,)`` [m], the direction along the way [rad] and the depth [m].
    """
    angles = np.repeat(angle + np.arange(-FINE, FINE + 1e-9, FINE_STEP), len(SHIFTS))
    along = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    shifts = np.resize(SHIFTS, len(angles))
    lines = _narrowest(routes, middle + shifts[:, None] * along, angles, np.zeros(1))
    deepest = min(depth + 0.2, DEEPEST)
    before, behind = _wider_at(routes, lines, step=routes.resolution, deepest=deepest)
    sizes = _sizes(routes, lines, before + behind)
    if np.isfinite(sizes).any():
        least = np.flatnonzero(sizes <= sizes.min() + 0.25 * routes.resolution)
        best = lines.taking(least[len(least) // 2 :][:1])
        (before,), (behind,) = _wider_at(routes, best, step=0.25 * routes.resolution)
        if np.isfinite(before + behind):
            turned = float(best.angle[0])
            shift = 0.5 * (behind - before) * np.array([np.cos(turned), np.sin(turned)])
            return best.middle[0] + shift, turned, float(before + behind)
    return middle, angle, depth


def posts_of(routes: RouteMap, middle: Array, outwards: Array) -> Array:
    """Span a segment ``(2, 2)`` [m] across a direction, from the solid on its left to the right."""
    side = np.array([-outwards[1], outwards[0]])
    reaches = np.arange(0.0, WIDEST_OPENING, routes.resolution / 2.0)
    posts = []
    for sign in (1.0, -1.0):
        points = middle + sign * reaches[:, None] * side
        solid = np.flatnonzero(routes.gap(points) <= 0.0)
        posts.append(points[solid[0] if len(solid) else -1])
    return frozen_array(posts)


def _sizes(routes: RouteMap, lines: _Crossings, depth: Array) -> Array:
    """Rate ``(n,)`` stretches [m]: the least lies straight across, in line with its wall."""
    across = np.stack([-np.sin(lines.angle), np.cos(lines.angle)], axis=-1)
    ends = (
        lines.middle[:, None]
        + np.multiply.outer(0.5 * lines.width, [[1.0], [-1.0]]) * (across[:, None])
    )
    return lines.width + DEPTH_COUNTS * depth - _solid_beyond(routes, ends, across)


def _solid_beyond(routes: RouteMap, ends: Array, across: Array) -> Array:
    """Measure how much ``(n,)`` [m] is solid beyond both ends of lines, of ``JAMB``.

    Args:
        routes: the floor.
        ends: ``(n, 2, 2)`` left and right end of each line [m].
        across: ``(n, 2)`` unit vectors from right to left.
    """
    reaches = np.arange(1.0, JAMB / routes.resolution + 1.0) * routes.resolution
    outwards = np.stack([across, -across], axis=1)
    points = ends[:, :, None] + reaches[:, None] * outwards[:, :, None]
    solid = routes.gap(points.reshape(-1, 2)).reshape(points.shape[:-1]) <= 0.0
    return np.asarray(np.minimum(solid.sum(axis=-1) * routes.resolution, JAMB).min(axis=-1))
