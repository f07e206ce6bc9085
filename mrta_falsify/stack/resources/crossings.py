"""Where a robot's way runs through the release areas of resources."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.compiled import njit
from mrta_falsify.core.plane import inside

STEP = 0.1  # m between the points of a way that are tested
REACH = 25.0  # m of the way ahead that are searched for areas


@dataclass(frozen=True, slots=True)
class Stretch:
    """A stretch of a way that lies in the release area of a resource."""

    queue: int  #: queue number
    enter: float  #: [m] ahead, 0: is inside
    leave: float  #: [m] ahead, inf: the way ends inside


def stretches(way: Array, areas: Sequence[tuple[int, Array]]) -> tuple[Stretch, ...]:
    """List the areas that a way runs through, in the order in which it enters them.

    Args:
        way: ``(L, 2)`` polyline ahead of a robot [m], L >= 1.
        areas: queue numbers, and their release areas ``(V, 2)`` [m].
    """
    found = []
    for queue, polygon in areas:
        enter, leave = find_crossing(way, polygon)
        if enter < np.inf:
            found.append(Stretch(queue, enter, leave))
    return tuple(sorted(found, key=lambda stretch: (stretch.enter, stretch.queue)))


@njit(cache=True)
def find_crossing(points: Array, polygon: Array) -> tuple[float, float]:
    """Find where a way first runs through an area.

    Args:
        points: ``(L, 2)`` polyline [m], L >= 1.
        polygon: ``(V, 2)`` [m].

    Returns:
        Distances along the way [m] at which it enters (0: begins inside, inf: never enters)
        and leaves again (inf: ends inside).
    """
    enter, arc = np.inf, 0.0
    if inside(polygon, points[0]):
        enter = 0.0
    for i in range(1, points.shape[0]):
        step = points[i] - points[i - 1]
        length = np.hypot(step[0], step[1])
        count = max(1, int(np.ceil(length / STEP)))
        for k in range(1, count + 1):
            here = inside(polygon, points[i - 1] + step * (k / count))
            if here and enter == np.inf:
                enter = arc + length * k / count
            elif not here and enter < np.inf:
                return enter, arc + length * k / count
        arc += length
        if arc > REACH and enter == np.inf:
            break
    return enter, np.inf


@njit(cache=True)
def nearest_arc(points: Array, target: Array, reach: float) -> float:
    """Distance [m] along ``points`` ``(L, 2)``, at most ``reach``, to the point nearest ``target``.

    Args:
        points: ``(L, 2)`` polyline [m].
        target: ``(2,)`` [m].
        reach: how far along the polyline to look [m].
    """
    best, found, arc = np.inf, 0.0, 0.0
    for i in range(1, points.shape[0]):
        step = points[i] - points[i - 1]
        length = np.hypot(step[0], step[1])
        count = max(1, int(np.ceil(length / STEP)))
        for k in range(count + 1):
            at = arc + length * k / count
            if at > reach:
                return found
            gap = points[i - 1] + step * (k / count) - target
            if gap[0] * gap[0] + gap[1] * gap[1] < best:
                best, found = gap[0] * gap[0] + gap[1] * gap[1], at
        arc += length
    return found
