"""The unit square mapped onto polygons so that area is preserved."""

from __future__ import annotations

import math
from bisect import bisect_right

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from mrta_falsify.core.arrays import Array, IntArray

#: u is kept below 1 so that a point never falls off the end of a table
LAST = 1.0 - 2.0**-53


class PolygonMap:
    """Area-preserving map from the unit square onto polygons, possibly several, with holes.

    The Knothe map. The inverse of the share of the area that lies left of x takes the first
    coordinate to x; the second goes to y along the vertical cut at x. Between two corners the
    cut is a fixed list of edges, so both steps are closed forms. x grows with the first
    coordinate, y with the second.

    Args:
        shape: shapely polygon or multi-polygon, valid, with positive area [m^2].

    Raises:
        ValueError: the shape has no area.

    Reference: Rosenblatt, "Remarks on a multivariate transformation", Ann. Math. Stat. 1952.
    """

    def __init__(self, shape: BaseGeometry) -> None:
        start, end = _edges(shape)
        corners = np.unique(np.concatenate([start[:, 0], end[:, 0]]))
        slab, edge = _crossings(corners, start[:, 0], end[:, 0])
        rise = (end[:, 1] - start[:, 1]) / (end[:, 0] - start[:, 0])
        left = start[edge, 1] + rise[edge] * (corners[slab] - start[edge, 0])
        right = start[edge, 1] + rise[edge] * (corners[slab + 1] - start[edge, 0])
        order = np.lexsort((left + right, slab))
        slab, left, right = slab[order], left[order], right[order]
        slabs = len(corners) - 1
        first = np.searchsorted(slab, np.arange(slabs + 1))
        # inside a slab the edges in order of y enclose the shape pairwise
        sign = np.where((np.arange(len(slab)) - first[slab]) % 2, 1.0, -1.0)
        length_left = np.maximum(np.bincount(slab, sign * left, slabs), 0.0)
        length_right = np.maximum(np.bincount(slab, sign * right, slabs), 0.0)
        areas = 0.5 * (length_left + length_right) * np.diff(corners)
        self._ends: list[float] = np.cumsum(areas).tolist()
        if not self._ends[-1] > 0.0:
            raise ValueError("the shape has no area")
        # plain lists: points are asked for one at a time
        self._x: list[float] = corners.tolist()
        self._first: list[int] = first.tolist()
        self._left: list[float] = left.tolist()
        self._right: list[float] = right.tolist()
        self._lengths: list[list[float]] = np.column_stack([length_left, length_right]).tolist()
        _, y_min, _, y_max = shape.bounds
        self.bounds = (float(corners[0]), float(y_min), float(corners[-1]), float(y_max))

    @property
    def area(self) -> float:
        """Of the shape [m^2]."""
        return self._ends[-1]

    def point(self, u: float, v: float) -> tuple[float, float]:
        """Point (x, y) [m] of the shape at ``(u, v)`` in the unit square."""
        target = min(max(u, 0.0), LAST) * self._ends[-1]
        i = min(bisect_right(self._ends, target), len(self._ends) - 1)
        share = self._share(i, target - (self._ends[i - 1] if i else 0.0))
        x = self._x[i] + share * (self._x[i + 1] - self._x[i])
        cut = range(self._first[i], self._first[i + 1])
        y = [self._left[j] + share * (self._right[j] - self._left[j]) for j in cut]
        return x, _along(y, min(max(v, 0.0), LAST))

    def _share(self, i: int, area: float) -> float:
        """Share of slab ``i``'s width to the left of which it has ``area`` [m^2]."""
        left, right = self._lengths[i]
        mean = area / (self._x[i + 1] - self._x[i])
        # left s + (right - left) s^2 / 2 = mean, solved without cancellation
        root = math.sqrt(max(left * left + 2.0 * (right - left) * mean, 0.0))
        return min(max(2.0 * mean / (left + root), 0.0), 1.0) if left + root > 0.0 else 0.0


def _along(y: list[float], share: float) -> float:
    """Value at ``share`` of the total length of the intervals (y0, y1), (y2, y3), ..."""
    left = share * sum(max(y[j + 1] - y[j], 0.0) for j in range(0, len(y), 2))
    for j in range(0, len(y), 2):
        length = max(y[j + 1] - y[j], 0.0)
        if left <= length:
            return y[j] + left
        left -= length
    return y[-1]


def _edges(shape: BaseGeometry) -> tuple[Array, Array]:
    """Left and right ends ``(E, 2)`` [m] of all edges that are not vertical."""
    parts = shapely.get_parts(shape)
    parts = parts[shapely.get_type_id(parts) == shapely.GeometryType.POLYGON]
    rings = shapely.get_rings(parts) if len(parts) else parts
    if not len(rings):
        raise ValueError("the shape has no area")
    corners, ring = shapely.get_coordinates(rings, return_index=True)
    same = ring[:-1] == ring[1:]
    start, end = corners[:-1][same], corners[1:][same]
    slanted = start[:, 0] != end[:, 0]
    start, end = start[slanted], end[slanted]
    swap = (start[:, 0] > end[:, 0])[:, None]
    return np.where(swap, end, start), np.where(swap, start, end)


def _crossings(corners: Array, left: Array, right: Array) -> tuple[IntArray, IntArray]:
    """Pairs (slab, edge) of all edges and the slabs between ``corners`` that they cross."""
    first = np.searchsorted(corners, left)
    count = np.searchsorted(corners, right) - first
    edge = np.repeat(np.arange(len(left)), count)
    before = np.concatenate([[0], np.cumsum(count)[:-1]])
    slab = np.arange(count.sum()) - np.repeat(before - first, count)
    return slab, edge
