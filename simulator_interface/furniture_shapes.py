"""Shapes of furniture, made of boxes and cylinders; for pictures, not for contacts.

Robots meet the extruded footprint (docs/stack.md), so a shape never reaches beyond its
box. A shape is built by name for any size, always with the same vertices.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import trimesh
from numpy.typing import NDArray

from mrta_falsify.core.arrays import Array, IntArray
from mrta_falsify.core.errors import UnknownNameError

TUBE = 0.035  # m, diameter of legs, rails and poles
BOARD = 0.03  # m, thickness of table tops, shelves and seats
SIDES = 16  # of a cylinder
#: turns z to -y
UPRIGHT_TO_SIDEWAYS = np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])

Corner = tuple[float, float, float]


@dataclass(frozen=True, slots=True, eq=False)
class Mesh:
    """Triangles of a body; x forward, y left, z up, origin on the floor below its middle."""

    vertices: Array  #: (V, 3) [m]
    faces: IntArray  #: (F, 3) numbers of vertices, counter-clockwise seen from outside


class _Builder:
    """Collects parts inside a box of length (x), width (y) and height (z) [m]."""

    def __init__(self, length: float, width: float, height: float) -> None:
        self.x, self.y, self.z = length / 2.0, width / 2.0, height
        self.parts: list[trimesh.Trimesh] = []

    def box(self, low: Corner, high: Corner) -> None:
        """Add a box between two corners, given as shares: x, y in [-1, 1], z in [0, 1]."""
        scale = np.array([self.x, self.y, self.z])
        first, last = np.array(low) * scale, np.array(high) * scale
        part = trimesh.creation.box(extents=last - first)
        part.apply_translation((first + last) / 2.0)
        self.parts.append(part)

    def board(self, low: tuple[float, float], high: tuple[float, float], top: float) -> None:
        """Add a level board whose upper face is at the share ``top`` of the height."""
        thickness = min(BOARD / self.z, top)
        self.box((*low, top - thickness), (*high, top))

    def pole(self, x: float, y: float, low: float, high: float, diameter: float = TUBE) -> None:
        """Add an upright cylinder; it is kept a radius away from the box's sides."""
        radius = min(diameter / 2.0, self.x, self.y)
        part = trimesh.creation.cylinder(
            radius=radius, height=(high - low) * self.z, sections=SIDES
        )
        at_x, at_y = x * (self.x - radius), y * (self.y - radius)
        part.apply_translation([at_x, at_y, (low + high) / 2.0 * self.z])
        self.parts.append(part)

    def legs(self, top: float, inset: float = 1.0) -> None:
        """Add four legs up to the share ``top`` of the height."""
        for x in (-inset, inset):
            for y in (-inset, inset):
                self.pole(x, y, 0.0, top)

    def wheel(self, x: float, y: float, radius: float, width: float) -> None:
        """Add a wheel that stands on the floor and rolls along x."""
        radius = min(radius, self.x, self.z / 2.0)
        part = trimesh.creation.cylinder(radius=radius, height=width, sections=SIDES)
        part.apply_transform(UPRIGHT_TO_SIDEWAYS)
        at_x, at_y = x * (self.x - radius), y * (self.y - width / 2.0)
        part.apply_translation([at_x, at_y, radius])
        self.parts.append(part)


def _bed(b: _Builder) -> None:
    b.box((-0.97, -0.92, 0.42), (0.97, 0.92, 0.62))  # mattress
    b.box((-1.0, -0.95, 0.0), (-0.97, 0.95, 1.0))  # head
    b.box((0.97, -0.95, 0.0), (1.0, 0.95, 0.75))  # foot
    b.box((-0.9, -0.85, 0.3), (0.9, 0.85, 0.4))  # frame
    for y in (-1.0, 0.96):
        b.box((-0.6, y, 0.45), (0.2, y + 0.04, 0.85))  # rails
    b.legs(0.3, inset=0.9)


