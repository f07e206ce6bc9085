"""Liveness: no livelock, steady progress, no starvation.

Robustness is a time [s]: patience minus the longest time without what is asked for.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.codec import quantity
from mrta_falsify.core.fleet import Frame
from mrta_falsify.core.verdict import Verdict, unjudged
from mrta_falsify.core.world import World
from mrta_falsify.specs.books import Books
from mrta_falsify.specs.deadlock.path_ahead import remaining_length
from mrta_falsify.specs.deadlock.service_clock import AT_GOAL
from mrta_falsify.specs.deadlock.standstill import GOAL_JITTER, Standstill
from mrta_falsify.specs.running_min import RunningMin

LIVENESS_EVERY = 0.5  # s between two looks
TRAVEL_SCALE = 0.05  # m; driving less by this counts as safer by 1 s


@dataclass(slots=True)
class _Approach:
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
    _best: list[list[tuple[Array, float]]] = field(init=False)  #: goal and waypoint (4,), distance
    _stops: Array = field(init=False)
    _last: Array = field(init=False)

    def __post_init__(self) -> None:
        self.since = np.zeros(self.robots)
        self.travelled = np.zeros(self.robots)
        self._best = [[] for _ in range(self.robots)]
        self._stops = np.full(self.robots, -1.0)
        self._last = np.full((self.robots, 2), np.nan)

    def update(self, frame: Frame) -> None:
        sensed, intent = frame.sensed, frame.intent
        position = sensed.pose[:, :2]
        driven = np.hypot(*(position - self._last).T)
        self.travelled += np.where(np.isfinite(driven), driven, 0.0)
        self._last = position.copy()
        away = np.hypot(*(position - intent.goal).T)
        served = (intent.tasks_left != self._stops) | np.isnan(away)
        self._stops = np.array(intent.tasks_left, dtype=np.float64)
        for i in range(self.robots):
            if served[i]:
                self._best[i] = []
            if served[i] or away[i] <= AT_GOAL:
                self._restart(i, sensed.time)
                continue
            path = intent.path[i]
            if not len(path):
                continue
            x, y = position[i]
            way = np.concatenate([intent.goal[i], path[-1]])
            if self._improves(i, way, remaining_length(path, x, y)):
                self._restart(i, sensed.time)

    def _restart(self, i: int, time: float) -> None:
        self.since[i] = time
        self.travelled[i] = 0.0

    def _improves(self, i: int, way: Array, distance: float) -> bool:
        known = self._best[i]
        for k, (seen, best) in enumerate(known):
            if np.abs(seen - way).sum() <= GOAL_JITTER:
                if distance > best - self.step:
                    return False
                known[k] = (seen, distance)
                return True
        known.append((way, distance))
        return True


class _ApproachMargin:
    """The smallest margin of any robot over a run, by how it approaches its goal."""

    _spec: ClassVar[str]

    def __init__(self, patience: float, step: float) -> None:
        self._patience, self._step = patience, step

    def start(self, world: World, dt: float) -> None:
        """Begin an episode."""
        self._names = tuple(robot.name for robot in world.robots)
        self._stride = max(1, round(LIVENESS_EVERY / dt))
        self._approach = _Approach(self._step, len(world.robots))
        self._missing = ""
        self._worst = RunningMin(self._spec, self._patience)

    def update(self, frame: Frame) -> None:
        """Take in one tick."""
        sensed = frame.sensed
        self._missing = frame.tells.lacking("goals", "paths")
        if sensed.tick % self._stride or self._missing:
            return
        self._approach.update(frame)
        margin = self._margins(sensed.time)
        if not len(margin):
            return
        i = int(margin.argmin())
        if margin[i] >= self._worst.margin:
            return
        who = tuple(self._names[k] for k in np.flatnonzero(margin < 0.0))
        evidence = {
            "robot": self._names[i],
            "since": float(self._approach.since[i]),
            "time": sensed.time,
            **self._seen(i, frame),
        }
        self._worst.note(float(margin[i]), sensed.time, who, evidence)

    def _margins(self, time: float) -> Array:
        """Compute the patience left of each robot, ``(N,)`` [s]."""
        return self._patience - (time - self._approach.since)

    def _seen(self, i: int, frame: Frame) -> dict[str, Any]:
        """Describe robot ``i`` for the evidence, beyond since when it has been without progress."""
        raise NotImplementedError

    def verdict(self) -> Verdict:
        """Give the verdict to date."""
        return unjudged(self._spec, self._missing) if self._missing else self._worst.verdict()


class NoLivelock(_ApproachMargin):
    """No livelock: no robot keeps driving without getting nearer to its goal.

    Robustness [s]: patience minus the longest time in which a robot drove at least
    ``min_travel`` without net progress; driving less counts as safer by 1 s per 5 cm.
    """

    _spec = "no_livelock"

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Options:
        """What counts as driving in vain."""

        patience: float = quantity(above=0.0, unit="s", default=60.0)
        min_travel: float = quantity(above=0.0, unit="m", default=5.0)  #: driven in that time
        step: float = quantity(above=0.0, unit="m", default=0.5)  #: nearer by this: progress

    def __init__(self, options: Options) -> None:
        super().__init__(options.patience, options.step)
        self._min_travel = options.min_travel

    def _margins(self, time: float) -> Array:
        idle = (self._min_travel - self._approach.travelled) / TRAVEL_SCALE
        return np.maximum(super()._margins(time), idle)

    def _seen(self, i: int, frame: Frame) -> dict[str, Any]:
        x, y = frame.sensed.pose[i, :2]
        travelled = float(self._approach.travelled[i])
        return {"travelled": travelled, "x": float(x), "y": float(y)}


class SteadyProgress(_ApproachMargin):
    """Every robot with a goal gets nearer to it by ``step`` within each ``window``.

    Robots at their goal (served, or waiting at their spot) are exempt: queues are judged by
    ``no_starvation`` and ``no_deadlock``. Robustness [s]: window minus the longest time
    without such progress.
    """

    _spec = "progress"

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Options:
        """How much progress in how much time."""

        window: float = quantity(above=0.0, unit="s", default=90.0)
        step: float = quantity(above=0.0, unit="m", default=0.3)

    def __init__(self, options: Options) -> None:
        super().__init__(options.window, options.step)

    def _seen(self, i: int, frame: Frame) -> dict[str, Any]:
        return {"causes": [edge.cause for edge in frame.blocked_by if edge.robot == i]}


class NoStarvation:
    """No robot and no task waits without end while others are served.

    A robot with a goal starves if it has not left its place for ``robot_patience`` while another
    one served a stop. A task starves if it was not picked up for ``task_patience`` although one
    that arrived later was. Robustness [s]: the smaller margin of the two, scaled to
    ``robot_patience``.
    """

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Options:
        """How long is too long."""

        robot_patience: float = quantity(above=0.0, unit="s", default=120.0)
        task_patience: float = quantity(above=0.0, unit="s", default=600.0)
        radius: float = quantity(above=0.0, unit="m", default=0.5)  #: of "its place"

    def __init__(self, options: Options) -> None:
        self._options = options

    def start(self, world: World, dt: float) -> None:
        """Begin an episode."""
        robots = len(world.robots)
        self._world = world
        self._names = tuple(robot.name for robot in world.robots)
        self._stride = max(1, round(LIVENESS_EVERY / dt))
        self._standstill = Standstill(robots, radius=self._options.radius)
        self._waiting_since = np.zeros(robots)
        self._last_stop = np.full(robots, -np.inf)  # of each robot itself [s]
        self._books, self._missing = Books(world), ""
        self._worst = RunningMin("no_starvation", self._options.robot_patience)

    def update(self, frame: Frame) -> None:
        """Take in one tick."""
        sensed = frame.sensed
        self._missing = frame.tells.lacking("deliveries", "goals")
        for stop in self._books.update(frame):
            self._last_stop[stop.robot] = sensed.time
        if sensed.tick % self._stride or not len(self._names):
            return
        since = self._standstill.update(sensed.pose, sensed.time)
        no_goal = ~np.isfinite(frame.intent.goal[:, 0])
        self._waiting_since[no_goal] = sensed.time
        self._waiting_since = np.maximum(self._waiting_since, since)
        self._waiting_since = np.maximum(self._waiting_since, self._last_stop)
        self._judge_robots(sensed.time)
        if self._world.tasks:
            self._judge_tasks(sensed.time)

    def _judge_robots(self, time: float) -> None:
        i = int(self._waiting_since.argmin())
        since = float(self._waiting_since[i])
        others = np.delete(self._last_stop, i)
        if len(others) and others.max() > since:
            margin = self._options.robot_patience - (time - since)
            self._note(margin, self._names[i], since, time)

    def _judge_tasks(self, time: float) -> None:
        tasks, picked = self._world.tasks, self._books.picked
        if not picked:
            return
        last_served = max(tasks[i].arrival for i in picked)
        scale = self._options.robot_patience / self._options.task_patience
        for i, task in enumerate(tasks):
            if i not in picked and task.arrival < last_served:
                margin = (self._options.task_patience - (time - task.arrival)) * scale
                self._note(margin, f"task{i}", task.arrival, time)

    def _note(self, margin: float, name: str, since: float, time: float) -> None:
        if margin >= self._worst.margin:
            return
        who = tuple(dict.fromkeys((*self._worst.who, name)))
        evidence = {"who": name, "waiting_since": since, "time": time}
        self._worst.note(margin, time, who, evidence)

    def verdict(self) -> Verdict:
        """Give the verdict to date."""
        if self._missing:
            return unjudged("no_starvation", self._missing)
        return self._worst.verdict()
