"""Straight corridors that cross at right angles, and right-hand ways along them.

A *street* is the middle line of a corridor or aisle with two lanes, one per direction, each
``lane`` metres right of the middle. Ways turn where the lanes of two streets meet.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from mrta_falsify.core.arrays import Array, IntArray

LANE = 0.42  # m, lane to the middle line at least: 0.84 between lanes, as AWS's 0.78
LANE_FAR = 0.7  # m, at most
SPOT_TO_LANE = 0.78  # m, as AWS: barrier of 0.6 m, its yield margin of 0.12 m, and a bit
SPOT_TO_WALL = 0.45  # m
SAME_PLACE = 0.15  # m; corners of a lane that are nearer are one
SIDE_SPACE = SPOT_TO_LANE + SPOT_TO_WALL  # m, between lane and wall where robots wait


@dataclass(frozen=True, slots=True)
class StreetCrossing:
    """Where a street meets another one."""

    node: int  #: number of the crossing on the floor
    station: float  #: distance from the street's start [m]


@dataclass(frozen=True, slots=True, kw_only=True)
class Street:
    """A straight corridor along x or y."""

    start: tuple[float, float]  #: [m], map frame
    along: tuple[float, float]  #: unit vector along x or y
    length: float  #: [m]
    width: float  #: wall to wall [m]
    crossings: tuple[StreetCrossing, ...] = ()  #: by station

    @property
    def lane(self) -> float:
        """Distance of each lane from the middle line [m]; grows with the width, continuously."""
        return max(LANE, min(LANE_FAR, self.width / 2.0 - SIDE_SPACE))

    @property
    def recess(self) -> float:
        """Depth [m] of the bay in the street's wall that waiting robots need; 0: none."""
        return max(0.0, SIDE_SPACE - (self.width / 2.0 - self.lane))

    def point(self, station: float, right: float = 0.0) -> tuple[float, float]:
        """Map point [m] at a station, ``right`` metres right of the middle line."""
        (x, y), (ux, uy) = self.start, self.along
        return (x + ux * station + uy * right, y + uy * station - ux * right)


@dataclass(frozen=True, slots=True)
class Leg:
    """A stretch of one street, driven in one direction."""

    street: int
    heading: int  #: 1: away from the street's start, -1: towards it


@dataclass(frozen=True, slots=True)
class Address:
    """A place beside a street."""

    street: int
    station: float  #: [m]


class StreetMap:
    """Streets with shortest ways between all crossings."""

    def __init__(self, streets: tuple[Street, ...]) -> None:
        self.streets = streets
        count = 1 + max((c.node for s in streets for c in s.crossings), default=-1)
        self._length: Array = np.full((count, count), np.inf)
        np.fill_diagonal(self._length, 0.0)
        self._next: IntArray = np.tile(np.arange(count), (count, 1))
        self._leg: dict[tuple[int, int], Leg] = {}
        for number, street in enumerate(streets):
            for one, two in itertools.pairwise(street.crossings):
                self._length[one.node, two.node] = two.station - one.station
                self._length[two.node, one.node] = two.station - one.station
                self._leg[one.node, two.node] = Leg(number, 1)
                self._leg[two.node, one.node] = Leg(number, -1)
        for middle in range(count):
            through = self._length[:, middle, None] + self._length[None, middle, :]
            shorter = through < self._length - 1e-9
            self._length = np.where(shorter, through, self._length)
            self._next = np.where(shorter, self._next[:, middle, None], self._next)

    def legs(self, start: Address, end: Address) -> tuple[Leg, ...]:
        """Find the shortest way between two addresses; one leg if they share a street."""
        if start.street == end.street:
            return (Leg(start.street, 1 if end.station >= start.station else -1),)
        best, nodes = np.inf, (-1, -1)
        for out in self.streets[start.street].crossings:
            for into in self.streets[end.street].crossings:
                length = (
                    abs(out.station - start.station)
                    + float(self._length[out.node, into.node])
                    + abs(into.station - end.station)
                )
                if length < best - 1e-9:
                    best, nodes = length, (out.node, into.node)
        first, last = nodes
        legs = [Leg(start.street, self._heading(start, first))]
        while first != last:
            step = int(self._next[first, last])
            legs.append(self._leg[first, step])
            first = step
        legs.append(Leg(end.street, -self._heading(end, last)))
        merged = [legs[0]]
        merged += [leg for before, leg in itertools.pairwise(legs) if leg != before]
        return tuple(merged)

    def _heading(self, address: Address, node: int) -> int:
        """Tell the direction from an address to a crossing of its street."""
        crossings = self.streets[address.street].crossings
        station = next(c.station for c in crossings if c.node == node)
        return 1 if station >= address.station else -1

    def way(self, legs: tuple[Leg, ...], start: float, end: float) -> list[tuple[float, float]]:
        """Follow the lane along ``legs``, station ``start`` to station ``end``: corners [m]."""
        first, last = legs[0], legs[-1]
        points = [self._on_lane(first, start)]
        points += [self._turn(one, two) for one, two in itertools.pairwise(legs)]
        arrival = self._on_lane(last, end)
        if abs(arrival[0] - points[-1][0]) + abs(arrival[1] - points[-1][1]) > SAME_PLACE:
            points.append(arrival)
        return points

    def _on_lane(self, leg: Leg, station: float) -> tuple[float, float]:
        street = self.streets[leg.street]
        return street.point(station, leg.heading * street.lane)

    def _turn(self, one: Leg, two: Leg) -> tuple[float, float]:
        """Find where the lanes of two streets that cross at a right angle meet."""
        x1, y1 = self._on_lane(one, 0.0)
        x2, y2 = self._on_lane(two, 0.0)
        return (x2, y1) if self.streets[one.street].along[0] else (x1, y2)
