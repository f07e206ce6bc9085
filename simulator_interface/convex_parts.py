"""Outlines as convex parts, for solvers that know convex bodies only."""

from __future__ import annotations

import mapbox_earcut
import numpy as np

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.geometry import signed_area

STRAIGHT = 1e-9  # m^2; a corner that turns right by no more counts as straight


def convex_parts(outline: Array) -> list[Array]:
    """Cut an outline ``(V, 2)`` [m] into convex parts, counter-clockwise.

    Triangles first; two that share a diagonal are joined where the result is convex
    (Hertel and Mehlhorn, "Fast triangulation of simple polygons", 1983).
    """
    ring = np.array(outline, dtype=np.float64)
    if signed_area(ring) < 0.0:
        ring = ring[::-1].copy()
    if _is_convex(ring):
        return [ring]
    corners = mapbox_earcut.triangulate_float64(ring, np.array([len(ring)], dtype=np.uint32))
    parts = [
        [int(k) for k in (triangle if signed_area(ring[triangle]) > 0.0 else triangle[::-1])]
        for triangle in corners.reshape(-1, 3)
    ]
    k = 0
    while k < len(parts):
        joined = _joined_with_any(ring, parts, k)
        k = k + 1 if joined is None else joined
    return [ring[part] for part in parts]


def _joined_with_any(ring: Array, parts: list[list[int]], k: int) -> int | None:
    """Join part ``k`` with a later one in ``parts``; says where to look next, None: no join."""
    for m in range(k + 1, len(parts)):
        whole = _joined(parts[k], parts[m])
        if whole and _is_convex(ring[whole]):
            parts[k] = whole
            del parts[m]
            return k
    return None


def _joined(one: list[int], other: list[int]) -> list[int]:
    """Join two counter-clockwise parts along a side that they share; empty: they share none."""
    for i, a in enumerate(one):
        b = one[(i + 1) % len(one)]
        for j, c in enumerate(other):
            if c == b and other[(j + 1) % len(other)] == a:
                rest = [other[(j + 2 + n) % len(other)] for n in range(len(other) - 2)]
                return one[: i + 1] + rest + one[i + 1 :]
    return []


def _is_convex(ring: Array) -> bool:
    sides = np.roll(ring, -1, axis=0) - ring
    after = np.roll(sides, -1, axis=0)
    turns = sides[:, 0] * after[:, 1] - sides[:, 1] * after[:, 0]
    return bool((turns >= -STRAIGHT).all())
