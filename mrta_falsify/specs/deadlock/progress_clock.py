"""When did a robot last make progress towards its next stop?

The answer depends neither on blocked-by edges nor on the stack's paths. Distance to the goal is
measured along free space. So a way round counts as progress; shuffling to and fro, or a new path,
does not. Neither does creep: a robot must come nearer at a pace that leads somewhere.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from mrta_falsify.core.arrays import Array, BoolArray
from mrta_falsify.core.fleet import Frame, Intent
from mrta_falsify.core.world import World
from mrta_falsify.specs.deadlock.free_distance import DETOUR_FROM, FreeDistance, free_distance
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

    goal: list[float]  #: [m]
    since: float  #: when last looked at [s]
    nearest: float = math.inf  #: along free space, then [m]


class _Course(NamedTuple):
    """What a robot is about."""

    goal: list[float]  #: [m]
    served: int  #: stops done
    known: _Approach  #: of the goal
    found: Array  #: (rows, cols) way to the goal from every cell [m], inf: none


@dataclass(slots=True)
class ProgressClock:
    """Clock of the last progress of every robot; one object per run."""

    world: World
    step: float = PROGRESS_STEP  #: how much nearer is progress [m]
    last: Array = field(init=False)  #: (N,) [s]
    #: (N,) last time it came nearer, or had done a stop; a new goal alone does not count [s]
    moved: Array = field(init=False)
    _brisk: Array = field(init=False)  #: (N,) last progress at more than creep [s]
    _driven: Array = field(init=False)  #: (N,) last time of more than creep, or of a new goal [s]
    _places: deque[tuple[float, Array]] = field(init=False)  #: (N, 2) of the last PACED_OVER
    _least_time: list[float] = field(init=False)  #: N of a step at the largest speed [s]
    _least_way: Array = field(init=False)  #: (N,) in a second, at more than creep [m]
    _served: list[int] = field(init=False)  #: stops done
    _approaches: list[list[_Approach]] = field(init=False)  #: since then
    _courses: list[_Course | None] = field(init=False)  #: when last looked at
    _space: FreeDistance = field(init=False)
    _looked: float = field(init=False, default=-1.0)  #: when the robots were looked at last [s]

    def __post_init__(self) -> None:
        robots = len(self.world.robots)
        self.last, self.moved, self._brisk, self._driven = np.zeros((4, robots))
        self._places = deque()
        least_time = self.step / np.array([robot.max_speed for robot in self.world.robots])
        self._least_time = least_time.tolist()
        self._least_way = BRISK * self.step / least_time
        self._served = [-1] * robots
        self._approaches = [[] for _ in range(robots)]
        self._courses = [None] * robots
        self._space = free_distance(self.world)

    def update(self, frame: Frame) -> Array:
        """Take in a tick, once; time ``(N,)`` [s] of each robot's last progress, not a copy."""
        if frame.sensed.time == self._looked:
            return self.last
        self._looked = frame.sensed.time
        places = frame.sensed.pose[:, :2]
        cells = self._space.cells_of(places).tolist()
        goals, stops = frame.intent.goal.tolist(), frame.served.tolist()
        for i, (goal, served) in enumerate(zip(goals, stops, strict=True)):
            if not math.isfinite(goal[0]):
                continue
            course = self._courses[i]
            if course is None or course.goal != goal or course.served != served:
                course = self._courses[i] = self._taken_up(i, goal, served)
            away = course.found.item(cells[i])
            if not DETOUR_FROM < away < math.inf:  # without a way, or nearby: straight
                away = float(np.hypot(places[i, 0] - goal[0], places[i, 1] - goal[1]))
            known = course.known
            is_nearer = away <= known.nearest - self.step
            share = self._least_time[i] / max(self._looked - known.since, 1e-9)
            if is_nearer or share < PACE:
                self._look_anew(i, known, away, share)
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
        least = self._least_way * max(time - began, 1e-9)  # (N,) m
        self._driven[np.hypot(*(places - before).T) >= least] = time

    def _taken_up(self, i: int, goal: list[float], served: int) -> _Course:
        """Take in that robot ``i`` heads for another goal, or has done a stop.

        Progress is a stop done, or a goal that the robot never had since its last stop. Stops
        taken off its list are none.
        """
        if self._served[i] != served:
            if self._served[i] >= 0:
                self.moved[i] = self._looked
            self._served[i] = served
            self._approaches[i].clear()
        found = self._space.map_to(goal)
        for known in self._approaches[i]:
            if np.hypot(known.goal[0] - goal[0], known.goal[1] - goal[1]) <= GOAL_SPREAD:
                return _Course(goal, served, known, found)
        new = _Approach(goal, self._looked)
        self._approaches[i].append(new)
        self._driven[i] = self._looked
        return _Course(goal, served, new, found)

    def _look_anew(self, i: int, known: _Approach, away: float, share: float) -> None:
        """Take in that robot ``i`` has come nearer by ``step`` than ever before, or is slow.

        The former is progress, unless it took longer than at ``PACE`` times the robot's largest
        speed: its pace was ``share`` of that.
        """
        if away <= known.nearest - self.step:
            if share >= PACE:
                self.last[i] = self._looked
                if math.isfinite(known.nearest):
                    self.moved[i] = self._looked
            if share >= BRISK:
                self._brisk[i] = self._looked
        known.nearest, known.since = min(known.nearest, away), self._looked


def has_stop_to_reach(intent: Intent, position: Array) -> BoolArray:
    """Tell which robots still have to reach something, ``(N,)``.

    Those without a goal do not, nor those that have arrived after their last stop.

    Args:
        intent: goals and stops left.
        position: ``(N, 2)`` [m].
    """
    away = np.hypot(*(position - intent.goal).T)
    return np.asarray(np.isfinite(away) & ((away > AT_GOAL) | (intent.tasks_left > 0)))
