"""Streets and the places beside them, put together to a layout."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mrta_falsify.core.arrays import Array, BoolArray, frozen_array
from mrta_falsify.core.world import Furniture, Lane, Wall, World
from scenic_worlds.layouts.frontages import Box, Frontage, ParkingBay, corners
from scenic_worlds.layouts.stops import StreetStop
from scenic_worlds.layouts.streets import Leg, Street, StreetMap
from simulator_interface.formats.outlines import merged_runs

MARGIN = 0.3  # m of solid around everything
SAME = 1e-6  # m; coordinates this near are one
THINNEST = 1e-3  # m; solids thinner than this are left out
# One robot alone drives length / 0.76 m/s + 1.3 s, spread 0.7 s; this is
# a little slower, as floors with traffic are.
DRIVEN_SPEED = 0.72  # m/s
TURNS = 2.0  # s, for the turns in and out


@dataclass(slots=True)
class SideRow:
    """Frontages placed one after the other along one side of a street."""

    street: Street
    number: int
    side: int  #: 1: right of the street's direction, -1: left
    low: float  #: station from which on the side is free [m]

    def take(self, length: float) -> Frontage:
        """Take the next ``length`` metres from the low end."""
        start = self.low if self.side > 0 else self.low + length
        self.low += length
        return Frontage(street=self.street, number=self.number, side=self.side, station=start)


def street_box(street: Street, before: float = 0.0, after: float = 0.0) -> Box:
    """Box the floor of a street, lengthened at its start and end [m]."""
    half = street.width / 2.0
    x1, y1 = street.point(-before, half)
    x2, y2 = street.point(street.length + after, -half)
    return (min(x1, x2), min(y1, y2), max(x1, x2), max(y1, y2))


def assemble_layout(
    name: str,
    *,
    streets: Sequence[Street],
    floor: Sequence[Box],
    stops: Sequence[StreetStop],
    parking: Sequence[ParkingBay],
    furniture: Sequence[Furniture] = (),
    closed: Sequence[Box] = (),
) -> World:
    """Put streets and stops together, with lanes and travel times between all stops.

    Args:
        name: of the layout.
        streets: the numbers in ``stops`` refer to this order.
        floor: boxes of the streets themselves.
        stops: rooms, in the order of their numbers.
        parking: bays for idle robots.
        furniture: what stands on the floor, beside that of the stops.
        closed: solid that the bounds are to hold too, so that they do not depend on which
            places are open.

    Returns:
        A world without robots, humans, tasks and events. Whatever is not floor is solid.
    """
    boxes = np.array(
        [
            *floor,
            *(box for stop in stops for box in stop.free),
            *(box for bay in parking for box in bay.free),
        ]
    )
    extent = np.vstack([boxes, np.array(closed).reshape(-1, 4)])
    low, high = extent[:, :2].min(axis=0), extent[:, 2:].max(axis=0)
    bounds = np.concatenate([low - MARGIN, high + MARGIN])
    roads = StreetMap(tuple(streets))
    lanes = tuple(
        _lane(roads, stops, start, end)
        for start, end in itertools.permutations(range(len(stops)), 2)
    )
    return World(
        name=name,
        bounds=frozen_array(bounds),
        walls=tuple(
            Wall(name=f"wall_{i}", polygon=corners(box))
            for i, box in enumerate(solid_boxes(bounds, boxes))
        ),
        furniture=(*furniture, *(item for stop in stops for item in stop.furniture)),
        rooms=tuple(stop.room for stop in stops),
        lanes=lanes,
        resources=tuple(stop.resource(number) for number, stop in enumerate(stops)),
        parking=frozen_array(
            np.vstack([bay.places for bay in parking]) if parking else np.zeros((0, 2))
        ),
        travel_times=lane_travel_times(lanes, [stop.room.point for stop in stops]),
    )


def _lane(roads: StreetMap, stops: Sequence[StreetStop], start: int, end: int) -> Lane:
    one, two = stops[start], stops[end]
    legs = roads.legs(one.door, two.door)
    to_room = roads.way(legs, one.door.station, two.door.station)
    to_tail = legs
    if len(legs) == 1:
        onwards = two.tail.station >= one.door.station
        to_tail = (Leg(legs[0].street, 1 if onwards else -1),)
    to_queue = roads.way(to_tail, one.door.station, two.tail.station)
    tail = two.spots[-1] if len(two.spots) else two.front
    return Lane(
        start=start,
        end=end,
        to_queue=frozen_array(np.vstack([*to_queue, tail])),
        to_room=frozen_array(np.vstack([*to_room, two.entry])),
    )


def lane_travel_times(lanes: Sequence[Lane], points: Sequence[Array]) -> Array:
    """Estimate seconds ``(R, R)`` from room point to room point, in whole numbers."""
    times = np.zeros((len(points), len(points)))
    for lane in lanes:
        steps = np.diff(np.vstack([points[lane.start], lane.to_room]), axis=0)
        length = float(np.hypot(steps[:, 0], steps[:, 1]).sum())
        times[lane.start, lane.end] = np.ceil(length / DRIVEN_SPEED + TURNS)
    return frozen_array(times)


# --- what is not floor is solid ----------------------------------------------------------


def solid_boxes(bounds: Array, free: Array) -> list[Box]:
    """Fill the ``bounds`` ``(4,)`` around the floor with boxes that do not overlap.

    Args:
        bounds: x min, y min, x max, y max [m].
        free: ``(B, 4)`` boxes of floor, inside the bounds.
    """
    xs = _distinct(np.concatenate([bounds[[0, 2]], free[:, 0], free[:, 2]]))
    ys = _distinct(np.concatenate([bounds[[1, 3]], free[:, 1], free[:, 3]]))
    solid: BoolArray = np.ones((len(ys) - 1, len(xs) - 1), dtype=np.bool_)
    cols = np.searchsorted(xs, free[:, [0, 2]] - SAME)
    rows = np.searchsorted(ys, free[:, [1, 3]] - SAME)
    for (low, high), (left, right) in zip(rows.tolist(), cols.tolist(), strict=True):
        solid[low:high, left:right] = False
    boxes = []
    for left, right, low, high in merged_runs(solid):
        box = (float(xs[left]), float(ys[low]), float(xs[right]), float(ys[high]))
        if min(box[2] - box[0], box[3] - box[1]) >= THINNEST:
            boxes.append(box)
    return boxes


def _distinct(values: Array) -> Array:
    ordered = np.sort(values)
    return np.asarray(ordered[np.concatenate([[True], np.diff(ordered) > SAME])])
