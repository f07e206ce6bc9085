"""Scenic's regions as images of the unit cube, uniformly.

A chart maps the unit cube onto a region so that a uniform u gives a uniform point, as Scenic's
own ``uniformPointInner`` would. The class whose ``uniformPointInner`` a region inherits decides
its chart. A user's region that samples in its own way gets none and is driven by a seed.
"""

from __future__ import annotations

import inspect
import math
from bisect import bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scenic.core import regions
from scenic.core.distributions import RejectionException
from scenic.core.geometry import averageVectors, headingOfSegment
from scenic.core.regions import Region
from scenic.core.vectors import OrientedVector, Vector

from mrta_falsify.core.candidate import DimensionKind
from scenic_worlds.primitives import solids
from scenic_worlds.primitives.polygons import LAST, PolygonMap

#: share of the unit cube in -> point out
PointMap = Callable[[Sequence[float]], Vector]


@dataclass(frozen=True, slots=True)
class Axis:
    """One coordinate of a chart."""

    kind: DimensionKind
    low: float | None = None  #: smallest value in the map frame [m], where there is one
    high: float | None = None
    choices: int = 0
    values: tuple[str, ...] = ()  #: of a choice, if they are equally likely and plain
    options: tuple[str, ...] = ()  #: what each choice is, in words


@dataclass(frozen=True, slots=True)
class Chart:
    """A map from the unit cube onto a region."""

    axes: tuple[Axis, ...]
    point: PointMap


def chart_of(region: Region) -> Chart | None:
    """Find the chart of a region that is not random; None if its sampling is not known.

    The chart is kept with the region, so that a region of the layout is charted once.
    """
    found = region.__dict__.get("_unit_cube_chart", _UNKNOWN)
    if found is _UNKNOWN:
        build = _BUILDERS.get(type(region).uniformPointInner)
        found = build(region) if build else None
        object.__setattr__(region, "_unit_cube_chart", found)
    return found  # type: ignore[no-any-return]


def axes_of_random(region: Any) -> int | None:
    """Count the coordinates of a region that is itself random; None if unknown.

    Args:
        region: a Scenic region with random parts, or a distribution over regions.
    """
    if isinstance(region, regions.IntersectionRegion):
        return _fewest(region.regions, min)
    if isinstance(region, regions.UnionRegion):
        return _fewest(region.regions, max)
    if isinstance(region, regions.DifferenceRegion):
        return axes_of_random(region.regionA)
    kind: Any = type(region)
    if not isinstance(region, Region):
        kind = getattr(region, "_valueType", object)
    if not inspect.isclass(kind) or not issubclass(kind, Region) or kind is Region:
        return FLOOR_AXES
    implementation: Any = kind
    return _AXES.get(implementation.uniformPointInner)


def _fewest(parts: Sequence[Any], choose: Callable[[list[int]], int]) -> int | None:
    counts = [axes_of_random(part) for part in parts]
    known = [count for count in counts if count is not None]
    return choose(known) if len(known) == len(counts) else None


_UNKNOWN = object()

#: coordinates of a region of which only a program's run tells what it is: places on a floor
FLOOR_AXES = 2


# --- flat regions ----------------------------------------------------------------------------


def _polygons(region: Any) -> Chart:
    shape = PolygonMap(region.polygons)
    x_min, y_min, x_max, y_max = shape.bounds

    def point(u: Sequence[float]) -> Vector:
        x, y = shape.point(u[0], u[1])
        return region.orient(Vector(x, y, region.z))

    return Chart((Axis("point", x_min, x_max), Axis("point", y_min, y_max)), point)


def _rectangle(region: Any) -> Chart:
    half_width, half_length = region.hw, region.hl

    def point(u: Sequence[float]) -> Vector:
        offset = Vector((2.0 * u[0] - 1.0) * half_width, (2.0 * u[1] - 1.0) * half_length, 0)
        return region.orient(region.position.offsetRotated(region.heading, offset))

    if region.heading == 0:
        (x_min, y_min, _), (x_max, y_max, _) = region.AABB
        return Chart((Axis("point", x_min, x_max), Axis("point", y_min, y_max)), point)
    return Chart((Axis("point"), Axis("point")), point)


