"""Who reached which stop, from motion and confirmed events alone."""

from __future__ import annotations

import numpy as np

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.fleet import Frame, Phase, StackEvent
from mrta_falsify.core.world import World

REACH = 0.5  # m from a room's point at which a stop can be served
#: m from its goal within which a robot of a foreign stack is being served, whatever it says
AT_GOAL = 0.2
SERVED = ("picked-up", "dropped-off")


class StopCount:
    """Counts the stops that each robot has reached; one object per run.

    A stop is reached once its service begins within 0.5 m of the room's point, however long it
    takes. What the stack says of it counts only where the motion agrees. A foreign stack need not
    say when a service begins: it does within 0.2 m of the goal.
    """

    def __init__(self, world: World, *, is_outside: bool = False) -> None:
        self._is_outside = is_outside
        robots = len(world.robots)
        self._tasks, self._rooms = world.tasks, world.rooms
        self._points = {room.name: room.point for room in world.rooms}
        self._served = np.zeros(robots, dtype=np.int64)
        self.reached = np.zeros(robots, dtype=np.int64)  #: stops, so far
        self.wants = np.zeros(robots, dtype=np.bool_)  #: is on its way to a stop or parking spot
        self.is_served = np.zeros(robots, dtype=np.bool_)
        self.waiting_since = np.zeros(robots)  #: begin of the way to its next stop [s]
        #: of each robot, the ways to stops that have ended: from, until [s]
        self.ways: list[list[tuple[float, float]]] = [[] for _ in range(robots)]

    def _place(self, event: StackEvent) -> Array:
        """Where a robot is served; a foreign stack names the task only."""
        if event.resource:
            return self._points[event.resource]
        task = self._tasks[event.task]
        room = task.start if event.kind == SERVED[0] else task.end
        return self._rooms[room].point

    def update(self, frame: Frame) -> None:
        """Take in one tick."""
        position, goal = frame.sensed.pose[:, :2], frame.intent.goal
        for event in frame.events:
            if event.kind in SERVED:
                away = np.hypot(*(position[event.robot] - self._place(event)))
                self._served[event.robot] += bool(away <= REACH)
        with_goal = np.isfinite(goal[:, 0])
        near = np.zeros(len(position), dtype=np.bool_)
        within = AT_GOAL if self._is_outside else REACH
        near[with_goal] = np.hypot(*(goal - position)[with_goal].T) <= within
        serving = near if self._is_outside else (frame.intent.phase == int(Phase.SERVING)) & near
        self.is_served = serving
        reached = self._served + serving
        wants, now = with_goal & ~serving, frame.sensed.time
        ended = self.wants & (~wants | (reached > self.reached))
        for i in np.flatnonzero(ended).tolist():
            self.ways[i].append((round(float(self.waiting_since[i]), 2), round(now, 2)))
        self.wants = wants
        self.waiting_since[~wants | (reached > self.reached)] = now
        self.reached = reached
