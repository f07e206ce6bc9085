"""Compiled geometry of polylines: project on one, walk along it, cut it, measure it."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import overload

import numpy as np

from mrta_falsify.core.arrays import Array, IntArray
from mrta_falsify.core.compiled import njit
from mrta_falsify.core.plane import NO_POINTS

TIE = 1e-12  # m^2, squared distances that differ by less are equal


@njit(cache=True)
def project_on_segment(path: Array, i: int, x: float, y: float) -> tuple[float, float]:
    """Find the share (0 to 1) of segment ``i`` nearest to (x, y); gives the distance^2 too."""
    ax, ay = path[i, 0], path[i, 1]
    dx, dy = path[i + 1, 0] - ax, path[i + 1, 1] - ay
    square = dx * dx + dy * dy
    t = 0.0
    if square > 0.0:
        t = min(1.0, max(0.0, ((x - ax) * dx + (y - ay) * dy) / square))
    return t, (ax + t * dx - x) ** 2 + (ay + t * dy - y) ** 2


@njit(cache=True)
def project_on_path(path: Array, x: float, y: float, first: int) -> tuple[int, float]:
    """Find where on ``path`` a point is closest.

    Args:
        path: ``(L, 2)`` polyline [m], L >= 2.
        x: position [m], map frame.
        y: position [m], map frame.
        first: segment to begin at; earlier ones are not looked at.

    Returns:
        Segment number and the share of it (0 to 1); the earliest on a tie.
    """
    best = np.inf
    segment, share = first, 0.0
    for i in range(first, path.shape[0] - 1):
        t, gap = project_on_segment(path, i, x, y)
        if gap < best - TIE:
            best = gap
            segment, share = i, t
    return segment, share


@njit(cache=True)
def point_ahead(
    path: Array, segment: int, share: float, x: float, y: float, distance: float
) -> tuple[float, float]:
    """Find the first point of ``path`` after (segment, share) ``distance`` [m] from (x, y)."""
    last = path.shape[0] - 1
    ax = path[segment, 0] + share * (path[segment + 1, 0] - path[segment, 0])
    ay = path[segment, 1] + share * (path[segment + 1, 1] - path[segment, 1])
    for i in range(segment, last):
        bx, by = path[i + 1, 0], path[i + 1, 1]
        if (bx - x) ** 2 + (by - y) ** 2 >= distance * distance:
            # |a + t (b - a) - p| = distance, the larger root: where the path leaves the disc
            dx, dy = bx - ax, by - ay
            ex, ey = ax - x, ay - y
            square = dx * dx + dy * dy
            if square <= 0.0:
                return bx, by
            half = dx * ex + dy * ey
            root = half * half - square * (ex * ex + ey * ey - distance * distance)
            t = (-half + np.sqrt(max(root, 0.0))) / square
            t = min(1.0, max(0.0, t))
            return ax + t * dx, ay + t * dy
        ax, ay = bx, by
    return path[last, 0], path[last, 1]


@njit(cache=True)
def look_along(
    path: Array, x: float, y: float, look_ahead: float
) -> tuple[Array, float, float, float]:
    """Find what is left of a path, and the point to steer for.

    Args:
        path: ``(L, 2)`` polyline [m], L >= 1.
        x: position [m], map frame.
        y: position [m], map frame.
        look_ahead: distance of the point to steer for [m].

    Returns:
        The rest of the path ``(K, 2)``, the point to steer for (x, y), the rest's length [m].
    """
    if path.shape[0] == 1:
        return path.copy(), path[0, 0], path[0, 1], 0.0
    segment, share = project_on_path(path, x, y, 0)
    if share >= 1.0:
        rest = path[segment + 1 :].copy()
    else:
        rest = path[segment:].copy()
        rest[0] = path[segment] + share * (path[segment + 1] - path[segment])
    target_x, target_y = point_ahead(path, segment, share, x, y, look_ahead)
    return rest, target_x, target_y, path_length(rest)


@njit(cache=True)
def path_length(points: Array) -> float:
    """Length [m] of the polyline ``(K, 2)``."""
    length = 0.0
    for i in range(1, points.shape[0]):
        length += np.hypot(points[i, 0] - points[i - 1, 0], points[i, 1] - points[i - 1, 1])
    return length


@njit(cache=True)
def cut_path(points: Array, distance: float) -> Array:
    """Keep the first ``distance`` [m] of the polyline ``(K, 2)``, at least its first point."""
    left = max(distance, 0.0)
    for i in range(1, points.shape[0]):
        length = np.hypot(points[i, 0] - points[i - 1, 0], points[i, 1] - points[i - 1, 1])
        if length > left:
            part = points[: i + 1].copy()
            part[i] = points[i - 1] + (points[i] - points[i - 1]) * (left / length)
            return part
        left -= length
    return points.copy()


def point_before_end(points: Array, distance: float) -> Array:
    """Point ``(2,)`` of the polyline ``(K, 2)`` that lies ``distance`` [m] before its end."""
    left = distance
    for i in range(len(points) - 1, 0, -1):
        step = points[i - 1] - points[i]
        length = float(np.hypot(*step))
        if length >= left and length > 0.0:
            return np.asarray(points[i] + step * (left / length))
        left -= length
    return np.asarray(points[0])


class Polylines(Sequence[Array]):
    """P polylines ``(L, 2)`` [m], empty or not, kept one after the other for compiled code."""

    __slots__ = ("first", "points")

    def __init__(self, points: Array, first: IntArray) -> None:
        self.points = points  #: (sum L, 2) of all
        self.first = first  #: (P + 1,) where each begins, the end included

    @classmethod
    def of(cls, polylines: Sequence[Array]) -> Polylines:
        """Put polylines one after the other."""
        first = np.array([0, *itertools.accumulate(map(len, polylines))], dtype=np.int64)
        return cls(np.concatenate([NO_POINTS, *polylines]), first)

    def __len__(self) -> int:
        return len(self.first) - 1

    @overload
    def __getitem__(self, number: int) -> Array: ...
    @overload
    def __getitem__(self, number: slice) -> list[Array]: ...
    def __getitem__(self, number: int | slice) -> Array | list[Array]:
        places = range(len(self))[number]
        if isinstance(places, range):
            return [self[place] for place in places]
        return self.points[self.first[places] : self.first[places + 1]]
