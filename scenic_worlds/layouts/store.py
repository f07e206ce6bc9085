"""A department store: a loop of aisles around display islands, departments on the outside.

Departments are rooms with wide openings on all four sides; counters are places at the
islands; lifts stand at the back.
"""

from __future__ import annotations

from collections.abc import Sequence

from mrta_falsify.core.world import World
from scenic_worlds.layouts.aisles import block_furniture, faces_length, place_faces, plan_aisles
from scenic_worlds.layouts.assembly import SideRow, assemble
from scenic_worlds.layouts.ranges import Numbers, active_flags, check_range, per_place
from scenic_worlds.layouts.stops import (
    LIFT,
    Box,
    ParkingBay,
    Stop,
    cabin_frontage,
    cabin_stop,
    least_frontage,
    parking_bay,
    parking_frontage,
    room_stop,
)

#: allowed values: lowest, highest
RANGES: dict[str, tuple[float, float]] = {
    "departments": (0, 20),
    "islands": (1, 6),
    "counters": (0, 16),
    "lifts": (0, 3),
    "parking": (0, 24),
    "aisle_width": (1.8, 6.0),
    "cross_width": (1.8, 6.0),
    "island_width": (1.0, 8.0),
    "island_length": (3.0, 30.0),
    "department_width": (3.0, 14.0),
    "department_depth": (2.6, 10.0),
    "opening": (0.9, 4.0),
    "opening_offset": (0.0, 1.0),
    "counter_offset": (0.0, 1.0),
    "spots": (1, 4),
    "lift_time": (0.0, 120.0),
}

ISLAND_HEIGHT = 1.4  # m


def department_store(
    *,
    departments: int = 8,
    active: Sequence[bool] = (),
    islands: int = 2,
    counters: int = 2,
    lifts: int = 1,
    parking: int = 6,
    aisle_width: float = 3.4,
    cross_width: float | None = None,
    island_width: float = 3.0,
    island_length: float = 8.0,
    department_width: Numbers = 7.0,
    department_depth: Numbers = 5.0,
    opening: Numbers = 2.6,
    opening_offset: Numbers = 0.5,
    counter_offset: float = 0.5,
    spots: int = 2,
    lift_time: float = 12.0,
) -> World:
    """Layout of a department store; see ``RANGES`` for what is allowed.

    Rooms are numbered in this order: lifts (``lift_0`` ...), the active departments, whose
    names ``department_0`` ... keep the number of their place, counters (``counter_0`` ...).
    Where a value per department may be given, a short sequence is repeated.

    Args:
        departments: places for departments, 0 to 20, in turn south, north, east, west.
        active: which departments exist; an inactive one is a closed wall. Empty: all.
        islands: blocks of displays inside the loop, 1 to 6.
        counters: places at the islands, 0 to 16.
        lifts: 0 to 3.
        parking: places for idle robots, 0 to 24.
        aisle_width: of the aisles along y [m], 1.8 to 6.
        cross_width: of the two aisles along x [m]; as ``aisle_width`` if None.
        island_width: along x [m], 1 to 8; never less than places at both sides need.
        island_length: along y [m], 3 to 30; never less than counters or departments need.
        department_width: along its aisle [m], 3 to 14; never less than the opening and the
            queue before it need.
        department_depth: [m], 2.6 to 10.
        opening: width of the entrance [m], 0.9 to 4.
        opening_offset: 0 to 1: as far up- or downstream as the queue allows.
        counter_offset: 0 to 1: where along the islands the counters are.
        spots: waiting spots per place, 1 to 4.
        lift_time: [s].

    Returns:
        A world without robots, humans, tasks and events; the south aisle runs along x from
        the origin.

    Raises:
        ConfigError: a value outside its range, by name.
    """
    cross = aisle_width if cross_width is None else cross_width
    values = {
        "departments": departments, "islands": islands, "counters": counters, "lifts": lifts,
        "parking": parking, "aisle_width": aisle_width, "cross_width": cross,
        "island_width": island_width, "island_length": island_length,
        "counter_offset": counter_offset, "spots": spots, "lift_time": lift_time,
    }  # fmt: skip
    for name, value in values.items():
        check_range("department_store", name, value, RANGES)
    widths, depths, doors, offsets = (
        per_place("department_store", name, given, departments, RANGES)
        for name, given in (
            ("department_width", department_width),
            ("department_depth", department_depth),
            ("opening", opening),
            ("opening_offset", opening_offset),
        )
    )
    is_active = active_flags("department_store", active, departments)
    lengths = [max(widths[i], least_frontage(spots, doors[i])) for i in range(departments)]
    south, north, east, west = (range(side, departments, 4) for side in range(4))
    lift = cabin_frontage(LIFT, spots)
    inner_sides = [(2 + k, 1) for k in range(islands)] + [(3 + k, -1) for k in range(islands)]
    plan = plan_aisles(
        islands + 1,
        width=aisle_width,
        cross=cross,
        length=max(
            island_length,
            sum(lengths[i] for i in east),
            sum(lengths[i] for i in west),
            faces_length(-(-counters // len(inner_sides)), spots),
        ),
        between=island_width,
        beside=0.0,
        least_front=max(
            sum(lengths[i] for i in south) + parking_frontage(parking),
            sum(lengths[i] for i in north) + lifts * lift,
        ),
    )
    low, _ = plan.inner
    rows = (
        SideRow(plan.streets[0], 0, 1, 0.0),
        SideRow(plan.streets[1], 1, 1, 0.0),
        SideRow(plan.streets[-1], len(plan.streets) - 1, 1, low),
        SideRow(plan.streets[2], 2, -1, low),
    )
    stops = [
        cabin_stop(
            rows[1].take(lift),
            name=f"lift_{i}",
            kind="elevator",
            size=LIFT,
            service_time=lift_time,
            spots=spots,
        )
        for i in range(lifts)
    ]
    closed: list[Box] = []
    open_departments: list[tuple[int, Stop]] = []
    for row, numbers in zip(rows, (south, north, east, west), strict=True):
        for i in numbers:
            stop = room_stop(
                row.take(lengths[i]),
                name=f"department_{i}",
                length=lengths[i],
                depth=depths[i],
                door_width=doors[i],
                door_offset=offsets[i],
                spots=spots,
            )
            if is_active[i]:
                open_departments.append((i, stop))
            else:
                closed += stop.free
    open_departments.sort(key=lambda entry: entry[0])
    bays: list[ParkingBay] = []
    if parking:
        bays.append(parking_bay(rows[0].take(parking_frontage(parking)), places=parking))
    faces = place_faces(
        plan, inner_sides, counters, name="counter", spots=spots, offset=counter_offset
    )
    return assemble(
        "department_store",
        streets=plan.streets,
        floor=plan.floor,
        stops=[*stops, *(stop for _, stop in open_departments), *faces],
        parking=bays,
        furniture=block_furniture(plan, faces, name="island", kind="display", height=ISLAND_HEIGHT),
        closed=closed,
    )
