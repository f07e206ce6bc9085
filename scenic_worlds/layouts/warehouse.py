"""A warehouse: aisles between racks, pick faces, packing stations, chargers.

Aisles run along y and end in a cross aisle at the front (packing stations) and one at the
back (chargers, parking). Rooms are the places where robots load and unload.
"""

from __future__ import annotations

from collections.abc import Sequence

from mrta_falsify.core.world import World
from scenic_worlds.layouts.aisles import block_furniture, faces_length, place_faces, plan_aisles
from scenic_worlds.layouts.assembly import SideRow, assemble_layout
from scenic_worlds.layouts.frontages import (
    ParkingBay,
    least_frontage,
    parking_bay,
    parking_frontage,
)
from scenic_worlds.layouts.ranges import active_flags, check_ranges
from scenic_worlds.layouts.stops import BAY, StreetStop, cabin_frontage, cabin_stop, room_stop

#: allowed values: lowest, highest
RANGES: dict[str, tuple[float, float]] = {
    "aisles": (1, 24),
    "picks": (0, 72),
    "stations": (0, 24),
    "chargers": (0, 6),
    "parking": (0, 72),
    "aisle_width": (1.8, 4.5),
    "cross_width": (1.8, 5.0),
    "aisle_length": (4.0, 40.0),
    "rack_depth": (0.5, 3.0),
    "pick_offset": (0.0, 1.0),
    "rack_height": (0.5, 12.0),
    "station_door": (0.8, 3.0),
    "spots": (1, 4),
    "charge_time": (0.0, 600.0),
}

STATION_WIDTH, STATION_DEPTH = 4.0, 2.6  # m


def warehouse(
    *,
    aisles: int = 4,
    picks: int = 6,
    active: Sequence[bool] = (),
    stations: int = 2,
    chargers: int = 1,
    parking: int = 6,
    aisle_width: float = 2.6,
    cross_width: float = 3.2,
    aisle_length: float = 12.0,
    rack_depth: float = 2.0,
    rack_height: float = 2.5,
    pick_offset: float = 0.5,
    station_door: float = 1.6,
    spots: int = 2,
    charge_time: float = 10.0,
) -> World:
    """Generate a warehouse; ``RANGES`` has what is allowed.

    Rooms are numbered in this order: packing stations (``station_0`` ...), charging bays
    (``charger_0`` ...), then the active pick faces, whose names ``pick_0`` ... keep the
    number of their place.

    Args:
        aisles: 1 to 24.
        picks: places at the racks, 0 to 72, spread over both sides of the aisles.
        active: which picks exist; an inactive one is closed rack. Empty: all.
        stations: packing stations in front, 0 to 24.
        chargers: charging bays at the back, 0 to 6.
        parking: places for idle robots at the back, 0 to 72.
        aisle_width: rack to rack [m], 1.8 to 4.5.
        cross_width: of the aisles in front and at the back [m], 1.8 to 5.
        aisle_length: [m], 4 to 40; never less than the picks along one side need.
        rack_depth: of the double racks between aisles [m], 0.5 to 3; never less than the
            waiting bays in them need.
        rack_height: [m], 0.5 to 12.
        pick_offset: 0 to 1: where along the aisle the picks are, front to back.
        station_door: opening of a packing station [m], 0.8 to 3.
        spots: waiting spots per place, 1 to 4.
        charge_time: [s].

    Returns:
        A world without robots, humans, tasks and events; the front aisle runs along x from
        the origin.

    Raises:
        ConfigError: a value outside its range, by name.
    """
    values = {
        "aisles": aisles, "picks": picks, "stations": stations, "chargers": chargers,
        "parking": parking, "aisle_width": aisle_width, "cross_width": cross_width,
        "aisle_length": aisle_length, "rack_depth": rack_depth, "rack_height": rack_height,
        "pick_offset": pick_offset, "station_door": station_door, "spots": spots,
        "charge_time": charge_time,
    }  # fmt: skip
    check_ranges("warehouse", values, RANGES)
    is_active = active_flags("warehouse", active, picks)

    sides = [(2 + k // 2, 1 if k % 2 == 0 else -1) for k in range(2 * aisles)]
    station = max(STATION_WIDTH, least_frontage(spots, station_door))
    back = chargers * cabin_frontage(BAY, spots) + parking_frontage(parking)
    plan = plan_aisles(
        aisles,
        width=aisle_width,
        cross=cross_width,
        length=max(aisle_length, faces_length(-(-picks // len(sides)), spots)),
        between=rack_depth,
        beside=rack_depth / 2.0,
        least_front=max(stations * station, back),
    )
    front_row = SideRow(plan.streets[0], 0, 1, 0.0)
    back_row = SideRow(plan.streets[1], 1, 1, 0.0)
    stops = _stations(front_row, stations, length=station, door=station_door, spots=spots)
    stops += _chargers(back_row, chargers, charge_time=charge_time, spots=spots)
    bays: list[ParkingBay] = []
    if parking:
        bays.append(parking_bay(back_row.take(parking_frontage(parking)), places=parking))
    faces = place_faces(plan, sides, picks, name="pick", spots=spots, offset=pick_offset)
    open_faces = [face for face, is_open in zip(faces, is_active, strict=True) if is_open]
    return assemble_layout(
        "warehouse",
        streets=plan.streets,
        floor=plan.floor,
        stops=[*stops, *open_faces],
        parking=bays,
        furniture=block_furniture(plan, open_faces, name="rack", kind="shelf", height=rack_height),
    )


def _stations(
    row: SideRow, count: int, *, length: float, door: float, spots: int
) -> list[StreetStop]:
    return [
        room_stop(
            row.take(length),
            name=f"station_{i}",
            length=length,
            depth=STATION_DEPTH,
            door_width=door,
            door_offset=0.5,
            spots=spots,
        )
        for i in range(count)
    ]


def _chargers(row: SideRow, count: int, *, charge_time: float, spots: int) -> list[StreetStop]:
    return [
        cabin_stop(
            row.take(cabin_frontage(BAY, spots)),
            name=f"charger_{i}",
            kind="charger",
            size=BAY,
            service_time=charge_time,
            spots=spots,
        )
        for i in range(count)
    ]
