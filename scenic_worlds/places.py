"""The named places of a floor as Scenic regions: rooms, corridors, walls, doors, lanes, queues.

A scenario author calls these as the functions of ``model.scenic``. ``random_places`` lets them
take random layouts, rooms and objects as well as fixed ones.
"""

from __future__ import annotations

import functools
import hashlib
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from scenic.core.distributions import RejectionException
from scenic.core.object_types import OrientedPoint
from scenic.core.regions import PolylineRegion, Region, nowhere
from scenic.core.vectors import Vector, VectorField
from shapely.geometry import LineString, MultiPolygon, Point, Polygon, box
from shapely.geometry.base import BaseGeometry

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.errors import InputError, UnknownNameError, WorldError
from mrta_falsify.core.shapes import polygons
from mrta_falsify.core.world import World
from scenic_worlds.layouts import load_layout
from scenic_worlds.lifted import lifted
from scenic_worlds.shapes import (
    facing_away,
    heading_of,
    region_from,
    stretches_that_fit,
    touching,
    wall_segments,
    wall_strip,
)
from simulator_interface.formats.floor_resources import ROOM_REACH

TRAFFIC_REACH = 2.0  # m from a roadway that still counts as corridor
KEPT_CLEAR = 0.45  # m around room points, waiting spots and parking: a robot of 0.22 m turns there
CLEAR_OF_DOORS = 0.6  # m around doorways: a robot of 0.22 m passes there with its margins
BED = (1.0, 2.2)  # m, width and length
DOORWAY_DEPTH = 0.8  # m on either side of a door that counts as the doorway
SMALL_ITEM = (0.45, 0.3)  # m, width and length of the least that stands along a wall
SMALLEST_VISIT = 0.2  # m^2, of the floor that people go to
SMALLEST_STEP = 0.5  # m; people who come no farther than this may go anywhere
PARKED_OFF = 0.35  # m that a bed is left off the place that it is pushed to, at most
PUSHED_OFF = 0.15  # m from the sides of a bed to walls on its way
QUEUE_WIDTH = 0.8  # m, of the strip that holds the waiting spots


