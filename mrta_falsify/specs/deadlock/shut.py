"""Rooms shut during the run: no robot gets there any more, whatever the stack does."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import shapely
from shapely.geometry import Point, Polygon

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

    A way is shut by the world only where something that came or moved during the run shuts it, or
    where none of the robots that may serve the place gets there. Else the stack has sent the wrong
    robot, or to the wrong place.
    """

    world: World
    pose: Array  #: (N, 3) of the robots [m, m, rad]
    discs: Sequence[Disc]  #: N, inside their bodies
    bystanders: Bystanders  #: furniture and people at the end
    stands_since: float  #: people who have stood since then at the latest are in the way [s]
    ended: float  #: when the continuation ended [s]

    def shut_way(self, i: int, goal: Array) -> Shut | None:
        """Say what shuts the way of robot ``i`` for good; None: the world does not.

        Args:
            i: number of the robot.
            goal: where it is to go ``(2,)`` [m]; of a waiting spot, the room that it waits for.
        """
        target, room, name = _target(self.world, goal)
        if not np.isfinite(target).all():
            return None
        walls = [Polygon(wall.polygon) for wall in self.world.walls]
        stop = around(target, ROOM_REACH) if room < 0 else stop_area(target, walls)
        by = self._shut_by(i, stop)
        if not by:
            return None
        closing = [thing for thing in self._things() if thing.name in by]
        since, place = max(thing.since for thing in closing), self.pose[i, :2]
        if since <= 0.0 and (room < 0 or self._is_open_to_others(room, stop)):
            return None
        inside = _room_of(self.world, place)
        centres = [thing.outline.mean(axis=0) for thing in closing]
        is_shut_in = bool(inside) and (
            not name or _distance(centres, place) < _distance(centres, target)
        )
        return Shut(room=inside if is_shut_in else name, by=by, since=since)

    def shut_in(self, i: int) -> tuple[str, ...]:
        """Name what keeps robot ``i`` from every parking spot and other room; empty: nothing."""
        place = self.pose[i, :2]
        places = [*self.world.parking, *(room.point for room in self.world.rooms)]
        areas = [
            around(other, REACH_OF_SPOT)
            for other in places
            if np.hypot(*(other - place)) > ELSEWHERE_BEYOND
        ]
        return self._shut_by(i, shapely.union_all(areas)) or () if areas else ()

    def _is_open_to_others(self, room: int, stop: Any) -> bool:
        """Whether a robot that may serve a task of a room gets to where it stops there."""
        tasks = [task for task in self.world.tasks if room in (task.start, task.end)]
        names = {task.robot for task in tasks}
        return any(
            self._shut_by(j, stop) is None
            for j, robot in enumerate(self.world.robots)
            if "" in names or robot.name in names
        )

    def _shut_by(self, i: int, area: Any) -> tuple[str, ...] | None:
        """Name what keeps robot ``i`` out of an area; empty: walls alone, None: nothing."""
        disc = self.discs[i]
        start = disc.at(self.pose[i])
        return self._space(disc).shut_by(start, shapely.buffer(area, disc.away))

    def _space(self, disc: Disc) -> FreeSpace:
        walls = [wall.polygon for wall in self.world.walls]
        outlines = [(thing.name, thing.outline) for thing in self._things()]
        return free_space(self.world.bounds, walls, outlines, disc.half_width)

    def _things(self) -> list[_Thing]:
        """List what stands in everybody's way at the end.

        A blockage is put down once nobody is there: not where the body of a robot is.
        """
        world, bystanders = self.world, self.bystanders
        bodies = [
            Point(disc.at(pose)).buffer(disc.half_width)
            for disc, pose in zip(self.discs, self.pose, strict=True)
        ]
        found = [
            _Thing(item.name, item.polygon, 0.0) for item in world.furniture if not item.movable
        ]
        pieces = world.movable_furniture()
        if len(pieces) == len(bystanders.furniture):
            for item, (x, y, turn, since) in zip(pieces, bystanders.furniture, strict=True):
                found.append(_Thing(item.name, item.outline_at(np.array([x, y, turn])), since))
        for event in world.events:
            if (
                not isinstance(event, Blockage)
                or event.start > self.stands_since
                or event.end <= self.ended
            ):
                continue
            outline = Polygon(event.polygon)
            if not any(outline.intersects(body) for body in bodies):
                found.append(_Thing(event.name, event.polygon, event.start))
        corners = 2.0 * np.pi * np.arange(CORNERS) / CORNERS
        for human, (x, y, since) in zip(world.humans, bystanders.people, strict=False):
            is_here = human.appears_at <= self.stands_since and human.leaves_at > self.ended
            if is_here and max(abs(x), abs(y)) < AWAY and since <= self.stands_since:
                ring = human.radius * np.stack([np.cos(corners), np.sin(corners)], axis=1)
                found.append(_Thing(human.name, ring + np.array([x, y]), since))
        return found


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


def _room_of(world: World, place: Array) -> str:
    """Name the room that a place ``(2,)`` [m] is in; empty: none."""
    for resource in world.resources:
        if resource.room is not None and is_inside(world, resource, place):
            return world.rooms[resource.room].name
    return ""


def _distance(places: Sequence[Array], place: Array) -> float:
    return min((float(np.hypot(*(one - place))) for one in places), default=np.inf)
