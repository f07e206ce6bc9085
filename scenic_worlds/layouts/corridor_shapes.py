"""Corridors of a hospital as a line, an L, a ring or a comb, and what stands beside each."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

from scenic_worlds.layouts.assembly import SideRow, street_box
from scenic_worlds.layouts.frontages import WALL, Box, parking_frontage
from scenic_worlds.layouts.streets import Street, StreetCrossing

Shape = Literal["line", "ell", "ring", "comb"]

DEAD_END = 0.3  # m of corridor beyond the last frontage
SHORTEST = 2.0  # m of corridor between two corners at least
STEP_BACK = 1.3  # m behind a corridor's wall, kept for where the wall steps back for robots


@dataclass(frozen=True, slots=True)
class Plot:
    """Something that needs a frontage."""

    kind: Literal["room", "station", "lift", "charger", "parking"]
    number: int  #: of the room, lift ... or how many parking places
    length: float  #: frontage [m]
    depth: float  #: behind the corridor's wall [m]


class Wanted(NamedTuple):
    """What the corridors are to give a place to."""

    wards: list[Plot]
    extras: list[Plot]  #: nurses' station, lifts and chargers
    parking: int  #: places for idle robots


class CorridorSize(NamedTuple):
    """Lengths that the corridors follow from."""

    width: float  #: of corridors along x [m]
    cross: float  #: width of corridors along y [m]
    teeth: int  #: branches of a comb


@dataclass(frozen=True, slots=True, eq=False)
class Corridors:
    """Corridors, their floor, and the plots along each of their sides."""

    streets: list[Street]
    floor: list[Box]
    sides: list[tuple[SideRow, list[Plot]]]


def plan_corridors(shape: Shape, wanted: Wanted, size: CorridorSize) -> Corridors:
    """Spread what is wanted over the sides of corridors that are long enough for it."""
    return _SHAPES[shape](wanted, size)


def _fill_in_turn(plots: Sequence[Plot], sides: Sequence[list[Plot]]) -> None:
    for i, plot in enumerate(plots):
        sides[i % len(sides)].append(plot)


def _fill_parking(places: int, sides: Sequence[list[Plot]]) -> None:
    """Spread parking places over the ends of some sides."""
    for i, side in enumerate(sides):
        share = (places + len(sides) - 1 - i) // len(sides)
        if share:
            side.append(Plot("parking", share, parking_frontage(share), 0.0))


def _length(side: list[Plot]) -> float:
    """Add up the frontage of a side's plots [m]."""
    return sum(plot.length for plot in side)


def _depth(side: list[Plot]) -> float:
    """Find the depth of a side's deepest plot [m]."""
    return max((plot.depth for plot in side), default=0.0)


def _line(wanted: Wanted, size: CorridorSize) -> Corridors:
    sides: list[list[Plot]] = [[], []]
    _fill_in_turn(wanted.extras, sides)
    _fill_in_turn(wanted.wards, sides[::-1])
    _fill_parking(wanted.parking, sides)
    length = max(SHORTEST, *map(_length, sides))
    street = Street(start=(0.0, 0.0), along=(1.0, 0.0), length=length, width=size.width)
    rows = [SideRow(street, 0, side, 0.0) for side in (1, -1)]
    return Corridors(
        [street], [street_box(street, DEAD_END, DEAD_END)], list(zip(rows, sides, strict=True))
    )


def _ell(wanted: Wanted, size: CorridorSize) -> Corridors:
    width, cross, _ = size
    sides: list[list[Plot]] = [[] for _ in range(4)]
    south, east, north, west = sides  # south and east are outside the corner
    _fill_in_turn(wanted.extras, [south, east])
    _fill_in_turn(wanted.wards, [north, east, south, west])
    _fill_parking(wanted.parking, [south, east])
    inner = _depth(north) + STEP_BACK  # what rooms take of the west side, north of the corridor
    x = max(SHORTEST, _length(south), _length(north)) + cross / 2.0
    y = width / 2.0 + max(SHORTEST, _length(east), _length(west) + inner)
    first = Street(
        start=(0.0, 0.0), along=(1.0, 0.0), length=x, width=width, crossings=(StreetCrossing(0, x),)
    )
    second = Street(
        start=(x, 0.0), along=(0.0, 1.0), length=y, width=cross, crossings=(StreetCrossing(0, 0.0),)
    )
    rows = [
        SideRow(first, 0, 1, 0.0),
        SideRow(second, 1, 1, width / 2.0),
        SideRow(first, 0, -1, 0.0),
        SideRow(second, 1, -1, width / 2.0 + inner),
    ]
    return Corridors(
        [first, second],
        [street_box(first, DEAD_END, cross / 2.0), street_box(second, width / 2.0, DEAD_END)],
        list(zip(rows, sides, strict=True)),
    )


