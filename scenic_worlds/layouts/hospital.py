"""A hospital floor from a few lengths: corridors as a line, an L, a ring or a comb.

Wards lie behind doors on both sides; a nurses' station, lifts, charging bays and parking for
idle robots may be added. Every value within the documented ranges gives a connected floor
on which two robots pass each other everywhere but in doorways.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal, get_args

from mrta_falsify.core.errors import UnknownNameError
from mrta_falsify.core.world import World
from scenic_worlds.layouts.assembly import SideRow, assemble_layout, street_box
from scenic_worlds.layouts.ranges import Numbers, active_flags, check_range, per_place
from scenic_worlds.layouts.stops import (
    BAY,
    LIFT,
    WALL,
    Box,
    Frontage,
    ParkingBay,
    StreetStop,
    cabin_frontage,
    cabin_stop,
    least_frontage,
    parking_bay,
    parking_frontage,
    room_stop,
)
from scenic_worlds.layouts.streets import Street, StreetCrossing

Shape = Literal["line", "ell", "ring", "comb"]

#: allowed values: lowest, highest
RANGES: dict[str, tuple[float, float]] = {
    "rooms": (0, 24),
    "corridor_width": (1.8, 5.0),
    "cross_width": (1.8, 5.0),
    "room_width": (2.5, 12.0),
    "room_depth": (2.6, 8.0),
    "door_width": (0.8, 2.0),
    "door_offset": (0.0, 1.0),
    "bathroom": (0.0, 1.0),
    "spots": (1, 5),
    "lifts": (0, 3),
    "chargers": (0, 4),
    "parking": (0, 24),
    "teeth": (2, 4),
    "lift_time": (0.0, 120.0),
    "charge_time": (0.0, 600.0),
}

STATION_WIDTH, STATION_DEPTH, STATION_DOOR = 5.0, 3.0, 2.0  # m
DEAD_END = 0.3  # m of corridor beyond the last frontage


@dataclass(frozen=True, slots=True)
class _Plot:
    """Something that wants a frontage."""

    kind: Literal["room", "station", "lift", "charger", "parking"]
    number: int  #: of the room, lift ... or how many parking places
    length: float  #: frontage [m]
    depth: float  #: behind the corridor's wall [m]


@dataclass(slots=True)
class _SidePlan:
    """What stands along one side of a corridor, in order."""

    plots: list[_Plot] = field(default_factory=list)

    @property
    def length(self) -> float:
        return sum(plot.length for plot in self.plots)

    @property
    def depth(self) -> float:
        return max((plot.depth for plot in self.plots), default=0.0)


@dataclass(slots=True)
class _Skeleton:
    """Corridors, their floor, and the rows that the sides' plots go to."""

    streets: list[Street]
    floor: list[Box]
    rows: list[SideRow]


