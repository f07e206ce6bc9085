"""Where robots want to go whose stack does not say: each is seen to drive without the others.

A robot that stands is asked about in a copy of the run from which all other robots are taken away.
Where it stops there, or claims to have picked up or delivered, is its goal. One that stays where it
is wants nothing. An allocator that deals anew when robots vanish gives a false wish, so what rests
on these goals is a suspicion and no more.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.fleet import Frame, Tells
from mrta_falsify.core.protocols import Forecast
from mrta_falsify.core.world import World
from mrta_falsify.specs.books import STOP_KINDS
from mrta_falsify.specs.deadlock.blocked_by import BlockedByTracker
from mrta_falsify.specs.deadlock.standstill import Standstill

ASKED_AFTER = 10.0  # s at rest until a robot is asked about: longer than most services
BEGINS_WITHIN = 15.0  # s; one that has not begun to drive by then wants nothing
MOVED = 0.5  # m; farther than robots shuffle on their spot
STOPS_FOR = 2.0  # s at rest on its way: it has arrived
LOOKED_FOR = 120.0  # s at most


class AloneWatch:
    """Watches where a robot goes that is alone in the building.

    Args:
        robot: its number.
    """

    def __init__(self, robot: int) -> None:
        self._robot = robot
        self._spot = Standstill(1)
        self._began: tuple[float, Array] | None = None  # when and where
        self._goal: tuple[float, float] | None = None

    def update(self, frame: Frame) -> bool:
        """See :class:`mrta_falsify.core.protocols.Watch`."""
        time, pose = frame.sensed.time, frame.sensed.pose[self._robot]
        if self._began is None:
            self._began = time, pose[:2].copy()
        rest = time - float(self._spot.update(pose[None, :], time)[0])
        began, place = self._began
        if np.hypot(*(pose[:2] - place)) < MOVED and self._goal is None:
            return time - began >= BEGINS_WITHIN
        x, y = pose[:2].tolist()
        self._goal = x, y
        has_claimed = any(
            event.robot == self._robot and event.kind in STOP_KINDS for event in frame.events
        )
        return has_claimed or rest >= STOPS_FOR or time - began >= LOOKED_FOR

    def answer(self) -> dict[str, Any]:
        """Give the place ``goal`` [m] that it went to, None: it stayed."""
        return {"goal": None if self._goal is None else list(self._goal)}


class UnknownGoals:
    """Finds the goals of robots that stand, one copy of the run for each; one object per episode.

    Args:
        world: of the episode.
        dt: control period [s].
    """

    def __init__(self, world: World, dt: float) -> None:
        robots = len(world.robots)
        self._joins = np.array([robot.joins_at for robot in world.robots])
        self._spot = Standstill(robots)
        self._known_for = np.full(robots, np.nan)  # (N,) standstill that was asked about [s]
        self._goal = np.full((robots, 2), np.nan)
        self._tracker = BlockedByTracker(world, dt)

    def with_goals(self, frame: Frame, forecast: Forecast) -> Frame:
        """Give the frame as if the stack told the goals of the robots that stand."""
        sensed = frame.sensed
        since = self._spot.update(sensed.pose, sensed.time).copy()
        self._goal[since != self._known_for] = np.nan
        stands = (sensed.time - np.maximum(since, self._joins)) >= ASKED_AFTER
        for robot in np.flatnonzero(stands & (since != self._known_for)).tolist():
            self._known_for[robot] = since[robot]
            others = tuple(other for other in range(len(since)) if other != robot)
            answer = forecast(AloneWatch(robot), without=others)
            if answer is not None and answer["goal"] is not None:
                self._goal[robot] = answer["goal"]
        goal = self._goal.copy()
        has_goal = np.isfinite(goal[:, 0]).astype(np.int64)
        intent = dataclasses.replace(frame.intent, goal=goal, tasks_left=has_goal)
        tells = Tells(deliveries=frame.tells.deliveries, goals=True, paths=False)
        edges = self._tracker.update(sensed, intent, frame.served, tells, frame.events)
        return dataclasses.replace(frame, intent=intent, tells=tells, blocked_by=edges)
