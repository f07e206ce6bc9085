"""Places beside a street: rooms with doors, counters, lifts, shelves.

Every place takes a frontage. Robots wait upstream of the door, along the wall; where the street
is narrow the wall steps back for them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from mrta_falsify.core.arrays import Array, frozen_array
from mrta_falsify.core.world import Furniture, Resource, Room
from scenic_worlds.layouts.frontages import (
    DOWNSTREAM,
    HEAD_SPOT,
    POINT_TO_SIDE,
    SPOT_STEP,
    WALL,
    Box,
    Frontage,
    corners,
    downstream_length,
    queue_length,
)
from scenic_worlds.layouts.streets import SPOT_TO_WALL, Address

APRON = 0.9  # m of floor before a door that an entering robot needs
ASK_AROUND = 4.5  # m around door and spots, as AWS
LIFT = 1.8  # m, width and depth of a lift car
FACE = 0.5  # m, half the width of a place at a shelf
BAY = 1.3  # m, width and depth of a charging bay

Kind = Literal["room", "elevator", "charger"]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StreetStop:
    """A place that tasks may name, with all that follows from where it is."""

    room: Room
    kind: Kind
    door: Address
    tail: Address  #: beside the last waiting spot
    front: Array  #: (2,) before the door, on the line of waiting robots [m]
    spots: Array  #: (S, 2) [m]
    release_area: Array  #: (V, 2) [m]
    free: tuple[Box, ...]  #: floor it adds to the street, map boxes
    service_time: float = 0.0  #: [s]
    furniture: tuple[Furniture, ...] = ()

    @property
    def entry(self) -> Array:
        """Waypoints ``(K, 2)`` [m] from before the door, or the shelf, to the room point."""
        if np.array_equal(self.front, self.room.point):
            return frozen_array(self.front[None, :])
        return frozen_array(np.vstack([self.front, self.room.point]))

    def resource(self, number: int) -> Resource:
        """Describe the resource that guards the place; ``number`` is the room's."""
        near = np.vstack([self.spots, self.front[None, :], self.room.point[None, :]])
        x1, y1 = (near.min(axis=0) - ASK_AROUND).tolist()
        x2, y2 = (near.max(axis=0) + ASK_AROUND).tolist()
        return Resource(
            name=self.room.name,
            kind=self.kind,
            room=number if self.kind == "room" else None,
            spots=frozen_array(self.spots),
            entry=self.entry,
            request_area=corners((x1, y1, x2, y2)),
            release_area=self.release_area,
            service_time=self.service_time,
        )


class _Queue(NamedTuple):
    """Where robots wait for a place."""

    front: Array  #: (2,) before the door [m]
    spots: Array  #: (S, 2) head first [m]
    tail: Address  #: beside the last spot


def _queue(frontage: Frontage, door: float, spots: int) -> _Queue:
    """Line up waiting spots upstream of a door's middle."""
    line = frontage.spot_line
    downstream = [door - HEAD_SPOT - k * SPOT_STEP for k in range(spots)]
    return _Queue(
        front=frontage.point(door, line),
        spots=frozen_array(frontage.points([(at, line) for at in downstream])),
        tail=frontage.address(downstream[-1] if downstream else door),
    )


def room_stop(
    frontage: Frontage,
    *,
    name: str,
    length: float,
    depth: float,
    door_width: float,
    door_offset: float,
    spots: int,
    bathroom: float = 0.0,
) -> StreetStop:
    """Build a room behind a door.

    Args:
        frontage: where it begins.
        name: of the room.
        length: of the frontage [m], at least :func:`least_frontage`.
        depth: of the room, wall to wall [m], >= 2.
        door_width: [m].
        door_offset: 0: as far upstream as the queue allows, 1: as far downstream.
        spots: waiting spots.
        bathroom: size of a cubicle in the room's back corner, 0: none, 1: 2 m x 1.8 m.

    Returns:
        The place; its point lies straight behind the door, in the middle of the depth.
    """
    low, high = queue_length(spots), length - downstream_length(door_width)
    door = low + door_offset * (high - low)
    wall = frontage.wall
    inner, back = wall + WALL, wall + WALL + depth
    left, right = WALL / 2.0, length - WALL / 2.0
    cubicle_width = bathroom * min(2.0, door - POINT_TO_SIDE - left)
    cubicle_depth = bathroom * min(1.8, depth / 2.0 - 0.1)
    if min(cubicle_width, cubicle_depth) > 0.2:
        inside = [
            (left, right, inner, back - cubicle_depth),
            (left + cubicle_width, right, inner, back),
        ]
    else:
        inside = [(left, right, inner, back)]
    half = door_width / 2.0
    free = [*inside, (door - half, door + half, wall, inner), _bay(frontage, door, half, spots)]
    queue = _queue(frontage, door, spots)
    apron = min(half + 0.2, HEAD_SPOT - 0.35)
    outline = [
        (door - apron, wall - APRON),
        (door + apron, wall - APRON),
        (door + apron, inner),
        (right, inner),
        (right, back),
        (left, back),
        (left, inner),
        (door - apron, inner),
    ]
    return StreetStop(
        room=Room(
            name=name,
            point=frontage.point(door, inner + depth / 2.0),
            door=frozen_array(frontage.points([(door - half, wall), (door + half, wall)])),
            area=_counter_clockwise(frontage.points(_outline_of_room(inside))),
        ),
        kind="room",
        door=frontage.address(door),
        tail=queue.tail,
        front=queue.front,
        spots=queue.spots,
        release_area=_counter_clockwise(frontage.points(outline)),
        free=tuple(frontage.box(box) for box in free),
    )


