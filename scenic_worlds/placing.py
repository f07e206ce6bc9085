"""Finds places for objects that stand outside their region or in each other.

A rejected scene mostly needs a few objects to stand elsewhere. Asking Scenic for a whole new
sample for each try is what makes dense scenes slow; here only the numbers that place one object
are drawn again and only its outline is tested, against its region and the outlines of the
others. Outlines are flat boxes; everything else is left to whole-scene checks, which decide
in any case.
"""

from __future__ import annotations

import math
import numbers
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from scenic.core.distributions import (
    FunctionDistribution,
    OperatorDistribution,
    needsSampling,
    underlyingFunction,
)
from scenic.core.geometry import normalizeAngle
from scenic.core.regions import PolygonalFootprintRegion
from scenic.core.requirements import ContainmentRequirement, IntersectionRequirement
from scenic.core.shapes import BoxShape
from scenic.core.type_support import TypecheckedDistribution
from scenic.core.vectors import Orientation, globalOrientation

from mrta_falsify.core.arrays import Array
from scenic_worlds.checking import FastChecker, region_name
from scenic_worlds.primitives.driver import Driver, Sample
from scenic_worlds.primitives.plan import NodeRejected
from simulator_interface.solids import Box, Boxes

_CORNERS = ((1, 1), (-1, 1), (-1, -1), (1, -1))
#: places drawn for one object, so many at a time, until others make way for it: 60 in all
BATCHES = (1, 3, 8, 16, 16, 16)
EJECTIONS = 2  # times the number of objects: how often others make way


@dataclass(frozen=True, slots=True, eq=False)
class _Piece:
    """An object that is a flat box, and what places it."""

    thing: Any  #: of the program
    name: str
    container: Any  #: region of the program that must contain it, None: none
    units: int  #: that only it depends on
    places: list[int]  #: coordinates of these units
    steps: tuple[int, ...]  #: numbers of the values to compute for a new outline
    position: Any  #: values of the program
    heading: Any  #: an angle [rad] or an orientation
    width: Any
    length: Any
    collides: bool  #: whether it may collide with others at all

    @property
    def outside(self) -> str:
        """Say that it has no place in its region."""
        return f"{self.name} is not inside {region_name(self.container)}"


@dataclass(frozen=True, slots=True)
class Placed:
    """What :meth:`Placing.place` did."""

    units: int  #: that were drawn again, as a bit set
    is_stuck: bool  #: an object found no place


@dataclass(slots=True, eq=False)
class _Floor:
    """Where everything stands at the moment; rows are pieces."""

    boxes: list[Box]
    collides: list[bool]  #: can be collided with
    solid: Boxes = field(default_factory=Boxes)  #: those that are where they shall be
    changed: set[int] = field(default_factory=set)


