"""When predicted motions come too near to each other, and which ways are free."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mrta_falsify.core.arrays import Array, BoolArray, IntArray
from mrta_falsify.core.compiled import njit
from mrta_falsify.core.plane import signed_distances
from mrta_falsify.stack.control.predicted_motions import SAMPLES, STEP, StraightLeg
from mrta_falsify.stack.control.state import Crew

SLACK_SAMPLES = 2  # a motion may come 0.5 s early or late
#: of the present distance: who is nearer than the gap already must not come nearer; 3 % less, so
#: that keeping the distance is no conflict
KEPT_SHARE = 0.97
SAME_WAY = 0.7  # cosine, motions within 45 degrees lead the same way
MOVES = 0.3  # m in 7 s, motions shorter than that have no direction
STANDS = 0.01  # m^2, (0.1 m)^2: who moves less in 7 s stands


class Traffic(NamedTuple):
    """What the others are about to do, as one robot that chooses sees it."""

    motion: Array  #: (N, SAMPLES, 2) predicted positions [m]
    box: Array  #: (N, 4) least x, y and largest x, y of each motion [m]
    settled: BoolArray  #: (N,) robots whose motion is known by now; others are not kept clear of
    gap: float  #: distance between robots that counts as a conflict [m]
    people: Array  #: (P, 2) who stands near [m]
    people_gap: Array  #: (P,) distance to keep from them [m]


class SharedPlaces(NamedTuple):
    """Outlines of places that robots must ask for, and which of them others hold."""

    corner: Array  #: (sum V, 2) of all outlines, one after the other [m]
    first: IntArray  #: (A + 1,) where each begins
    closed: BoolArray  #: (A,) to the robot


@njit(cache=True)
def fill_box(motion: Array, box: Array) -> None:
    """Fill ``box`` (4,) with the least x, y and the largest x, y of ``motion`` (SAMPLES, 2)."""
    box[0], box[1] = motion[0]
    box[2], box[3] = motion[0]
    for k in range(1, SAMPLES):
        x, y = motion[k]
        box[0], box[1] = min(box[0], x), min(box[1], y)
        box[2], box[3] = max(box[2], x), max(box[3], y)


@njit(cache=True)
def are_apart(box: Array, other: Array, gap: float) -> bool:
    """Whether nothing in one box is nearer than ``gap`` to anything in the other."""
    return bool(
        other[0] - box[2] >= gap
        or box[0] - other[2] >= gap
        or other[1] - box[3] >= gap
        or box[1] - other[3] >= gap
    )


@njit(cache=True)
def conflict(motion: Array, other: Array, gap: float) -> float:
    """Find when two motions first come nearer than ``gap`` [s], inf: never.

    A gap larger than the present distance shrinks to it: what counts is coming nearer.
    """
    now = (motion[0, 0] - other[0, 0]) ** 2 + (motion[0, 1] - other[0, 1]) ** 2
    held = min(gap, KEPT_SHARE * np.sqrt(now))
    square = held * held
    for k in range(SAMPLES):
        for m in range(max(0, k - SLACK_SAMPLES), min(SAMPLES, k + SLACK_SAMPLES + 1)):
            dx, dy = motion[k, 0] - other[m, 0], motion[k, 1] - other[m, 1]
            if dx * dx + dy * dy < square:
                return k * STEP
    return np.inf


@njit(cache=True)
def _conflict_with_point(motion: Array, point: Array, gap: float) -> float:
    """Do as :func:`conflict` with something that stands at ``point`` ``(2,)``."""
    now = (motion[0, 0] - point[0]) ** 2 + (motion[0, 1] - point[1]) ** 2
    held = min(gap, KEPT_SHARE * np.sqrt(now))
    square = held * held
    for k in range(SAMPLES):
        dx, dy = motion[k, 0] - point[0], motion[k, 1] - point[1]
        if dx * dx + dy * dy < square:
            return k * STEP
    return np.inf


@njit(cache=True)
def _is_followed(motion: Array, other: Array) -> bool:
    """Whether ``other`` comes from behind in the same direction: then it is the one to wait."""
    last = SAMPLES - 1
    mx, my = motion[last, 0] - motion[0, 0], motion[last, 1] - motion[0, 1]
    ox, oy = other[last, 0] - other[0, 0], other[last, 1] - other[0, 1]
    dx, dy = motion[0, 0] - other[0, 0], motion[0, 1] - other[0, 1]
    m, o = np.sqrt(mx * mx + my * my), np.sqrt(ox * ox + oy * oy)
    d = np.sqrt(dx * dx + dy * dy)
    if m < MOVES or o < MOVES:
        return False
    return bool(mx * ox + my * oy > SAME_WAY * m * o and dx * ox + dy * oy > SAME_WAY * d * o)


@njit(cache=True)
def first_conflict(i: int, motion: Array, traffic: Traffic) -> tuple[float, bool]:
    """Find robot ``i``'s first conflict [s], inf: none; says whether what it meets stands."""
    first, stands = np.inf, False
    box, place = np.empty(4), np.empty(4)
    fill_box(motion, box)
    for j in range(traffic.motion.shape[0]):
        if j == i or not traffic.settled[j] or are_apart(box, traffic.box[j], traffic.gap):
            continue
        other = traffic.motion[j]
        t = conflict(motion, other, traffic.gap)
        if t < first and not _is_followed(motion, other):
            first = t
            moved = (other[-1, 0] - other[0, 0]) ** 2
            moved += (other[-1, 1] - other[0, 1]) ** 2
            stands = moved < STANDS
    for k in range(traffic.people.shape[0]):
        gap = traffic.people_gap[k]
        place[:2], place[2:] = traffic.people[k], traffic.people[k]
        if are_apart(box, place, gap):
            continue
        t = _conflict_with_point(motion, traffic.people[k], gap)
        if t < first:
            first, stands = t, True
    return first, stands


