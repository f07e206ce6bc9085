"""Whether a robot's body could get to its goal, past all that stands in the building at the end.

The body is taken for a disc of half its narrowest width, so that what shuts the way for it shuts
it for every stack. Robots are no part of what stands there.
"""

from __future__ import annotations

import functools

import numpy as np
import shapely
from shapely.geometry import Point, Polygon, box

from experiments.oracle.continuing import Fate
from experiments.oracle.stops import REACH
from mrta_falsify.core.arrays import Array
from mrta_falsify.core.world import Blockage, World
from simulator_interface.engines.robot_models import find_model


def half_width(model: str) -> float:
    """Half of the narrowest width of a robot's body [m]."""
    return _half_width(model)


@functools.cache
def _half_width(model: str) -> float:
    body = Polygon(np.asarray(find_model(model).footprint))
    corners = np.array(body.minimum_rotated_rectangle.exterior.coords)
    return float(np.hypot(*np.diff(corners, axis=0).T).min()) / 2.0


def is_shut_off(world: World, fate: Fate, robot: int, place: Array, goal: Array) -> bool:
    """Whether no way leads a robot's body from its place to within reach of its goal.

    Args:
        world: of the run.
        fate: continuation, at the end of which furniture and people stand for good.
        robot: its number.
        place: ``(2,)`` where it stands [m].
        goal: ``(2,)`` where it wants to be [m].
    """
    radius = half_width(world.robots[robot].model)
    solid = shapely.union_all([Polygon(corners) for corners in _solids(world, fate)])
    people = [
        Point(*at).buffer(world.humans[k].radius)
        for k, at in enumerate(fate.people)
        if np.isfinite(at).all()
    ]
    solid = shapely.union_all([solid, *people])
    free = box(*world.bounds).difference(solid.buffer(radius, quad_segs=16))
    parts = [part for part in getattr(free, "geoms", [free]) if not part.is_empty]
    if not parts:
        return True
    own = min(parts, key=lambda part: part.distance(Point(*place)))
    return bool(own.distance(Point(*goal)) > REACH)


def _solids(world: World, fate: Fate) -> list[Array]:
    """Outlines ``(V, 2)`` [m] of all that stands at the end of a continuation."""
    found = list(world.solid_polygons())
    pieces = world.movable_furniture()
    found += [
        piece.outline_at(np.array(pose))
        for piece, pose in zip(pieces, fate.furniture, strict=False)
    ]
    found += [
        event.polygon
        for event in world.events
        if isinstance(event, Blockage) and event.start <= fate.ended < event.end
    ]
    return found
