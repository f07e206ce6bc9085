"""The deadlock oracle: robots that wait for each other, or for something that never moves.

A robot is *stuck* if every blocked-by edge of it leads to a stuck robot or to something
permanent: a solid (furniture on wheels once it has rested as long as a person who stands), a
goal that cannot be reached, an idle robot, nothing at all. A deadlock is a knot: a set of stuck
robots that wait only among themselves. Robots that queue up behind it are its victims, not its
members: were a member taken away, the rest would go free.

Where possible, the run itself tells whether a knot is a deadlock (see
:class:`~mrta_falsify.core.protocols.Forecast`). A copy of the run continues without anything new
from outside, until all are at rest, or for four minutes. A set that gets going again is no
deadlock. For a set that does not, counterfactuals without one robot each tell its members: those
without whom the others go free.

Without forecasts (a recorded trace, a system that cannot copy a process) patience decides. How
long a knot must last before it counts then depends on whether anything could still resolve it.
A hard knot counts after a few seconds, unless robots stand in each other's way: they may still
back off, which neither motion nor geometry rules out. Those, and knots that are not hard, are
given longer, since a stack may re-plan, as ours does when a robot has been parked for 5 s.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Any

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.codec import quantity
from mrta_falsify.core.fleet import Frame
from mrta_falsify.core.protocols import Forecast
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.core.world import World
from mrta_falsify.specs.deadlock.blocked_by import EDGES_EVERY
from mrta_falsify.specs.deadlock.counterfactual import CounterfactualTest
from mrta_falsify.specs.deadlock.evidence import Deadlock, deadlock_evidence
from mrta_falsify.specs.deadlock.patience import Hardness, Patience
from mrta_falsify.specs.deadlock.permanence import Permanence
from mrta_falsify.specs.deadlock.reduction import ReducedGraph
from mrta_falsify.specs.deadlock.standstill import Standstill
from mrta_falsify.specs.deadlock.stuck_clock import StuckClock
from mrta_falsify.specs.deadlock.suspects import AskAfter, find_suspects
from mrta_falsify.specs.deadlock.wait_graph import (
    EdgesByRobot,
    awaited_by,
    edges_by_robot,
    knots_of,
    victims_of,
)

UNCONFIRMED = 0.95  # of the patience is all that a knot can use up before a forecast confirms it
SHUFFLE_PATIENCE = 1.5  # times the soft patience, for knots that only shuffle


class NoDeadlock:
    """No set of robots waits for itself for good.

    Robustness [s]: patience minus the age of the oldest knot so far. The age of a soft knot runs
    slower by ``patience / soft_patience``. A robot that merely waits for another one lowers
    robustness too, but never below half the patience, so that a search has a slope. Where there
    are forecasts, only a deadlock that one confirmed takes it below 0.
    """

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Options:
        """Times after which a knot is a deadlock, or is asked about in a forecast."""

        patience: float = quantity(above=0.0, unit="s", default=4.0)  #: no member has a way round
        soft_patience: float = quantity(above=0.0, unit="s", default=15.0)  #: a member may have
        idle_patience: float = quantity(above=0.0, unit="s", default=12.0)  #: behind an idle robot
        human_patience: float = quantity(above=0.0, unit="s", default=30.0)  #: a person who stands
        robot_gap: float = quantity(above=0.0, unit="m", default=0.6)  #: needed to pass a robot
        #: a robot stuck, or standing, for so long is asked about in a forecast
        ask_closed: float = quantity(above=0.0, unit="s", default=1.5)
        ask_standing: float = quantity(above=0.0, unit="s", default=20.0)
        #: so is a robot that has stood for so long with nothing but people in its way
        ask_behind: float = quantity(above=0.0, unit="s", default=3.0)
        look_ahead: float = quantity(above=0.0, unit="s", default=240.0)  #: of a forecast, at most

    def __init__(self, options: Options) -> None:
        self._options = options
        self._patience = Patience(
            hard=options.patience, behind_idle=options.idle_patience, soft=options.soft_patience
        )
        self._ask_after = AskAfter(
            stuck=options.ask_closed,
            standing=options.ask_standing,
            behind_people=options.ask_behind,
        )

    def start(self, world: World, dt: float) -> None:
        """Begin an episode."""
        robots = len(world.robots)
        self._world = world
        self._stride = max(1, round(EDGES_EVERY / dt))
        self._standstill = Standstill(robots)
        self._stuck_clock = StuckClock(robots)
        self._permanence = Permanence(world, self._options.human_patience)
        self._hardness = Hardness(world, self._options.robot_gap)
        self._test = CounterfactualTest(world)
        self._forecast: Forecast | None = None
        self._used_up = 0.0  # largest share of the patience
        self._longest_wait = 0.0
        self._violated_at: float | None = None
        self._found: list[Deadlock] = []
        self._evidence: list[dict[str, Any]] = []

    def foresee(self, forecast: Forecast) -> None:
        """See :class:`mrta_falsify.core.protocols.Foreseeing`."""
        self._forecast = forecast

    def update(self, frame: Frame) -> None:
        """Take in one tick."""
        sensed = frame.sensed
        since = self._standstill.update(sensed.pose, sensed.time, frame.intent.goal)
        if sensed.tick % self._stride:
            return
        self._permanence.update(sensed)
        if self._forecast is not None:
            self._test.update(frame)
        if not frame.blocked_by:
            return
        graph = self._permanence.reduce(edges_by_robot(frame.blocked_by), sensed.time)
        self._stuck_clock.update(graph.stuck, sensed.pose[:, :2], sensed.time)
        self._count_waits(graph.edges, since, sensed.time)
        if self._forecast is not None:
            self._judge_by_forecast(self._forecast, graph, frame, since)
        self._judge_by_patience(graph, frame, since)

    def verdict(self) -> Verdict:
        """Give the verdict to date."""
        patience = self._options.patience
        wait = self._longest_wait
        share = max(self._used_up, 0.5 * wait / (wait + self._options.soft_patience))
        robustness = patience * (1.0 - share)
        if not self._found:
            return Verdict(spec="no_deadlock", robustness=max(robustness, 0.0), violated=False)
        first, *others = self._evidence
        return Verdict(
            spec="no_deadlock",
            robustness=min(robustness, -1e-9),
            violated=True,
            violated_at=self._violated_at,
            who=tuple(first["members"]),
            evidence={**first, "others": others},
        )

    def _count_waits(self, edges: EdgesByRobot, since: Array, time: float) -> None:
        for i, own in edges.items():
            if any(edge.other >= 0 and edge.cause != "human" for edge in own):
                self._longest_wait = max(self._longest_wait, time - float(since[i]))

    def _judge_by_forecast(
        self, forecast: Forecast, graph: ReducedGraph, frame: Frame, since: Array
    ) -> None:
        """Ask for a forecast if a robot may be stuck about which nothing is known yet."""
        time = frame.sensed.time
        known = {i for deadlock in self._found for i in deadlock.robots}
        suspects = find_suspects(
            graph,
            self._stuck_clock.stuck_for(time),
            time - since,
            self._ask_after,
            is_last=time > self._world.horizon - EDGES_EVERY,
        )
        asked = {
            i
            for i in suspects - known
            if self._test.free_until[i] <= time
            and not awaited_by(i, graph.edges, graph.edges) & known
        }
        if not asked:
            return
        for members, robots in self._test.deadlocks(
            forecast, asked, time, self._options.look_ahead
        ):
            if not known & set(robots):
                victims = frozenset(robots) - set(members)
                deadlock = self._deadlock(members, victims, graph, frame, since)
                age = time - deadlock.onset
                self._used_up = max(self._used_up, 1.0 + age / self._options.patience)
                self._report(deadlock, graph.stuck, frame)

    def _judge_by_patience(self, graph: ReducedGraph, frame: Frame, since: Array) -> None:
        """Let knots use up patience; without forecasts, report those that used up all of it."""
        time, soft_patience = frame.sensed.time, self._options.soft_patience
        for members in knots_of(graph.stuck, graph.edges):
            victims = victims_of(members, graph.stuck, graph.edges)
            deadlock = self._deadlock(members, victims, graph, frame, since)
            edges = [edge for own in deadlock.knot.values() for edge in own]
            patience = self._patience.of_knot(edges, graph.permanent, hard=deadlock.hard)
            shuffled_for = self._stuck_clock.shuffled_for(members, time)
            share = max(
                (time - deadlock.onset) / patience,
                shuffled_for / (SHUFFLE_PATIENCE * soft_patience),
            )
            if self._forecast is not None:
                share = min(share, UNCONFIRMED)
            self._used_up = max(self._used_up, share)
            if share > 1.0:
                self._report(deadlock, graph.stuck, frame)

    def _deadlock(
        self,
        members: tuple[int, ...],
        victims: frozenset[int],
        graph: ReducedGraph,
        frame: Frame,
        since: Array,
    ) -> Deadlock:
        knot = {i: graph.edges.get(i, []) for i in members}
        return Deadlock(
            knot=knot,
            victims=victims,
            onset=self._stuck_clock.onset(members, since),
            hard=self._hardness.is_hard(knot, graph.permanent, frame),
            confirmed=self._forecast is not None,
        )

    def _report(self, deadlock: Deadlock, stuck: Collection[int], frame: Frame) -> None:
        if self._violated_at is None:
            self._violated_at = frame.sensed.time
        if any(set(known.members) & set(deadlock.members) for known in self._found):
            return
        self._found.append(deadlock)
        self._evidence.append(deadlock_evidence(deadlock, stuck, self._world, frame))
