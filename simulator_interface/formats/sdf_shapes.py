"""Shapes of SDF links: their footprints within a slab of heights."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import shapely
from shapely.geometry import Polygon
from shapely.geometry.base import BaseGeometry

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.codec import FARTHEST
from mrta_falsify.core.world import Furniture
from simulator_interface.formats.meshes import mesh_slab, read_mesh
from simulator_interface.formats.outlines import outlines
from simulator_interface.formats.sdf_places import SdfPlace, read_numbers, read_positive
from simulator_interface.formats.xml_files import Node

ROUND = 32  # corners of a round shape
UPRIGHT = 1e-3  # rad; a shape that leans less stands upright
PIECE = 1e-4  # m^2, smaller pieces are left out
FLAT = 1e-6  # m, shapes are not thinner
LEAST_HEIGHT = 0.1  # m, of the furniture that stands for a shape


def footprints_of_model(
    model: Node, where: SdfPlace, low: float, high: float
) -> Iterator[Furniture]:
    """Yield footprints of a model's links within the slab from ``low`` to ``high`` [m]."""
    for number, link in enumerate(model.findall("link")):
        at_link = where.inside(link, link.get("name", f"link_{number}"))
        shapes = link.findall("collision") or link.findall("visual")
        for count, shape in enumerate(shapes):
            at = at_link.inside(shape, shape.get("name", f"{shape.tag}_{count}"))
            geometry = shape.find("geometry")
            if geometry is None:
                continue
            footprint = _footprint(geometry, at, low, high)
            rings = [ring for ring in outlines(footprint) if Polygon(ring).area > PIECE]
            for piece, ring in enumerate(rings):
                name = at.name if len(rings) == 1 else f"{at.name}/{piece}"
                yield Furniture(
                    name=name, kind="static", polygon=ring, height=max(high, LEAST_HEIGHT)
                )


def _footprint(geometry: Node, at: SdfPlace, low: float, high: float) -> BaseGeometry:
    for child in geometry:
        reader = _READERS.get(child.tag)
        if reader is not None:
            return reader(child, at, low, high)
        if child.tag not in _NO_OBSTACLE:
            raise at.fail(
                f"<{child.tag}> is not a shape that is read; allowed: {', '.join(sorted(_READERS))}"
            )
    return Polygon()


def _box(node: Node, at: SdfPlace, low: float, high: float) -> BaseGeometry:
    x, y, z = read_positive(node.find("size"), at, "size", 3)
    outline = np.array([[-x, -y], [x, -y], [x, y], [-x, y]]) / 2.0
    return _prism(outline, (-z / 2.0, z / 2.0), at, low, high)


def _cylinder(node: Node, at: SdfPlace, low: float, high: float) -> BaseGeometry:
    (radius,) = read_positive(node.find("radius"), at, "radius")
    (length,) = read_positive(node.find("length"), at, "length")
    return _prism(_circle(radius), (-length / 2.0, length / 2.0), at, low, high)


def _sphere(node: Node, at: SdfPlace, low: float, high: float) -> BaseGeometry:
    (radius,) = read_positive(node.find("radius"), at, "radius")
    x, y, z = at.matrix[:3, 3]
    off = max(low - z, z - high, 0.0)
    if off >= radius:
        return Polygon()
    return Polygon(_circle(math.sqrt(radius * radius - off * off)) + np.array([x, y]))


def _polyline(node: Node, at: SdfPlace, low: float, high: float) -> BaseGeometry:
    points = [read_numbers(point, at, "point", (2,)) for point in node.findall("point")]
    (height,) = read_positive(node.find("height"), at, "height")
    if len(points) < 3:
        raise at.fail(f"<polyline> has {len(points)} points; it needs at least 3")
    return _prism(np.array(points), (0.0, height), at, low, high)


