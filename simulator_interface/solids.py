"""What stands on a floor as solids in a collision tree of FCL: what a body placed there meets.

Everything is a prism of one height, so that bodies meet if and only if their outlines do. Contacts
are found down to about a tenth of a millimetre.

Reference: Pan, Chitta & Manocha, "FCL: A general purpose library for collision and proximity
queries", ICRA 2012.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import fcl
import numpy as np
import shapely
from shapely.geometry.polygon import orient

from mrta_falsify.core.arrays import Array
from simulator_interface.convex_parts import convex_parts

HEIGHT = 1.0  # m, of every prism; any would do
THIN = 1e-4  # m, half the width of an outline that is a line


class Solids:
    """Outlines that do not move; answers which of them a body meets."""

    def __init__(self, outlines: Sequence[Array]) -> None:
        """Put prisms on a floor.

        Args:
            outlines: n of them, each ``(V, 2)`` [m], map frame, convex or not.
        """
        self._owners: dict[int, list[int]] = {}  # by the id of a shape, which FCL gives back
        bodies = []
        for number, outline in enumerate(outlines):
            for shape in _prisms(np.ascontiguousarray(outline, dtype=np.float64).tobytes()):
                self._owners.setdefault(id(shape), []).append(number)
                bodies.append(fcl.CollisionObject(shape))
        self._tree = fcl.DynamicAABBTreeCollisionManager()
        self._tree.registerObjects(bodies)
        self._tree.setup()

    def met_by_disc(self, x: float, y: float, radius: float) -> list[int]:
        """List the outlines that a disc around ``(x, y)`` [m] meets, by number, sorted."""
        disc = fcl.Cylinder(radius, HEIGHT)
        return self._met_by(fcl.CollisionObject(disc, fcl.Transform(np.array([x, y, 0.0]))))

    def met_by(self, outline: Array) -> list[int]:
        """List the outlines that a body with this outline ``(V, 2)`` [m] meets, sorted."""
        parts = [_prism(part) for part in _rings(np.asarray(outline))]
        return sorted({hit for part in parts for hit in self._met_by(fcl.CollisionObject(part))})

    def _met_by(self, body: fcl.CollisionObject) -> list[int]:
        met = (self._owners.get(shape, ()) for shape in _shapes_met(self._tree, body))
        return sorted({number for numbers in met for number in numbers})


class Boxes:
    """Boxes that come and go, by number; answers which of them another box meets."""

    def __init__(self) -> None:
        self._tree = fcl.DynamicAABBTreeCollisionManager()
        self._bodies: dict[int, tuple[fcl.Box, fcl.CollisionObject]] = {}
        self._numbers: dict[int, int] = {}  # by the id of a shape, which FCL gives back

    def put(self, number: int, box: Box) -> None:
        """Add a box, or replace the one that has this number."""
        self.take(number)
        shape, body = self._bodies[number] = box.body()
        self._numbers[id(shape)] = number
        self._tree.registerObject(body)

    def take(self, number: int) -> None:
        """Take the box with this number away, if there is one."""
        if number in self._bodies:
            shape, body = self._bodies.pop(number)
            del self._numbers[id(shape)]
            self._tree.unregisterObject(body)

    def met_by(self, box: Box) -> list[int]:
        """List the boxes that a box would meet, by number, sorted."""
        shape, body = box.body()
        return sorted(self._numbers[met] for met in _shapes_met(self._tree, body) - {id(shape)})


def _shapes_met(tree: fcl.DynamicAABBTreeCollisionManager, body: fcl.CollisionObject) -> set[int]:
    """Ids of the shapes in all contacts of a body with those in a tree, its own included."""
    found = fcl.CollisionData(fcl.CollisionRequest(num_max_contacts=max(1, tree.size())))
    tree.collide(body, found, fcl.defaultCollisionCallback)
    return {id(shape) for contact in found.result.contacts for shape in (contact.o1, contact.o2)}


class Box(NamedTuple):
    """An upright box."""

    x: float  #: of its middle, map frame [m]
    y: float
    z: float
    yaw: float  #: of its length, counter-clockwise from y [rad]: Scenic's heading
    width: float  #: [m]
    length: float  #: [m]
    height: float  #: [m]

    def body(self) -> tuple[fcl.Box, fcl.CollisionObject]:
        """Build its shape and what holds it in place."""
        shape = fcl.Box(self.width, self.length, self.height)
        turn = np.array([math.cos(self.yaw / 2.0), 0.0, 0.0, math.sin(self.yaw / 2.0)])
        place = fcl.Transform(turn, np.array([self.x, self.y, self.z]))
        return shape, fcl.CollisionObject(shape, place)


@functools.lru_cache(maxsize=8192)  # worlds of one floor have the same walls
def _prisms(data: bytes) -> tuple[fcl.Convex, ...]:
    """Build convex prisms that together fill an outline, given by its bytes."""
    outline = np.frombuffer(data).reshape(-1, 2)
    return tuple(_prism(part) for part in _rings(outline))


def _rings(outline: Array) -> Iterator[Array]:
    """Split an outline ``(V, 2)`` [m] into convex rings; one that crosses itself is mended."""
    shape = shapely.Polygon(outline)
    if shape.is_valid and shape.area:
        yield from convex_parts(outline)
        return
    shape = shapely.make_valid(shape)
    if not shape.area:
        shape = shape.buffer(THIN)
    for part in shapely.constrained_delaunay_triangles(shape).geoms:
        yield np.asarray(orient(part).exterior.coords)[:-1]


def _prism(ring: Array) -> fcl.Convex:
    n = len(ring)
    corners = np.concatenate(
        [np.column_stack([ring, np.full(n, z)]) for z in (-HEIGHT / 2.0, HEIGHT / 2.0)]
    )
    faces = [n, *range(n - 1, -1, -1), n, *range(n, 2 * n)]
    for i in range(n):
        j = (i + 1) % n
        faces += [4, i, j, n + j, n + i]
    return fcl.Convex(corners, n + 2, np.array(faces, dtype=np.int32))
