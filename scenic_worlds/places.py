"""Regions of a layout that a scenario author names: free floor, rooms, corridors."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
import shapely
from scenic.core.regions import PolygonalRegion
from shapely.geometry import MultiPolygon, Point, Polygon, box
from shapely.geometry.base import BaseGeometry

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.errors import UnknownNameError
from mrta_falsify.core.world import World
from scenic_worlds.layouts import load_layout

ROOM_REACH = 3.0  # m around the room point that counts as the room, where no outline is known


@dataclass(frozen=True, slots=True, eq=False)
class Places:
    """The named places of one layout, as Scenic regions."""

    layout: World
    free: BaseGeometry  #: floor without walls and furniture, connected to the rooms

    @property
    def free_floor(self) -> PolygonalRegion:
        """All floor that robots can be on."""
        return _region(self.free, "free_floor")

    @property
    def corridors(self) -> PolygonalRegion:
        """Free floor outside every room."""
        rooms = shapely.union_all([self._room_shape(i) for i in range(len(self.layout.rooms))])
        return _region(self.free.difference(rooms), "corridors")

    def room(self, place: int | str) -> PolygonalRegion:
        """Free floor of a room, by number or name."""
        shape = self._room_shape(self.room_number(place))
        return _region(self.free.intersection(shape), f"room({place!r})")

    def room_point(self, place: int | str) -> Array:
        """Location point ``(2,)`` [m] of a room, by number or name."""
        return self.layout.rooms[self.room_number(place)].point

    def room_number(self, place: int | str) -> int:
        """Number of a room given by number or name.

        Raises:
            UnknownNameError: no such room.
        """
        rooms = self.layout.rooms
        if isinstance(place, str):
            names = [room.name for room in rooms]
            if place not in names:
                raise UnknownNameError("room", place, names)
            return names.index(place)
        if not 0 <= place < len(rooms):
            known = [str(i) for i in range(len(rooms))]
            raise UnknownNameError("room", str(place), known)
        return int(place)

    def _room_shape(self, number: int) -> BaseGeometry:
        room = self.layout.rooms[number]
        if len(room.area) >= 3:
            return Polygon(room.area)
        x, y = room.point
        return box(x - ROOM_REACH, y - ROOM_REACH, x + ROOM_REACH, y + ROOM_REACH)


@functools.cache
def places_of(layout_name: str) -> Places:
    """Places of a layout by name.

    Raises:
        UnknownNameError: no such layout.
    """
    layout = load_layout(layout_name)
    solids = [Polygon(polygon) for polygon in layout.solid_polygons()]
    floor = box(*layout.bounds).difference(shapely.union_all(solids))
    parts = floor.geoms if isinstance(floor, MultiPolygon) else [floor]
    points = [Point(room.point) for room in layout.rooms]
    inside = [part for part in parts if any(part.contains(point) for point in points)]
    return Places(layout=layout, free=shapely.union_all(inside))


def _region(shape: BaseGeometry, name: str) -> PolygonalRegion:
    parts = getattr(shape, "geoms", [shape])
    polygons = [part for part in parts if isinstance(part, Polygon) and part.area > 1e-6]
    return PolygonalRegion(polygon=MultiPolygon(polygons), name=name)


def route_points(route: list[object], places: Places) -> Array:
    """Route ``(K, 2)`` [m] given as points, rooms by number or rooms by name."""
    points = [
        places.room_point(stop) if isinstance(stop, (int, str)) else np.asarray(stop)[:2]
        for stop in route
    ]
    return np.array(points, dtype=np.float64)
