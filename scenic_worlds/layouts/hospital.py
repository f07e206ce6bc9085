"""A hospital floor from a few lengths: corridors as a line, an L, a ring or a comb.

Wards lie behind doors on both sides; a nurses' station, lifts, charging bays and parking for
idle robots may be added. Every value within the documented ranges gives a connected floor
on which two robots pass each other everywhere but in doorways.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import get_args

from mrta_falsify.core.errors import UnknownNameError
from mrta_falsify.core.world import World
from scenic_worlds.layouts.assembly import assemble_layout
from scenic_worlds.layouts.corridor_shapes import (
    Corridors,
    CorridorSize,
    Plot,
    Shape,
    Wanted,
    plan_corridors,
)
from scenic_worlds.layouts.frontages import (
    WALL,
    Box,
    Frontage,
    ParkingBay,
    least_frontage,
    parking_bay,
)
from scenic_worlds.layouts.ranges import Numbers, active_flags, check_ranges, per_place
from scenic_worlds.layouts.stops import BAY, LIFT, StreetStop, cabin_frontage, cabin_stop, room_stop

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


@dataclass(frozen=True, slots=True, kw_only=True)
class _Ward:
    """Lengths of one ward [m], and whether it exists."""

    width: float
    depth: float
    door_width: float
    door_offset: float  #: 0 to 1
    bathroom: float  #: 0 to 1
    is_active: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class _Common:
    """What all places of a floor share."""

    spots: int  #: waiting spots each
    lift_time: float  #: [s]
    charge_time: float  #: [s]


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
    """Generate a hospital floor; ``RANGES`` has what is allowed.

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
    check_ranges("hospital", values, RANGES)
    per_ward = {
        "room_width": room_width, "room_depth": room_depth, "door_width": door_width,
        "door_offset": door_offset, "bathroom": bathroom,
    }  # fmt: skip
    lengths = [
        per_place("hospital", name, given, rooms, RANGES) for name, given in per_ward.items()
    ]
    wards = [
        _Ward(width=w, depth=d, door_width=door, door_offset=at, bathroom=b, is_active=is_active)
        for w, d, door, at, b, is_active in zip(
            *lengths, active_flags("hospital", active, rooms), strict=True
        )
    ]
    extras = _extra_plots(station=station, lifts=lifts, chargers=chargers, spots=spots)
    corridors = plan_corridors(
        shape,
        Wanted([_ward_plot(i, ward, spots) for i, ward in enumerate(wards)], extras, parking),
        CorridorSize(corridor_width, cross, int(teeth)),
    )
    common = _Common(spots=spots, lift_time=lift_time, charge_time=charge_time)
    return _built(corridors, wards, common)


def _ward_plot(number: int, ward: _Ward, spots: int) -> Plot:
    length = max(ward.width, least_frontage(spots, ward.door_width))
    return Plot("room", number, length, ward.depth + 2 * WALL)


def _extra_plots(*, station: bool, lifts: int, chargers: int, spots: int) -> list[Plot]:
    plots: list[Plot] = []
    if station:
        length = max(STATION_WIDTH, least_frontage(spots, STATION_DOOR))
        plots.append(Plot("station", 0, length, STATION_DEPTH + 2 * WALL))
    plots += [Plot("lift", i, cabin_frontage(LIFT, spots), LIFT + 2 * WALL) for i in range(lifts)]
    plots += [
        Plot("charger", i, cabin_frontage(BAY, spots), BAY + 2 * WALL) for i in range(chargers)
    ]
    return plots


def _built(corridors: Corridors, wards: Sequence[_Ward], common: _Common) -> World:
    """Give every plot its frontage, and put the floor together."""
    stops: dict[tuple[int, int], StreetStop] = {}
    closed: list[Box] = []
    bays: list[ParkingBay] = []
    for row, plots in corridors.sides:
        for plot in plots:
            frontage = row.take(plot.length)
            if plot.kind == "parking":
                bays.append(parking_bay(frontage, places=plot.number))
                continue
            stop = _stop(plot, frontage, wards, common)
            if plot.kind == "room" and not wards[plot.number].is_active:
                closed += stop.free
            else:
                stops[_ORDER.index(plot.kind), plot.number] = stop
    return assemble_layout(
        "hospital",
        streets=corridors.streets,
        floor=corridors.floor,
        closed=closed,
        stops=[stops[key] for key in sorted(stops)],
        parking=bays,
    )


#: kinds of place in the order of their room numbers
_ORDER = ("station", "lift", "charger", "room")


def _stop(plot: Plot, frontage: Frontage, wards: Sequence[_Ward], common: _Common) -> StreetStop:
    if plot.kind == "room":
        ward = wards[plot.number]
        return room_stop(
            frontage,
            name=f"ward_{plot.number}",
            length=plot.length,
            depth=ward.depth,
            door_width=ward.door_width,
            door_offset=ward.door_offset,
            spots=common.spots,
            bathroom=ward.bathroom,
        )
    if plot.kind == "station":
        return room_stop(
            frontage,
            name="nurses_station",
            length=plot.length,
            depth=STATION_DEPTH,
            door_width=STATION_DOOR,
            door_offset=1.0,
            spots=common.spots,
        )
    is_lift = plot.kind == "lift"
    return cabin_stop(
        frontage,
        name=f"{plot.kind}_{plot.number}",
        kind="elevator" if is_lift else "charger",
        size=LIFT if is_lift else BAY,
        service_time=common.lift_time if is_lift else common.charge_time,
        spots=common.spots,
    )