@njit(cache=True)
def _comes_near(leg: StraightLeg, dx: float, dy: float, gap: float) -> bool:
    """Whether a leg comes nearer than ``gap`` to the point at offset (dx, dy) from its start.

    A gap larger than the present distance shrinks to it.
    """
    t = min(leg.length, max(0.0, dx * leg.ux + dy * leg.uy))
    square = (dx - t * leg.ux) ** 2 + (dy - t * leg.uy) ** 2
    held = min(gap, KEPT_SHARE * np.sqrt(dx * dx + dy * dy))
    return bool(square < held * held)


@njit(cache=True)
def is_clear_of_points(leg: StraightLeg, points: Array, gap: float) -> bool:
    """Whether a leg keeps ``gap`` from all ``points`` ``(S, 2)`` [m], inf: none."""
    for k in range(points.shape[0]):
        dx, dy = points[k, 0] - leg.x, points[k, 1] - leg.y
        if np.isfinite(dx) and _comes_near(leg, dx, dy, gap):
            return False
    return True


@njit(cache=True)
def enters_closed_place(leg: StraightLeg, places: SharedPlaces) -> bool:
    """Whether a leg ends in a place that is closed to the robot, deeper than it begins."""
    ends = np.array([[leg.x, leg.y], [leg.x, leg.y]])
    ends[1, 0] += leg.length * leg.ux
    ends[1, 1] += leg.length * leg.uy
    for k in range(places.closed.shape[0]):
        if places.closed[k]:
            outline = places.corner[places.first[k] : places.first[k + 1]]
            start, end = signed_distances(outline, ends)
            if end < 0.0 and end < start:
                return True
    return False


@njit(cache=True)
def is_clear_of_undecided(
    i: int, leg: StraightLeg, crew: Crew, settled: BoolArray, gap: float
) -> bool:
    """Whether a leg of robot ``i`` keeps ``gap`` from where robots yet to decide are now."""
    for j in range(crew.shape[0]):
        if j == i or not crew[j].present or settled[j]:
            continue
        dx, dy = crew[j].pose[0] - leg.x, crew[j].pose[1] - leg.y
        if _comes_near(leg, dx, dy, gap):
            return False
    return True