def hospital(
    *,
    shape: Shape = "ring",
    rooms: int = 8,
    active: Sequence[bool] = (),
    corridor_width: float = 2.8,
    cross_width: float | None = None,
    room_width: Numbers = 6.0,
    room_depth: Numbers = 4.5,
    door_width: Numbers = 1.4,
    door_offset: Numbers = 0.5,
    bathroom: Numbers = 0.0,
    spots: int = 3,
    station: bool = True,
    lifts: int = 0,
    chargers: int = 0,
    parking: int = 6,
    teeth: int = 2,
    lift_time: float = 12.0,
    charge_time: float = 10.0,
) -> World:
    """Layout of a hospital floor; see ``RANGES`` for what is allowed.

    Rooms are numbered in this order: the nurses' station (``nurses_station``), lifts
    (``lift_0`` ...), charging bays (``charger_0`` ...), then the active wards, whose names
    ``ward_0`` ... keep the number of their place. Where a value per room may be given, a
    short sequence is repeated.

    Args:
        shape: "line", "ell" (two corridors that meet), "ring" (around a core) or "comb"
            (branches off a main corridor).
        rooms: places for wards, 0 to 24, spread over the corridors' sides.
        active: which wards exist; an inactive one is a closed wall and nothing else
            changes. Empty: all.
        corridor_width: of the corridors along x [m], 1.8 to 5.
        cross_width: of the corridors along y [m]; as ``corridor_width`` if None.
        room_width: per ward, along the corridor [m], 2.5 to 12; never less than the door
            and the queue before it need.
        room_depth: per ward [m], 2.6 to 8.
        door_width: per ward [m], 0.8 to 2.
        door_offset: per ward, 0 to 1: as far up- or downstream as the queue allows.
        bathroom: per ward, 0 (none) to 1: a cubicle in the ward's back corner.
        spots: waiting spots per room, 1 to 5, one metre apart along the wall. Corridors
            narrower than 3.3 m step back for them, so that lanes stay free.
        station: whether there is a nurses' station.
        lifts: lift cars, 0 to 3; robots visit them like rooms and stand ``lift_time``.
        chargers: charging bays, 0 to 4; the same with ``charge_time``.
        parking: places for idle robots beside the lanes, 0 to 24.
        teeth: branches of a comb, 2 to 4.
        lift_time: [s].
        charge_time: [s].

    Returns:
        A world without robots, humans, tasks and events. The first corridor runs along x
        from the origin.

    Raises:
        ConfigError: a value outside its range, by name.
    """
    if shape not in get_args(Shape):
        raise UnknownNameError("shape", shape, get_args(Shape), where="hospital")
    cross = corridor_width if cross_width is None else cross_width
    values = {
        "rooms": rooms, "corridor_width": corridor_width, "cross_width": cross,
        "spots": spots, "lifts": lifts, "chargers": chargers, "parking": parking,
        "teeth": teeth, "lift_time": lift_time, "charge_time": charge_time,
    }  # fmt: skip
    for name, value in values.items():
        check_range("hospital", name, value, RANGES)
    widths = per_place("hospital", "room_width", room_width, rooms, RANGES)
    depths = per_place("hospital", "room_depth", room_depth, rooms, RANGES)
    doors = per_place("hospital", "door_width", door_width, rooms, RANGES)
    offsets = per_place("hospital", "door_offset", door_offset, rooms, RANGES)
    cubicles = per_place("hospital", "bathroom", bathroom, rooms, RANGES)
    is_active = active_flags("hospital", active, rooms)

    wards = [
        _Plot("room", i, max(widths[i], least_frontage(spots, doors[i])), depths[i] + 2 * WALL)
        for i in range(rooms)
    ]
    extras: list[_Plot] = []
    if station:
        length = max(STATION_WIDTH, least_frontage(spots, STATION_DOOR))
        extras.append(_Plot("station", 0, length, STATION_DEPTH + 2 * WALL))
    extras += [_Plot("lift", i, cabin_frontage(LIFT, spots), LIFT + 2 * WALL) for i in range(lifts)]
    extras += [
        _Plot("charger", i, cabin_frontage(BAY, spots), BAY + 2 * WALL) for i in range(chargers)
    ]
    skeleton, plans = _SHAPES[shape](wards, extras, parking, (corridor_width, cross, float(teeth)))

    stops: dict[tuple[str, int], StreetStop] = {}
    closed: list[Box] = []
    bays: list[ParkingBay] = []
    for plan, row in zip(plans, skeleton.rows, strict=True):
        for plot in plan.plots:
            frontage = row.take(plot.length)
            if plot.kind == "parking":
                bays.append(parking_bay(frontage, places=plot.number))
            elif plot.kind != "room":
                times = {"lift": lift_time, "charger": charge_time}
                stops[plot.kind, plot.number] = _extra(plot, frontage, spots, times)
            else:
                i = plot.number
                ward = room_stop(
                    frontage,
                    name=f"ward_{i}",
                    length=plot.length,
                    depth=depths[i],
                    door_width=doors[i],
                    door_offset=offsets[i],
                    spots=spots,
                    bathroom=cubicles[i],
                )
                if is_active[i]:
                    stops["room", i] = ward
                else:
                    closed += ward.free
    order = {"station": 0, "lift": 1, "charger": 2, "room": 3}
    return assemble_layout(
        "hospital",
        streets=skeleton.streets,
        floor=skeleton.floor,
        closed=closed,
        stops=[stops[key] for key in sorted(stops, key=lambda key: (order[key[0]], key[1]))],
        parking=bays,
    )


def _extra(plot: _Plot, frontage: Frontage, spots: int, times: dict[str, float]) -> StreetStop:
    if plot.kind == "station":
        return room_stop(
            frontage,
            name="nurses_station",
            length=plot.length,
            depth=STATION_DEPTH,
            door_width=STATION_DOOR,
            door_offset=1.0,
            spots=spots,
        )
    is_lift = plot.kind == "lift"
    return cabin_stop(
        frontage,
        name=f"{plot.kind}_{plot.number}",
        kind="elevator" if is_lift else "charger",
        size=LIFT if is_lift else BAY,
        service_time=times[plot.kind],
        spots=spots,
    )


# --- shapes --------------------------------------------------------------------------------


def _spread(plots: list[_Plot], plans: Sequence[_SidePlan]) -> None:
    """Hand out plots in turn."""
    for i, plot in enumerate(plots):
        plans[i % len(plans)].plots.append(plot)


def _add_parking(places: int, plans: Sequence[_SidePlan]) -> None:
    """Spread parking places over the ends of some sides."""
    for i, plan in enumerate(plans):
        share = (places + len(plans) - 1 - i) // len(plans)
        if share:
            plan.plots.append(_Plot("parking", share, parking_frontage(share), 0.0))


def _line(
    wards: list[_Plot], extras: list[_Plot], parking: int, lengths: tuple[float, float, float]
) -> tuple[_Skeleton, list[_SidePlan]]:
    width, _, _ = lengths
    plans = [_SidePlan(), _SidePlan()]
    _spread(extras, plans)
    _spread(wards, plans[::-1])
    _add_parking(parking, plans)
    length = max(2.0, *(plan.length for plan in plans))
    street = Street(start=(0.0, 0.0), along=(1.0, 0.0), length=length, width=width)
    return _Skeleton(
        [street],
        [street_box(street, DEAD_END, DEAD_END)],
        [SideRow(street, 0, side, 0.0) for side in (1, -1)],
    ), plans


