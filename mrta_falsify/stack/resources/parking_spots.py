"""Where idle robots park when they are in the way."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.plane import inside
from mrta_falsify.core.world import World
from mrta_falsify.stack.resources.clear_ways import APART, OFF_WAY, ClearWays

Point: TypeAlias = tuple[float, float]  # x, y [m], map frame


@dataclass(frozen=True, slots=True, eq=False)
class ParkingSpots:
    """Points to park at, best kind first."""

    points: Array  #: (P, 2) [m]
    kind: Array  #: (P,) 0: parking of the world, 1: waiting spot, 2: corner of a lane
    ways: ClearWays  #: finds more where all of these are taken


def parking_spots_of(world: World, ways: ClearWays) -> ParkingSpots:
    """List the parking of the world, then waiting spots and corners of lanes.

    Spots and corners inside a release area are left out, and those where a robot would close the
    only way between two rooms. Parking inside a release area counts as a waiting spot.
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
        if kind > 0 and not ways.leaves_open(point[None, :]):
            continue
        points[len(kinds)] = point
        kinds.append(1.0 if guarded else float(kind))
    return ParkingSpots(points[: len(kinds)], np.array(kinds), ways)


def choose_spot(
    spots: ParkingSpots,
    position: Array,
    others: Array,
    avoid: Array,
    excluded: Collection[Point],
) -> Point | None:
    """Choose the nearest free spot of the best kind, else the nearest place that is in no way.

    Args:
        spots: to choose from.
        position: ``(2,)`` of the robot that is to go [m].
        others: ``(K, 2)`` robots, and places that robots drive to [m].
        avoid: ``(L, 2)`` points of a way to be cleared [m], may be empty.
        excluded: spots that are taken, or that could not be reached.

    Returns:
        The spot, None if there is none.
    """
    gaps = np.hypot(*(spots.points - position).T)
    for number in np.lexsort((gaps, spots.kind)).tolist():
        point = spots.points[number]
        x, y = point.tolist()
        if (x, y) in excluded or _near(point, others, APART) or _near(point, avoid, OFF_WAY):
            continue
        return x, y
    known = np.array(list(excluded), dtype=np.float64).reshape(-1, 2)
    free = spots.ways.places_near(position, beside=others, off=np.vstack([avoid, known]), count=1)
    return (float(free[0][0]), float(free[0][1])) if free else None


def _near(point: Array, points: Array, distance: float) -> bool:
    return len(points) > 0 and bool(np.hypot(*(points - point).T).min() <= distance)
