"""When predicted motions come too near to each other, and which ways are free."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mrta_falsify.core.arrays import Array, BoolArray, IntArray
from mrta_falsify.core.compiled import njit
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
    gap: float  #: distance between robots that counts as a conflict [m]
    people: Array  #: (P, 2) who stands near [m]
    people_gap: Array  #: (P,) distance to keep from them [m]
    others: IntArray  #: (M,) settled robots that the robot may meet, ascending
    undecided: IntArray  #: (U,) robots yet to decide that it may come near, ascending


class SharedPlaces(NamedTuple):
    """Outlines of places that robots must ask for, and which of them others hold."""

    corner: Array  #: (sum V, 2) of all outlines, one after the other [m]
    first: IntArray  #: (A + 1,) where each begins
    closed: BoolArray  #: (A,) to the robot


@njit(cache=True)
def fill_box(motion: Array, box: Array) -> None:
    """Fill ``box`` (4,) with the least x, y and the largest x, y of ``motion`` (SAMPLES, 2)."""
    box[0] = box[2] = motion[0, 0]
    box[1] = box[3] = motion[0, 1]
    for k in range(1, SAMPLES):
        x, y = motion[k, 0], motion[k, 1]
        box[0], box[1] = min(box[0], x), min(box[1], y)
        box[2], box[3] = max(box[2], x), max(box[3], y)


@njit(cache=True)
def _held(gap: float, dx: float, dy: float) -> float:
    """Give the gap to keep from what is at an offset of (dx, dy) now: coming nearer counts."""
    return float(min(gap, KEPT_SHARE * np.sqrt(dx * dx + dy * dy)))


@njit(cache=True)
def _meets_within(motion: Array, traffic: Traffic, j: int, until: float) -> float:
    """Find when a motion first comes too near to that of robot ``j`` [s]; inf: not by ``until``."""
    other, box = traffic.motion, traffic.box
    held = _held(traffic.gap, motion[0, 0] - other[j, 0, 0], motion[0, 1] - other[j, 0, 1])
    square = held * held
    for k in range(SAMPLES):
        if k * STEP >= until:
            break
        x, y = motion[k, 0], motion[k, 1]
        if box[j, 0] - x >= held or x - box[j, 2] >= held:
            continue
        if box[j, 1] - y >= held or y - box[j, 3] >= held:
            continue
        for m in range(max(0, k - SLACK_SAMPLES), min(SAMPLES, k + SLACK_SAMPLES + 1)):
            dx, dy = x - other[j, m, 0], y - other[j, m, 1]
            if dx * dx + dy * dy < square:
                return k * STEP
    return np.inf


@njit(cache=True)
def _meets_point_within(motion: Array, x: float, y: float, gap: float, until: float) -> float:
    """Do as :func:`_meets_within` with something that stands at (x, y)."""
    held = _held(gap, motion[0, 0] - x, motion[0, 1] - y)
    square = held * held
    for k in range(SAMPLES):
        if k * STEP >= until:
            break
        dx, dy = motion[k, 0] - x, motion[k, 1] - y
        if dx * dx + dy * dy < square:
            return k * STEP
    return np.inf


@njit(cache=True)
def _is_followed(motion: Array, others: Array, j: int) -> bool:
    """Whether robot ``j`` comes from behind in the same direction: then it is the one to wait."""
    last = SAMPLES - 1
    mx, my = motion[last, 0] - motion[0, 0], motion[last, 1] - motion[0, 1]
    ox, oy = others[j, last, 0] - others[j, 0, 0], others[j, last, 1] - others[j, 0, 1]
    dx, dy = motion[0, 0] - others[j, 0, 0], motion[0, 1] - others[j, 0, 1]
    m, o = np.sqrt(mx * mx + my * my), np.sqrt(ox * ox + oy * oy)
    d = np.sqrt(dx * dx + dy * dy)
    if m < MOVES or o < MOVES:
        return False
    return bool(mx * ox + my * oy > SAME_WAY * m * o and dx * ox + dy * oy > SAME_WAY * d * o)


@njit(cache=True)
def first_conflict(motion: Array, traffic: Traffic) -> tuple[float, bool]:
    """Find a motion's first conflict [s], inf: none; says whether what it meets stands.

    A gap larger than the present distance shrinks to it: what counts is coming nearer.
    """
    first, stands = np.inf, False
    others, box, gap = traffic.motion, traffic.box, traffic.gap
    west = east = motion[0, 0]
    south = north = motion[0, 1]
    for k in range(1, SAMPLES):
        x, y = motion[k, 0], motion[k, 1]
        west, east = min(west, x), max(east, x)
        south, north = min(south, y), max(north, y)
    for m in range(traffic.others.shape[0]):
        j = traffic.others[m]
        if box[j, 0] - east >= gap or west - box[j, 2] >= gap:
            continue
        if box[j, 1] - north >= gap or south - box[j, 3] >= gap:
            continue
        t = _meets_within(motion, traffic, j, first)
        if t < first and not _is_followed(motion, others, j):
            ox = others[j, SAMPLES - 1, 0] - others[j, 0, 0]
            oy = others[j, SAMPLES - 1, 1] - others[j, 0, 1]
            first, stands = t, ox * ox + oy * oy < STANDS
    for k in range(traffic.people.shape[0]):
        x, y = traffic.people[k, 0], traffic.people[k, 1]
        t = _meets_point_within(motion, x, y, traffic.people_gap[k], first)
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
    x, y = leg.x + leg.length * leg.ux, leg.y + leg.length * leg.uy
    for k in range(places.closed.shape[0]):
        if places.closed[k]:
            end = _signed_distance(places, k, x, y)
            if end < 0.0 and end < _signed_distance(places, k, leg.x, leg.y):
                return True
    return False


@njit(cache=True)
def _signed_distance(places: SharedPlaces, place: int, x: float, y: float) -> float:
    """Measure how far (x, y) is from a place [m], as :func:`~.plane.signed_distances` does."""
    corner, begin, end = places.corner, places.first[place], places.first[place + 1]
    square, is_inside = np.inf, False
    ax, ay = corner[end - 1, 0], corner[end - 1, 1]
    for k in range(begin, end):
        bx, by = corner[k, 0], corner[k, 1]
        dx, dy = bx - ax, by - ay
        length, share = dx * dx + dy * dy, 0.0
        if length > 0.0:
            share = min(1.0, max(0.0, ((x - ax) * dx + (y - ay) * dy) / length))
        square = min(square, (ax + share * dx - x) ** 2 + (ay + share * dy - y) ** 2)
        if (by > y) != (ay > y) and x < (ax - bx) * (y - by) / (ay - by) + bx:
            is_inside = not is_inside
        ax, ay = bx, by
    distance = float(np.sqrt(square))
    return -distance if is_inside else distance


@njit(cache=True)
def is_clear_of_undecided(leg: StraightLeg, crew: Crew, traffic: Traffic, gap: float) -> bool:
    """Whether a leg keeps ``gap`` from where robots yet to decide are now."""
    for m in range(traffic.undecided.shape[0]):
        pose = crew[traffic.undecided[m]].pose
        if _comes_near(leg, pose[0] - leg.x, pose[1] - leg.y, gap):
            return False
    return True
