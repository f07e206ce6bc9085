"""Liveness: no livelock, steady progress, no starvation.

Robustness is a time [s]: patience minus the longest time without what is asked for.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.codec import quantity
from mrta_falsify.core.fleet import BlockedBy, Frame, StackEvent
from mrta_falsify.core.protocols import Forecast
from mrta_falsify.core.spec_profile import SpecProfile
from mrta_falsify.core.verdict import Verdict, unjudged
from mrta_falsify.core.world import World
from mrta_falsify.specs.approach import LIVENESS_EVERY, ApproachMargin
from mrta_falsify.specs.books import Ledger
from mrta_falsify.specs.deadlock.counterfactual import LOOK_AHEAD, CounterfactualTest
from mrta_falsify.specs.deadlock.progress_clock import ProgressClock
from mrta_falsify.specs.deadlock.standstill import Standstill
from mrta_falsify.specs.holds import Holds, kind_of
from mrta_falsify.specs.running_min import RunningMin
from mrta_falsify.specs.suspicion import UNCONFIRMED, awaits_an_end, suspected

TRAVEL_SCALE = 0.05  # m; driving less by this counts as safer by 1 s


class NoLivelock(ApproachMargin):
    """No livelock: no robot keeps driving and never gets nearer to its goal.

    A robot is suspected once it has driven at least ``min_travel`` and for ``patience`` without net
    progress. It is in a livelock if a continuation of the run shows that it makes no progress
    any more, by the rules of :class:`~mrta_falsify.specs.deadlock.oracle.NoDeadlock`, and still
    drives. Any other answer starts its clock anew: a long detour is none, nor is a robot that
    comes to a standstill. Without continuations a livelock is suspected at most, not judged.

    Robustness [s]: patience minus the longest time in which a robot drove at least
    ``min_travel`` without net progress; driving less counts as safer by 1 s per 5 cm. All but 5 %
    of the patience can be lost before a continuation decides.
    """

    profile = SpecProfile(
        meaning="a robot kept driving without getting closer to its goal",
        scale=60.0,
        role="standstill",
        tie=9,
    )

    _spec = "no_livelock"

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Options:
        """What counts as driving in vain."""

        patience: float = quantity(above=0.0, unit="s", default=60.0)
        min_travel: float = quantity(above=0.0, unit="m", default=5.0)  #: driven in that time
        step: float = quantity(above=0.0, unit="m", default=0.5)  #: nearer by this: progress
        look_ahead: float = quantity(above=0.0, unit="s", default=LOOK_AHEAD)  #: at most

    def __init__(self, options: Options) -> None:
        super().__init__(options.patience, options.step)
        self._min_travel, self._look_ahead = options.min_travel, options.look_ahead

    def start(self, world: World, dt: float) -> None:
        """Begin an episode."""
        super().start(world, dt)
        self._world = world
        self._progress = ProgressClock(world)
        self._test = CounterfactualTest(world, dt, self._progress, self._look_ahead)
        self._forecast: Forecast | None = None
        self._confirmed: dict[int, float] = {}  # since when each robot drives in vain [s]
        self._suspected: Verdict | None = None

    def foresee(self, forecast: Forecast) -> None:
        """See :class:`mrta_falsify.core.protocols.Foreseeing`."""
        self._forecast = forecast

    def verdict(self) -> Verdict:
        """Give the verdict to date."""
        if self._missing or self._suspected is None:
            return super().verdict()
        return self._suspected

    def _look(self, frame: Frame) -> None:
        self._progress.update(frame)
        since = self._approach.since
        self._confirmed = {i: at for i, at in self._confirmed.items() if at == since[i]}
        spent = set((self._spare(frame.sensed.time) < 0.0).nonzero()[0].tolist())
        if self._forecast is None:
            self._suspect(spent, frame)
        elif spent - set(self._confirmed):
            self._ask(self._forecast, spent - set(self._confirmed), frame.sensed.time)

    def _ask(self, forecast: Forecast, asked: set[int], time: float) -> None:
        """Ask which of ``asked`` drive in vain for good; the clocks of the others start anew."""
        last, driven, _ = self._test.prospect(forecast, asked, time)
        for i in asked:
            is_stuck = last.get(i, np.inf) <= time
            if is_stuck and driven.get(i, 0.0) >= self._min_travel:
                self._confirmed[i] = float(self._approach.since[i])
            else:
                self._approach.restart(i, time)

    def _suspect(self, spent: set[int], frame: Frame) -> None:
        """Suspect a livelock where no forecast can tell, or drop a suspicion."""
        self._suspected = None
        if not spent or awaits_an_end(self._world, frame.sensed.time):
            return
        first = min(spent, key=lambda i: (self._approach.since[i], i))
        self._suspected = suspected(
            self._spec,
            "a livelock",
            who=tuple(self._names[i] for i in sorted(spent)),
            evidence=self._evidence_of(first, frame),
        )

    def _spare(self, time: float) -> Array:
        """Compute what is left of the patience of each robot, ``(N,)`` [s]; below 0: nothing."""
        idle = (self._min_travel - self._approach.travelled) / TRAVEL_SCALE
        return np.maximum(super()._margins(time), idle)

    def _margins(self, time: float) -> Array:
        spare = self._spare(time)
        margins = np.maximum(spare, (1.0 - UNCONFIRMED) * self._patience)
        for i in self._confirmed:
            margins[i] = spare[i]
        return margins

    def _seen(self, i: int, frame: Frame) -> dict[str, Any]:
        x, y = frame.sensed.pose[i, :2]
        travelled = float(self._approach.travelled[i])
        confirmed = i in self._confirmed
        return {"travelled": travelled, "x": float(x), "y": float(y), "confirmed": confirmed}


class SteadyProgress(ApproachMargin):
    """Every robot with a goal gets nearer to it by ``step`` within each ``window``.

    This is a bound on time, not a claim about liveness. A robot that comes nearer one second after
    the window has violated it, whatever it does next; ``no_livelock`` and ``no_deadlock`` claim
    that a robot never gets there. Robots at their goal (served, or waiting at their spot) are
    exempt: queues are judged by ``no_starvation`` and ``no_deadlock``. Robustness [s]: window
    minus the longest time without such progress. The evidence tells how long the robot was held in
    that time, and by whom or what (:class:`~mrta_falsify.specs.holds.Holds`); ``held_by`` are the
    kinds at its last instant.
    """

    profile = SpecProfile(
        meaning="a robot with work made no progress", scale=60.0, role="standstill", tie=11
    )

    _spec = "progress"

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Options:
        """How much progress in how much time."""

        window: float = quantity(above=0.0, unit="s", default=90.0)
        step: float = quantity(above=0.0, unit="m", default=0.3)

    def __init__(self, options: Options) -> None:
        super().__init__(options.window, options.step)

    def start(self, world: World, dt: float) -> None:
        """Begin an episode."""
        super().start(world, dt)
        self._holds = Holds(world)

    def update(self, frame: Frame) -> None:
        """Take in one tick."""
        self._holds.update(frame.blocked_by, frame.sensed.time, self._approach.since)
        super().update(frame)

    def _look(self, frame: Frame) -> None:
        self._holds.forget(self._approach.since)

    def _seen(self, i: int, frame: Frame) -> dict[str, Any]:
        held = self._holds.evidence(i, frame.sensed.time)
        return {"held_by": held_by(i, frame.blocked_by), **held}


def held_by(robot: int, edges: Iterable[BlockedBy]) -> list[str]:
    """Name the kinds of what holds a robot: person, robot, solid; none: nothing that is seen."""
    return sorted({kind_of(edge) for edge in edges if edge.robot == robot} - {""})


class NoStarvation:
    """No robot and no task waits without end while others are served.

    A robot with a goal starves if it has not left its place for ``robot_patience`` while another
    one served a stop. A task starves if it was not picked up for ``task_patience`` although one
    that arrived later was. Robustness [s]: the smaller margin of the two, scaled to
    ``robot_patience``.
    """

    profile = SpecProfile(
        meaning="a robot went on waiting while later ones were served",
        scale=120.0,
        role="standstill",
        tie=10,
    )

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
        self._ledger, self._missing = Ledger(world), ""
        self._last_served = -np.inf  # latest arrival of a task that was picked up [s]
        self._worst = RunningMin("no_starvation", self._options.robot_patience)

    def update(self, frame: Frame) -> None:
        """Take in one tick."""
        sensed = frame.sensed
        self._missing = "" if all(frame.tells) else frame.tells.lacking("deliveries", "goals")
        if frame.confirmed:
            self._enter(frame.confirmed, sensed.time)
        if sensed.tick % self._stride or not len(self._names):
            return
        since = self._standstill.update(sensed.pose, sensed.time)
        no_goal = ~np.isfinite(frame.intent.goal[:, 0])
        self._waiting_since[no_goal] = sensed.time
        self._waiting_since = np.maximum(self._waiting_since, since)
        self._waiting_since = np.maximum(self._waiting_since, self._last_stop)
        self._judge_robots(sensed.time)
        if self._ledger.picked:
            self._judge_tasks(sensed.time)

    def _enter(self, confirmed: Sequence[StackEvent], time: float) -> None:
        """Take in stops that the books hold."""
        self._ledger.enter(confirmed, time)
        for stop in confirmed:
            self._last_stop[stop.robot] = time
        arrivals = [self._world.tasks[i].arrival for i in self._ledger.picked]
        self._last_served = max(arrivals, default=-np.inf)

    def _judge_robots(self, time: float) -> None:
        i = int(self._waiting_since.argmin())
        since = float(self._waiting_since[i])
        others = np.delete(self._last_stop, i)
        if len(others) and others.max() > since:
            margin = self._options.robot_patience - (time - since)
            self._note(margin, self._names[i], since, time)

    def _judge_tasks(self, time: float) -> None:
        picked = self._ledger.picked
        scale = self._options.robot_patience / self._options.task_patience
        for i, task in enumerate(self._world.tasks):
            if i not in picked and task.arrival < self._last_served:
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