def _ell(
    wards: list[_Plot], extras: list[_Plot], parking: int, lengths: tuple[float, float, float]
) -> tuple[_Skeleton, list[_SidePlan]]:
    width, cross, _ = lengths
    plans = [_SidePlan() for _ in range(4)]  # south, east (outer), north, west (inner)
    south, east, north, west = plans
    _spread(extras, [south, east])
    _spread(wards, [north, east, south, west])
    _add_parking(parking, [south, east])
    inner = north.depth + 1.3  # depth beyond the corridor's wall that rooms north of it take
    x = max(2.0, south.length, north.length) + cross / 2.0
    y = width / 2.0 + max(2.0, east.length, west.length + inner)
    first = Street(
        start=(0.0, 0.0), along=(1.0, 0.0), length=x, width=width, crossings=(StreetCrossing(0, x),)
    )
    second = Street(
        start=(x, 0.0), along=(0.0, 1.0), length=y, width=cross, crossings=(StreetCrossing(0, 0.0),)
    )
    return _Skeleton(
        [first, second],
        [
            street_box(first, DEAD_END, cross / 2.0),
            street_box(second, width / 2.0, DEAD_END),
        ],
        [
            SideRow(first, 0, 1, 0.0),
            SideRow(second, 1, 1, width / 2.0),
            SideRow(first, 0, -1, 0.0),
            SideRow(second, 1, -1, width / 2.0 + inner),
        ],
    ), plans


def _ring(
    wards: list[_Plot], extras: list[_Plot], parking: int, lengths: tuple[float, float, float]
) -> tuple[_Skeleton, list[_SidePlan]]:
    width, cross, _ = lengths
    plans = [_SidePlan() for _ in range(6)]  # outer south, east, north, west; core south, north
    south, east, north, west, core_south, core_north = plans
    _spread(extras, [core_south, core_north])
    _spread(wards, [south, north, east, west])
    _add_parking(parking, [core_south, core_north])
    room = 2.0 * 1.3 + WALL  # both of the core's walls may step back
    x = cross + max(2.0, *(p.length for p in (south, north, core_south, core_north)))
    y = width + max(2.0, east.length, west.length, core_south.depth + core_north.depth + room)
    points = [(0.0, 0.0), (x, 0.0), (x, y), (0.0, y)]
    headings = [(1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0)]
    streets = []
    for i in range(4):
        length = x if i % 2 == 0 else y
        ends = (StreetCrossing(i, 0.0), StreetCrossing((i + 1) % 4, length))
        breadth = width if i % 2 == 0 else cross
        streets.append(
            Street(start=points[i], along=headings[i], length=length, width=breadth, crossings=ends)
        )
    gaps = [cross / 2.0, width / 2.0]  # half the corridor that each one runs into
    floor = [street_box(s, gaps[i % 2], gaps[i % 2]) for i, s in enumerate(streets)]
    rows = [SideRow(s, i, 1, gaps[i % 2]) for i, s in enumerate(streets)]
    rows += [SideRow(streets[i], i, -1, cross / 2.0) for i in (0, 2)]
    return _Skeleton(streets, floor, rows), plans


def _comb(
    wards: list[_Plot], extras: list[_Plot], parking: int, lengths: tuple[float, float, float]
) -> tuple[_Skeleton, list[_SidePlan]]:
    width, cross, teeth = lengths
    count = int(teeth)
    sides = [_SidePlan() for _ in range(2 * count)]  # right, left of each branch
    main = _SidePlan()
    _add_parking(parking - parking // 2, [main])
    _spread(extras, [main])
    _add_parking(parking // 2, [main])
    _spread(wards, sides)
    recess = 1.3
    xs, x = [], 0.0
    for k in range(count):
        x += sides[2 * k + 1].depth + recess + cross / 2.0
        xs.append(x)
        x += cross / 2.0 + sides[2 * k].depth + recess
    length = max(x, main.length)
    streets = [
        Street(
            start=(0.0, 0.0), along=(1.0, 0.0), length=length, width=width,
            crossings=tuple(StreetCrossing(k, at) for k, at in enumerate(xs)),
        )
    ]  # fmt: skip
    floor = [street_box(streets[0], DEAD_END, DEAD_END)]
    rows = []
    for k, at in enumerate(xs):
        reach = width / 2.0 + max(2.0, sides[2 * k].length, sides[2 * k + 1].length)
        branch = Street(
            start=(at, 0.0), along=(0.0, 1.0), length=reach, width=cross,
            crossings=(StreetCrossing(k, 0.0),),
        )  # fmt: skip
        streets.append(branch)
        floor.append(street_box(branch, 0.0, DEAD_END))
        rows += [SideRow(branch, k + 1, side, width / 2.0) for side in (1, -1)]
    rows.append(SideRow(streets[0], 0, 1, 0.0))
    return _Skeleton(streets, floor, rows), [*sides, main]


_SHAPES = {"line": _line, "ell": _ell, "ring": _ring, "comb": _comb}