def _mesh(node: Node, at: SdfPlace, low: float, high: float) -> BaseGeometry:
    uri = (node.findtext("uri") or "").strip()
    scale_node = node.find("scale")
    scale = [1.0, 1.0, 1.0] if scale_node is None else read_numbers(scale_node, at, "scale", (3,))
    vertices, faces = read_mesh(_mesh_file(uri, at))
    placed = (vertices * np.array(scale)) @ at.matrix[:3, :3].T + at.matrix[:3, 3]
    if not (np.abs(placed) <= FARTHEST).all():
        raise at.fail(
            f"mesh {uri[:80]!r} has coordinates that are not from -{FARTHEST:g} to {FARTHEST:g} m"
        )
    try:
        return mesh_slab(placed, faces, low, high)
    except (shapely.errors.GEOSException, ValueError, ArithmeticError) as error:
        raise at.fail(f"mesh {uri[:80]!r} cannot be cut: {str(error)[:80]}") from None


def _mesh_file(uri: str, at: SdfPlace) -> Path:
    if uri.startswith("model://"):
        name = uri.removeprefix("model://")
        candidates = [at.root / name, at.root / "models" / name]
    else:
        name = uri.removeprefix("file://")
        candidates = [at.file.parent / name]
    for file in candidates:
        try:
            found = file.resolve()
        except (OSError, ValueError, RuntimeError) as error:
            raise at.fail(f"<uri> is {uri[:80]!r}; it is no path: {error}") from None
        if not found.is_relative_to(at.root):
            raise at.fail(f"<uri> is {uri[:80]!r}; it must lie in {at.root}")
        if found.is_file():
            return found
    raise at.fail(f"mesh {uri[:80]!r} is not there; copy it beside the file that names it")


def _circle(radius: float) -> Array:
    """Regular polygon ``(ROUND, 2)`` around a circle, never inside it."""
    angle = 2.0 * math.pi * np.arange(ROUND) / ROUND
    reach = radius / math.cos(math.pi / ROUND)
    return reach * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def _prism(
    outline: Array, heights: tuple[float, float], at: SdfPlace, low: float, high: float
) -> BaseGeometry:
    """Footprint of an extruded outline ``(V, 2)`` within the slab."""
    bottom, top = heights
    rotation, shift = at.matrix[:3, :3], at.matrix[:3, 3]
    if abs(rotation[2, 2]) > math.cos(UPRIGHT):
        ends = sorted((shift[2] + rotation[2, 2] * bottom, shift[2] + rotation[2, 2] * top))
        if ends[0] >= high or ends[1] <= low:
            return Polygon()
        middle = np.full((len(outline), 1), 0.5 * (bottom + top))
        placed = np.hstack([outline, middle]) @ rotation.T + shift
        return _valid(Polygon(placed[:, :2]), at)
    # A leaning shape: the sections of its hull; exact for boxes and cylinders.
    n = len(outline)
    rings = [np.hstack([outline, np.full((n, 1), z)]) for z in heights]
    placed = np.vstack(rings) @ rotation.T + shift
    return _hull_slab(placed, low, high)


def _hull_slab(points: Array, low: float, high: float) -> BaseGeometry:
    """Footprint of the part of the convex hull of ``points`` ``(V, 3)`` within the slab."""
    z = points[:, 2]
    inside = [points[(z >= low) & (z <= high), :2]]
    for level in (low, high):
        below, above = points[z < level], points[z > level]
        if len(below) and len(above):
            share = (level - below[:, None, 2]) / (above[None, :, 2] - below[:, None, 2])
            cut = below[:, None, :2] + share[..., None] * (above[None, :, :2] - below[:, None, :2])
            inside.append(cut.reshape(-1, 2))
    kept = np.vstack(inside)
    hull = shapely.MultiPoint(kept).convex_hull if len(kept) > 2 else Polygon()
    return hull if isinstance(hull, Polygon) else hull.buffer(FLAT)


def _valid(shape: Polygon, at: SdfPlace) -> BaseGeometry:
    if not shape.is_valid:
        raise at.fail("its outline crosses itself")
    return shape


_READERS: dict[str, Callable[[Node, SdfPlace, float, float], BaseGeometry]] = {
    "box": _box,
    "cylinder": _cylinder,
    "sphere": _sphere,
    "polyline": _polyline,
    "mesh": _mesh,
}
_NO_OBSTACLE = ("empty", "plane")