class Placing:
    """Draws again where objects stand until their outlines fit.

    Args:
        driver: of the program.
        checker: that knows the scenario's requirements.
        own: units that only one object depends on and that place it, by ``id`` of the object.
    """

    def __init__(self, driver: Driver, checker: FastChecker, own: Mapping[int, int]) -> None:
        containers = {
            id(r.obj): r.container
            for r in checker.requirements
            if type(r) is ContainmentRequirement
        }
        colliding: set[int] = set()
        for requirement in checker.requirements:
            if type(requirement) is IntersectionRequirement:
                colliding |= {id(requirement.objA), id(requirement.objB)}
        self._pieces = tuple(
            _piece(driver, thing, name, containers.get(id(thing)), own[id(thing)], colliding)
            for thing, name in driver.names.items()
            if _is_flat_box(thing)
        )

    def place(
        self, sample: Sample, u: Array, draws: np.random.Generator, rejections: Counter[str]
    ) -> Placed:
        """Draw new places for everything that is outside its region or collides.

        Args:
            sample: complete; its values are out of date for the units returned.
            u: ``(k,)``, changed in place.
            draws: to draw with.
            rejections: counts every rejected place.

        Returns:
            What was drawn again; no units if nothing has to move, or nothing can.
        """
        floor = self._floor(sample)
        wrong = self._standing_wrong(sample, floor, draws, rejections)
        for row in wrong:
            floor.solid.take(row)
        left = EJECTIONS * len(self._pieces)
        is_stuck = False
        while wrong:
            row = wrong.pop(0)
            ejected = self._place(row, floor, sample, u, draws, rejections)
            if ejected is None:
                is_stuck = True
                continue
            if self._pieces[row].collides:
                floor.solid.put(row, floor.boxes[row])
            left -= len(ejected)
            if left < 0:
                is_stuck = True
                break
            for other in ejected:
                floor.solid.take(other)
            wrong += ejected
        units = 0
        for row in floor.changed:
            units |= self._pieces[row].units
        return Placed(units, is_stuck)

    def _floor(self, sample: Sample) -> _Floor:
        things = [sample.values[piece.thing] for piece in self._pieces]
        floor = _Floor(
            boxes=[_box_of(thing) for thing in things],
            collides=[
                piece.collides and not thing.allowCollisions
                for piece, thing in zip(self._pieces, things, strict=True)
            ],
        )
        return floor

    def _standing_wrong(
        self, sample: Sample, floor: _Floor, draws: np.random.Generator, rejections: Counter[str]
    ) -> list[int]:
        """List the rows that must move: outside their region, or one of each colliding pair."""
        wrong: set[int] = set()
        for row, piece in enumerate(self._pieces):
            outline = sample.values[piece.thing]._boundingPolygon
            if piece.units and not _is_inside(sample.values[piece.container], outline):
                rejections[piece.outside] += 1
                wrong.add(row)
        pairs = []
        for row, box in enumerate(floor.boxes):
            if floor.collides[row] and row not in wrong:
                pairs += [(other, row) for other in floor.solid.met_by(box)]
                floor.solid.put(row, box)
        for a, b in sorted(pairs):
            movable = [row for row in (a, b) if self._pieces[row].units]
            if movable and not {a, b} & wrong:
                rejections[self._collision(a, b)] += 1
                wrong.add(movable[int(draws.integers(len(movable)))])
        return sorted(wrong)

    def _collision(self, row: int, other: int) -> str:
        first, second = sorted((row, other))
        return f"{self._pieces[first].name} collides with {self._pieces[second].name}"

    def _place(
        self,
        row: int,
        floor: _Floor,
        sample: Sample,
        u: Array,
        draws: np.random.Generator,
        rejections: Counter[str],
    ) -> list[int] | None:
        """Draw a place for one piece: the rows that make way for it, None if it found none."""
        piece = self._pieces[row]
        floor.changed.add(row)
        draw: list[float] = []
        best: tuple[int, list[float], Box, list[int]] | None = None
        for size in BATCHES:
            before = draws.bit_generator.state
            batch = draws.random((size, len(piece.places))).tolist()
            for number, (box, hits) in enumerate(self._try(row, floor, sample, batch)):
                draw = batch[number]
                if box is None or hits is None:
                    rejections[piece.outside] += 1
                    continue
                for other in hits:
                    rejections[self._collision(row, other)] += 1
                if not hits:
                    u[piece.places], floor.boxes[row] = draw, box
                    # as if what was tried beyond this place had never been drawn
                    draws.bit_generator.state = before
                    draws.random((number + 1, len(piece.places)))
                    sample.nudge(piece.places, draw, piece.steps)
                    return []
                if all(self._pieces[other].units for other in hits) and (
                    best is None or len(hits) < best[0]
                ):
                    best = (len(hits), draw, box, hits)
        if best is None:
            u[piece.places] = draw
            return None
        _, u[piece.places], floor.boxes[row], hits = best
        return hits

    def _try(
        self, row: int, floor: _Floor, sample: Sample, batch: list[list[float]]
    ) -> Iterator[tuple[Box | None, list[int] | None]]:
        """Find a piece's box at each of a batch of places, and list the rows that it would hit.

        No rows (None) where it has no box, or is not inside its region.
        """
        piece = self._pieces[row]
        boxes, containers = [], []
        for draw in batch:
            boxes.append(self._box(piece, sample, draw, floor.boxes[row]))
            containers.append(sample.values[piece.container])
        there = [i for i, box in enumerate(boxes) if box is not None]
        placed = [box for box in boxes if box is not None]
        is_inside = np.zeros(len(batch), dtype=np.bool_)
        if there:
            outlines = shapely.polygons(np.array([_corners(box) for box in placed]))
            is_inside[there] = _are_inside([containers[i] for i in there], outlines)
        for box, inside in zip(boxes, is_inside.tolist(), strict=True):
            if box is None or not inside:
                yield box, None
            else:
                yield box, floor.solid.met_by(box) if piece.collides else []

    def _box(self, piece: _Piece, sample: Sample, draw: list[float], before: Box) -> Box | None:
        """Compute a piece's box with its coordinates at ``draw``; None if it has no place."""
        try:
            sample.nudge(piece.places, draw, piece.steps)
        except NodeRejected:
            return None
        values = sample.values
        turn = values[piece.heading]
        yaw = turn if isinstance(turn, (float, int)) else turn.yaw
        x, y, _ = values[piece.position].coordinates
        size = (values[piece.width], values[piece.length], before.height)
        return Box(x, y, before.z, yaw, *size)


