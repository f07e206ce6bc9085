"""Which kind of place a deadlock is at: a word for signatures that names no room or queue."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.plane import inside
from mrta_falsify.core.polyline import project_on_path
from mrta_falsify.core.world import World
from mrta_falsify.specs.deadlock.goals import ROOM_CORE, is_inside
from mrta_falsify.specs.deadlock.service_clock import AT_GOAL

DOOR_REACH = 1.0  # m from a door's line: a robot there closes a door of usual width for others
WAITING_SPOT, DOORWAY, ROOM, OPEN_FLOOR = "waiting spot", "doorway", "room", "open floor"
KIND_OF_RESOURCE = {"corridor": "corridor", "door": DOORWAY, "elevator": "lift"}
#: from narrow to wide: robots that stand at several kinds of place are at the narrowest
NARROWEST_FIRST = (DOORWAY, "lift", "charger", "crossing", "corridor", WAITING_SPOT, ROOM)
OF_QUEUE = "queue of "  #: how names of places begin that are the waiting spots of a resource


def kind_of_place(world: World, points: Array) -> str:
    """Say at which kind of place robots stand that hold each other up.

    Args:
        world: its rooms, doors and resources.
        points: ``(K, 2)`` where the robots stand [m].
    """
    found = {_kind_at(world, point) for point in points}
    return next((kind for kind in NARROWEST_FIRST if kind in found), OPEN_FLOOR)


def place_kind(place: Mapping[str, Any]) -> str:
    """Read the kind of place from the evidence of a deadlock; empty if it does not tell.

    Args:
        place: ``kind`` if the version that judged knew it, else ``near`` and ``distance`` [m].
    """
    if place.get("kind"):
        return str(place["kind"])
    near, distance = str(place.get("near", "")), float(place.get("distance", np.inf))
    if near.startswith(OF_QUEUE):
        return WAITING_SPOT if distance <= AT_GOAL else ""
    return ROOM if near and distance <= ROOM_CORE else ""


def _kind_at(world: World, point: Array) -> str:
    return next(_kinds_at(world, point), OPEN_FLOOR)


def _kinds_at(world: World, point: Array) -> Iterator[str]:
    """Yield the kinds of place that hold ``point`` ``(2,)`` [m], the most telling one first."""
    resources = world.resources
    if any(np.hypot(*(spot - point)) <= AT_GOAL for r in resources for spot in r.spots):
        yield WAITING_SPOT
    if any(_reaches(room.door, point) for room in world.rooms):
        yield DOORWAY
    if any(r.room is not None and is_inside(world, r, point) for r in resources):
        yield ROOM
    if any(np.hypot(*(room.point - point)) <= ROOM_CORE for room in world.rooms):
        yield ROOM
    shared = [r.kind for r in resources if r.room is None and inside(r.release_area, point)]
    if shared.count("corridor") > 1:
        yield "crossing"
    yield from (KIND_OF_RESOURCE.get(kind, kind) for kind in shared)
    if any(r.room is not None and inside(r.release_area, point) for r in resources):
        yield DOORWAY


def _reaches(door: Array, point: Array) -> bool:
    """Whether ``point`` ``(2,)`` is within reach of the line ``(D, 2)`` of a door [m]."""
    if len(door) < 2:
        return False
    leg, share = project_on_path(door, point[0], point[1], 0)
    nearest = door[leg] + share * (door[leg + 1] - door[leg])
    return bool(np.hypot(*(nearest - point)) <= DOOR_REACH)