def _cabinet(b: _Builder) -> None:
    b.box((-1.0, -1.0, 0.05), (0.96, 1.0, 1.0))
    b.box((-0.95, -0.95, 0.0), (0.9, 0.95, 0.05))
    for y in (-0.49, 0.04):
        b.box((0.96, y, 0.1), (1.0, y + 0.45, 0.95))  # doors


def _bookshelf(b: _Builder) -> None:
    b.box((-1.0, -1.0, 0.0), (-0.93, 1.0, 1.0))  # back
    for y in (-1.0, 0.95):
        b.box((-1.0, y, 0.0), (1.0, y + 0.05, 1.0))
    for k in range(6):
        b.board((-1.0, -1.0), (1.0, 1.0), 0.04 + k * 0.192)
    for k in range(5):
        b.box((-0.9, -0.85, 0.04 + k * 0.192), (0.5, -0.85 + 0.3 * (k + 2), 0.16 + k * 0.192))


def _desk(b: _Builder) -> None:
    b.board((-1.0, -1.0), (1.0, 1.0), 1.0)
    b.legs(0.96)


def _bench(b: _Builder) -> None:
    for k in range(3):
        y = -1.0 + k * 2.0 / 3.0
        b.box((-0.7, y + 0.03, 0.5), (1.0, y + 0.63, 0.56))
        b.box((-1.0, y + 0.03, 0.55), (-0.85, y + 0.63, 1.0))
    b.box((-0.3, -1.0, 0.42), (-0.1, 1.0, 0.5))
    for y in (-0.8, 0.8):
        b.pole(-0.2, y, 0.0, 0.45)


def _sofa(b: _Builder) -> None:
    b.box((-1.0, -1.0, 0.0), (1.0, 1.0, 0.3))
    b.box((-0.5, -0.85, 0.3), (1.0, 0.85, 0.55))
    b.box((-1.0, -1.0, 0.3), (-0.5, 1.0, 1.0))
    for y in (-1.0, 0.85):
        b.box((-0.5, y, 0.3), (0.95, y + 0.15, 0.72))


def _box(b: _Builder) -> None:
    b.box((-1.0, -1.0, 0.0), (1.0, 1.0, 1.0))


def _curtain(b: _Builder) -> None:
    folds = 8
    for k in range(folds):
        y = -0.95 + 1.9 * k / folds
        x = -0.5 if k % 2 else 0.0
        b.box((x, y, 0.12), (x + 0.5, y + 1.9 / folds, 0.98))
    for y in (-1.0, 1.0):
        b.pole(0.0, y, 0.0, 1.0)
        b.box((-1.0, 0.94 * y - 0.03, 0.0), (1.0, 0.94 * y + 0.03, 0.03))


def _chair(b: _Builder) -> None:
    b.board((-0.9, -0.95), (1.0, 0.95), 0.53)
    b.box((-1.0, -0.9, 0.6), (-0.85, 0.9, 1.0))
    for y in (-0.85, 0.85):
        b.pole(-0.95, y, 0.5, 0.95)
    b.legs(0.5, inset=0.95)


def _stool(b: _Builder) -> None:
    b.pole(0.0, 0.0, 0.92, 1.0, diameter=2.0 * min(b.x, b.y))
    b.pole(0.0, 0.0, 0.05, 0.92)
    b.box((-1.0, -0.1, 0.0), (1.0, 0.1, 0.06))
    b.box((-0.1, -1.0, 0.0), (0.1, 1.0, 0.06))


def _trolley(b: _Builder) -> None:
    for top in (0.22, 0.55, 0.88):
        b.board((-0.95, -0.95), (0.95, 0.95), top)
    for x in (-0.97, 0.97):
        for y in (-0.97, 0.97):
            b.pole(x, y, 0.1, 0.9)
            b.wheel(0.95 * x, 0.95 * y, 0.05, 0.03)
    b.box((-1.0, -0.9, 0.96), (-0.94, 0.9, 1.0))  # handle
    for y in (-0.88, 0.88):
        b.pole(-1.0, y, 0.85, 0.98)