def _box_of(thing: Any) -> Box:
    """Find the box of an object of a sample."""
    x, y, z = thing.position.coordinates
    return Box(x, y, z, thing.yaw, thing.width, thing.length, thing.height)


def _corners(box: Box) -> list[tuple[float, float]]:
    width, length = box.width / 2.0, box.length / 2.0
    across = (width * math.cos(box.yaw), width * math.sin(box.yaw))
    along = (-length * math.sin(box.yaw), length * math.cos(box.yaw))
    return [
        (box.x + a * across[0] + b * along[0], box.y + a * across[1] + b * along[1])
        for a, b in _CORNERS
    ]


def _are_inside(containers: list[Any], outlines: NDArray[np.object_]) -> NDArray[np.bool_]:
    """Test whether each outline lies in its region, ``(n,)``; mostly it is one region."""
    first = containers[0]
    if any(container is not first for container in containers):
        pairs = zip(containers, outlines, strict=True)
        return np.array([_is_inside(container, outline) for container, outline in pairs])
    if not isinstance(first, PolygonalFootprintRegion):
        return np.ones(len(outlines), dtype=np.bool_)  # whole-scene checks decide
    inside: NDArray[np.bool_] = shapely.contains(first.polygons, outlines)
    return inside


def _is_inside(container: Any, outline: Any) -> bool:
    if not isinstance(container, PolygonalFootprintRegion):
        return True  # whole-scene checks decide
    return bool(shapely.contains(container.polygons, outline))


def _is_flat_box(thing: Any) -> bool:
    return (
        isinstance(thing.shape, BoxShape)
        and not needsSampling(thing.mutationScale)
        and thing.mutationScale == 0
        and not needsSampling(thing.height)
    )


def _piece(
    driver: Driver, thing: Any, name: str, container: Any, units: int, colliding: set[int]
) -> _Piece:
    heading = _heading(thing.orientation)
    needed = (thing.position, heading, thing.width, thing.length, container)
    return _Piece(
        thing=thing,
        name=name,
        container=container,
        units=units,
        places=np.flatnonzero(driver.coordinates(units)).tolist(),
        steps=driver.steps(needed, units),
        position=thing.position,
        heading=heading,
        width=thing.width,
        length=thing.length,
        collides=id(thing) in colliding,
    )


def _heading(orientation: Any) -> Any:
    """Find the value that says which way something faces: an angle if there is one.

    `facing X deg` makes Scenic turn the angle into a rotation, that into three angles, and
    those into a rotation again.
    """
    if not _calls(orientation, Orientation.fromEuler):
        return orientation
    _, yaw, pitch, roll = orientation.arguments
    if not needsSampling(pitch) and not needsSampling(roll):
        return yaw if pitch == roll == 0 else orientation
    angles = [_part_of_local_angles(value) for value in (yaw, pitch, roll)]
    local = angles[0]
    if local is None or any(other is not local for other in angles):
        return orientation
    parent, target = local.arguments
    if needsSampling(parent) or parent != globalOrientation:
        return orientation
    if isinstance(target, TypecheckedDistribution) and _is_number(target._dist):
        return target._dist
    return orientation


def _part_of_local_angles(angle: Any) -> Any:
    """Find the call of ``localAnglesFor`` that an angle is a part of, or None."""
    if not _calls(angle, normalizeAngle):
        return None
    part = angle.arguments[0]
    if isinstance(part, OperatorDistribution) and part.operator == "__getitem__":
        return part.object if _calls(part.object, Orientation.localAnglesFor) else None
    return None


def _calls(value: Any, function: Any) -> bool:
    return (
        isinstance(value, FunctionDistribution)
        and value._conditioned is value
        and value.function is underlyingFunction(function)
    )


def _is_number(value: Any) -> bool:
    return isinstance(getattr(value, "_valueType", None), type) and issubclass(
        value._valueType, numbers.Real
    )
