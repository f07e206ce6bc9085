"""COLLADA meshes (``.dae``): positions and faces, as Gazebo's models have them.

Reference: COLLADA 1.4.1 specification, Khronos Group 2008; Gazebo classic ignores
``up_axis`` (gazebo-classic issue 1305), and so do models made for it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from mrta_falsify.core.arrays import Array, IntArray
from mrta_falsify.core.codec import FARTHEST
from mrta_falsify.core.errors import FormatError
from simulator_interface.formats.xml_files import Node, read_xml

MAX_NODES = 100_000


def read_collada(path: Path) -> tuple[Array, IntArray]:
    """Read vertices ``(V, 3)`` [m] and triangles ``(F, 3)`` of a COLLADA file.

    ``up_axis`` is ignored, as in Gazebo: what a node's matrix makes z is up.

    Raises:
        FormatError: not such a file, or its numbers do not fit together.
    """
    top = read_xml(path, "COLLADA")
    try:
        unit = float((_found(top, "asset/unit") or {}).get("meter", "1"))
        meshes = {geometry.get("id", ""): _mesh(geometry) for geometry in top.iter("geometry")}
        points, faces, count = [np.zeros((0, 3))], [np.zeros((0, 3), dtype=np.int64)], 0
        for name, matrix in _placed(top, list(meshes)):
            vertices, triangles = meshes[name]
            points.append(vertices @ matrix[:3, :3].T + matrix[:3, 3])
            faces.append(triangles + count)
            count += len(vertices)
        made = unit * np.vstack(points)
        if not (np.abs(made) <= FARTHEST).all():
            raise ValueError(f"it has coordinates beyond {FARTHEST:g} m")
    except (KeyError, ValueError, IndexError, ArithmeticError, RecursionError) as error:
        text = " ".join(str(error).split())[:80]
        raise FormatError(
            f"{path}: is not a supported mesh: {type(error).__name__}: {text}"
        ) from None
    return made, np.vstack(faces)


def _found(node: Node, where: str) -> dict[str, str] | None:
    found = node.find(where)
    return None if found is None else dict(found.attrib)


def _numbers(text: str | None) -> Array:
    return np.array((text or "").split(), dtype=np.float64)


def _mesh(geometry: Node) -> tuple[Array, IntArray]:
    """Vertices and triangles of one geometry; polygons become fans."""
    mesh = geometry.find("mesh")
    if mesh is None:
        return np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64)
    sources = {
        source.get("id", ""): _numbers(source.findtext("float_array"))
        for source in mesh.findall("source")
    }
    vertices = mesh.find("vertices")
    inputs = [] if vertices is None else vertices.findall("input")
    positions = [node for node in inputs if node.get("semantic") == "POSITION"]
    if not positions:
        raise ValueError("a mesh without POSITION")
    points = sources[positions[0].get("source", "").lstrip("#")].reshape(-1, 3)
    faces: list[tuple[int, int, int]] = []
    for kind in ("triangles", "polylist", "polygons"):
        for primitive in mesh.findall(kind):
            for corners in _polygons(primitive, kind):
                faces += [
                    (corners[0], corners[k], corners[k + 1]) for k in range(1, len(corners) - 1)
                ]
    triangles = np.array(faces, dtype=np.int64).reshape(-1, 3)
    if len(triangles) and not 0 <= triangles.min() <= triangles.max() < len(points):
        raise ValueError("faces name vertices that are not there")
    return points, triangles


def _polygons(primitive: Node, kind: str) -> Iterator[list[int]]:
    """Vertex numbers of every face."""
    inputs = primitive.findall("input")
    stride = 1 + max(int(node.get("offset", "0")) for node in inputs)
    offset = next(
        int(node.get("offset", "0")) for node in inputs if node.get("semantic") == "VERTEX"
    )
    for text in primitive.findall("p"):
        numbers = np.array((text.text or "").split(), dtype=np.int64)
        corners = numbers.reshape(-1, stride)[:, offset].tolist()
        if kind == "polygons":
            yield corners
            continue
        sizes = [3] * (len(corners) // 3)
        if kind == "polylist":
            sizes = [int(word) for word in (primitive.findtext("vcount") or "").split()]
        if sum(sizes) != len(corners):
            raise ValueError("vcount does not fit p")
        first = 0
        for size in sizes:
            yield corners[first : first + size]
            first += size


def _placed(top: Node, names: list[str]) -> Iterator[tuple[str, Array]]:
    """Geometries by name, with their matrices; all of them as they are without a scene."""
    scenes = list(top.iter("visual_scene"))
    if not scenes:
        yield from ((name, np.eye(4)) for name in names)
        return
    pending = [(node, np.eye(4)) for node in scenes[0].findall("node")][::-1]
    seen = 0
    while pending:
        node, matrix = pending.pop()
        seen += 1
        if seen > MAX_NODES:
            raise ValueError(f"has more than {MAX_NODES} nodes")
        here = matrix @ _transform(node)
        for instance in node.findall("instance_geometry"):
            yield instance.get("url", "").lstrip("#"), here
        pending += [(child, here) for child in node.findall("node")][::-1]


def _transform(node: Node) -> Array:
    """Matrix ``(4, 4)`` of a node: its transforms in the order of the file."""
    matrix: Array = np.eye(4)
    for child in node:
        step: Array = np.eye(4)
        if child.tag == "matrix":
            step = _numbers(child.text).reshape(4, 4)
        elif child.tag == "translate":
            step[:3, 3] = _numbers(child.text).reshape(3)
        elif child.tag == "scale":
            step[:3, :3] = np.diag(_numbers(child.text).reshape(3))
        elif child.tag == "rotate":
            x, y, z, degrees = _numbers(child.text).reshape(4).tolist()
            step[:3, :3] = _rotation(x, y, z, math.radians(degrees))
        else:
            continue
        matrix = matrix @ step
    return matrix


def _rotation(x: float, y: float, z: float, angle: float) -> Array:
    """Rotation ``(3, 3)`` about an axis (Rodrigues)."""
    length = math.sqrt(x * x + y * y + z * z)
    if length == 0.0:
        return np.eye(3)
    x, y, z = x / length, y / length, z / length
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    turned: Array = np.eye(3) + math.sin(angle) * cross + (1.0 - math.cos(angle)) * cross @ cross
    return turned