def _sector_map(region: Any, middle: float, angle: float) -> PointMap:
    """First coordinate: radius; second: angle around ``middle`` [rad]."""
    center, radius = region.center, region.radius

    def point(u: Sequence[float]) -> Vector:
        reach = radius * math.sqrt(u[0])
        turn = middle + (u[1] - 0.5) * angle
        x, y = center.x + reach * math.cos(turn), center.y + reach * math.sin(turn)
        return region.orient(Vector(x, y, center.z))

    return point


def _disc(region: Any) -> Chart:
    axes = (Axis("point", 0.0, float(region.radius)), Axis("point", -math.pi, math.pi))
    return Chart(axes, _sector_map(region, 0.0, 2.0 * math.pi))


def _sector(region: Any) -> Chart:
    middle = region.heading + math.pi / 2.0
    half = region.angle / 2.0
    axes = (
        Axis("point", 0.0, float(region.radius)),
        Axis("point", float(middle - half), float(middle + half)),
    )
    return Chart(axes, _sector_map(region, middle, region.angle))


# --- lines and sets of points ----------------------------------------------------------------


def _polyline(region: Any) -> Chart:
    ends = [float(length) for length in region.cumulativeLengths]

    def point(u: Sequence[float]) -> Vector:
        i, share = _pick(ends, u[0])
        start, end = region.segments[i]
        x, y = averageVectors(start, end, weight=share)
        if region._usingDefaultOrientation:
            return OrientedVector(x, y, 0, headingOfSegment(start, end))
        return region.orient(Vector(x, y, 0))

    return Chart((Axis("point", 0.0, ends[-1]),), point)


def _path(region: Any) -> Chart:
    ends = np.cumsum(region.edge_lengths).tolist()

    def point(u: Sequence[float]) -> Vector:
        i, share = _pick(ends, u[0])
        start, end = (region.vert_to_vec[vertex] for vertex in region.edges[i])
        return start + share * (end - start)

    return Chart((Axis("point", 0.0, ends[-1]),), point)


def _point_set(region: Any) -> Chart:
    return _points(region, region.points)


def _points(region: Any, points: Any) -> Chart:
    """Chart the points ``(n, 3)`` [m]."""

    def point(u: Sequence[float]) -> Vector:
        return region.orient(Vector(*points[min(int(u[0] * len(points)), len(points) - 1)]))

    return Chart((Axis("choice", choices=len(points)),), point)


def _pick(ends: list[float], u: float) -> tuple[int, float]:
    """Interval of cumulated lengths ``ends`` at share ``u``, and the share within it."""
    target = min(max(u, 0.0), LAST) * ends[-1]
    i = min(bisect_right(ends, target), len(ends) - 1)
    before = ends[i - 1] if i else 0.0
    return i, (target - before) / (ends[i] - before)


# --- solids ----------------------------------------------------------------------------------


def _surface(region: Any) -> Chart:
    surface = solids.SurfaceMap(region.mesh)

    def point(u: Sequence[float]) -> Vector:
        return Vector(*surface.point(u[0], u[1]))

    return Chart((Axis("point"), Axis("point")), point)


def _volume(region: Any) -> Chart:
    if isinstance(region, regions.BoxRegion):
        volume = solids.box_map(region.mesh)
    else:
        volume = solids.volume_map(region.mesh, convex=bool(region.isConvex))
    name = region.name or type(region).__name__

    def point(u: Sequence[float]) -> Vector:
        found = volume(u[0], u[1], u[2])
        if found is None:
            raise RejectionException(f"the point is outside {name}")
        return Vector(*found)

    return Chart((Axis("point"), Axis("point"), Axis("point")), point)


def _voxels(region: Any) -> Chart:
    cells, size = region.voxel_points, region.scale

    def point(u: Sequence[float]) -> Vector:
        place = min(max(u[0], 0.0), LAST) * len(cells)
        offset = np.array([place - int(place), u[1], u[2]]) - 0.5
        return Vector(*(cells[int(place)] + offset * size))

    return Chart((Axis("point"), Axis("point"), Axis("point")), point)


# --- combinations that Scenic could not simplify ---------------------------------------------