def _bay(frontage: Frontage, door: float, half: float, spots: int) -> Box:
    """Box the floor along the street before the door and the waiting robots."""
    before = queue_length(spots) if spots else half + DOWNSTREAM
    edge = frontage.street.width / 2.0 - 0.01
    return (door - before, door + half + DOWNSTREAM, edge, frontage.wall)


def _outline_of_room(inside: list[Box]) -> list[tuple[float, float]]:
    left, right, inner, middle = inside[0]
    if len(inside) == 1:
        return [(left, inner), (right, inner), (right, middle), (left, middle)]
    step, _, _, back = inside[1]
    return [(left, inner), (right, inner), (right, back), (step, back), (step, middle),
            (left, middle)]  # fmt: skip


def _counter_clockwise(points: Array) -> Array:
    x, y = points[:, 0], points[:, 1]
    area = float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))
    return frozen_array(points if area > 0 else points[::-1])


def cabin_stop(
    frontage: Frontage, *, name: str, kind: Kind, size: float, service_time: float, spots: int
) -> StreetStop:
    """Build a lift car or charging bay: one robot stands in its middle for a time.

    Args:
        frontage: where it begins; it takes ``queue_length(spots) + size / 2 + 0.2`` m.
        name: of the place.
        kind: "elevator" or "charger".
        size: width and depth [m].
        service_time: [s].
        spots: waiting spots.
    """
    middle, half, wall = queue_length(spots), size / 2.0, frontage.wall
    cabin = (middle - half, middle + half, wall, wall + WALL + size)
    queue = _queue(frontage, middle, spots)
    opening = min(half, HEAD_SPOT - 0.35)
    point = wall + WALL + half - 0.1
    # Robots are served in the middle of the area: that is to be the room point.
    area = (middle - opening, middle + opening, wall - APRON, 2.0 * point - (wall - APRON))
    bay = _bay(frontage, middle, half - DOWNSTREAM + 0.1, spots)
    return StreetStop(
        room=Room(
            name=name,
            point=frontage.point(middle, point),
            door=frozen_array(frontage.points([(middle - half, wall), (middle + half, wall)])),
            area=corners(frontage.box((cabin[0], cabin[1], wall + WALL, cabin[3]))),
        ),
        kind=kind,
        door=frontage.address(middle),
        tail=queue.tail,
        front=queue.front,
        spots=queue.spots,
        release_area=corners(frontage.box(area)),
        free=(frontage.box(cabin), frontage.box(bay)),
        service_time=service_time,
    )


def cabin_frontage(size: float, spots: int) -> float:
    """Compute the frontage [m] of :func:`cabin_stop`."""
    return queue_length(spots) + size / 2.0 + 0.2


def face_stop(frontage: Frontage, *, name: str, spots: int) -> StreetStop:
    """Build a place at a shelf or counter: the robot stands at the wall, out of the lane.

    Args:
        frontage: where it begins; it takes :func:`face_frontage` m.
        name: of the place.
        spots: waiting spots.
    """
    middle, wall, line = queue_length(spots), frontage.wall, frontage.spot_line
    reach = HEAD_SPOT - 0.35
    queue = _queue(frontage, middle, spots)
    around = corners(frontage.box((middle - reach, middle + reach, wall - APRON, wall)))
    return StreetStop(
        room=Room(
            name=name,
            point=frontage.point(middle, line),
            area=corners(frontage.box((middle - FACE, middle + FACE, line - SPOT_TO_WALL, wall))),
        ),
        kind="room",
        door=frontage.address(middle),
        tail=queue.tail,
        front=queue.front,
        spots=queue.spots,
        release_area=around,
        free=(frontage.box(_bay(frontage, middle, FACE, spots)),),
    )


def face_frontage(spots: int) -> float:
    """Compute the frontage [m] of :func:`face_stop`."""
    return queue_length(spots) + FACE + DOWNSTREAM
