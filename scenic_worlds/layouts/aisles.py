"""Parallel aisles between two cross aisles, with solid blocks between them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mrta_falsify.core.world import Furniture
from scenic_worlds.layouts.assembly import SideRow, solid_boxes, street_box
from scenic_worlds.layouts.frontages import Box, corners
from scenic_worlds.layouts.stops import StreetStop, face_frontage, face_stop
from scenic_worlds.layouts.streets import Street, StreetCrossing

APART = 0.2  # m between places on one side
END = 0.3  # m of cross aisle beyond the last aisle
LEFT = 0.3  # m of a block that places on both its sides leave standing


@dataclass(frozen=True, slots=True, kw_only=True)
class AislePlan:
    """Aisles and what lies between them."""

    streets: tuple[Street, ...]  #: front, back, then the aisles from west to east
    floor: tuple[Box, ...]
    blocks: Box  #: all blocks and aisles together

    @property
    def inner(self) -> tuple[float, float]:
        """Stations [m] between which an aisle has blocks beside it."""
        half = self.streets[0].width / 2.0
        return half, self.streets[2].length - half


def plan_aisles(
    aisles: int,
    *,
    width: float,
    cross: float,
    length: float,
    between: float,
    beside: float,
    least_front: float,
) -> AislePlan:
    """Plan aisles along y, joined by a cross aisle in front (y = 0) and one at the back.

    Args:
        aisles: how many, >= 1.
        width: of an aisle [m].
        cross: width of the cross aisles [m].
        length: of the blocks between the cross aisles [m].
        between: width of the blocks between aisles [m]; at least what waiting bays need.
        beside: width of the blocks outside the first and last aisle [m], 0: none.
        least_front: the cross aisles are at least this long [m].
    """
    recess = Street(start=(0.0, 0.0), along=(0.0, 1.0), length=length, width=width).recess
    between = max(between, 2.0 * recess + LEFT)
    beside = max(beside, recess + LEFT) if beside else 0.0
    xs = [beside + width / 2.0 + k * (width + between) for k in range(aisles)]
    span = xs[-1] + width / 2.0 + beside
    total, depth = max(span, least_front), length + cross
    front = Street(
        start=(0.0, 0.0), along=(1.0, 0.0), length=total, width=cross,
        crossings=tuple(StreetCrossing(k, x) for k, x in enumerate(xs)),
    )  # fmt: skip
    back = Street(
        start=(total, depth), along=(-1.0, 0.0), length=total, width=cross,
        crossings=tuple(
            StreetCrossing(aisles + k, total - xs[k]) for k in reversed(range(aisles))
        ),
    )  # fmt: skip
    lanes = tuple(
        Street(
            start=(x, 0.0), along=(0.0, 1.0), length=depth, width=width,
            crossings=(StreetCrossing(k, 0.0), StreetCrossing(aisles + k, depth)),
        )
        for k, x in enumerate(xs)
    )  # fmt: skip
    blocks = (0.0, cross / 2.0, span, depth - cross / 2.0)
    floor = (street_box(front, END, END), street_box(back, END, END), blocks)
    return AislePlan(streets=(front, back, *lanes), floor=floor, blocks=blocks)


def faces_length(count: int, spots: int) -> float:
    """Compute the length [m] of an aisle side with ``count`` places."""
    return count * (face_frontage(spots) + APART)


def place_faces(
    plan: AislePlan,
    sides: Sequence[tuple[int, int]],
    count: int,
    *,
    name: str,
    spots: int,
    offset: float,
) -> list[StreetStop]:
    """Hand out places at blocks to the aisle sides in turn.

    Args:
        plan: the aisles.
        sides: (number of the street, 1 right or -1 left) to use.
        count: how many places.
        name: their names are ``name_0`` ...
        spots: waiting spots each.
        offset: 0 to 1: where along the aisle, front to back.
    """
    face = face_frontage(spots) + APART
    low, high = plan.inner
    found: dict[int, StreetStop] = {}
    for first, (number, side) in enumerate(sides):
        numbers = range(first, count, len(sides))
        start = low + (high - low - len(numbers) * face) * offset
        row = SideRow(plan.streets[number], number, side, start)
        for place in numbers:
            found[place] = face_stop(row.take(face), name=f"{name}_{place}", spots=spots)
    return [found[i] for i in range(count)]


def block_furniture(
    plan: AislePlan, faces: Sequence[StreetStop], *, name: str, kind: str, height: float
) -> tuple[Furniture, ...]:
    """Fill what is neither aisle nor place at a block with boxes."""
    bounds = np.array(plan.blocks)
    free = np.array(
        [
            *(street_box(street) for street in plan.streets[2:]),
            *(box for stop in faces for box in stop.free),
        ]
    )
    free[:, :2] = np.clip(free[:, :2], bounds[:2], bounds[2:])
    free[:, 2:] = np.clip(free[:, 2:], bounds[:2], bounds[2:])
    return tuple(
        Furniture(name=f"{name}_{i}", kind=kind, polygon=corners(box), height=height)
        for i, box in enumerate(solid_boxes(bounds, free))
    )
