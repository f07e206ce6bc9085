"""Will anything move any more? When a continuation has shown enough and may end."""

from __future__ import annotations

from collections import deque

import numpy as np

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.directives import Wait
from mrta_falsify.core.fleet import Frame
from mrta_falsify.core.world import World
from mrta_falsify.specs.deadlock.progress_clock import PACE
from mrta_falsify.specs.deadlock.wait_graph import EdgesByRobot, awaited_by, is_unexplained

ALL_REST_FOR = 30.0  # s without any motion in the building: three times our stack's longest wait
PARTY_RESTS_FOR = 120.0  # s in which nothing that a robot waits for does more than creep
SAME_POSE = 1e-3  # m, rad or m/s; smaller changes are no motion
LEG = 10.0  # s; a robot that moves in a leg farther than in the one before drifts off ...
DRIFT = 1e-5  # m, rad ... if it is more than this: less may be rounding or jitter
CREEPING_SPEED = 0.1  # m/s; a person who moves, but no faster than this ...
CREEPING_FOR = 5.0  # s ... for so long, is squeezing past something
SERVED_AFTER = 2.0  # s that a robot with a goal stands without an edge: it is being served


def longest_pause(world: World) -> float:
    """Find how long a person's script lets it stand before it walks on, at most [s]."""
    steps = [step for human in world.humans for step in human.directives]
    return max((step.duration for step in steps if isinstance(step, Wait)), default=0.0)


class LastingRest:
    """Tells lasting rest from a pause in a run.

    Standing is not enough. A robot that is being served will move on, and so will a person whose
    script has a pause. Robots in an unstable balance first creep off it by micrometres, each
    leg farther than the last; a person pressed against robots takes minutes to slip past them.

    Args:
        world: of the episode.
    """

    def __init__(self, world: World) -> None:
        robots = len(world.robots)
        speed = np.array([robot.max_speed for robot in world.robots])
        self._pause = longest_pause(world)
        self._creep = PACE * speed * PARTY_RESTS_FOR  # (N,) m
        self._time = 0.0
        self._pose: Array | None = None  # at the last motion
        self._moved = np.zeros(robots)  # (N,) last motion [s]
        self._place = np.zeros((robots, 2))  # m
        self._strayed = np.zeros(robots)  # (N,) last time of more than creep [s]
        self._explained = np.zeros(robots)  # (N,) last time with an edge, or without a goal [s]
        self._served = np.zeros(robots)  # (N,) last time of a service [s]
        self._people = _PeoplesMotion(len(world.humans))
        self._legs: deque[Array] = deque(maxlen=3)  # poses LEG apart
        self._leg_began = 0.0  # s
        self._edges: EdgesByRobot = {}

    def update(self, frame: Frame, edges: EdgesByRobot) -> None:
        """Take in a look at the run, with the blocked-by edges of each robot."""
        pose, time = frame.sensed.pose, frame.sensed.time
        self._time, self._edges = time, edges
        if self._pose is None:
            self._begin(pose, time)
        assert self._pose is not None
        moved = np.abs(pose - self._pose).max(axis=1) > SAME_POSE
        self._moved[moved], self._pose[moved] = time, pose[moved]
        if not self._legs or time >= self._leg_began + LEG:
            self._legs.append(pose.copy())
            self._leg_began = time
        strayed = ~(np.hypot(*(pose[:, :2] - self._place).T) <= self._creep)
        self._strayed[strayed], self._place[strayed] = time, pose[strayed, :2]
        explained = ~np.isfinite(frame.intent.goal[:, 0])
        explained[list(edges)] = True
        self._explained[explained] = time
        self._served[time - self._explained >= SERVED_AFTER] = time
        self._people.update(frame.sensed.human_velocity, time)

    def _begin(self, pose: Array, time: float) -> None:
        self._pose, self._place = pose.copy(), pose[:, :2].copy()
        for since in (self._moved, self._strayed, self._explained, self._served):
            since[:] = time
        self._people.walked = self._people.squeezed = time

    def is_complete(self, settled: float) -> bool:
        """Whether nothing at all has moved for long, and nothing drifts off a balance.

        Args:
            settled: rest counts from this time on, when awaited events have had their effect [s].
        """
        last = max(self._moved.max(initial=0.0), self._served.max(initial=0.0))
        last = max(last, self._people.walked, settled)
        return bool(self._time - last >= ALL_REST_FOR + self._pause) and not self._drifting()

    def keeps(self, i: int, settled: float) -> bool:
        """Whether nothing that robot ``i`` waits for has done more than creep for long.

        Args:
            i: the robot.
            settled: as of :meth:`is_complete`.
        """
        rest = self._time - max(self.party_moved(i), settled)
        return rest >= PARTY_RESTS_FOR + self._pause

    def party_moved(self, i: int) -> float:
        """Tell when something that robot ``i`` waits for did more than creep last [s]."""
        party, people = self._party(i)
        chosen = sorted(party)
        last = max(self._strayed[chosen].max(), self._served[chosen].max())
        return float(max(last, self._people.squeezed) if people else last)

    def _party(self, i: int) -> tuple[set[int], bool]:
        """Find the robots that ``i`` waits for, itself among them, and whether people count.

        Behind people, or where no robot explains why a robot stands, it waits for all: what its
        stack waits for cannot be seen, and a solid beside it may be chance.
        """
        party = {i} | awaited_by(i, range(len(self._moved)), self._edges)
        own = [edge for j in party for edge in self._edges.get(j, ())]
        people = any(edge.cause == "human" for edge in own)
        is_alone = all(edge.other < 0 and not edge.resource for edge in self._edges.get(i, ()))
        if people or is_alone or any(is_unexplained(edge) for edge in own):
            return set(range(len(self._moved))), True
        return party, people

    def _drifting(self) -> set[int]:
        """Find the robots that moved farther in the last leg than in the one before."""
        if len(self._legs) < 3:
            return set()
        first, second, third = self._legs
        before, lately = np.abs(second - first), np.abs(third - second)
        drifts = (lately > np.maximum(2.0 * before, DRIFT)).any(axis=1)
        return set(np.flatnonzero(drifts).tolist())


class _PeoplesMotion:
    """When people last moved."""

    def __init__(self, count: int) -> None:
        self.walked = 0.0  #: last time a person moved [s]
        self.squeezed = 0.0  #: last time a person squeezed past something [s]
        self._uncrept = np.full(count, np.nan)  # last time each stood or walked [s]

    def update(self, velocity: Array, time: float) -> None:
        speed = np.hypot(*velocity.T)
        moves = speed > SAME_POSE
        if moves.any():
            self.walked = time
        creeps = moves & (speed < CREEPING_SPEED)
        self._uncrept[~creeps | np.isnan(self._uncrept)] = time
        if (time - self._uncrept > CREEPING_FOR).any():
            self.squeezed = time
