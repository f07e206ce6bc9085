"""The functions that a scenario author calls to name places, bound to the program's floor.

A *place* is a room, by number or by name. Places, distances and objects may be random; the
region is then another one in each scene.
"""

from __future__ import annotations

from typing import Any

from scenic.core.distributions import needsSampling
from scenic.core.regions import Region
from scenic.core.vectors import Vector

from scenic_worlds import random_places as regions
from scenic_worlds.places import SMALL_ITEM, places_of

Place = int | str
Pair = tuple[float, float]


class PlaceFunctions:
    """Places of the floor that ``param layout`` names.

    Args:
        layout: a shipped name, the path of a floor, or a layout, fixed or random.
    """

    def __init__(self, layout: Any) -> None:
        self.places = places_of(layout)
        self.varies = bool(needsSampling(self.places))  #: another floor in each scene
        self.free_floor = regions.region_named(self.places, "free_floor")
        self.corridors = regions.region_named(self.places, "corridors")
        self.standing_room = regions.region_named(self.places, "standing_room")
        self.inside_rooms = regions.region_named(self.places, "inside_rooms")
        self.bed_parking = regions.region_named(self.places, "bed_parking")

    def room(self, place: Place) -> Region:
        """Free floor of a room."""
        return regions.region_of_room(self.places, "room", place)

    def near(self, place: Place, distance: float = 0.5) -> Region:
        """Free floor within ``distance`` metres of a room's point."""
        return regions.region_of_room(self.places, "near", place, distance)

    def along_wall(self, place: Place, gap: Pair = (0.02, 0.12), fits: Pair = SMALL_ITEM) -> Region:
        """Strip along the walls of a room, facing into the room.

        ``on along_wall(2)`` puts the middle of an object's back edge there, so that it
        stands with its back to the wall; ``gap`` is the nearest and farthest distance from
        the wall. Where walls are crowded, ``fits=(width, length)`` keeps the places where
        such an object can stand: ``new Bed on along_wall(2, fits=(1.0, 2.2))``.
        """
        return regions.region_of_room(self.places, "along_wall", place, gap, fits)

    def doorway(self, place: Place) -> Region:
        """Free floor within 0.8 m of a room's door, facing into the room."""
        return regions.region_of_room(self.places, "doorway", place)

    def queue_area(self, place: Place) -> Region:
        """Free floor around the waiting spots of a room."""
        return regions.region_of_room(self.places, "queue_area", place)

    def route(self, start: Place, end: Place) -> Region:
        """The right-hand way of robots from one room to another, facing along it."""
        return regions.region_of_route(self.places, start, end)

    def beside(self, thing: Any, distance: Pair = (0.3, 0.9)) -> Region:
        """Free floor around an object, facing it; ``distance`` is from its outline."""
        return regions.region_beside(self.places, thing, distance)

    def room_point(self, place: Place, height: float = 0.0) -> Vector:
        """The point of a room where robots pick up and drop off."""
        return regions.point_of_room(self.places, place, height)
