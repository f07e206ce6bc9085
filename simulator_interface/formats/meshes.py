"""Triangle meshes of untrusted files, and what they fill between two heights."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
import shapely
import trimesh
from shapely.geometry import Polygon
from shapely.geometry.base import BaseGeometry

from mrta_falsify.core.arrays import Array, IntArray
from mrta_falsify.core.codec import FARTHEST
from mrta_falsify.core.errors import FormatError
from mrta_falsify.core.parsing import read_bytes
from simulator_interface.formats.collada import read_collada

MAX_BYTES = 128 * 1024 * 1024
MAX_FACES = 2_000_000
KINDS = ("dae", "glb", "obj", "off", "ply", "stl")  # read without looking at any other file
LEVELS = 5  # sections through the slab
SKIN = 0.01  # m around every section, so that open surfaces are obstacles too
GRID = 1e-4  # m, ends of sections that are nearer than this meet
DETAIL = 0.005  # m, corners that matter less are dropped


def read_mesh(path: Path) -> tuple[Array, IntArray]:
    """Read vertices ``(V, 3)`` and triangles ``(F, 3)`` of a mesh file, and no other file.

    Raises:
        FormatError: not a kind that is read, too large, or broken.
    """
    kind = path.suffix.lower().removeprefix(".")
    if kind not in KINDS:
        raise FormatError(
            f"{path}: is a .{kind} file; meshes must be one of {', '.join(KINDS)} (convert it)"
        )
    vertices, faces = read_collada(path) if kind == "dae" else _loaded(path, kind)
    if not len(faces) or len(faces) > MAX_FACES:
        raise FormatError(f"{path}: has {len(faces)} triangles; 1 to {MAX_FACES} are allowed")
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise FormatError(f"{path}: its triangles name vertices that it does not have")
    if not (np.abs(vertices) <= FARTHEST).all():
        raise FormatError(f"{path}: has coordinates beyond {FARTHEST:g} m")
    return vertices, faces


def _loaded(path: Path, kind: str) -> tuple[Array, IntArray]:
    """Vertices and triangles as trimesh reads them."""
    content = read_bytes(path, MAX_BYTES)
    try:
        # A stream without a resolver: materials and textures are not read.
        mesh: Any = trimesh.load(
            io.BytesIO(content), file_type=kind, force="mesh", process=False, skip_materials=True
        )
        vertices = np.asarray(mesh.vertices, dtype=np.float64)
        return vertices, np.asarray(mesh.faces, dtype=np.int64)
    except Exception as error:  # whatever a broken file makes the readers raise
        raise FormatError(
            f"{path}: is not a mesh: {type(error).__name__}: {' '.join(str(error).split())[:80]}"
        ) from None


def mesh_slab(vertices: Array, faces: IntArray, low: float, high: float) -> BaseGeometry:
    """Find what a mesh fills between two heights, seen from above.

    The union of sections at ``LEVELS`` heights. Closed sections are filled (even-odd), and
    every section has a skin, so that surfaces without a back are obstacles as well.

    Args:
        vertices: ``(V, 3)`` [m], map frame.
        faces: ``(F, 3)``.
        low: of the slab [m].
        high: of the slab [m].
    """
    section: Any = trimesh.intersections.mesh_plane
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    z = vertices[faces][..., 2]
    if z.max() < low or z.min() > high:
        return Polygon()
    found: list[BaseGeometry] = []
    top, bottom = min(high, float(z.max())), max(low, float(z.min()))
    inset = 1e-4 * (top - bottom)
    for level in np.linspace(bottom + inset, top - inset, LEVELS):
        segments = section(mesh, [0.0, 0.0, 1.0], [0.0, 0.0, level])
        if not len(segments):
            continue
        flat = np.ascontiguousarray(segments[:, :, :2])
        lines = shapely.linestrings(flat[np.hypot(*(flat[:, 1] - flat[:, 0]).T) > GRID])
        if len(lines):
            drawn = shapely.union_all(lines, grid_size=GRID)
            # Triangles cut straight walls into many pieces: join them before they get a skin.
            joined = shapely.simplify(shapely.line_merge(drawn), GRID)
            skin = shapely.buffer(joined, SKIN, cap_style="square", join_style="mitre")
            found += [skin, *_filled(drawn, flat)]
    return shapely.simplify(shapely.union_all(found), DETAIL) if found else Polygon()


def _filled(drawn: BaseGeometry, segments: Array) -> list[BaseGeometry]:
    """Faces between lines that lie inside by the even-odd rule.

    Args:
        drawn: the lines, ends that nearly meet joined, so that rounding opens no ring.
        segments: ``(S, 2, 2)`` the same lines as they were cut [m].
    """
    faces = shapely.get_parts(shapely.polygonize(shapely.get_parts(drawn)))
    if not len(faces):
        return []
    within = shapely.get_coordinates(shapely.point_on_surface(faces))
    (x1, y1), (x2, y2) = segments[:, 0].T, segments[:, 1].T
    inside = []
    for face, (x, y) in zip(faces, within, strict=True):
        crosses = (y1 > y) != (y2 > y)
        height = np.where(crosses, y2 - y1, 1.0)
        hits = crosses & (x1 + (y - y1) / height * (x2 - x1) > x)
        if hits.sum() % 2:
            inside.append(face)
    return inside
