"""Plane geometry of places: pieces of wall, strips before them, headings, regions of shapes."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import shapely
from scenic.core.regions import PolygonalRegion, Region, nowhere
from scenic.core.vectors import VectorField
from shapely.geometry import LineString, MultiPolygon, Polygon
from shapely.geometry.base import BaseGeometry

from mrta_falsify.core.arrays import Array

WALL_TOUCH = 0.08  # m, outline of a room this near to a wall runs along it
SHORTEST_WALL = 0.3  # m, shorter pieces of wall take no furniture
FIT_STEP = 0.05  # m, between places tried along a wall


def wall_segments(
    room: BaseGeometry, walls: Sequence[Array], doorway: BaseGeometry | None
) -> list[tuple[Array, Array]]:
    """Find the straight pieces of wall around a room, each with the room on its left.

    Args:
        room: outline of the room.
        walls: outlines ``(V, 2)`` [m]; those farther than 1 m do not belong to this room.
        doorway: what lies in it does not count as wall.
    """
    near = [wall for wall in map(Polygon, walls) if wall.distance(room) < 1.0]
    solid = shapely.union_all(near)
    inside = room.difference(solid)
    if doorway is not None:
        solid = solid.difference(doorway)
    beside = solid.buffer(WALL_TOUCH)
    segments = []
    for part in getattr(inside, "geoms", [inside]):
        for i, ring in enumerate((part.exterior, *part.interiors)):
            corners = np.array(shapely.simplify(ring, 0.01).coords)
            if Polygon(corners).exterior.is_ccw != (i == 0):
                corners = corners[::-1]
            for start, end in itertools.pairwise(corners):
                edge = LineString([start, end]).intersection(beside)
                for piece in getattr(edge, "geoms", [edge]):
                    if piece.length < SHORTEST_WALL:
                        continue
                    ends = np.array(piece.coords)
                    if (ends[-1] - ends[0]) @ (end - start) < 0:
                        ends = ends[::-1]
                    segments.append((ends[0], ends[-1]))
    return segments


def touching(shape: BaseGeometry, others: Any) -> BaseGeometry:
    """Keep the parts of ``shape`` that meet one of ``others``."""
    parts = list(getattr(shape, "geoms", [shape]))
    other = shapely.union_all(others)
    return shapely.union_all([part for part in parts if part.intersects(other)])


def stretches_that_fit(
    wall: tuple[Array, Array], standing: BaseGeometry, gap: float, size: tuple[float, float]
) -> list[tuple[Array, Array]]:
    """Find stretches of a wall before which a box of ``size`` stands free, centred on them."""
    start, end = wall
    length = float(np.hypot(*(end - start)))
    along = (end - start) / length
    left = np.array([-along[1], along[0]])
    steps = np.linspace(0.0, length, max(2, math.ceil(length / FIT_STEP) + 1))
    backs = start + steps[:, None] * along + (gap + 0.01) * left
    half = size[0] / 2.0 * along
    corners = np.stack(
        [backs - half, backs + half, backs + half + size[1] * left, backs - half + size[1] * left],
        axis=1,
    )
    fits = shapely.contains(standing, shapely.polygons(corners))
    edges = np.flatnonzero(np.diff(np.concatenate([[0], fits.astype(int), [0]])))
    return [
        (start + steps[first] * along, start + steps[last - 1] * along)
        for first, last in edges.reshape(-1, 2)
        if last - first >= 2  # a single place would be no stretch
    ]


def wall_strip(start: Array, end: Array, near: float, far: float) -> Polygon:
    """Build the rectangle left of a segment, between two distances [m] from it."""
    along = (end - start) / np.hypot(*(end - start))
    left = np.array([-along[1], along[0]])
    return Polygon([start + near * left, end + near * left, end + far * left, start + far * left])


def facing_away(walls: list[tuple[Array, Array]]) -> VectorField:
    """Point from the nearest wall piece into the room."""
    lines = shapely.linestrings([np.array(wall) for wall in walls])
    headings = [heading_of(np.array([-(end - start)[1], (end - start)[0]])) for start, end in walls]

    def heading(position: Any) -> float:
        point = shapely.points(float(position[0]), float(position[1]))
        return headings[int(np.argmin(shapely.distance(lines, point)))]

    return VectorField("along_wall", heading)


def heading_of(direction: Array) -> float:
    """Convert a direction ``(2,)`` to a Scenic heading [rad]: 0 is north, counter-clockwise."""
    return math.atan2(-float(direction[0]), float(direction[1]))


def region_from(
    shape: BaseGeometry, name: str, orientation: VectorField | None = None
) -> PolygonalRegion | Region:
    """Make a region of the polygons of ``shape``; ``nowhere`` if it has no area."""
    parts = getattr(shape, "geoms", [shape])
    polygons = [part for part in parts if isinstance(part, Polygon) and part.area > 1e-6]
    if not polygons:
        return nowhere
    region = PolygonalRegion(polygon=MultiPolygon(polygons), name=name, orientation=orientation)
    region.footprint.name = name  # what contains objects, so what messages are about
    return region