@dataclass(frozen=True, eq=False)
class Places:
    """The named places of one layout.

    Shapes are built when first asked for and kept; all regions lie at height 0.
    """

    layout: World
    varies: bool = False  #: the layout is another one in each scene; unknown rooms reject it
    _regions: dict[tuple[object, ...], Region] = field(default_factory=dict, repr=False)

    # --- whole floor ---------------------------------------------------------------------

    @functools.cached_property
    def free(self) -> BaseGeometry:
        """Floor without walls and furniture, as far as rooms are reached on it."""
        solid = shapely.union_all(polygons(self.layout.solid_polygons()))
        floor = box(*self.layout.bounds).difference(solid)
        parts = floor.geoms if isinstance(floor, MultiPolygon) else [floor]
        points = shapely.points([room.point for room in self.layout.rooms])
        inside = [part for part in parts if shapely.intersects(part, points).any()]
        return shapely.union_all(inside or parts)

    @functools.cached_property
    def _all_rooms(self) -> BaseGeometry:
        return shapely.union_all([self._room_shape(i) for i in range(len(self.layout.rooms))])

    @property
    def free_floor(self) -> Region:
        """All floor that robots can be on."""
        return self._kept(("free_floor",), lambda: region_from(self.free, "free_floor"))

    @property
    def corridors(self) -> Region:
        """Free floor outside every room and within 2 m of a roadway, not through walls."""

        def build() -> Region:
            floor = self.free.difference(self._all_rooms)
            legs = self._roadway_legs()
            if not len(legs):
                return region_from(floor, "corridors")
            # Behind the walls of a generated floor are only rooms, so one step will do.
            steps = 1 if self.varies else 4
            near = shapely.linestrings(legs)
            for _ in range(steps):
                # round ends of 8 corners: 0.04 m off the circle at most
                grown = shapely.union_all(shapely.buffer(near, TRAFFIC_REACH / steps, quad_segs=2))
                near = touching(floor.intersection(grown), near)
            return region_from(near, "corridors")

        return self._kept(("corridors",), build)

    @functools.cached_property
    def standing_shape(self) -> BaseGeometry:
        """Shape of :attr:`standing_room`."""
        return self.free.difference(self._kept_clear)

    @functools.cached_property
    def _kept_clear(self) -> BaseGeometry:
        """Doorways, and what is around room points, waiting spots and parking."""
        layout = self.layout
        points = [room.point for room in layout.rooms]
        points += [spot for resource in layout.resources for spot in resource.spots]
        points += list(layout.parking)
        clear = list(shapely.buffer(shapely.points(np.array(points)), KEPT_CLEAR, quad_segs=2))
        return shapely.union_all([*clear, self._doorways])

    @functools.cached_property
    def _doorways(self) -> BaseGeometry:
        rooms = self.layout.rooms
        return shapely.union_all(
            [self._doorway_shape(i) for i, room in enumerate(rooms) if len(room.door) > 1]
        )

    @property
    def standing_room(self) -> Region:
        """Free floor where furniture does not make the task hopeless.

        Doorways, room points, waiting spots and parking stay clear.
        """
        return self._kept(
            ("standing_room",), lambda: region_from(self.standing_shape, "standing_room")
        )

    @functools.cached_property
    def _inside_shape(self) -> BaseGeometry:
        return self.standing_shape.intersection(self._all_rooms)

    @property
    def clear_of_doors(self) -> Region:
        """The part of ``standing_room`` that is not within 0.6 m of a doorway."""

        def build() -> Region:
            around = shapely.buffer(self._doorways, CLEAR_OF_DOORS, quad_segs=2)
            return region_from(self.standing_shape.difference(around), "clear_of_doors")

        return self._kept(("clear_of_doors",), build)

    @property
    def bed_parking(self) -> Region:
        """Places for the centre of a bed that is left there, whichever way it points.

        It fits along some heading, and along none it reaches into a doorway or stands on a room
        point, a waiting spot or a parking place. A bed can be pushed from each to each.
        """

        def build() -> Region:
            width, length = BED
            reach = float(np.hypot(width, length)) / 2.0 + PARKED_OFF
            wide = self.free.buffer(-(width / 2.0 + PUSHED_OFF))
            fits = max(getattr(wide, "geoms", [wide]), key=lambda part: part.area)
            return region_from(fits.difference(self._kept_clear.buffer(reach)), "bed_parking")

        return self._kept(("bed_parking",), build)

    @property
    def inside_rooms(self) -> Region:
        """The part of ``standing_room`` inside rooms: where people go without being in the way."""
        return self._kept(
            ("inside_rooms",),
            lambda: region_from(self._inside_shape, "inside_rooms"),
        )

    def visits(self, least: float, before: Array) -> Region:
        """Where people go: inside rooms, else in ``standing_room``, away from where they come from.

        Args:
            least: distance [m] to each of ``before``; less where the floor has no such place.
            before: ``(K, 2)`` [m].
        """
        inside = self._inside_shape
        while True:
            near = shapely.union_all(shapely.buffer(shapely.points(before), least))
            for shape in (inside, self.standing_shape):
                far = shape.difference(near)
                if far.area > SMALLEST_VISIT:
                    return region_from(far, "visits")
            if least < SMALLEST_STEP:
                return region_from(self.standing_shape, "visits")
            least /= 2.0

    # --- one room ------------------------------------------------------------------------

    def room(self, place: int | str) -> Region:
        """Free floor of a room, by number or name."""
        number = self.room_number(place)
        return self._kept(
            ("room", number),
            lambda: region_from(
                self.free.intersection(self._room_shape(number)), f"room({place!r})"
            ),
        )

    def near(self, place: int | str, distance: float) -> Region:
        """Free floor within ``distance`` [m] of a room's point."""
        number = self.room_number(place)
        shape = Point(self.layout.rooms[number].point).buffer(distance)
        return region_from(self.free.intersection(shape), f"near({place!r})")

    def along_wall(
        self,
        place: int | str,
        gap: tuple[float, float] = (0.02, 0.12),
        fits: tuple[float, float] = SMALL_ITEM,
    ) -> Region:
        """Strip along the walls of a room, oriented from the wall into the room.

        Args:
            place: room number or name.
            gap: nearest and farthest distance from the wall [m].
            fits: width and length [m] of a thing; the strip has only places where its
                back edge finds standing room in front of the wall.
        """
        number = self.room_number(place)
        near, far, width, length = (float(value) for value in (*gap, *fits))
        if not 0.0 <= near < far:
            raise WorldError(
                f"along_wall({place!r}): gap is {gap}; it must be (nearest, farthest) in metres "
                "with 0 <= nearest < farthest"
            )

        def build() -> Region:
            standing = self.standing_shape
            shapely.prepare(standing)
            pieces = [
                piece
                for wall in self._walls_of(number)
                for piece in stretches_that_fit(wall, standing, near, (width, length))
            ]
            if not pieces:
                return nowhere
            shape = shapely.union_all([wall_strip(start, end, near, far) for start, end in pieces])
            return region_from(
                shape.intersection(self.free),
                f"along_wall({place!r})",
                orientation=facing_away(pieces),
            )

        return self._kept(("along_wall", number, near, far, width, length), build)

    def doorway(self, place: int | str) -> Region:
        """Free floor within 0.8 m of a room's door, oriented into the room."""
        number = self.room_number(place)

        def build() -> Region:
            heading = heading_of(self._door_direction(number))
            shape = self._doorway_shape(number).intersection(self.free)
            return region_from(
                shape, f"doorway({place!r})", VectorField(f"doorway_{number}", lambda _: heading)
            )

        return self._kept(("doorway", number), build)

    def queue_area(self, place: int | str) -> Region:
        """Free floor around the waiting spots of a room, head spot to tail.

        Raises:
            WorldError: the layout has no waiting spots for this room.
        """
        number = self.room_number(place)

        def build() -> Region:
            spots = [
                resource.spots
                for resource in self.layout.resources
                if resource.room == number and len(resource.spots)
            ]
            if not spots:
                raise WorldError(f"queue_area({place!r}): this room has no waiting spots")
            line = LineString(spots[0]) if len(spots[0]) > 1 else Point(spots[0][0])
            shape = line.buffer(QUEUE_WIDTH / 2.0).intersection(self.free)
            return region_from(shape, f"queue_area({place!r})")

        return self._kept(("queue_area", number), build)

    def route(self, start: int | str, end: int | str) -> Region:
        """The right-hand way from one room to another, oriented along it.

        Raises:
            WorldError: the layout has no such way.
        """
        first, last = self.room_number(start), self.room_number(end)

        def build() -> Region:
            for lane in self.layout.lanes:
                if (lane.start, lane.end) == (first, last):
                    points = np.vstack([self.layout.rooms[first].point, lane.to_room])
                    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
                    return PolylineRegion(
                        points=points[np.concatenate([[True], steps > 1e-6])],
                        name=f"route({start!r}, {end!r})",
                    )
            raise WorldError(f"route({start!r}, {end!r}): the layout has no roadway between them")

        return self._kept(("route", first, last), build)

    # --- rooms by number and name --------------------------------------------------------

    def room_point(self, place: int | str) -> Array:
        """Location point ``(2,)`` [m] of a room, by number or name."""
        return self.layout.rooms[self.room_number(place)].point

    def room_number(self, place: int | str) -> int:
        """Find the number of a room given by number or name.

        Raises:
            UnknownNameError: no such room.
            RejectionException: no such room, on a floor that varies.
        """
        names = [room.name for room in self.layout.rooms]
        if isinstance(place, str) and place in names:
            return names.index(place)
        if not isinstance(place, str) and 0 <= place < len(names) and place == int(place):
            return int(place)
        if self.varies:
            raise RejectionException(f"room {place!r} is not part of this floor")
        known = names if isinstance(place, str) else [str(i) for i in range(len(names))]
        raise UnknownNameError("room", str(place), known)

    def route_points(self, route: Any) -> Array:
        """List the points ``(K, 2)`` [m] of a route of points and rooms, or of a polyline region.

        Raises:
            InputError: an unknown room, or a stop of another kind.
        """
        if isinstance(route, PolylineRegion):
            return np.array(route.points, dtype=np.float64)[:, :2]
        if isinstance(route, (str, Vector)) or not hasattr(route, "__len__"):
            raise WorldError(f"is {route!r}; it must be a list of points and rooms")
        points = [_stop_point(stop, self) for stop in route]
        return np.array(points, dtype=np.float64).reshape(-1, 2)

    # --- shapes --------------------------------------------------------------------------

    def _kept(self, key: tuple[object, ...], build: Callable[[], Region]) -> Region:
        if key not in self._regions:
            self._regions[key] = build()
        return self._regions[key]

    def _roadway_legs(self) -> Array:
        """Collect the different straight legs ``(L, 2, 2)`` [m] of all lanes."""
        ways = [way for lane in self.layout.lanes for way in (lane.to_queue, lane.to_room)]
        legs = [np.stack([way[:-1], way[1:]], axis=1) for way in ways if len(way) > 1]
        if not legs:
            return np.zeros((0, 2, 2))
        rounded: Array = np.asarray(np.concatenate(legs).round(2), dtype=np.float64)
        swap = rounded[:, 0, 0] * 1e4 + rounded[:, 0, 1] > rounded[:, 1, 0] * 1e4 + rounded[:, 1, 1]
        rounded[swap] = rounded[swap][:, ::-1]
        different: Array = np.unique(rounded.reshape(-1, 4), axis=0).reshape(-1, 2, 2)
        return different

    def _room_shape(self, number: int) -> BaseGeometry:
        room = self.layout.rooms[number]
        if len(room.area) >= 3:
            return Polygon(room.area)
        x, y = room.point
        return box(x - ROOM_REACH, y - ROOM_REACH, x + ROOM_REACH, y + ROOM_REACH)

    def _door_direction(self, number: int) -> Array:
        """Point through a room's door, inward: a unit vector ``(2,)``.

        Raises:
            WorldError: the layout knows no door of this room.
        """
        room = self.layout.rooms[number]
        if len(room.door) < 2:
            with_door = [str(i) for i, r in enumerate(self.layout.rooms) if len(r.door) > 1]
            raise WorldError(
                f"doorway({number}): room {number} ({room.name}) has no door in layout "
                f"{self.layout.name}; rooms with a door: {', '.join(with_door) or 'none'}"
            )
        along = room.door[-1] - room.door[0]
        normal: Array = np.array([-along[1], along[0]]) / np.hypot(*along)
        inside = self._room_shape(number).representative_point()
        towards = np.array([inside.x, inside.y]) - room.door.mean(axis=0)
        return normal if normal @ towards > 0.0 else -normal

    def _doorway_shape(self, number: int) -> BaseGeometry:
        reach = DOORWAY_DEPTH * self._door_direction(number)
        start, end = self.layout.rooms[number].door[0], self.layout.rooms[number].door[-1]
        return Polygon([start - reach, end - reach, end + reach, start + reach]).buffer(0)

    def _walls_of(self, number: int) -> list[tuple[Array, Array]]:
        has_door = len(self.layout.rooms[number].door) > 1
        return wall_segments(
            self._room_shape(number),
            [wall.polygon for wall in self.layout.walls],
            self._doorway_shape(number) if has_door else None,
        )


