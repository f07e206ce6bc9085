"""How robots approach their goals, and what they lack of it.

Robustness is a time [s]: patience minus the longest time without coming nearer.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, ClassVar, NamedTuple, TypeAlias

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


class _Rows(NamedTuple):
    """What is known of each robot's approach."""

    since: Array  #: (N,) of the last improvement [s]
    travelled: Array  #: (N,) way driven since then [m]
    last: Array  #: (N, 2) where it was [m]
    served: IntArray  #: (N,) stops done
    way: Array  #: (N, 4) that it was last seen on, nan: none
    number: IntArray  #: (N,) of that way, among the ways of its stop
    best: Array  #: (N,) least distance along that way [m]
    left: Array  #: (N,) distance now [m]
    news: IntArray  #: (N,) what is new: NOTHING, OTHER_STOP or OTHER_WAY


NOTHING, OTHER_STOP, OTHER_WAY = range(3)


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
    _rows: _Rows = field(init=False)
    _ways: list[list[tuple[_Way, float]]] = field(init=False)  #: of a stop, and best distances
    _told: tuple[Array, ...] | None = field(init=False, default=None)  #: paths, as last told
    _paths: Polylines = field(init=False)  #: the same, for compiled code

    def __post_init__(self) -> None:
        robots = self.robots
        self.since, self.travelled, best, left = np.zeros((4, robots))
        self._rows = _Rows(
            since=self.since,
            travelled=self.travelled,
            last=np.full((robots, 2), np.nan),
            served=np.full(robots, -1, dtype=np.int64),
            way=np.full((robots, 4), np.nan),
            number=np.zeros(robots, dtype=np.int64),
            best=best,
            left=left,
            news=np.zeros(robots, dtype=np.int64),
        )
        self._ways = [[] for _ in range(robots)]

    def update(self, frame: Frame) -> None:
        """Take in a tick."""
        sensed, intent, rows = frame.sensed, frame.intent, self._rows
        if intent.path is not self._told:
            self._told, self._paths = intent.path, Polylines.of(intent.path)
        paths = self._paths.points, self._paths.first
        time, step = sensed.time, self.step
        if not _take_in(tuple(rows), sensed.pose, intent.goal, paths, frame.served, time, step):
            return
        for i in rows.news.nonzero()[0].tolist():
            if rows.news[i] == OTHER_STOP:
                self._ways[i] = []
            elif self._improves_on(i, float(rows.left[i])):
                self.restart(i, time)

    def restart(self, i: int, time: float) -> None:
        """Count from ``time`` [s] on for robot ``i``."""
        self.since[i] = time
        self.travelled[i] = 0.0

    def _improves_on(self, i: int, distance: float) -> bool:
        """Take up the way that robot ``i`` is on by now; whether it is nearer than ever on it."""
        known, rows, last = self._ways[i], self._rows, int(self._rows.number[i])
        if known:
            known[last] = (known[last][0], float(rows.best[i]))
        x, y, next_x, next_y = rows.way[i].tolist()
        for k, (seen, best) in enumerate(known):
            off = abs(seen[0] - x) + abs(seen[1] - y) + abs(seen[2] - next_x)
            if off + abs(seen[3] - next_y) <= GOAL_JITTER:
                rows.number[i], rows.best[i] = k, best
                break
        else:
            rows.number[i], rows.best[i] = len(known), np.inf
            known.append(((x, y, next_x, next_y), np.inf))
        if distance > rows.best[i] - self.step:
            return False
        rows.best[i] = distance
        return True


@njit(cache=True)
def _take_in(
    fields: tuple[Any, ...],
    pose: Array,
    goal: Array,
    paths: tuple[Array, IntArray],
    served: IntArray,
    time: float,
    step: float,
) -> bool:
    """Bring the fields of :class:`_Rows` to ``time`` [s].

    Args:
        fields: of the rows.
        pose: ``(N, 3)``.
        goal: ``(N, 2)`` [m], nan: none.
        paths: N of them, as in :class:`~mrta_falsify.core.polyline.Polylines`.
        served: ``(N,)`` stops done.
        time: [s].
        step: improvement that counts [m].

    Returns:
        Whether there are news: a robot has another stop to reach, or is on another way.
    """
    rows, (points, first), is_any = _Rows(*fields), paths, False
    for i in range(len(goal)):
        x, y, way = pose[i, 0], pose[i, 1], rows.way[i]
        driven = np.hypot(x - rows.last[i, 0], y - rows.last[i, 1])
        rows.travelled[i] += driven if np.isfinite(driven) else 0.0
        rows.last[i, 0], rows.last[i, 1] = x, y
        away = np.hypot(x - goal[i, 0], y - goal[i, 1])
        path, rows.news[i] = points[first[i] : first[i + 1]], NOTHING
        if served[i] != rows.served[i] or np.isnan(away):
            rows.news[i] = NOTHING if np.isnan(way[0]) else OTHER_STOP
            rows.served[i], way[:] = served[i], np.nan
            away = 0.0
        if away <= AT_GOAL:
            rows.since[i], rows.travelled[i] = time, 0.0
        elif len(path):
            rows.left[i] = remaining_length(path, x, y)
            on_it = way[0] == goal[i, 0] and way[1] == goal[i, 1]
            on_it = on_it and way[2] == path[-1, 0] and way[3] == path[-1, 1]
            if not on_it:
                rows.news[i], way[:2], way[2:] = OTHER_WAY, goal[i], path[-1]
            elif rows.left[i] <= rows.best[i] - step:
                rows.best[i], rows.since[i], rows.travelled[i] = rows.left[i], time, 0.0
        is_any = is_any or rows.news[i] != NOTHING
    return is_any


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
