"""SDF worlds: what their static models put in a robot's way.

Every collision shape of a static model (its visual shapes if it has none) is cut by the slab
of heights that a robot fills, and becomes furniture. Files count as untrusted: document
types and entities are refused, and nothing outside the world's folder is read.

Reference: http://sdformat.org/spec (1.4 to 1.9); poses are x y z roll pitch yaw.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import shapely
from shapely.geometry import Polygon
from shapely.geometry.base import BaseGeometry

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.errors import FormatError
from mrta_falsify.core.world import Furniture
from simulator_interface.formats.meshes import mesh_slab, read_mesh
from simulator_interface.formats.outlines import outlines
from simulator_interface.formats.xml_files import Node, read_xml

MAX_NESTING = 20  # of models that include models
MAX_MODELS = 20_000
ROUND = 32  # corners of a round shape
UPRIGHT = 1e-3  # rad; a shape that leans less stands upright
IGNORED = ("sun", "ground_plane")  # models of Gazebo that are no obstacles
PIECE = 1e-4  # m^2, smaller pieces are left out
FLAT = 1e-6  # m, shapes are not thinner


@dataclass(frozen=True, slots=True, eq=False)
class _Place:
    """Where an element stands, for poses and messages."""

    file: Path  #: that holds it
    root: Path  #: folder of the world; nothing outside is read
    matrix: Array  #: (4, 4) to the map frame
    name: str  #: models and links on the way, joined by /
    nesting: int = 0

    def inside(self, node: Node, name: str) -> _Place:
        """The place of an element that has a pose."""
        matrix = self.matrix @ _pose(node, self, name)
        joined = f"{self.name}/{name}" if self.name else name
        return _Place(self.file, self.root, matrix, joined, self.nesting)

    def fail(self, problem: str) -> FormatError:
        """An error that names the file and the element."""
        where = f"{self.name}: " if self.name else ""
        return FormatError(f"{self.file}: {where}{problem}")


def read_sdf(
    path: Path, *, low: float = 0.05, high: float = 0.5, skip: tuple[str, ...] = ()
) -> tuple[Furniture, ...]:
    """Obstacles of the static models of an SDF world, or of one model.

    Args:
        path: the file. Models that it includes are looked up beside it as ``NAME`` or
            ``models/NAME``, meshes beside the file that names them; all must lie in the
            folder of ``path``.
        low: lowest height at which robots touch things [m].
        high: highest such height [m].
        skip: names of models to leave out.

    Returns:
        Footprints ``model/link/collision`` within the slab, kind "static".

    Raises:
        FormatError: a file cannot be read or is broken; a model or mesh is not there; a
            pose or size is not allowed.
    """
    root = path.parent.resolve()
    top = read_xml(path, "sdf")
    worlds = top.findall("world")
    holders = worlds if worlds else [top]
    place = _Place(path, root, np.eye(4), "")
    found: list[Furniture] = []
    left = itertools.count()
    for holder in holders:
        for model, where in _models(holder, place, frozenset(skip), left):
            found += _footprints(model, where, low, high)
    return tuple(found)


# --- numbers and poses ---------------------------------------------------------------------


def _numbers(node: Node, place: _Place, what: str, counts: tuple[int, ...]) -> list[float]:
    text = node.text or ""
    try:
        values = [float(word) for word in text.split()]
    except ValueError:
        values = []
    if len(values) not in counts or not all(map(math.isfinite, values)):
        wanted = " or ".join(map(str, counts))
        raise place.fail(f"<{what}> is {text.strip()[:60]!r}; it must be {wanted} finite numbers")
    return values


def _positive(node: Node | None, place: _Place, what: str, count: int = 1) -> list[float]:
    if node is None:
        raise place.fail(f"<{what}> is missing")
    values = _numbers(node, place, what, (count,))
    if min(values) <= 0.0:
        raise place.fail(f"<{what}> is {(node.text or '').strip()!r}; it must be positive")
    return values


def _pose(node: Node, place: _Place, name: str) -> Array:
    """Matrix ``(4, 4)`` of an element's <pose>, the identity if it has none."""
    pose = node.find("pose")
    if pose is None or not (pose.text or "").strip():
        return np.eye(4)
    frame = pose.get("relative_to") or pose.get("frame") or ""
    if frame not in ("", "world", "__model__"):
        raise place.fail(
            f"{name}: <pose> is relative to {frame!r}; only poses in the parent's frame are read "
            "(resolve them first, for example with `gz sdf -p`)"
        )
    matrix: Array = np.eye(4)
    if pose.get("rotation_format") == "quat_xyzw":
        values = _numbers(pose, place, "pose", (7,))
        matrix[:3, :3] = _quaternion_rotation(values[3:], place)
    else:
        values = _numbers(pose, place, "pose", (6,))
        scale = math.pi / 180.0 if pose.get("degrees") == "true" else 1.0
        matrix[:3, :3] = _euler_rotation(*(scale * angle for angle in values[3:]))
    matrix[:3, 3] = values[:3]
    return matrix


