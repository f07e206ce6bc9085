"""Where movable furniture stands in a run."""

from __future__ import annotations

import numpy as np

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.trace import Trace
from mrta_falsify.core.world import World


def furniture_poses(world: World, trace: Trace) -> Array:
    """Centre x, y [m] and turn since the start [rad] of the movable furniture.

    Returns:
        ``(K, F, 3)`` for the K ticks of the trace; where the trace does not say, the first places.
    """
    pieces = world.movable_furniture()
    ticks = len(trace) if "time" in trace.columns else 0
    known = trace.columns.get("furniture_pose")
    if known is not None and known.shape == (ticks, len(pieces), 3):
        return np.asarray(known)
    first = np.array([(*piece.center, 0.0) for piece in pieces]).reshape(-1, 3)
    return np.tile(first, (ticks, 1, 1))


def movable_outlines(world: World, trace: Trace, tick: int) -> list[Array]:
    """Footprints ``(V, 2)`` [m] of the movable furniture at ``tick`` (-1: the last one)."""
    pieces, poses = world.movable_furniture(), furniture_poses(world, trace)
    if not len(poses):
        return [piece.polygon for piece in pieces]
    return [piece.outline_at(pose) for piece, pose in zip(pieces, poses[tick], strict=True)]


def fixed_outlines(world: World) -> list[Array]:
    """Footprints ``(V, 2)`` [m] of the furniture that cannot be pushed."""
    return [item.polygon for item in world.furniture if not item.movable]
