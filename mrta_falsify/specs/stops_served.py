"""How many stops each robot has done, as motion tells it."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from mrta_falsify.core.arrays import Array, BoolArray, IntArray
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
        self._rooms = np.array([room.point for room in world.rooms]).reshape(-1, 2)
        self._served: IntArray = np.zeros(robots, dtype=np.int64)
        self._goal: Array = np.full((robots, 2), np.nan)  # m
        self._is_room: BoolArray = np.zeros(robots, dtype=np.bool_)  # the goal
        self._place: Array = np.full((robots, 2), np.inf)  # of its last stop [m]
        self._has_come: BoolArray = np.zeros(robots, dtype=np.bool_)  # to rest at its goal

    def update(self, sensed: Sensed, goal: Array, confirmed: Iterable[StackEvent]) -> IntArray:
        """Take in one tick; gives the stops done to date ``(N,)``, never changed later.

        Args:
            sensed: ground truth.
            goal: ``(N, 2)`` where robots are heading for [m], nan: nowhere.
            confirmed: stops of this tick that the books hold.
        """
        moved = ~(np.hypot(*(goal - self._goal).T) <= GOAL_JITTER)
        moved &= np.isfinite(goal[:, 0]) | np.isfinite(self._goal[:, 0])
        done = moved & self._has_come
        for event in confirmed:
            done[event.robot] = True
        if done.any():
            self._served = self._served + done
            self._place[done], self._has_come[done] = sensed.pose[done, :2], False
        if moved.any():
            self._take_goals(goal, moved)
        position = sensed.pose[:, :2]
        self._place[np.hypot(*(position - self._place).T) > ROOM_REACH] = np.inf
        rests = np.hypot(*sensed.velocity[:, :2].T) <= STOPPED
        rests &= self._is_room & np.isinf(self._place[:, 0])
        self._has_come |= rests & (np.hypot(*(position - self._goal).T) <= ROOM_REACH)
        return self._served

    def _take_goals(self, goal: Array, moved: BoolArray) -> None:
        self._goal = np.where(moved[:, None], goal, self._goal)
        away = np.hypot(*(self._goal[:, None] - self._rooms).transpose(2, 0, 1))
        self._is_room = (away <= GOAL_JITTER).any(axis=1)
        self._has_come &= ~moved
