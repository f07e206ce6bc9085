"""Numbers, headings and rectangles as a Scenic program must write them to get them back exactly.

A minimised failure is handed over as a program, and a deadlock may hang on the last bit of a
corner. Scenic turns a heading into a quaternion and back, so the number to write is often a
neighbour of the number wanted; the neighbours are tried.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scenic.core.vectors import Orientation

from mrta_falsify.core import geometry
from mrta_falsify.core.arrays import Array

DEG = 0.01745329252  # rad, what Scenic multiplies by for `deg`
#: neighbouring floating-point headings tried on each side of a yaw; of 400 random rectangles
#: 191 come back exactly with 1, 241 with 4, 258 with 12 and 266 with 24
NEAREST = 24


def number_text(value: float) -> str:
    """Write ``value`` exactly and as short as possible."""
    value = float(value)
    whole = value == math.floor(value) and abs(value) < 1e9
    return str(int(value)) if whole else repr(value)


def point_text(point: Array) -> str:
    """Write a point ``(2,)`` exactly."""
    return f"({number_text(point[0])}, {number_text(point[1])})"


@dataclass(frozen=True, slots=True)
class Box:
    """A rectangle as Scenic places it."""

    x: float
    y: float
    heading: str  #: as written behind `facing`
    length: float  #: along the heading [m]
    width: float
    is_exact: bool  #: its corners come out bit for bit


def _headings(yaw: float) -> Iterator[tuple[str, float]]:
    """Yield ways to write a yaw as a heading, and the yaw that each gives; best first."""
    heading = float(geometry.wrap_angle(yaw - np.pi / 2.0))
    degrees = round(heading / DEG, 6)
    yield f"{number_text(degrees)} deg", _yaw_of(degrees * DEG)
    above = below = heading
    for _ in range(NEAREST):
        for near in (below, above):
            yield number_text(near), _yaw_of(near)
        above, below = math.nextafter(above, math.inf), math.nextafter(below, -math.inf)


def _yaw_of(heading: float) -> float:
    """Compute the yaw of an object that faces ``heading``; Scenic goes over a quaternion."""
    faced = float(Orientation.fromEuler(heading, 0, 0).yaw)
    return float(geometry.wrap_angle(faced + np.pi / 2.0))


@functools.lru_cache(maxsize=4096)
def heading_text(yaw: float) -> str:
    """Write a yaw as Scenic's `facing` takes it: exact if possible, the nearest otherwise."""
    ways = list(_headings(yaw))
    return min(ways, key=lambda way: abs(float(geometry.wrap_angle(way[1] - yaw))))[0]


def box_of(polygon: Array) -> Box:
    """Find the box whose footprint is ``polygon`` ``(V, 2)`` [m], or nearest to it."""
    corners = tuple(float(value) for value in polygon.ravel())
    return _box_of_corners(corners)


@functools.lru_cache(maxsize=4096)
def _box_of_corners(corners: tuple[float, ...]) -> Box:
    polygon = np.array(corners).reshape(-1, 2)
    middle = polygon.mean(axis=0)
    if len(polygon) != 4:
        return Box(float(middle[0]), float(middle[1]), "0", 0.0, 0.0, is_exact=False)
    along, across = polygon[1] - polygon[0], polygon[3] - polygon[0]
    sides = (math.hypot(*along), math.hypot(*across))
    yaw = math.atan2(along[1], along[0])
    for decimals in (6, 15):
        length, width = (round(side, decimals) for side in sides)
        outline = geometry.rectangle(length, width)
        for text, given in _headings(yaw):
            turned = geometry.transform(outline, (0.0, 0.0, given))
            x, y = (_offset(turned[:, i], polygon[:, i]) for i in (0, 1))
            if x is not None and y is not None:
                moved = geometry.transform(outline, (x, y, given))
                if np.array_equal(moved, polygon):
                    return Box(x, y, text, length, width, is_exact=True)
    return Box(float(middle[0]), float(middle[1]), heading_text(yaw), *sides, is_exact=False)


def _offset(start: Array, end: Array) -> float | None:
    """Find a number that takes each of ``start`` ``(4,)`` exactly to ``end``; None: none does."""
    guesses = [round(float(np.mean(end)), 6), float(np.mean(end - start))]
    for difference in end - start:
        near = float(difference)
        guesses += [near, math.nextafter(near, math.inf), math.nextafter(near, -math.inf)]
    return next((guess for guess in guesses if np.array_equal(start + guess, end)), None)
