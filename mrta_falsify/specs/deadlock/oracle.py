"""The deadlock oracle: robots that wait for each other, or for something that never moves.

A robot is *lost* if every blocked-by edge of it leads to a lost robot or to something
permanent: a solid (furniture on wheels once it has rested as long as a person who stands), a
goal that cannot be reached, an idle robot, nothing at all. A deadlock is a set of lost robots
that wait only among themselves; robots that queue up behind it are its victims, not its
members: were a member taken away, the rest would go free.

Whether such a set is a deadlock is asked of the run itself where that is possible (see
:class:`~mrta_falsify.core.protocols.Forecast`): a copy of it goes on, without anything new from
outside, until all are at rest, or for four minutes. A set that gets going again is none. Of one
that does not, further copies without one robot each tell its members: those without whom the
others go free.

Without forecasts (a recorded trace, a system that cannot copy a process) it is a matter of
patience. How long a closed set must last before it counts then depends on whether anything could
still resolve it. It is *hard* if no member has a way round the others, or they hold resources that
exclude each other. A hard set counts after a few seconds, unless robots stand in each other's
way: they may still back off, which neither motion nor geometry rules out. Those, and sets that
are not hard, are given longer, since a stack may re-plan, as ours does when a robot has been
parked for 5 s.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.codec import quantity
from mrta_falsify.core.fleet import BlockedBy, Frame
from mrta_falsify.core.protocols import Forecast
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.core.world import World
from mrta_falsify.specs.deadlock.blocked_by import STILL_FOR, UNREACHABLE
from mrta_falsify.specs.deadlock.counterfactual import Future
from mrta_falsify.specs.deadlock.goals import Places
from mrta_falsify.specs.deadlock.motion import Standstill
from mrta_falsify.specs.deadlock.occupancy import FreeSpace
from mrta_falsify.specs.deadlock.reduction import Hope
from mrta_falsify.specs.deadlock.wait_graph import (
    by_robot,
    cores_of,
    reach_of,
    waiting_on,
)

EVALUATE_EVERY = 0.25  # s between two looks at the edges, as the tracker's
REOPENED_FOR = 0.6  # s a robot may look free before its time in a closed set starts anew
#: what does not start the time of a soft set anew: shuffling, a new path, a turn on the spot
SHUFFLE = 0.3  # m
SHUFFLE_FOR = 4.0  # s of looking free
SHORT = 2.0  # s; who stands for less is hardly stuck
UNCONFIRMED = 0.95  # of the patience is all that a set can use up before a forecast confirms it
SHUFFLE_PATIENCE = 1.5  # times the soft patience, for sets that only shuffle
BODY_CELL = 0.05  # m, grid on which ways round are looked for
BODY_MARGIN = 0.03  # m beyond the robot's radius that any way needs on each side
HARDNESS_FOR = 2.0  # s for which the answer "is there a way round" is kept


@dataclass(slots=True)
class _Closed:
    """A minimal closed set at one moment."""

    members: tuple[int, ...]
    onset: float  #: when its last member stopped [s]
    age: float  #: how long it has been closed [s]
    hard: bool
    patience: float  #: for sets of its kind [s]


@dataclass(slots=True)
class _Found:
    """The deadlock that the verdict reports."""

    members: tuple[int, ...]
    group: tuple[int, ...]  #: with the robots that wait for them
    first_seen: float  #: [s]
    evidence: dict[str, Any]


class NoDeadlock:
    """No set of robots waits for itself for good.

    Robustness [s]: patience minus the age of the oldest closed set so far. The age of a soft
    set runs slower by ``patience / soft_patience``; a robot that merely waits for another one
    lowers robustness too, but never below half the patience, so that a search has a slope.
    Where there are forecasts, only a deadlock that one confirmed takes it below 0.
    """

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Options:
        """Times after which a closed set is a deadlock."""

        patience: float = quantity(above=0.0, unit="s", default=4.0)  #: nobody has a way round
        soft_patience: float = quantity(above=0.0, unit="s", default=15.0)  #: somebody may have
        idle_patience: float = quantity(above=0.0, unit="s", default=12.0)  #: behind an idle robot
        human_patience: float = quantity(above=0.0, unit="s", default=30.0)  #: a person who stands
        robot_gap: float = quantity(above=0.0, unit="m", default=0.6)  #: needed to pass a robot
        #: a set closed, or a robot standing, for so long is asked about in a forecast
        ask_closed: float = quantity(above=0.0, unit="s", default=1.5)
        ask_standing: float = quantity(above=0.0, unit="s", default=20.0)
        #: a robot that has stood for so long with nothing but people in its way, too
        ask_behind: float = quantity(above=0.0, unit="s", default=3.0)
        look_ahead: float = quantity(above=0.0, unit="s", default=240.0)  #: of a forecast, at most

    def __init__(self, options: Options) -> None:
        self._options = options

    def start(self, world: World, dt: float) -> None:
        """Begin an episode."""
        robots = len(world.robots)
        self._world = world
        self._names = tuple(robot.name for robot in world.robots)
        self._stride = max(1, round(EVALUATE_EVERY / dt))
        self._still = Standstill(robots)
        radius = min((robot.radius for robot in world.robots), default=0.0)
        self._space = FreeSpace(world, cell=BODY_CELL, clearance=radius + BODY_MARGIN)
        self._stuck_since = np.full(robots, np.inf)
        self._stuck_at = np.full((robots, 2), np.inf)
        self._closed_since = np.full(robots, np.inf)
        self._closed_last = np.full(robots, -np.inf)
        self._hardness: dict[frozenset[BlockedBy], tuple[float, bool]] = {}
        self._hope = Hope(world, self._space, self._options.human_patience)
        self._forecast: Forecast | None = None
        self._future = Future(world)
        self._worst = 0.0  # largest share of the patience used up
        self._longest_wait = 0.0
        self._violated_at: float | None = None
        self._found: list[_Found] = []

    def foresee(self, forecast: Forecast) -> None:
        """See :class:`mrta_falsify.core.protocols.Foreseeing`."""
        self._forecast = forecast

    def update(self, frame: Frame) -> None:
        """Take in one tick."""
        sensed = frame.sensed
        since = self._still.update(sensed.pose, sensed.time, frame.intent.goal)
        if sensed.tick % self._stride:
            return
        self._hope.note(sensed)
        if self._forecast is not None:
            self._future.note(frame)
        if not frame.blocked_by:
            return
        time = sensed.time
        self._space.furnish(sensed.furniture_pose)
        edges = by_robot(frame.blocked_by)
        lost, permanent = self._hope.lost(edges, time)
        self._remember(lost, sensed.pose[:, :2], time)
        self._count_waits(edges, since, time)
        if self._forecast is not None:
            self._look_ahead(self._forecast, lost, edges, permanent, frame, since)
        for members in cores_of(lost, edges):
            closed = self._closed_set(members, edges, permanent, frame, since)
            stuck_for = time - float(self._stuck_since[list(members)].max())
            shuffling = stuck_for / (SHUFFLE_PATIENCE * self._options.soft_patience)
            share = max(closed.age / closed.patience, shuffling)
            if self._forecast is not None:
                share = min(share, UNCONFIRMED)
            self._worst = max(self._worst, share)
            if share > 1.0:
                self._report(closed, waiting_on(members, lost, edges), edges, lost, frame)

    def verdict(self) -> Verdict:
        """Verdict to date."""
        patience = self._options.patience
        wait = self._longest_wait
        share = max(self._worst, 0.5 * wait / (wait + self._options.soft_patience))
        robustness = patience * (1.0 - share)
        if not self._found:
            return Verdict(spec="no_deadlock", robustness=max(robustness, 0.0), violated=False)
        first = self._found[0]
        evidence = dict(first.evidence)
        evidence["others"] = [found.evidence for found in self._found[1:]]
        return Verdict(
            spec="no_deadlock",
            robustness=min(robustness, -1e-9),
            violated=True,
            violated_at=self._violated_at,
            who=tuple(self._names[i] for i in first.members),
            evidence=evidence,
        )

    # --- what a copy of the run says ---------------------------------------------------

    def _look_ahead(
        self,
        forecast: Forecast,
        lost: set[int],
        edges: dict[int, list[BlockedBy]],
        permanent: set[BlockedBy],
        frame: Frame,
        since: Array,
    ) -> None:
        """Ask for a forecast if somebody may be stuck about whom nothing is known yet."""
        time, options = frame.sensed.time, self._options
        is_last = time > self._world.horizon - EVALUATE_EVERY
        known = {i for found in self._found for i in found.group}
        closed_for = time - self._closed_since + STILL_FOR
        stands_for = time - since
        busy = {i for i, own in edges.items() if own[0].cause != "task"}
        asked = {i for i in lost if is_last or closed_for[i] > options.ask_closed}
        patience = SHORT if is_last else options.ask_standing
        asked |= {i for i in busy if stands_for[i] > patience}
        behind = {i for i in busy if all(edge.cause == "human" for edge in edges[i])}
        asked |= {i for i in behind if stands_for[i] > options.ask_behind}
        asked = {
            i
            for i in asked - known
            if self._future.free_at[i] <= time and not reach_of(i, set(edges), edges) & known
        }
        if not asked:
            return
        groups = self._future.deadlocks(forecast, asked, time, options.look_ahead)
        for members, group in groups:
            if known & set(group):
                continue
            shown = {i: edges.get(i, []) for i in group}
            onset = self._onset(members, since)
            hard = self._is_hard(members, shown, permanent, frame)
            closed = _Closed(members, onset, time - onset, hard, options.patience)
            self._worst = max(self._worst, 1.0 + closed.age / options.patience)
            self._report(closed, set(group) - set(members), shown, lost, frame)

    # --- how long, how hard ------------------------------------------------------------

    def _remember(self, lost: set[int], position: Array, time: float) -> None:
        for i in lost:
            free_for = time - self._closed_last[i]
            if free_for > REOPENED_FOR:
                self._closed_since[i] = time
            moved = not np.hypot(*(position[i] - self._stuck_at[i])) <= SHUFFLE
            if moved or free_for > SHUFFLE_FOR:
                self._stuck_since[i], self._stuck_at[i] = time, position[i]
            self._closed_last[i] = time

    def _count_waits(self, edges: dict[int, list[BlockedBy]], since: Array, time: float) -> None:
        for i, own in edges.items():
            if any(edge.other >= 0 and edge.cause != "human" for edge in own):
                self._longest_wait = max(self._longest_wait, time - float(since[i]))

    def _closed_set(
        self,
        members: tuple[int, ...],
        edges: dict[int, list[BlockedBy]],
        permanent: set[BlockedBy],
        frame: Frame,
        since: Array,
    ) -> _Closed:
        time = frame.sensed.time
        onset = self._onset(members, since)
        hard = self._is_hard(members, edges, permanent, frame)
        return _Closed(
            members=members,
            onset=onset,
            age=time - onset,
            hard=hard,
            patience=self._patience(members, edges, permanent, hard=hard),
        )

    def _onset(self, members: tuple[int, ...], since: Array) -> float:
        """When the last of ``members`` stopped and began to wait for the others [s]."""
        chosen = list(members)
        closed = self._closed_since[chosen]
        began = closed[np.isfinite(closed)].max(initial=STILL_FOR) - STILL_FOR
        return float(max(since[chosen].max(), began))

    def _patience(
        self,
        members: tuple[int, ...],
        edges: dict[int, list[BlockedBy]],
        permanent: set[BlockedBy],
        *,
        hard: bool,
    ) -> float:
        """How long such a set must last.

        No way round does not mean no way back: robots that stand before each other may still
        back off, and an idle one may be sent out of the way. Only what no robot can mend by
        moving (a goal that solids cut off, a circle of held resources) counts at once.
        """
        shown = [edge for i in members for edge in edges[i]]
        in_the_way = any(edge.cause == "barrier" and edge not in permanent for edge in shown)
        if not hard or in_the_way:
            return self._options.soft_patience
        behind_idle = any(
            edge.other >= 0 and edge.cause != "human" and edge in permanent for edge in shown
        )
        return self._options.idle_patience if behind_idle else self._options.patience

    def _is_hard(
        self,
        members: tuple[int, ...],
        edges: dict[int, list[BlockedBy]],
        permanent: set[BlockedBy],
        frame: Frame,
    ) -> bool:
        time = frame.sensed.time
        shown = [edge for i in members for edge in edges[i]]
        asked_at, answer = self._hardness.get(frozenset(shown), (-np.inf, False))
        if time - asked_at < HARDNESS_FOR:
            return answer
        idle = {edge.other for edge in shown if edge in permanent and edge.cause != "human"}
        bodies = (set(members) | idle) - {-1}
        answer = all(self._has_no_way_out(i, edges[i], bodies, frame) for i in members)
        self._hardness[frozenset(shown)] = (time, answer)
        return answer

    def _has_no_way_out(self, i: int, own: list[BlockedBy], bodies: set[int], frame: Frame) -> bool:
        for edge in own:
            if edge.cause == "queue" or edge.resource == UNREACHABLE:
                return True
            if edge.cause in ("human", "cluster", "stalled") or (
                edge.cause == "wall" and not edge.resource
            ):
                return False
        position = frame.sensed.pose[:, :2]
        return not self._space.reachable(
            position[i],
            frame.intent.goal[i],
            frame.sensed.time,
            others=position[sorted(bodies - {i})],
            gap=self._options.robot_gap,
        )

    # --- the report --------------------------------------------------------------------

    def _report(
        self,
        closed: _Closed,
        victims: set[int],
        edges: dict[int, list[BlockedBy]],
        lost: set[int],
        frame: Frame,
    ) -> None:
        time = frame.sensed.time
        if self._violated_at is None:
            self._violated_at = time
        if any(set(found.members) & set(closed.members) for found in self._found):
            return
        names = self._names
        shown = [edge for i in closed.members for edge in edges[i]]
        within = lost | victims | set(closed.members)
        others = {e.other for e in shown if e.cause != "human"} - within - {-1}
        place = frame.sensed.pose[list(closed.members), :2].mean(axis=0)
        near, distance = Places(self._world).nearest_name(place)
        evidence: dict[str, Any] = {
            "members": [names[i] for i in closed.members],
            "cycle": [self._shown_edge(edge) for edge in shown],
            "victims": [names[i] for i in sorted(victims)],
            "blockers": sorted(names[i] for i in others),
            "place": {
                "x": float(place[0]),
                "y": float(place[1]),
                "near": near,
                "distance": distance,
            },
            "onset": closed.onset,
            "detected_at": time,
            "hard": closed.hard,
            "confirmed": self._forecast is not None,
        }
        group = (*closed.members, *sorted(victims))
        self._found.append(_Found(closed.members, group, time, evidence))

    def _shown_edge(self, edge: BlockedBy) -> dict[str, str]:
        other = ""
        if edge.other >= 0:
            human = edge.cause == "human"
            other = self._world.humans[edge.other].name if human else self._names[edge.other]
        return {
            "robot": self._names[edge.robot],
            "cause": edge.cause,
            "blocked_by": other,
            "resource": edge.resource,
        }