@functools.cache
def _places_of_name(name_or_path: str, content: str) -> Places:
    return Places(load_layout(name_or_path))


def _content(name_or_path: str) -> str:
    """Digest a floor's file, so that a changed one is read again."""
    path = Path(name_or_path)
    return hashlib.sha256(path.read_bytes()).hexdigest() if path.is_file() else ""


@lifted
def places_of(layout: Any) -> Places:
    """Find the places of a layout: a shipped name, a floor file's path, or a layout itself.

    Raises:
        InputError: no such layout.
    """
    if isinstance(layout, World):
        return Places(layout, varies=True)
    if isinstance(layout, Path):  # what Scenic's localPath gives
        layout = str(layout)
    if not isinstance(layout, str):
        raise WorldError(
            f"param layout is {layout!r}; it must be the name of a layout, the path of a floor, "
            "or what a function such as hospital(...) returns"
        )
    return _places_of_name(layout, _content(layout))


def _stop_point(stop: Any, places: Places) -> Array:
    if isinstance(stop, (str, int, np.integer)) and not isinstance(stop, bool):
        return places.room_point(stop if isinstance(stop, str) else int(stop))
    if isinstance(stop, OrientedPoint) or hasattr(stop, "position"):
        stop = stop.position
    try:
        x, y = float(stop[0]), float(stop[1])
    except (TypeError, IndexError, ValueError, InputError):
        raise WorldError(
            f"has the stop {stop!r}; a stop is a point (x, y), a room number or a room name"
        ) from None
    return np.array([x, y])
