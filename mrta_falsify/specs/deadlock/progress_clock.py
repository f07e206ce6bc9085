"""When did a robot last make progress towards its next stop?

The answer depends neither on blocked-by edges nor on the stack's paths. Distance to the goal is
measured along free space. So a way round counts as progress; shuffling to and fro, or a new path,
does not. Neither does creep: a robot must come nearer at a pace that leads somewhere.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field

import numpy as np

from mrta_falsify.core.arrays import Array, BoolArray
from mrta_falsify.core.fleet import Frame, Intent
from mrta_falsify.core.world import World
from mrta_falsify.specs.deadlock.free_distance import FreeDistance, Point, free_distance
from mrta_falsify.specs.deadlock.service_clock import AT_GOAL

PROGRESS_STEP = 0.25  # m nearer to the goal than ever before, about a robot's radius: progress ...
#: ... if it took no longer than at this share of the robot's largest speed. A way at this pace
#: takes 200 times as long as a free drive; numerical creep is slower by another factor of five
PACE = 0.005
BRISK = 0.03  # the same, of a robot that is on its way: slower ones stand, push or are pushed
PACED_OVER = 2.0  # s over which the pace of a robot is measured
GOAL_SPREAD = 0.5  # m; goals this near to each other are one, so alternating is no progress


@dataclass(slots=True)
class _Approach:
    """How near a robot has come to a goal."""

    goal: Point  #: [m]
    nearest: float  #: along free space, when last looked at [m]
    since: float  #: when that was [s]


@dataclass(slots=True)
class ProgressClock:
    """Clock of the last progress of every robot; one object per run."""

    world: World
    step: float = PROGRESS_STEP  #: how much nearer is progress [m]
    last: Array = field(init=False)  #: (N,) [s]
    _brisk: Array = field(init=False)  #: (N,) last progress at more than creep [s]
    _driven: Array = field(init=False)  #: (N,) last time of more than creep, or of a new goal [s]
    _places: deque[tuple[float, Array]] = field(init=False)  #: (N, 2) of the last PACED_OVER
    _least_time: Array = field(init=False)  #: (N,) of a step at the largest speed [s]
    _served: list[int] = field(init=False)  #: stops done
    _approaches: list[list[_Approach]] = field(init=False)  #: since then
    _space: FreeDistance = field(init=False)
    _looked: float = field(init=False, default=-1.0)  #: when the robots were looked at last [s]

    def __post_init__(self) -> None:
        robots = len(self.world.robots)
        self.last, self._brisk, self._driven = np.zeros((3, robots))
        self._places = deque()
        self._least_time = self.step / np.array([robot.max_speed for robot in self.world.robots])
        self._served = [-1] * robots
        self._approaches = [[] for _ in range(robots)]
        self._space = free_distance(self.world)

    def update(self, frame: Frame) -> Array:
        """Take in a tick, once; time ``(N,)`` [s] of each robot's last progress, not a copy."""
        if frame.sensed.time == self._looked:
            return self.last
        self._looked = frame.sensed.time
        places = frame.sensed.pose[:, :2]
        told = zip(places.tolist(), frame.intent.goal.tolist(), frame.served.tolist(), strict=True)
        for i, (place, goal, served) in enumerate(told):
            if math.isfinite(goal[0]):
                self._advance(i, place, goal, served)
        self._note_pace(frame.sensed.time, places)
        return self.last

    def on_the_way(self) -> Array:
        """Tell until when each robot was on its way, at more than creep, ``(N,)`` [s]."""
        return np.minimum(self._brisk, self._driven)

    def _note_pace(self, time: float, places: Array) -> None:
        self._places.append((time, places.copy()))
        while self._places[0][0] < time - PACED_OVER - 1e-6:
            self._places.popleft()
        began, before = self._places[0]
        least = BRISK * self.step / self._least_time * max(time - began, 1e-9)  # (N,) m
        self._driven[np.hypot(*(places - before).T) >= least] = time

    def _advance(self, i: int, position: Point, goal: Point, served: int) -> None:
        """Take in where robot ``i`` is that heads for ``goal``.

        Progress is a stop done, or a goal that the robot never had since its last stop. To come
        nearer to such a goal by ``step`` than ever before is progress, too, unless it takes longer
        than at ``PACE`` times the robot's largest speed. Stops taken off its list are none.
        """
        time = self._looked
        if self._served[i] != served:
            self._served[i] = served
            self._approaches[i].clear()
        away = self._space.between(position, goal)
        for known in self._approaches[i]:
            if np.hypot(known.goal[0] - goal[0], known.goal[1] - goal[1]) <= GOAL_SPREAD:
                self._compare(i, known, away, time)
                break
        else:
            self._approaches[i].append(_Approach(goal, away, time))
            self.last[i] = self._brisk[i] = self._driven[i] = time

    def _compare(self, i: int, known: _Approach, away: float, time: float) -> None:
        share = self._least_time[i] / max(time - known.since, 1e-9)
        is_in_time = share >= PACE
        if away <= known.nearest - self.step:
            if is_in_time:
                self.last[i] = time
            if share >= BRISK:
                self._brisk[i] = time
        elif is_in_time:
            return
        known.nearest, known.since = min(known.nearest, away), time


def has_stop_to_reach(intent: Intent, position: Array) -> BoolArray:
    """Tell which robots still have to reach something, ``(N,)``.

    Those without a goal do not, nor those that have arrived after their last stop.

    Args:
        intent: goals and stops left.
        position: ``(N, 2)`` [m].
    """
    away = np.hypot(*(position - intent.goal).T)
    return np.asarray(np.isfinite(away) & ((away > AT_GOAL) | (intent.tasks_left > 0)))
