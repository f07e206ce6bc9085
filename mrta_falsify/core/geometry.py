"""Plane geometry in the map frame (x east, y north, yaw counter-clockwise)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from mrta_falsify.core.arrays import Array, frozen_array


def wrap_angle(angle: ArrayLike) -> Array:
    """Map angles [rad] of any shape to (-pi, pi]."""
    wrapped: Array = np.pi - (np.pi - np.asarray(angle, dtype=np.float64)) % (2.0 * np.pi)
    return wrapped


def rectangle(size_x: float, size_y: float, center: tuple[float, float] = (0.0, 0.0)) -> Array:
    """Build an axis-aligned rectangle ``(4, 2)`` [m], counter-clockwise, around ``center``."""
    half = np.array([size_x, size_y]) / 2.0
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * half
    return frozen_array(corners + np.asarray(center))


def transform(points: Array, pose: ArrayLike) -> Array:
    """Move points ``(..., 2)`` of a body frame to ``pose`` (x [m], y [m], yaw [rad])."""
    x, y, yaw = np.asarray(pose, dtype=np.float64)
    cos, sin = np.cos(yaw), np.sin(yaw)
    rotation = np.array([[cos, -sin], [sin, cos]])
    moved: Array = np.asarray(points) @ rotation.T + np.array([x, y])
    return moved


def signed_area(polygon: Array) -> float:
    """Measure a simple polygon ``(V, 2)`` [m^2]; positive if counter-clockwise."""
    x, y = polygon[:, 0], polygon[:, 1]
    return 0.5 * float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))
