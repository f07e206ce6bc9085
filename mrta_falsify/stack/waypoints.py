"""Waypoint generators, and where a robot joins a sequence of waypoints."""

from __future__ import annotations

import numpy as np

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.registry import WithoutOptions
from mrta_falsify.core.world import Lane


class Roadways(WithoutOptions):
    """Waypoints along the right-hand lanes of the world."""

    def to_queue(self, lane: Lane, tail: Array) -> Array:
        """See :class:`~mrta_falsify.core.protocols.WaypointGenerator`."""
        return np.vstack([lane.to_queue[:-1], tail[None, :]])

    def to_room(self, lane: Lane) -> Array:
        """See :class:`~mrta_falsify.core.protocols.WaypointGenerator`."""
        return np.asarray(lane.to_room)


class Direct(WithoutOptions):
    """Straight to the destination; the planner alone finds the way."""

    def to_queue(self, lane: Lane, tail: Array) -> Array:
        """See :class:`~mrta_falsify.core.protocols.WaypointGenerator`."""
        del lane
        return np.asarray(tail)[None, :]

    def to_room(self, lane: Lane) -> Array:
        """See :class:`~mrta_falsify.core.protocols.WaypointGenerator`."""
        return np.asarray(lane.to_room[-1:])


def join(waypoints: Array, position: Array, origin: Array | None = None) -> Array:
    """Find the part of ``waypoints`` that a robot at ``position`` still has to visit.

    The robot joins at the end of the nearest leg, so that one that starts beside its lane, or
    half-way along it, is not sent back.

    Args:
        waypoints: ``(K, 2)`` [m], K >= 1.
        position: ``(2,)`` [m].
        origin: ``(2,)`` where the way begins, for example the room point; None if unknown.

    Returns:
        A suffix of ``waypoints``, never empty.
    """
    corners = waypoints if origin is None else np.vstack([origin[None, :], waypoints])
    if len(corners) < 2:
        return waypoints
    start, leg = corners[:-1], np.diff(corners, axis=0)
    square = np.maximum((leg**2).sum(axis=1), 1e-12)
    share = np.clip(((position - start) * leg).sum(axis=1) / square, 0.0, 1.0)
    gap = np.hypot(*(start + share[:, None] * leg - position).T)
    nearest = int(np.argmin(np.round(gap, 6)))
    return corners[nearest + 1 :]
