"""Places whose arguments may be random: the functions behind the model's names.

With a random argument they return a random value that Scenic computes for each scene.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scenic.core.distributions import RejectionException
from scenic.core.regions import Region
from scenic.core.vectors import Vector, VectorField
from shapely.geometry import Polygon

from scenic_worlds.lifted import lifted
from scenic_worlds.places import Places
from scenic_worlds.shapes import heading_of, region_from


@lifted
def region_named(places: Places, name: str) -> Region:
    """A region of the whole floor, such as ``free_floor`` or ``standing_room``."""
    region: Region = getattr(places, name)
    return region


@lifted
def region_to_stand_in(places: Places, clear_of_doors: bool) -> Region:
    """``clear_of_doors`` of a floor, or ``standing_room``."""
    return places.clear_of_doors if clear_of_doors else places.standing_room


@lifted
def region_of_room(places: Places, kind: str, place: Any, *options: Any) -> Region:
    """``room``, ``near``, ``along_wall``, ``doorway`` or ``queue_area`` of one room."""
    region: Region = getattr(places, kind)(place, *options)
    return region


@lifted
def region_of_route(places: Places, start: Any, end: Any) -> Region:
    """The way between two rooms; a sampled pair without a way rejects the scene."""
    if places.room_number(start) == places.room_number(end):
        raise RejectionException(f"route({start!r}, {end!r}): the rooms are the same")
    return places.route(start, end)


@lifted
def region_of_visits(places: Places, least: float, *before: Any) -> Region:
    """Where a person may go who comes from places ``before``, ``least`` [m] from each of them."""
    return places.visits(float(least), np.array([[p[0], p[1]] for p in before]).reshape(-1, 2))


@lifted
def region_beside(places: Places, thing: Any, distance: Any) -> Region:
    """Free floor around an object, oriented towards it.

    Args:
        places: of the floor.
        thing: a Scenic object.
        distance: least and largest distance [m] from its footprint.
    """
    outline = Polygon([(corner.x, corner.y) for corner in thing._corners2D])
    near, far = distance
    ring = outline.buffer(far, quad_segs=4).difference(outline.buffer(near, quad_segs=4))
    center = np.array([thing.position.x, thing.position.y])

    def heading(position: Any) -> float:
        return heading_of(center - np.array([position[0], position[1]]))

    return region_from(
        places.standing_shape.intersection(ring),
        "beside",
        orientation=VectorField("beside", heading),
    )


@lifted
def point_of_room(places: Places, place: Any, height: float) -> Vector:
    """Location point of a room, ``height`` [m] above the floor."""
    x, y = places.room_point(place)
    return Vector(float(x), float(y), height)


@lifted
def first_stop(places: Places, route: Any, height: float) -> Vector:
    """First point of a person's route, ``height`` [m] above the floor."""
    x, y = places.route_points(route)[0]
    return Vector(float(x), float(y), height)


@lifted
def pick_room(places: Places, share: float) -> int:
    """Pick the room number at ``share`` in [0, 1) of the list of rooms."""
    rooms = len(places.layout.rooms)
    return min(int(share * rooms), rooms - 1)


@lifted
def pick_other_room(places: Places, room: Any, share: float) -> int:
    """Pick a room other than ``room``, at ``share`` in [0, 1) of the list of others.

    A share means nearly the same room whatever ``room`` is, so that a search can send several
    robots to one.
    """
    rooms = len(places.layout.rooms)
    first = places.room_number(room)
    if rooms < 2:
        return first
    among_others = min(int(share * (rooms - 1)), rooms - 2)
    return among_others + (among_others >= first)


@lifted
def travel_time(places: Places, start: Any, end: Any) -> float:
    """Look up the expected time [s] from one room to another."""
    times = places.layout.travel_times
    return float(times[places.room_number(start), places.room_number(end)])


@lifted
def longest_approach(places: Places, room: Any) -> float:
    """Look up the expected time [s] to a room from the room farthest from it."""
    return float(places.layout.travel_times[:, places.room_number(room)].max())
