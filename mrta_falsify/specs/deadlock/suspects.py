"""Which robots may be stuck, so that a forecast is worth its time."""

from __future__ import annotations

import numpy as np

from mrta_falsify.core.arrays import Array, BoolArray
from mrta_falsify.core.fleet import Frame
from mrta_falsify.core.world import World
from mrta_falsify.specs.deadlock.progress_clock import (
    PROGRESS_STEP,
    ProgressClock,
    has_stop_to_reach,
)
from mrta_falsify.specs.deadlock.standstill import SPOT_RADIUS, Standstill
from mrta_falsify.specs.deadlock.wait_graph import EdgesByRobot, awaited_by

SERVED_AFTER = 2.0  # s that a robot with a goal stands without an edge: it is being served
#: of its largest speed; a robot that is slower than this may be held up by more than a crowd. At
#: 1.5 m/s it has 1 s to leave its spot of 0.1 m, and 2.4 s to come nearer by 0.25 m
CROWD_SHARE = 0.07


class SuspectClock:
    """Finds the robots that may be stuck, by motion and wait-for graph; one object per episode.

    A robot is *closed in* if it stands, and so does all that it waits for, directly or through
    other robots, and none of it is being served. A robot is *held up* if it has made no progress
    for longer than a crowd would keep it.

    Args:
        world: of the episode.
        progress: of the run; kept up to date by its owner.
    """

    def __init__(self, world: World, progress: ProgressClock) -> None:
        robots = len(world.robots)
        speed = CROWD_SHARE * np.array([robot.max_speed for robot in world.robots])
        self._spot_limit = SPOT_RADIUS / speed  # (N,) s
        self._progress_limit = PROGRESS_STEP / speed  # (N,) s
        self._progress = progress
        self._spots = Standstill(robots + len(world.humans))  # of robots, then of people
        self._pose = np.zeros((self._spots.robots, 3))  # people are taken not to turn
        self._stands_since = self._spots.since[:robots]  # (N,) [s]
        self._people_stand_since = self._spots.since[robots:]  # (H,) [s]
        self._closed_since = np.full(robots, np.inf)  # (N,) [s]
        self._people_stand = np.zeros(robots)  # (N,) since when those do that it waits for [s]
        self._edges: EdgesByRobot = {}
        self._time = 0.0
        self.waits: BoolArray = np.zeros(robots, dtype=np.bool_)  #: (N,) who has a stop to reach

    def watch(self, frame: Frame) -> None:
        """Take in a tick's motion."""
        sensed, robots = frame.sensed, len(self.waits)
        self._pose[:robots] = sensed.pose
        if len(sensed.human_position):
            self._pose[robots:, :2] = sensed.human_position
        self._spots.update(self._pose, sensed.time, frame.intent.goal)

    def look(self, frame: Frame, edges: EdgesByRobot) -> None:
        """Take in the wait-for graph of a tick."""
        self._time, self._edges = frame.sensed.time, edges
        self.waits = has_stop_to_reach(frame.intent, frame.sensed.pose[:, :2])
        closed = [i for i in edges if self.waits[i] and self._is_closed_in(i)]
        since = np.full(len(self.waits), np.inf)
        since[closed] = np.minimum(self._closed_since[closed], self._time)
        self._closed_since = since
        self._people_stand[closed] = [self._people_since(i) for i in closed]

    def suspects(self, *, is_last: bool) -> set[int]:
        """Find the robots that may be stuck.

        Args:
            is_last: whether the episode ends, so that a later look cannot find a robot.
        """
        closed = set(np.isfinite(self._closed_since).nonzero()[0].tolist())
        waits = self.waits.nonzero()[0].tolist()
        held_up = {i for i in waits if self._is_held_up(i)}
        standing = {i for i in waits if is_last and i in self._edges}
        return closed | held_up | standing

    def closed_for(self) -> Array:
        """Tell for how long each robot has been closed in, ``(N,)`` [s]; -inf: it is not.

        Time in which a person moved for whom it waits is left out.
        """
        return np.asarray(self._time - np.maximum(self._closed_since, self._people_stand))

    def longest_wait(self) -> float:
        """Tell for how long a robot has stood that waits for another one, at most [s]."""
        waits = [
            self._time - float(self._stands_since[i])
            for i, own in self._edges.items()
            if any(edge.other >= 0 and edge.cause != "human" for edge in own)
        ]
        return max(waits, default=0.0)

    def _is_closed_in(self, i: int) -> bool:
        party = {i} | self._awaited(i)
        stands = self._time - self._stands_since >= self._spot_limit
        return all(j in self._edges and stands[j] for j in party)

    def _people_since(self, i: int) -> float:
        """Find since when all people stand that ``i`` and its party wait for [s]."""
        edges = [edge for j in {i, *self._awaited(i)} for edge in self._edges.get(j, ())]
        people = [edge.other for edge in edges if edge.cause == "human"]
        return float(self._people_stand_since[people].max(initial=0.0))

    def _is_held_up(self, i: int) -> bool:
        without = self._time - self._progress.last[i]
        return bool(without >= self._progress_limit[i]) and not self._awaits_service(i)

    def _awaits_service(self, i: int) -> bool:
        """Whether a robot waits for one that is being served.

        One without a path may lack it for more than that robot.
        """
        if any(edge.cause == "no-path" for edge in self._edges.get(i, ())):
            return False
        party = {i} | self._awaited(i)
        stands = self._time - self._stands_since >= SERVED_AFTER
        return any(self.waits[j] and stands[j] and j not in self._edges for j in party)

    def _awaited(self, i: int) -> set[int]:
        return awaited_by(i, range(len(self.waits)), self._edges)
