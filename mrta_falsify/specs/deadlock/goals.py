"""What a goal means in a world: a room's point, a waiting spot, a parking spot."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from mrta_falsify.core.arrays import Array, BoolArray
from mrta_falsify.core.compiled import njit
from mrta_falsify.core.plane import inside
from mrta_falsify.core.world import Resource, World

#: m; goals may be jittered by 0.2 m per axis (MRTA-Sim), and spots are 1 m apart
GOAL_TOLERANCE = 0.35
ROOM_CORE = 1.0  # m around a room's point that count as standing in it


@dataclass(frozen=True, slots=True)
class Goal:
    """Meaning of a goal point."""

    kind: str  #: "room", "spot", "parking" or "elsewhere"
    room: int = -1  #: room number, for "room"
    resource: int = -1  #: index into ``World.resources`` of the resource asked for, -1: none
    spot: int = -1  #: place in the queue, 0 = head, for "spot"


ELSEWHERE = Goal("elsewhere")


@dataclass(slots=True)
class GoalMap:
    """Named points of one world, to look goals up in."""

    world: World
    _points: Array = field(init=False)
    _goals: tuple[Goal, ...] = field(init=False)

    def __post_init__(self) -> None:
        points: list[Array] = []
        goals: list[Goal] = []
        of_room = {
            r.room: i
            for i, r in reversed(list(enumerate(self.world.resources)))
            if r.kind == "room"
        }
        for number, room in enumerate(self.world.rooms):
            points.append(room.point)
            goals.append(Goal("room", room=number, resource=of_room.get(number, -1)))
        for number, resource in enumerate(self.world.resources):
            for k, spot in enumerate(resource.spots):
                points.append(spot)
                goals.append(Goal("spot", resource=number, spot=k))
        for spot in self.world.parking:
            points.append(spot)
            goals.append(Goal("parking"))
        self._points = np.array(points, dtype=np.float64).reshape(-1, 2)
        self._goals = tuple(goals)

    def of(self, goal: Array) -> Goal:
        """Look up the meaning of ``goal`` ``(2,)`` [m]: the nearest named point within 0.35 m."""
        if not len(self._goals):
            return ELSEWHERE
        distance = np.hypot(*(self._points - goal).T)
        nearest = int(np.argmin(distance))
        return self._goals[nearest] if distance[nearest] <= GOAL_TOLERANCE else ELSEWHERE

    def nearest_name(self, position: Array) -> tuple[str, float]:
        """Find the nearest room or resource of ``position`` ``(2,)``: its name and distance [m]."""
        named = [
            (float(np.hypot(*(room.point - position))), room.name) for room in self.world.rooms
        ]
        for resource in self.world.resources:
            if len(resource.spots):
                gap = float(np.hypot(*(resource.spots - position).T).min())
                named.append((gap, f"queue of {resource.name}"))
        if not named:
            return "", 0.0
        distance, name = min(named)
        return name, distance


def is_inside(world: World, resource: Resource, position: Array) -> bool:
    """Whether ``position`` ``(2,)`` [m] is in the very place that the resource guards."""
    return bool(are_inside(world, resource, np.reshape(position, (1, 2)))[0])


def are_inside(world: World, resource: Resource, positions: Array) -> BoolArray:
    """Say which ``positions`` ``(N, 2)`` [m] are in the very place that the resource guards."""
    if resource.room is None:
        return inside_each(np.asarray(resource.release_area), positions)
    room = world.rooms[resource.room]
    near = np.hypot(*(room.point - positions).T) <= ROOM_CORE
    return np.asarray(near | inside_each(np.asarray(room.area), positions))


@njit(cache=True)
def inside_each(polygon: Array, positions: Array) -> BoolArray:
    """Say which ``positions`` ``(N, 2)`` lie in a polygon ``(V, 2)``, as :func:`~.plane.inside`."""
    result = np.empty(len(positions), dtype=np.bool_)
    for i in range(len(positions)):
        result[i] = inside(polygon, positions[i])
    return result
