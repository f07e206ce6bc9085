"""Rooms shut during the run: no robot gets there any more, whatever the stack does."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import shapely
from shapely.geometry import Polygon

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.free_space import Disc, FreeSpace, around, free_space
from mrta_falsify.core.world import Blockage, World
from mrta_falsify.specs.books import ROOM_REACH, stop_area
from mrta_falsify.specs.deadlock.bystanders import AWAY, Bystanders
from mrta_falsify.specs.deadlock.goals import GoalMap, is_inside

CORNERS = 16  # of the outline of a person
ELSEWHERE_BEYOND = 1.0  # m from a robot, a place is somewhere else
REACH_OF_SPOT = 0.3  # m from a parking spot, a robot stands there


@dataclass(frozen=True, slots=True, kw_only=True)
class Shut:
    """A place to which a robot cannot get any more, or out of which it cannot get."""

    room: str
    by: tuple[str, ...]  #: furniture, blockages and people; empty: walls alone
    since: float  #: when the last of them came to stand there [s]


class _Thing(NamedTuple):
    name: str
    outline: Array  #: (V, 2) [m]
    since: float  #: [s]


@dataclass(frozen=True, slots=True, kw_only=True)
class Ground:
    """What stands in everybody's way at the end of a continuation.

    Robots are in no way: they could be elsewhere. In the way are walls, furniture as it stands,
    blockages that last to the end, and people who stand all the time.
    """

    world: World
    bystanders: Bystanders  #: furniture and people at the end
    stands_since: float  #: people who have stood since then at the latest are in the way [s]
    ended: float  #: when the continuation ended [s]

    def shut_way(self, pose: Array, goal: Array, disc: Disc) -> Shut | None:
        """Say what shuts a robot's way for good; None: its body would get there.

        Args:
            pose: of the robot ``(3,)`` [m, m, rad].
            goal: where it is to go ``(2,)`` [m]; of a waiting spot, the room that it waits for.
            disc: inside the robot's body.
        """
        target, room, name = _target(self.world, goal)
        if not np.isfinite(target).all():
            return None
        walls = [Polygon(wall.polygon) for wall in self.world.walls]
        stop = around(target, ROOM_REACH) if room < 0 else stop_area(target, walls)
        by = self._space(disc).shut_by(disc.at(pose), shapely.buffer(stop, disc.away))
        if by is None:
            return None
        closing = [thing for thing in self._things() if thing.name in by]
        inside = _room_of(self.world, pose[:2])
        centres = [thing.outline.mean(axis=0) for thing in closing]
        is_shut_in = bool(inside) and (
            not name or _distance(centres, pose[:2]) < _distance(centres, target)
        )
        since = max((thing.since for thing in closing), default=0.0)
        return Shut(room=inside if is_shut_in else name, by=by, since=since)

    def shut_in(self, pose: Array, disc: Disc) -> tuple[str, ...]:
        """Name what keeps a robot from every parking spot and every other room; empty: nothing.

        Args:
            pose: of the robot ``(3,)`` [m, m, rad].
            disc: inside the robot's body.
        """
        places = [*self.world.parking, *(room.point for room in self.world.rooms)]
        areas = [
            around(place, disc.away + REACH_OF_SPOT)
            for place in places
            if np.hypot(*(place - pose[:2])) > ELSEWHERE_BEYOND
        ]
        if not areas:
            return ()
        return self._space(disc).shut_by(disc.at(pose), shapely.union_all(areas)) or ()

    def _space(self, disc: Disc) -> FreeSpace:
        walls = [wall.polygon for wall in self.world.walls]
        outlines = [(thing.name, thing.outline) for thing in self._things()]
        return free_space(self.world.bounds, walls, outlines, disc.half_width)

    def _things(self) -> list[_Thing]:
        return _things(self.world, self.bystanders, self.stands_since, self.ended)


def _target(world: World, goal: Array) -> tuple[Array, int, str]:
    """Find where a robot is to go in the end ``(2,)`` [m], the room (-1: none) and its name."""
    goals = GoalMap(world)
    meaning = goals.of(goal)
    room = meaning.room
    if meaning.kind == "spot":
        resource = world.resources[meaning.resource]
        room = -1 if resource.room is None else resource.room
    if room >= 0:
        return world.rooms[room].point, room, world.rooms[room].name
    return goal, -1, goals.nearest_name(goal)[0]


def _things(
    world: World, bystanders: Bystanders, stands_since: float, ended: float
) -> list[_Thing]:
    """List what stands in everybody's way at the end."""
    found = [_Thing(item.name, item.polygon, 0.0) for item in world.furniture if not item.movable]
    pieces = world.movable_furniture()
    if len(pieces) == len(bystanders.furniture):
        for item, (x, y, turn, since) in zip(pieces, bystanders.furniture, strict=True):
            found.append(_Thing(item.name, item.outline_at(np.array([x, y, turn])), since))
    for event in world.events:
        if isinstance(event, Blockage) and event.start <= stands_since and event.end > ended:
            found.append(_Thing(event.name, event.polygon, event.start))
    corners = 2.0 * np.pi * np.arange(CORNERS) / CORNERS
    for human, (x, y, since) in zip(world.humans, bystanders.people, strict=False):
        if max(abs(x), abs(y)) < AWAY and since <= stands_since:
            ring = human.radius * np.stack([np.cos(corners), np.sin(corners)], axis=1)
            found.append(_Thing(human.name, ring + np.array([x, y]), since))
    return found


def _room_of(world: World, place: Array) -> str:
    """Name the room that a place ``(2,)`` [m] is in; empty: none."""
    for resource in world.resources:
        if resource.room is not None and is_inside(world, resource, place):
            return world.rooms[resource.room].name
    return ""


def _distance(places: Sequence[Array], place: Array) -> float:
    return min((float(np.hypot(*(one - place))) for one in places), default=np.inf)
