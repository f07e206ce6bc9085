"""Who reached which stop, from motion and confirmed events alone."""

from __future__ import annotations

import numpy as np

from mrta_falsify.core.fleet import Frame, Phase
from mrta_falsify.core.world import World

REACH = 0.5  # m from a room's point at which a stop can be served
SERVED = ("picked-up", "dropped-off")


class StopCount:
    """Counts the stops that each robot has reached; one object per run.

    A stop is reached once its service begins within 0.5 m of the room's point, however long it
    takes. What the stack says of it counts only where the motion agrees.
    """

    def __init__(self, world: World) -> None:
        robots = len(world.robots)
        self._points = {room.name: room.point for room in world.rooms}
        self._served = np.zeros(robots, dtype=np.int64)
        self.reached = np.zeros(robots, dtype=np.int64)  #: stops, so far
        self.wants = np.zeros(robots, dtype=np.bool_)  #: is on its way to a stop or parking spot
        self.waiting_since = np.zeros(robots)  #: begin of the way to its next stop [s]

    def update(self, frame: Frame) -> None:
        """Take in one tick."""
        position, goal = frame.sensed.pose[:, :2], frame.intent.goal
        for event in frame.events:
            if event.kind in SERVED:
                away = np.hypot(*(position[event.robot] - self._points[event.resource]))
                self._served[event.robot] += bool(away <= REACH)
        with_goal = np.isfinite(goal[:, 0])
        near = np.zeros(len(position), dtype=np.bool_)
        near[with_goal] = np.hypot(*(goal - position)[with_goal].T) <= REACH
        serving = (frame.intent.phase == int(Phase.SERVING)) & near
        reached = self._served + serving
        self.wants = with_goal & ~serving
        self.waiting_since[~self.wants | (reached > self.reached)] = frame.sensed.time
        self.reached = reached
