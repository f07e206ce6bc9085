"""Where idle robots go when they are in the way."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.world import World
from mrta_falsify.stack.resources.queue import inside

APART = 0.6  # m between a place and other robots
OFF_WAY = 0.8  # m between a place and the way that is to be cleared


@dataclass(frozen=True, slots=True, eq=False)
class Refuges:
    """Places to stand, best kind first."""

    points: Array  #: (P, 2) [m]
    kind: Array  #: (P,) 0: parking of the world, 1: waiting spot, 2: corner of a lane


def refuges_of(world: World) -> Refuges:
    """Parking, then what lies outside every release area: waiting spots, corners of lanes.

    Parking inside a release area comes with the waiting spots.
    """
    found: list[tuple[int, Array]] = [(0, point) for point in world.parking]
    found += [(1, spot) for resource in world.resources for spot in resource.spots]
    found += [(2, corner) for lane in world.lanes for corner in lane.to_queue[:-1]]
    points = np.empty((len(found), 2))
    kinds: list[float] = []
    for kind, point in found:
        guarded = any(inside(resource.release_area, point) for resource in world.resources)
        if guarded and kind > 0:
            continue
        gaps = point - points[: len(kinds)]
        if (np.hypot(gaps[:, 0], gaps[:, 1]) < APART).any():
            continue
        points[len(kinds)] = point
        kinds.append(1.0 if guarded else float(kind))
    return Refuges(points[: len(kinds)], np.array(kinds))


def choose_refuge(
    refuges: Refuges,
    position: Array,
    others: Array,
    avoid: Array,
    excluded: Collection[int],
) -> int:
    """The nearest free place of the best kind.

    Args:
        refuges: the places.
        position: ``(2,)`` of the robot that is to go [m].
        others: ``(K, 2)`` robots, and places that robots stand or wait at [m].
        avoid: ``(L, 2)`` points of a way to be cleared [m], may be empty.
        excluded: numbers of places that are taken, or that could not be reached.

    Returns:
        Number of the place, -1 if there is none.
    """
    gaps = np.hypot(*(refuges.points - position).T)
    for place in np.lexsort((gaps, refuges.kind)).tolist():
        point = refuges.points[place]
        if place in excluded or _near(point, others, APART) or _near(point, avoid, OFF_WAY):
            continue
        return int(place)
    return -1


def _near(point: Array, points: Array, distance: float) -> bool:
    return len(points) > 0 and bool(np.hypot(*(points - point).T).min() <= distance)
