"""Shapes of SDF links: their footprints within a slab of heights."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from pathlib import Path
from urllib.parse import unquote

import numpy as np
import shapely
from shapely.geometry import Polygon
from shapely.geometry.base import BaseGeometry

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.codec import FARTHEST
from mrta_falsify.core.errors import FormatError
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
        link_name = link.get("name", f"link_{number}")
        if where.is_left_out(link_name):
            continue
        at_link = where.inside(link, link_name)
        shapes = link.findall("collision") or link.findall("visual")
        for count, shape in enumerate(shapes):
            shape_name = shape.get("name", f"{shape.tag}_{count}")
            geometry = shape.find("geometry")
            if geometry is None or at_link.is_left_out(shape_name, *_uris(geometry)):
                continue
            at = at_link.inside(shape, shape_name)
            try:
                footprint = _footprint(geometry, at, low, high)
            except FormatError as error:
                raise FormatError(f"{error} (or leave it out by `skip: [{at.name}]`)") from None
            rings = [ring for ring in outlines(footprint) if Polygon(ring).area > PIECE]
            for piece, ring in enumerate(rings):
                name = at.name if len(rings) == 1 else f"{at.name}/{piece}"
                yield Furniture(
                    name=name, kind="static", polygon=ring, height=max(high, LEAST_HEIGHT)
                )


def _uris(geometry: Node) -> list[str]:
    return [(node.text or "").strip() for node in geometry.iter("uri")]


def _footprint(geometry: Node, at: SdfPlace, low: float, high: float) -> BaseGeometry:
    for child in geometry:
        reader = _READERS.get(child.tag)
        if reader is not None:
            return reader(child, at, low, high)
        if child.tag not in _NO_OBSTACLE:
            raise at.fail(
                f"<{child.tag}> is not a supported shape; allowed: {', '.join(sorted(_READERS))}"
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


def _capsule(node: Node, at: SdfPlace, low: float, high: float) -> BaseGeometry:
    (radius,) = read_positive(node.find("radius"), at, "radius")
    (length,) = read_positive(node.find("length"), at, "length")
    ball = radius * _ball()
    reach = np.array([0.0, 0.0, length / 2.0])
    return _hull_slab(_placed(np.vstack([ball + reach, ball - reach]), at), low, high)


def _ellipsoid(node: Node, at: SdfPlace, low: float, high: float) -> BaseGeometry:
    radii = read_positive(node.find("radii"), at, "radii", 3)
    return _hull_slab(_placed(_ball() * radii, at), low, high)


def _cone(node: Node, at: SdfPlace, low: float, high: float) -> BaseGeometry:
    (radius,) = read_positive(node.find("radius"), at, "radius")
    (length,) = read_positive(node.find("length"), at, "length")
    rim = np.hstack([_circle(radius), np.full((ROUND, 1), -length / 2.0)])
    return _hull_slab(_placed(np.vstack([rim, [[0.0, 0.0, length / 2.0]]]), at), low, high)


def _ball() -> Array:
    """Points ``(K, 3)`` of a polyhedron around the unit ball, never inside it."""
    rise = np.linspace(-math.pi / 2.0, math.pi / 2.0, ROUND // 2 + 1)
    rings = [
        np.hstack([math.cos(angle) * _circle(1.0), np.full((ROUND, 1), math.sin(angle))])
        for angle in rise
    ]
    return np.vstack(rings) / math.cos(math.pi / ROUND)


def _placed(points: Array, at: SdfPlace) -> Array:
    placed: Array = points @ at.matrix[:3, :3].T + at.matrix[:3, 3]
    return placed


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
    scheme, _, rest = uri.rpartition("://")
    name = Path(unquote(rest).lstrip("/") if scheme in ("model", "package") else unquote(rest))
    if scheme in ("model", "package"):
        candidates = [at.root / name, at.root / "models" / name]
    else:
        candidates = [at.file.parent / name]
    if scheme not in ("", "model") or name.is_absolute():  # a path of another machine
        ends = [Path(*name.parts[k:]) for k in range(1, len(name.parts))]
        candidates += [at.file.parent / end for end in ends] + [at.root / end for end in ends]
    try:
        inside = [file.resolve() for file in candidates]
    except (OSError, ValueError, RuntimeError) as error:
        raise at.fail(f"<uri> is {uri[:80]!r}; it is not a path: {error}") from None
    inside = [file for file in inside if file.is_relative_to(at.root)]
    for file in inside:
        if file.is_file():
            return file
    if not inside:
        raise at.fail(f"<uri> is {uri[:80]!r}; it must lie in {at.root}")
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
    "capsule": _capsule,
    "ellipsoid": _ellipsoid,
    "cone": _cone,
    "polyline": _polyline,
    "mesh": _mesh,
}
_NO_OBSTACLE = ("empty", "plane")
