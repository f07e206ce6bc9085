"""Compiled geometry of points and polygons in the plane."""

from __future__ import annotations

import numpy as np

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.compiled import njit

#: no points ``(0, 2)``; read-only, so that values may share it
NO_POINTS = np.zeros((0, 2))
NO_POINTS.setflags(write=False)


@njit(cache=True)
def inside(polygon: Array, point: Array) -> bool:
    """Whether ``point`` ``(2,)`` lies in the simple polygon ``(V, 2)`` (even-odd rule)."""
    x, y = point[0], point[1]
    hit = False
    if len(polygon) == 0:
        return hit
    last_x, last_y = polygon[-1, 0], polygon[-1, 1]
    for i in range(len(polygon)):
        corner_x, corner_y = polygon[i, 0], polygon[i, 1]
        if (corner_y > y) != (last_y > y):
            crossing = (last_x - corner_x) * (y - corner_y) / (last_y - corner_y) + corner_x
            if x < crossing:
                hit = not hit
        last_x, last_y = corner_x, corner_y
    return hit


@njit(cache=True)
def is_near(point: Array, position: Array, distance: float) -> bool:
    """Whether ``point`` is at most ``distance`` [m] away; x and y come first in both."""
    dx, dy = point[0] - position[0], point[1] - position[1]
    return bool(dx * dx + dy * dy <= distance * distance)


@njit(cache=True)
def is_within(points: Array, position: Array, distance: float) -> bool:
    """Whether one of the points ``(K, 2)`` is at most ``distance`` [m] away."""
    for i in range(points.shape[0]):
        dx, dy = points[i, 0] - position[0], points[i, 1] - position[1]
        if dx * dx + dy * dy <= distance * distance:
            return True
    return False


@njit(cache=True)
def signed_distances(polygon: Array, points: Array) -> Array:
    """Measure how far ``points`` are from a polygon ``(V, 2)`` [m]; inside negative.

    Args:
        polygon: corners.
        points: ``(N, 2)`` [m], or poses ``(N, 3)``.

    Returns:
        ``(N,)`` to the outline [m].
    """
    count = len(polygon)
    result = np.empty(len(points))
    for i in range(len(points)):
        x, y = points[i, 0], points[i, 1]
        square = np.inf
        for k in range(count):
            ax, ay = polygon[k - 1, 0], polygon[k - 1, 1]
            bx, by = polygon[k, 0], polygon[k, 1]
            dx, dy = bx - ax, by - ay
            length = dx * dx + dy * dy
            share = 0.0
            if length > 0.0:
                share = min(1.0, max(0.0, ((x - ax) * dx + (y - ay) * dy) / length))
            square = min(square, (ax + share * dx - x) ** 2 + (ay + share * dy - y) ** 2)
        result[i] = -np.sqrt(square) if inside(polygon, points[i]) else np.sqrt(square)
    return result


def distance_of(point: Array, other: Array) -> float:
    """Distance [m] between two points ``(2,)``."""
    return float(np.hypot(point[0] - other[0], point[1] - other[1]))
