"""How robots approach their goals, and what they lack of it.

Robustness is a time [s]: patience minus the longest time without coming nearer.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, ClassVar, TypeAlias

import numpy as np

from mrta_falsify.core.arrays import Array, IntArray
from mrta_falsify.core.compiled import njit
from mrta_falsify.core.fleet import Frame
from mrta_falsify.core.polyline import Polylines
from mrta_falsify.core.verdict import Verdict, unjudged
from mrta_falsify.core.world import World
from mrta_falsify.specs.deadlock.path_ahead import remaining_length
from mrta_falsify.specs.deadlock.service_clock import AT_GOAL
from mrta_falsify.specs.deadlock.standstill import GOAL_JITTER
from mrta_falsify.specs.running_min import RunningMin

LIVENESS_EVERY = 0.5  # s between two looks

_Way: TypeAlias = tuple[float, float, float, float]  # goal, then next waypoint [m]


@dataclass(slots=True)
class Approach:
    """Best remaining distance of each robot to its goal, and when it last got better.

    Distances compare only along ways that lead to one goal by one next waypoint. The rest of the
    way behind that waypoint is not known, and a straight line through walls would be too short
    ever to be beaten. A new waypoint is progress; goals and waypoints that come back while
    no stop was served keep their best distance, so that alternating between them is none. A
    robot without a goal, or at its goal, has nothing to improve.
    """

    step: float  #: improvement that counts [m]
    robots: int
    since: Array = field(init=False)  #: (N,) of the last improvement [s]
    travelled: Array = field(init=False)  #: (N,) way driven since then [m]
    _best: list[list[tuple[_Way, float]]] = field(init=False)  #: ways and distances
    _served: IntArray = field(init=False)  #: (N,) stops done
    _last: Array = field(init=False)
    _told: tuple[Array, ...] | None = field(init=False, default=None)  #: paths, as last told
    _paths: Polylines = field(init=False)  #: the same, for compiled code

    def __post_init__(self) -> None:
        self.since = np.zeros(self.robots)
        self.travelled = np.zeros(self.robots)
        self._best = [[] for _ in range(self.robots)]
        self._served = np.full(self.robots, -1)
        self._last = np.full((self.robots, 2), np.nan)

    def update(self, frame: Frame) -> None:
        """Take in a tick."""
        sensed, intent = frame.sensed, frame.intent
        position = sensed.pose[:, :2]
        driven = np.hypot(*(position - self._last).T)
        self.travelled += np.where(np.isfinite(driven), driven, 0.0)
        self._last = position.copy()
        away = np.hypot(*(position - intent.goal).T)
        anew = (frame.served != self._served) | np.isnan(away)
        self._served = frame.served
        is_over = anew | (away <= AT_GOAL)
        self.since[is_over], self.travelled[is_over] = sensed.time, 0.0
        goals, left = intent.goal.tolist(), self._left(intent.path, position)
        for i in range(self.robots):
            if anew[i]:
                self._best[i] = []
            if len(intent.path[i]) and not is_over[i]:
                way = (*goals[i], *intent.path[i][-1].tolist())
                if self._improves(i, way, left[i]):
                    self.restart(i, sensed.time)

    def _left(self, paths: tuple[Array, ...], position: Array) -> list[float]:
        """Measure what is left of the paths from ``position`` ``(N, 2)`` on [m]; 0: no path."""
        if paths is not self._told:
            self._told, self._paths = paths, Polylines.of(paths)
        lengths = np.empty(self.robots)
        _fill_lengths(self._paths.points, self._paths.first, position, lengths)
        measured: list[float] = lengths.tolist()
        return measured

    def restart(self, i: int, time: float) -> None:
        """Count from ``time`` [s] on for robot ``i``."""
        self.since[i] = time
        self.travelled[i] = 0.0

    def _improves(self, i: int, way: _Way, distance: float) -> bool:
        known = self._best[i]
        x, y, next_x, next_y = way
        for k, (seen, best) in enumerate(known):
            off = abs(seen[0] - x) + abs(seen[1] - y) + abs(seen[2] - next_x)
            if off + abs(seen[3] - next_y) <= GOAL_JITTER:
                if distance > best - self.step:
                    return False
                known[k] = (seen, distance)
                return True
        known.append((way, distance))
        return True


@njit(cache=True)
def _fill_lengths(points: Array, first: IntArray, position: Array, lengths: Array) -> None:
    for i in range(lengths.shape[0]):
        path = points[first[i] : first[i + 1]]
        lengths[i] = 0.0
        if len(path):
            lengths[i] = remaining_length(path, position[i, 0], position[i, 1])


class ApproachMargin:
    """The smallest margin of any robot over a run, by how it approaches its goal."""

    _spec: ClassVar[str]

    def __init__(self, patience: float, step: float) -> None:
        self._patience, self._step = patience, step

    def start(self, world: World, dt: float) -> None:
        """Begin an episode."""
        self._names = tuple(robot.name for robot in world.robots)
        self._stride = max(1, round(LIVENESS_EVERY / dt))
        self._approach = Approach(self._step, len(world.robots))
        self._missing = ""
        self._worst = RunningMin(self._spec, self._patience)

    def update(self, frame: Frame) -> None:
        """Take in one tick."""
        sensed = frame.sensed
        self._missing = "" if all(frame.tells) else frame.tells.lacking("goals", "paths")
        if sensed.tick % self._stride or self._missing:
            return
        self._approach.update(frame)
        self._look(frame)
        margin = self._margins(sensed.time)
        if not len(margin):
            return
        i = int(margin.argmin())
        if margin[i] >= self._worst.margin:
            return
        who = tuple(self._names[k] for k in np.flatnonzero(margin < 0.0))
        self._worst.note(float(margin[i]), sensed.time, who, self._evidence_of(i, frame))

    def _look(self, frame: Frame) -> None:
        """Take in what else decides, before the margins are computed."""

    def _margins(self, time: float) -> Array:
        """Compute the patience left of each robot, ``(N,)`` [s]."""
        return self._patience - (time - self._approach.since)

    def _evidence_of(self, i: int, frame: Frame) -> dict[str, Any]:
        return {
            "robot": self._names[i],
            "since": float(self._approach.since[i]),
            "time": frame.sensed.time,
            **self._seen(i, frame),
        }

    def _seen(self, i: int, frame: Frame) -> dict[str, Any]:
        """Describe robot ``i`` for the evidence, beyond since when it has been without progress."""
        raise NotImplementedError

    def verdict(self) -> Verdict:
        """Give the verdict to date."""
        return unjudged(self._spec, self._missing) if self._missing else self._worst.verdict()
