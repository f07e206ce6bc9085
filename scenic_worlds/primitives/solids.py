"""The unit cube mapped onto triangle meshes, on their surface and inside."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from mrta_falsify.core.arrays import Array
from scenic_worlds.primitives.polygons import LAST

#: unit cube in, point (3,) [m] out; None: outside the solid
VolumeMap = Callable[[float, float, float], Array | None]


class SurfaceMap:
    """Area-preserving map from the unit square onto the triangles of a mesh.

    Args:
        mesh: a trimesh mesh with triangles of positive area [m^2].
    """

    def __init__(self, mesh: Any) -> None:
        self._corners = np.asarray(mesh.triangles, dtype=np.float64)
        self._ends = np.cumsum(mesh.area_faces)

    def point(self, u: float, v: float) -> Array:
        """Point ``(3,)`` [m]: ``u`` picks the triangle and the row in it, ``v`` the place there."""
        i, share = _pick(self._ends, u)
        a, b, c = self._corners[i]
        row = math.sqrt(share)
        found: Array = a + row * ((1.0 - v) * (b - a) + v * (c - a))
        return found


def volume_map(mesh: Any, *, convex: bool) -> VolumeMap:
    """Volume-preserving map from the unit cube onto the inside of a mesh.

    A convex mesh is cut into the tetrahedra between its centre and its triangles. Any other is
    met from its bounding box: points outside give None, for the caller to draw again.

    Args:
        mesh: a closed trimesh mesh.
        convex: whether every segment between two of its points lies inside.
    """
    return _tetrahedra(mesh) if convex else _box(mesh)


def box_map(mesh: Any) -> VolumeMap:
    """Linear map from the unit cube onto a box made by ``trimesh.creation.box``, then moved."""
    corners = np.asarray(mesh.vertices, dtype=np.float64)
    origin = corners[0]
    edges = corners[[4, 2, 1]] - origin  # trimesh numbers the corners in binary: x, y, z
    if len(corners) != 8 or not np.allclose(origin + edges.sum(axis=0), corners[7]):
        return _tetrahedra(mesh)

    def point(u: float, v: float, w: float) -> Array | None:
        found: Array = origin + np.array([u, v, w]) @ edges
        return found

    return point


def _tetrahedra(mesh: Any) -> VolumeMap:
    corners = np.asarray(mesh.triangles, dtype=np.float64)
    apex = np.asarray(mesh.vertices, dtype=np.float64).mean(axis=0)
    edges = corners - apex
    volumes = np.abs(np.einsum("ij,ij->i", edges[:, 0], np.cross(edges[:, 1], edges[:, 2])))
    ends = np.cumsum(volumes)

    def point(u: float, v: float, w: float) -> Array | None:
        i, share = _pick(ends, u)
        a, b, c = edges[i]
        depth, row = share ** (1.0 / 3.0), math.sqrt(v)
        found: Array = apex + depth * (a + row * ((1.0 - w) * (b - a) + w * (c - a)))
        return found

    return point


def _box(mesh: Any) -> VolumeMap:
    low, high = np.asarray(mesh.bounds, dtype=np.float64)

    def point(u: float, v: float, w: float) -> Array | None:
        found: Array = low + np.array([u, v, w]) * (high - low)
        return found if bool(mesh.contains([found])[0]) else None

    return point


def _pick(ends: Array, u: float) -> tuple[int, float]:
    """Piece of cumulated sizes ``ends`` at share ``u``, and the share within it."""
    target = min(max(u, 0.0), LAST) * ends[-1]
    i = min(int(np.searchsorted(ends, target, side="right")), len(ends) - 1)
    before = ends[i - 1] if i else 0.0
    return i, float((target - before) / (ends[i] - before))