def _euler_rotation(roll: float, pitch: float, yaw: float) -> Array:
    """Rotation ``(3, 3)``: roll about x, then pitch about y, then yaw about z, fixed axes."""
    cr, sr, cp, sp = math.cos(roll), math.sin(roll), math.cos(pitch), math.sin(pitch)
    cy, sy = math.cos(yaw), math.sin(yaw)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def _quaternion_rotation(quaternion: list[float], place: _Place) -> Array:
    x, y, z, w = quaternion
    norm = math.sqrt(x * x + y * y + z * z + w * w)
    if norm < 1e-6:
        raise place.fail("<pose> has a quaternion of length 0")
    x, y, z, w = x / norm, y / norm, z / norm, w / norm
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


# --- models ------------------------------------------------------------------------------


def _is_true(node: Node, tag: str) -> bool:
    return (node.findtext(tag) or "").strip().lower() in ("true", "1")


def _models(
    holder: Node, place: _Place, skip: frozenset[str], count: Iterator[int]
) -> Iterator[tuple[Node, _Place]]:
    """Static models of a world or model, at any depth, each with its place."""
    for child in holder:
        if child.tag not in ("model", "include"):
            continue
        if next(count) >= MAX_MODELS:
            raise place.fail(f"has more than {MAX_MODELS} models")
        if child.tag == "model":
            name = child.get("name", "")
            if name in skip:
                continue
            where = place.inside(child, name)
            yield from _whole(child, where, skip, count, static=_is_true(child, "static"))
        else:
            yield from _included(child, place, skip, count)


def _whole(
    model: Node, where: _Place, skip: frozenset[str], count: Iterator[int], *, static: bool
) -> Iterator[tuple[Node, _Place]]:
    """A model, if it is static, and the models inside it."""
    if static:
        yield model, where
        for inner in model.findall("model"):
            # What is part of a static model does not move either.
            name = inner.get("name", "")
            yield from _whole(inner, where.inside(inner, name), skip, count, static=True)
        for include in model.findall("include"):
            yield from _included(include, where, skip, count, static=True)
        return
    yield from _models(model, where, skip, count)


def _included(
    include: Node,
    place: _Place,
    skip: frozenset[str],
    count: Iterator[int],
    *,
    static: bool = False,
) -> Iterator[tuple[Node, _Place]]:
    uri = (include.findtext("uri") or "").strip()
    if not uri.startswith("model://"):
        raise place.fail(f"<uri> is {uri[:80]!r}; only model://NAME is read")
    model_name = uri.removeprefix("model://").strip("/")
    name = (include.findtext("name") or model_name).strip()
    if model_name in IGNORED or model_name in skip or name in skip:
        return
    if place.nesting >= MAX_NESTING:
        raise place.fail(f"models include each other more than {MAX_NESTING} deep ({uri})")
    file = _model_file(model_name, place)
    models = read_xml(file, "sdf").findall("model")
    if not models:
        raise FormatError(f"{file}: has no <model>")
    model = models[0]
    # The pose of an <include> takes the place of the model's own.
    holder = include if include.find("pose") is not None else model
    at = place.inside(holder, name)
    where = _Place(file, place.root, at.matrix, at.name, place.nesting + 1)
    given = include.find("static")
    own = _is_true(model, "static") if given is None else _is_true(include, "static")
    yield from _whole(model, where, skip, count, static=static or own)


