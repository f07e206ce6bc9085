"""Pieces of one side of a street, and the room that queues and parked robots take of them.

In a frontage's frame the first coordinate runs with the traffic of the near lane, so the wall
is on its right; the second runs from the street's middle line outwards.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mrta_falsify.core.arrays import Array, frozen_array
from scenic_worlds.layouts.streets import SPOT_TO_WALL, Address, Street

WALL = 0.15  # m, thickness
HEAD_SPOT = 1.2  # m, door middle to the first waiting spot
SPOT_STEP = 1.0  # m between waiting spots, as MRTA-Sim
END_SPACE = 0.5  # m, last spot to the end of its bay
DOWNSTREAM = 0.25  # m, door jamb to the end of the frontage
POINT_TO_SIDE = 0.85  # m, room point to the room's side walls at least

Box = tuple[float, float, float, float]  # low and high of both coordinates


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Frontage:
    """A piece of one side of a street."""

    street: Street
    number: int  #: of the street
    side: int  #: 1: right of the street's direction, -1: left
    station: float  #: where it begins, seen by the traffic of the near lane [m]

    def points(self, local: list[tuple[float, float]]) -> Array:
        """Map points ``(K, 2)`` [m] of (downstream, outwards) pairs."""
        (ax, ay), side = self.street.along, self.side
        ux, uy = ax * side, ay * side
        x, y = self.street.point(self.station)
        s, out = np.array(local, dtype=np.float64).reshape(-1, 2).T
        return np.stack([x + ux * s + uy * out, y + uy * s - ux * out], axis=1)

    def point(self, downstream: float, outwards: float) -> Array:
        """Map point ``(2,)`` [m]."""
        return frozen_array(self.points([(downstream, outwards)])[0])

    def box(self, box: Box) -> Box:
        """Map box (x min, y min, x max, y max) of (from, to downstream, from, to outwards)."""
        (x1, y1), (x2, y2) = self.points([(box[0], box[2]), (box[1], box[3])]).tolist()
        return (min(x1, x2), min(y1, y2), max(x1, x2), max(y1, y2))

    def address(self, downstream: float) -> Address:
        """Where a place of the frontage lies on the street."""
        return Address(self.number, self.station + self.side * downstream)

    @property
    def wall(self) -> float:
        """Middle line to the stepped-back wall [m]."""
        return self.street.width / 2.0 + self.street.recess

    @property
    def spot_line(self) -> float:
        """Middle line to the line of waiting robots [m]."""
        return self.wall - SPOT_TO_WALL


def corners(box: Box) -> Array:
    """Outline ``(4, 2)`` a box (x min, y min, x max, y max), counter-clockwise."""
    x1, y1, x2, y2 = box
    return frozen_array([[x1, y1], [x2, y1], [x2, y2], [x1, y2]])


def queue_length(spots: int) -> float:
    """Compute the frontage [m] upstream of a door's middle that waiting robots need."""
    return HEAD_SPOT + max(spots - 1, 0) * SPOT_STEP + END_SPACE if spots else POINT_TO_SIDE + WALL


def least_frontage(spots: int, door_width: float) -> float:
    """Compute the shortest frontage [m] of a place with a queue and a door."""
    return queue_length(spots) + downstream_length(door_width)


def downstream_length(door_width: float) -> float:
    """Compute the frontage [m] downstream of a door's middle."""
    return max(door_width / 2.0 + DOWNSTREAM, POINT_TO_SIDE + WALL / 2.0)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ParkingBay:
    """Places for idle robots along a street."""

    places: Array  #: (P, 2) [m]
    free: tuple[Box, ...]


def parking_frontage(places: int) -> float:
    """Compute the frontage [m] that ``places`` parked robots need."""
    return places * SPOT_STEP + 2 * (END_SPACE - SPOT_STEP / 2.0) + 0.2 if places else 0.0


def parking_bay(frontage: Frontage, *, places: int) -> ParkingBay:
    """Park robots side by side along the wall, out of the lanes."""
    length = parking_frontage(places)
    middle = [(0.1 + (k + 0.5) * SPOT_STEP, frontage.spot_line) for k in range(places)]
    box = (0.0, length, frontage.street.width / 2.0 - 0.01, frontage.wall)
    return ParkingBay(places=frontage.points(middle), free=(frontage.box(box),))