def _wheelchair(b: _Builder) -> None:
    for y in (-1.0, 1.0):
        b.wheel(-0.75, y, 0.3, 0.035)
        b.wheel(0.6, 0.85 * y, 0.09, 0.03)
        b.pole(-0.7, 0.75 * y, 0.5, 1.0)
        b.box((-0.65, 0.78 * y - 0.06, 0.68), (0.1, 0.78 * y + 0.06, 0.73))  # arm rests
    b.box((-0.62, -0.7, 0.5), (0.25, 0.7, 0.55))
    b.box((-0.7, -0.7, 0.55), (-0.62, 0.7, 0.98))
    b.box((0.7, -0.55, 0.1), (1.0, 0.55, 0.14))  # foot rest
    for y in (-0.5, 0.5):
        b.box((0.2, y - 0.05, 0.45), (0.75, y + 0.05, 0.5))
        b.pole(0.75, y, 0.12, 0.5)


def _iv_stand(b: _Builder) -> None:
    b.pole(0.0, 0.0, 0.04, 1.0)
    for turn in (0, 1):
        low, high = ((-1.0, -0.06), (1.0, 0.06)) if turn else ((-0.06, -1.0), (0.06, 1.0))
        b.box((*low, 0.0), (*high, 0.035))
        b.box((0.35 * low[0], 0.35 * low[1], 0.985), (0.35 * high[0], 0.35 * high[1], 1.0))
    b.box((-0.05, 0.12, 0.8), (0.1, 0.42, 0.96))  # bag


def _bin(b: _Builder) -> None:
    b.pole(0.0, 0.0, 0.0, 0.92, diameter=1.9 * min(b.x, b.y))
    b.pole(0.0, 0.0, 0.92, 1.0, diameter=2.0 * min(b.x, b.y))


def _pallet(b: _Builder) -> None:
    top = min(0.144 / b.z, 0.5)  # m, height of a EUR pallet
    for y in (-0.95, -0.1, 0.75):
        b.box((-1.0, y, 0.0), (1.0, y + 0.2, 0.7 * top))
    b.box((-1.0, -1.0, 0.7 * top), (1.0, 1.0, top))
    for k in range(2):
        low = top + k * (1.0 - top) / 2.0
        b.box((-0.95, -0.95, low), (-0.03, 0.95, low + 0.48 * (1.0 - top)))
        b.box((0.03, -0.95, low), (0.95, 0.95, low + 0.48 * (1.0 - top)))


_SHAPES: dict[str, Callable[[_Builder], None]] = {
    "bed": _bed,
    "bench": _bench,
    "bin": _bin,
    "bookshelf": _bookshelf,
    "box": _box,
    "cabinet": _cabinet,
    "chair": _chair,
    "curtain": _curtain,
    "desk": _desk,
    "iv_stand": _iv_stand,
    "pallet": _pallet,
    "sofa": _sofa,
    "stool": _stool,
    "trolley": _trolley,
    "wheelchair": _wheelchair,
}


def mesh_names() -> tuple[str, ...]:
    """List the names that :func:`build_mesh` knows."""
    return tuple(sorted(_SHAPES))


def build_mesh(name: str, *, length: float, width: float, height: float) -> Mesh:
    """Build the shape of a piece of furniture.

    Args:
        name: one of :func:`mesh_names`.
        length: along x, the way it faces [m], > 0.
        width: along y [m], > 0.
        height: along z [m], > 0.

    Returns:
        Triangles inside the box of this size.

    Raises:
        UnknownNameError: no such shape.
    """
    if name not in _SHAPES:
        raise UnknownNameError("mesh", name, _SHAPES)
    builder = _Builder(length, width, height)
    _SHAPES[name](builder)
    whole = trimesh.util.concatenate(builder.parts)
    vertices: NDArray[np.float64] = np.asarray(whole.vertices, dtype=np.float64)
    return Mesh(vertices=vertices, faces=np.asarray(whole.faces, dtype=np.int64))