def _model_file(model: str, place: _Place) -> Path:
    """The SDF file of ``model://NAME``."""
    for folder in (place.root / model, place.root / "models" / model):
        for file in (folder / "model.sdf", *sorted(folder.glob("*.sdf"))):
            if file.is_file() and file.resolve().is_relative_to(place.root):
                return file
    raise place.fail(
        f"model://{model} is not in {place.root} or its folder models; copy it there, or name "
        "it in `skip`"
    )


# --- shapes ------------------------------------------------------------------------------


def _footprints(model: Node, where: _Place, low: float, high: float) -> Iterator[Furniture]:
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
                yield Furniture(name=name, kind="static", polygon=ring, height=max(high, 0.1))


def _footprint(geometry: Node, at: _Place, low: float, high: float) -> BaseGeometry:
    for child in geometry:
        reader = _READERS.get(child.tag)
        if reader is not None:
            return reader(child, at, low, high)
        if child.tag not in _NO_OBSTACLE:
            raise at.fail(
                f"<{child.tag}> is not a shape that is read; allowed: {', '.join(sorted(_READERS))}"
            )
    return Polygon()


def _box(node: Node, at: _Place, low: float, high: float) -> BaseGeometry:
    x, y, z = _positive(node.find("size"), at, "size", 3)
    outline = np.array([[-x, -y], [x, -y], [x, y], [-x, y]]) / 2.0
    return _prism(outline, (-z / 2.0, z / 2.0), at, low, high)


def _cylinder(node: Node, at: _Place, low: float, high: float) -> BaseGeometry:
    (radius,) = _positive(node.find("radius"), at, "radius")
    (length,) = _positive(node.find("length"), at, "length")
    return _prism(_circle(radius), (-length / 2.0, length / 2.0), at, low, high)


def _sphere(node: Node, at: _Place, low: float, high: float) -> BaseGeometry:
    (radius,) = _positive(node.find("radius"), at, "radius")
    x, y, z = at.matrix[:3, 3]
    off = max(low - z, z - high, 0.0)
    if off >= radius:
        return Polygon()
    return Polygon(_circle(math.sqrt(radius * radius - off * off)) + np.array([x, y]))


def _polyline(node: Node, at: _Place, low: float, high: float) -> BaseGeometry:
    points = [_numbers(point, at, "point", (2,)) for point in node.findall("point")]
    (height,) = _positive(node.find("height"), at, "height")
    if len(points) < 3:
        raise at.fail(f"<polyline> has {len(points)} points; it needs at least 3")
    return _prism(np.array(points), (0.0, height), at, low, high)


def _mesh(node: Node, at: _Place, low: float, high: float) -> BaseGeometry:
    uri = (node.findtext("uri") or "").strip()
    scale_node = node.find("scale")
    scale = [1.0, 1.0, 1.0] if scale_node is None else _numbers(scale_node, at, "scale", (3,))
    vertices, faces = read_mesh(_mesh_file(uri, at))
    placed = (vertices * np.array(scale)) @ at.matrix[:3, :3].T + at.matrix[:3, 3]
    if not np.isfinite(placed).all():
        raise at.fail(f"mesh {uri!r} has coordinates that are not finite")
    return mesh_slab(placed, faces, low, high)


def _mesh_file(uri: str, at: _Place) -> Path:
    if uri.startswith("model://"):
        name = uri.removeprefix("model://")
        candidates = [at.root / name, at.root / "models" / name]
    else:
        name = uri.removeprefix("file://")
        candidates = [at.file.parent / name]
    for file in candidates:
        found = file.resolve()
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
    outline: Array, heights: tuple[float, float], at: _Place, low: float, high: float
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


def _valid(shape: Polygon, at: _Place) -> BaseGeometry:
    if not shape.is_valid:
        raise at.fail("its outline crosses itself")
    return shape


_READERS: dict[str, Callable[[Node, _Place, float, float], BaseGeometry]] = {
    "box": _box,
    "cylinder": _cylinder,
    "sphere": _sphere,
    "polyline": _polyline,
    "mesh": _mesh,
}
_NO_OBSTACLE = ("empty", "plane")
