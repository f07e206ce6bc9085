"""How many stops each robot has done, as motion tells it."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from mrta_falsify.core.arrays import Array, BoolArray, IntArray
from mrta_falsify.core.compiled import njit
from mrta_falsify.core.fleet import Sensed, StackEvent
from mrta_falsify.core.world import World
from mrta_falsify.specs.books import ROOM_REACH
from mrta_falsify.specs.deadlock.standstill import GOAL_JITTER
from mrta_falsify.specs.halts import STOPPED


class StopsServed:
    """Counts stops; one object per episode, updated once a tick.

    A stop is done when the books confirm it. It also is when a robot came to rest at the room it
    was heading for and then was sent elsewhere: a stack need not tell its deliveries, and its
    claims may be refused. How many stops the stack has left does not count, since stops that are
    given to another robot have not been done.
    """

    def __init__(self, world: World) -> None:
        robots = len(world.robots)
        self._rooms: Array = np.array([room.point for room in world.rooms]).reshape(-1, 2)
        self._served: IntArray = np.zeros(robots, dtype=np.int64)
        self._stops = _Stops(
            goal=np.full((robots, 2), np.nan),
            is_room=np.zeros(robots, dtype=np.bool_),
            place=np.full((robots, 2), np.inf),
            has_come=np.zeros(robots, dtype=np.bool_),
        )

    def update(self, sensed: Sensed, goal: Array, confirmed: Iterable[StackEvent]) -> IntArray:
        """Take in one tick; gives the stops done to date ``(N,)``, never changed later.

        Args:
            sensed: ground truth.
            goal: ``(N, 2)`` where robots are heading for [m], nan: nowhere.
            confirmed: stops of this tick that the books hold.
        """
        done = np.zeros(len(goal), dtype=np.bool_)
        for event in confirmed:
            done[event.robot] = True
        if _note_stops(self._stops, sensed.pose, sensed.velocity, goal, self._rooms, done):
            self._served = self._served + done
        return self._served


class _Stops(NamedTuple):
    """What is remembered of each robot's stop."""

    goal: Array  #: (N, 2) that it heads for [m], nan: none
    is_room: BoolArray  #: (N,) the goal is a room
    place: Array  #: (N, 2) of its last stop [m], inf: left
    has_come: BoolArray  #: (N,) to rest at its goal


@njit(cache=True)
def _note_stops(
    stops: _Stops, pose: Array, velocity: Array, goal: Array, rooms: Array, done: BoolArray
) -> bool:
    """Note who comes to rest at its goal, and add to ``done`` who leaves for another one.

    Returns:
        Whether any robot has done a stop.
    """
    for i in range(len(goal)):
        known = stops.goal[i]
        moved = not np.hypot(goal[i, 0] - known[0], goal[i, 1] - known[1]) <= GOAL_JITTER
        moved = moved and (np.isfinite(goal[i, 0]) or np.isfinite(known[0]))
        if done[i] or (moved and stops.has_come[i]):
            done[i], stops.has_come[i] = True, False
            stops.place[i] = pose[i, :2]
        if moved:
            known[:] = goal[i]
            stops.has_come[i] = stops.is_room[i] = False
            for room in rooms:
                away = np.hypot(known[0] - room[0], known[1] - room[1])
                stops.is_room[i] = stops.is_room[i] or away <= GOAL_JITTER
        x, y = pose[i, 0], pose[i, 1]
        if np.hypot(x - stops.place[i, 0], y - stops.place[i, 1]) > ROOM_REACH:
            stops.place[i] = np.inf
        rests = np.hypot(velocity[i, 0], velocity[i, 1]) <= STOPPED
        if rests and stops.is_room[i] and np.isinf(stops.place[i, 0]):
            has_come = np.hypot(x - known[0], y - known[1]) <= ROOM_REACH
            stops.has_come[i] = stops.has_come[i] or has_come
    return bool(done.any())