def _empty(region: Any) -> Chart:
    def point(u: Sequence[float]) -> Vector:
        raise RejectionException(f"the region {region.name or 'nowhere'} is empty")

    return Chart((Axis("point"), Axis("point")), point)


def _intersection(region: Any) -> Chart | None:
    parts = region.regions
    if region.sampler is not None:
        if isinstance(parts[0], regions.PointSetRegion):
            return _common_points(region)
        return None
    known = [part.dimensionality for part in parts if part.dimensionality is not None]
    least = min(known) if known else math.inf
    candidates = [p for p in parts if p.dimensionality is None or p.dimensionality <= least]
    charts = ((part, chart_of(part)) for part in candidates)
    source, chart = next(((part, chart) for part, chart in charts if chart), (None, None))
    if chart is None:
        return None
    others = [part for part in parts if part is not source]

    def point(u: Sequence[float]) -> Vector:
        found = chart.point(u)
        if not all(part._trueContainsPoint(found) for part in others):
            raise RejectionException(f"the point is outside {others[0]}")
        return region.orient(found)

    return Chart(chart.axes, point)


def _common_points(region: Any) -> Chart:
    first, *others = region.regions
    points = [p for p in first.points if all(o.containsPoint(Vector(*p)) for o in others)]
    return _points(region, np.array(points)) if points else _empty(region)


def _union(region: Any) -> Chart | None:
    parts = region.regions
    if region.sampler is not None or any(part.dimensionality is None for part in parts):
        return None
    most = max(part.dimensionality for part in parts)
    large = [part for part in parts if part.dimensionality == most]
    charts = [chart_of(part) for part in large]
    if any(chart is None for chart in charts) or any(part.size is None for part in large):
        return None
    ends = np.cumsum([part.size for part in large]).tolist()

    def point(u: Sequence[float]) -> Vector:
        i, share = _pick(ends, u[0])
        chart = charts[i]
        assert chart is not None
        found = chart.point((share, *u[1:]))
        # where parts overlap only the first one counts
        if any(part._trueContainsPoint(found) for part in large[:i]):
            raise RejectionException(f"the point is in {large[i]} and in another part")
        return region.orient(found)

    return Chart(max((c.axes for c in charts if c), key=len), point)


def _difference(region: Any) -> Chart | None:
    chart = chart_of(region.regionA)
    if region.sampler is not None or chart is None:
        return None

    def point(u: Sequence[float]) -> Vector:
        found = chart.point(u)
        if region.regionB._trueContainsPoint(found):
            raise RejectionException(f"the point is inside {region.regionB}")
        return region.orient(found)

    return Chart(chart.axes, point)


_BUILDERS: dict[Any, Callable[[Any], Chart | None]] = {
    regions.PolygonalRegion.uniformPointInner: _polygons,
    regions.RectangularRegion.uniformPointInner: _rectangle,
    regions.CircularRegion.uniformPointInner: _disc,
    regions.SectorRegion.uniformPointInner: _sector,
    regions.PolylineRegion.uniformPointInner: _polyline,
    regions.PathRegion.uniformPointInner: _path,
    regions.PointSetRegion.uniformPointInner: _point_set,
    regions.MeshSurfaceRegion.uniformPointInner: _surface,
    regions.MeshVolumeRegion.uniformPointInner: _volume,
    regions.VoxelRegion.uniformPointInner: _voxels,
    regions.EmptyRegion.uniformPointInner: _empty,
    regions.IntersectionRegion.uniformPointInner: _intersection,
    regions.UnionRegion.uniformPointInner: _union,
    regions.DifferenceRegion.uniformPointInner: _difference,
}

_AXES: dict[Any, int] = {
    regions.PolygonalRegion.uniformPointInner: 2,
    regions.RectangularRegion.uniformPointInner: 2,
    regions.CircularRegion.uniformPointInner: 2,
    regions.SectorRegion.uniformPointInner: 2,
    regions.PolylineRegion.uniformPointInner: 1,
    regions.PathRegion.uniformPointInner: 1,
    regions.PointSetRegion.uniformPointInner: 1,
    regions.MeshSurfaceRegion.uniformPointInner: 2,
    regions.MeshVolumeRegion.uniformPointInner: 3,
    regions.VoxelRegion.uniformPointInner: 3,
}
