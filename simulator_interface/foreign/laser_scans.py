"""What a laser scanner on each robot would see, from what the door tells."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from mrta_falsify.core.arrays import Array


class Scans:
    """What a scanner would see: the solids that rays hit, and the bodies of robots and people.

    The door tells points that rays hit. Rays are evenly spaced; where the first one points is
    found from them.

    Args:
        tick: message of the door.
        radii: ``(N,)`` of the robots [m].
        range_max: nothing farther is seen [m].
    """

    def __init__(self, tick: Mapping[str, Any], radii: Array, range_max: float) -> None:
        self._range_max = range_max
        self._pose: Array = tick["pose"]
        self._points: Array = tick["obstacle_points"]
        is_there = np.isfinite(tick["human_position"]).all(axis=1)
        people, human_radii = tick["human_position"][is_there], tick["human_radius"][is_there]
        self._centres = np.concatenate([self._pose[:, :2], people])
        self._radii = np.concatenate([radii, human_radii])

    def of(self, robot: int) -> tuple[float, Array]:
        """Give the angle of the first ray from the heading [rad], and ranges ``(A,)`` [m].

        A range is inf where nothing is seen.
        """
        x, y, yaw = self._pose[robot]
        offset = self._points[robot] - (x, y)
        count = len(offset)
        angles = np.arange(count) * (2.0 * math.pi / max(1, count))
        hit = np.isfinite(offset).all(axis=1)
        ranges = np.full(count, np.inf)
        ranges[hit] = np.hypot(offset[hit, 0], offset[hit, 1])
        turned = np.arctan2(offset[hit, 1], offset[hit, 0]) - yaw - angles[hit]
        first = math.atan2(np.sin(turned).sum(), np.cos(turned).sum())
        centres = self._centres - (x, y)  # its own is at the origin, so before no ray
        bodies = _distance_to_discs(yaw + first + angles, centres, self._radii)
        nearest = np.minimum(ranges, bodies)
        return first, np.where(nearest <= self._range_max, nearest, np.inf)


def _distance_to_discs(angles: Array, centres: Array, radii: Array) -> Array:
    """Distances ``(A,)`` [m] along rays from the origin to the nearest disc ahead; inf: none.

    Args:
        angles: ``(A,)`` [rad].
        centres: ``(D, 2)`` [m], at least one.
        radii: ``(D,)`` [m].
    """
    along = np.cos(angles)[:, None] * centres[:, 0] + np.sin(angles)[:, None] * centres[:, 1]
    half_chord = radii**2 - ((centres**2).sum(axis=1) - along**2)
    meets = (half_chord >= 0.0) & (along > 0.0)
    near = along - np.sqrt(np.where(meets, half_chord, 0.0))
    return np.asarray(np.where(meets, np.maximum(near, 0.0), np.inf).min(axis=1))
