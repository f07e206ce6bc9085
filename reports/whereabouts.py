"""Where something with a name was at a tick: robots, people, furniture and blockages."""

from __future__ import annotations

import numpy as np

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.trace import Trace
from mrta_falsify.core.world import Blockage, World
from reports.furnishing import furniture_poses


def place_of(world: World, trace: Trace, tick: int, name: str) -> Array | None:
    """Find the middle ``(2,)`` [m] of what is called ``name``; None if it has no place then.

    Args:
        world: of the run.
        trace: of the run, kept.
        tick: when.
        name: of a robot, a person, a piece of furniture or a blockage.
    """
    if name in trace.robots:
        return _finite(trace.columns["pose"][tick, trace.robots.index(name), :2])
    if name in trace.humans:
        return _finite(trace.columns["human_position"][tick, trace.humans.index(name)])
    for number, item in enumerate(world.movable_furniture()):
        if item.name == name:
            return _finite(furniture_poses(world, trace)[tick, number, :2])
    standing = [(item.name, item.polygon) for item in world.furniture]
    standing += [(e.name, e.polygon) for e in world.events if isinstance(e, Blockage)]
    for known, polygon in standing:
        if known == name:
            return np.asarray(0.5 * (polygon.min(axis=0) + polygon.max(axis=0)))
    return None


def _finite(place: Array) -> Array | None:
    return np.asarray(place) if np.isfinite(place).all() else None