def _ring(wanted: Wanted, size: CorridorSize) -> Corridors:
    width, cross, _ = size
    sides: list[list[Plot]] = [[] for _ in range(6)]
    south, east, north, west, core_south, core_north = sides
    _fill_in_turn(wanted.extras, [core_south, core_north])
    _fill_in_turn(wanted.wards, [south, north, east, west])
    _fill_parking(wanted.parking, [core_south, core_north])
    core = _depth(core_south) + _depth(core_north) + (2.0 * STEP_BACK + WALL)
    x = cross + max(SHORTEST, *map(_length, (south, north, core_south, core_north)))
    y = width + max(SHORTEST, _length(east), _length(west), core)
    starts = [(0.0, 0.0), (x, 0.0), (x, y), (0.0, y)]
    headings = [(1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0)]
    streets = []
    for i, (start, along) in enumerate(zip(starts, headings, strict=True)):
        length, breadth = (x, width) if i % 2 == 0 else (y, cross)
        ends = (StreetCrossing(i, 0.0), StreetCrossing((i + 1) % 4, length))
        streets.append(
            Street(start=start, along=along, length=length, width=breadth, crossings=ends)
        )
    gaps = [cross / 2.0, width / 2.0]  # half the corridor that each one runs into
    floor = [street_box(s, gaps[i % 2], gaps[i % 2]) for i, s in enumerate(streets)]
    rows = [SideRow(s, i, 1, gaps[i % 2]) for i, s in enumerate(streets)]
    rows += [SideRow(streets[i], i, -1, cross / 2.0) for i in (0, 2)]
    return Corridors(streets, floor, list(zip(rows, sides, strict=True)))


def _comb(wanted: Wanted, size: CorridorSize) -> Corridors:
    width, cross, teeth = size
    sides: list[list[Plot]] = [[] for _ in range(2 * teeth)]  # right, left of each branch
    main: list[Plot] = []
    _fill_parking(wanted.parking - wanted.parking // 2, [main])
    _fill_in_turn(wanted.extras, [main])
    _fill_parking(wanted.parking // 2, [main])
    _fill_in_turn(wanted.wards, sides)
    xs, x = [], 0.0
    for right, left in zip(sides[::2], sides[1::2], strict=True):
        x += _depth(left) + STEP_BACK + cross / 2.0
        xs.append(x)
        x += cross / 2.0 + _depth(right) + STEP_BACK
    trunk = Street(
        start=(0.0, 0.0), along=(1.0, 0.0), length=max(x, _length(main)), width=width,
        crossings=tuple(StreetCrossing(k, at) for k, at in enumerate(xs)),
    )  # fmt: skip
    streets, floor, rows = [trunk], [street_box(trunk, DEAD_END, DEAD_END)], []
    for k, at in enumerate(xs):
        reach = width / 2.0 + max(SHORTEST, *map(_length, sides[2 * k : 2 * k + 2]))
        branch = Street(
            start=(at, 0.0), along=(0.0, 1.0), length=reach, width=cross,
            crossings=(StreetCrossing(k, 0.0),),
        )  # fmt: skip
        streets.append(branch)
        floor.append(street_box(branch, 0.0, DEAD_END))
        rows += [SideRow(branch, k + 1, side, width / 2.0) for side in (1, -1)]
    rows.append(SideRow(trunk, 0, 1, 0.0))
    return Corridors(streets, floor, list(zip(rows, [*sides, main], strict=True)))


_SHAPES: dict[Shape, Callable[[Wanted, CorridorSize], Corridors]] = {
    "line": _line,
    "ell": _ell,
    "ring": _ring,
    "comb": _comb,
}
