"""A ward for tests: rooms along one straight corridor, generated from a few lengths.

The smallest floor that has everything: doors, right-hand lanes, queue spots, parking. The
corridor runs along x; rooms lie north of it, or on both sides.
"""

from __future__ import annotations

import itertools

import numpy as np
from shapely import unary_union
from shapely.geometry import Polygon, box
from shapely.geometry.polygon import orient

from mrta_falsify.core.arrays import Array, frozen_array
from mrta_falsify.core.errors import ConfigError
from mrta_falsify.core.world import Lane, Resource, Room, Wall, World

WALL = 0.15  # m, thickness
LANE_OFFSET = 0.5  # m, lane to the corridor's middle line
SPOT_INSET = 0.5  # m, waiting and parking spots to the corridor's wall
FIRST_SPOT, SPOT_STEP = 1.3, 1.0  # m, door centre to head spot, and between spots
PARKING_BESIDE = 1.6  # m, door centre to the parking place west of it
APPROACH_SPEED = 0.69  # m/s, mean of the loaded travel times of MRTA-Sim over its road lengths
TURN_ALLOWANCE = 5.0  # s, added to each travel time


def ward_layout(
    *,
    rooms: int = 3,
    two_sided: bool = False,
    room_width: float = 5.0,
    room_depth: float = 4.0,
    corridor_width: float = 4.0,
    door_width: float = 1.4,
    spots: int = 3,
) -> World:
    """Layout of a ward.

    Args:
        rooms: number of rooms, >= 1.
        two_sided: odd rooms lie south of the corridor.
        room_width: along the corridor [m]; must leave room for the waiting spots.
        room_depth: across [m].
        corridor_width: >= 2.6 m, so that two lanes and waiting spots fit.
        door_width: >= 0.9 m.
        spots: waiting spots per room.

    Returns:
        A world without robots, humans, tasks and events; map origin at the corridor's
        south-west corner.

    Raises:
        ConfigError: a length that leaves no room for robots.
    """
    if rooms < 1:
        raise ConfigError(f"ward: rooms is {rooms}; it must be >= 1")
    if corridor_width < 2.6:
        raise ConfigError(f"ward: corridor_width is {corridor_width} m; it must be >= 2.6 m")
    if not 0.9 <= door_width <= room_width - 0.4:
        raise ConfigError(
            f"ward: door_width is {door_width} m; it must be between 0.9 m and {room_width - 0.4} m"
        )
    columns = -(-rooms // 2) if two_sided else rooms
    reach = FIRST_SPOT + (spots - 1) * SPOT_STEP + SPOT_INSET
    length = columns * room_width + max(0.0, reach - room_width / 2.0)
    doors = [
        _Door(i, two_sided, room_width, corridor_width, room_depth, door_width)
        for i in range(rooms)
    ]
    south = -room_depth - WALL if two_sided else -WALL
    bounds = (-WALL, south - WALL, length + WALL, corridor_width + room_depth + 2 * WALL)
    free = unary_union([box(0.0, 0.0, length, corridor_width), *(door.free for door in doors)])
    return World(
        name="ward",
        bounds=frozen_array(bounds),
        walls=_walls(box(*bounds), free),
        rooms=tuple(door.room for door in doors),
        lanes=tuple(
            _lane(start, end, corridor_width, spots)
            for start in doors
            for end in doors
            if start is not end
        ),
        resources=tuple(door.resource(spots) for door in doors),
        parking=frozen_array(_parking(doors, corridor_width, spots)),
        travel_times=frozen_array(_travel_times(doors)),
    )


class _Door:
    """One room with its door, and the corners that follow from them."""

    def __init__(
        self,
        number: int,
        two_sided: bool,
        room_width: float,
        corridor_width: float,
        room_depth: float,
        door_width: float,
    ) -> None:
        self.number = number
        self.side = -1 if two_sided and number % 2 else 1
        column = number // 2 if two_sided else number
        self.x = (column + 0.5) * room_width
        self.edge = corridor_width if self.side > 0 else 0.0
        self.middle = corridor_width / 2.0
        half_room, half_door = room_width / 2.0 - WALL / 2.0, door_width / 2.0
        inner, outer = self.at(WALL), self.at(WALL + room_depth - WALL)
        self.room_box = _box(self.x - half_room, inner, self.x + half_room, outer)
        self.gap = _box(
            self.x - half_door, self.at(-0.01), self.x + half_door, self.at(WALL + 0.01)
        )
        self.free = unary_union([self.room_box, self.gap])
        self.point = np.array([self.x, self.at(WALL + (room_depth - WALL) / 2.0)])
        self.segment = np.array([[self.x - half_door, self.edge], [self.x + half_door, self.edge]])
        self.half_door = half_door

    def at(self, depth: float) -> float:
        """Y [m] of a line ``depth`` beyond the corridor's wall, towards the room."""
        return self.edge + self.side * depth

    @property
    def room(self) -> Room:
        return Room(
            name=f"ward_{self.number}",
            point=frozen_array(self.point),
            door=frozen_array(self.segment),
            area=_corners(self.room_box),
        )

    def spot(self, place: int) -> Array:
        """Waiting spot ``place`` (0 = head) along the wall east of the door."""
        x = self.x + (FIRST_SPOT + place * SPOT_STEP)
        return np.array([x, self.at(-SPOT_INSET)])

    def resource(self, spots: int) -> Resource:
        apron = _box(
            self.x - self.half_door - 0.2,
            self.at(-0.9),
            self.x + self.half_door + 0.2,
            self.at(WALL),
        )
        near = _box(self.x - 5.0, self.at(-5.0), self.x + 5.0, self.at(5.0))
        return Resource(
            name=f"ward_{self.number}",
            kind="room",
            room=self.number,
            spots=frozen_array([self.spot(k) for k in range(spots)]),
            entry=frozen_array(np.array([[self.x, self.at(-SPOT_INSET)], [*self.point]])),
            request_area=_corners(near),
            release_area=_corners(unary_union([self.room_box, apron])),
        )


def _box(x1: float, y1: float, x2: float, y2: float) -> Polygon:
    return box(min(x1, x2), min(y1, y2), max(x1, x2), max(y1, y2))


def _corners(shape: Polygon) -> Array:
    return frozen_array(np.array(orient(shape).exterior.coords)[:-1])


def _walls(outside: Polygon, free: Polygon) -> tuple[Wall, ...]:
    """Everything that is not free, cut into rectangles along the free area's edges."""
    x_min, y_min, x_max, y_max = outside.bounds
    edges = np.array(free.exterior.coords)
    xs = sorted({x_min, x_max, *(round(float(x), 6) for x in edges[:, 0])})
    walls: list[Wall] = []
    for left, right in itertools.pairwise(xs):
        # A hair narrower, so that rounded edges leave no slivers between pieces.
        column = box(left + 1e-5, y_min, right - 1e-5, y_max).difference(free)
        for part in getattr(column, "geoms", [column]):
            if part.area > 1e-4:
                piece = box(left, part.bounds[1], right, part.bounds[3])
                walls.append(Wall(name=f"wall_{len(walls)}", polygon=_corners(piece)))
    return tuple(walls)


def _lane(start: _Door, end: _Door, corridor_width: float, spots: int) -> Lane:
    heading = 1.0 if end.x >= start.x else -1.0
    y = corridor_width / 2.0 - heading * LANE_OFFSET  # keep right
    leave, arrive = [start.x, y], [end.x, y]
    way = [leave] if abs(end.x - start.x) < 0.5 else [leave, arrive]
    tail = end.spot(spots - 1)
    tail_y = corridor_width / 2.0 - np.sign(tail[0] - start.x) * LANE_OFFSET
    return Lane(
        start=start.number,
        end=end.number,
        to_queue=frozen_array(np.array([[start.x, tail_y], [tail[0], tail_y], [*tail]])),
        to_room=frozen_array(np.array([*way, [end.x, end.at(-SPOT_INSET)], [*end.point]])),
    )


def _parking(doors: list[_Door], corridor_width: float, spots: int) -> list[list[float]]:
    """A place west of each door, and one across the corridor where no room is opposite."""
    taken = [door.spot(place) for door in doors for place in range(spots)]
    places = [[door.x - PARKING_BESIDE, door.at(-SPOT_INSET)] for door in doors]
    if all(door.side > 0 for door in doors):
        places += [[door.x, SPOT_INSET] for door in doors]
    return [
        place
        for place in places
        if all(np.hypot(*(np.array(place) - spot)) >= SPOT_STEP - 0.1 for spot in taken)
        and 0.4 <= place[1] <= corridor_width - 0.4
    ]


def _travel_times(doors: list[_Door]) -> Array:
    points = np.array([door.point for door in doors])
    steps = np.abs(points[:, None, :] - points[None, :, :])
    depth = np.array([abs(door.point[1] - door.middle) for door in doors])
    lengths = steps[:, :, 0] + depth[:, None] + depth[None, :]
    times: Array = np.ceil(lengths / APPROACH_SPEED + TURN_ALLOWANCE)
    np.fill_diagonal(times, 0.0)
    return times
