"""The deadlock oracle: robots that wait for each other, or for something that never moves.

A robot is *lost* if every blocked-by edge of it leads to a lost robot or to something
permanent: a solid, a goal that cannot be reached, an idle robot, nothing at all. A deadlock
is a set of lost robots that wait only among themselves; robots that queue up behind it are
its victims, not its members: were a member taken away, the rest would go free.

How long a closed set must last before it counts depends on whether anything could still
resolve it. It is *hard* if no member has a way round the others (or they hold resources that
exclude each other): then a few seconds do. Otherwise a stack may still re-plan, as ours does
when a robot has been parked for 5 s, and the set is given longer.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.codec import quantity
from mrta_falsify.core.fleet import BlockedBy, Frame
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.core.world import CommsOutage, World
from mrta_falsify.specs.blocked_by import STILL_FOR, UNREACHABLE
from mrta_falsify.specs.free_space import FreeSpace
from mrta_falsify.specs.motion import Standstill
from mrta_falsify.specs.places import Places

EVALUATE_EVERY = 0.25  # s between two looks at the edges, as the tracker's
REOPENED_FOR = 0.6  # s a robot may look free before its time in a closed set starts anew
HARDNESS_FOR = 2.0  # s for which the answer "is there a way round" is kept
HUMAN_STILL = 0.3  # m, a person who stays within this stands


@dataclass(slots=True)
class _Closed:
    """A minimal closed set at one moment."""

    members: tuple[int, ...]
    onset: float  #: when its last member stopped [s]
    age: float  #: how long it has been closed [s]
    hard: bool


@dataclass(slots=True)
class _Found:
    """The deadlock that the verdict reports."""

    members: tuple[int, ...]
    first_seen: float  #: [s]
    evidence: dict[str, Any]


class NoDeadlock:
    """No set of robots waits for itself for longer than the patience.

    Robustness [s]: patience minus the age of the oldest closed set so far. The age of a soft
    set runs slower by ``patience / soft_patience``; a robot that merely waits for another one
    lowers robustness too, but never below half the patience, so that a search has a slope.
    """

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Options:
        """Times after which a closed set is a deadlock."""

        patience: float = quantity(above=0.0, unit="s", default=4.0)  #: nobody has a way round
        soft_patience: float = quantity(above=0.0, unit="s", default=15.0)  #: somebody may have
        human_patience: float = quantity(above=0.0, unit="s", default=30.0)  #: a person who stands
        robot_gap: float = quantity(above=0.0, unit="m", default=0.6)  #: needed to pass a robot

    def __init__(self, options: Options) -> None:
        self._options = options

    def start(self, world: World, dt: float) -> None:
        """Begin an episode."""
        robots = len(world.robots)
        self._world = world
        self._names = tuple(robot.name for robot in world.robots)
        self._stride = max(1, round(EVALUATE_EVERY / dt))
        self._still = Standstill(robots)
        self._space = FreeSpace(world)
        self._closed_since = np.full(robots, np.inf)
        self._closed_last = np.full(robots, -np.inf)
        self._hardness: dict[tuple[int, ...], tuple[float, bool]] = {}
        self._human_place = np.full((len(world.humans), 2), np.inf)
        self._human_since = np.zeros(len(world.humans))
        self._worst = 0.0  # largest share of the patience used up
        self._longest_wait = 0.0
        self._violated_at: float | None = None
        self._found: list[_Found] = []

    def update(self, frame: Frame) -> None:
        """Take in one tick."""
        sensed = frame.sensed
        since = self._still.update(sensed.pose, sensed.time, frame.intent.goal)
        if sensed.tick % self._stride:
            return
        if len(self._human_since):
            self._watch_humans(sensed.human_position, sensed.time)
        if not frame.blocked_by:
            return
        time = sensed.time
        edges = _by_robot(frame.blocked_by)
        lost, permanent = self._lost(edges, frame)
        self._remember(lost, time)
        self._count_waits(edges, since, time)
        for members in _cores(lost, edges):
            closed = self._closed_set(members, edges, permanent, frame, since)
            patience = self._options.patience if closed.hard else self._options.soft_patience
            share = closed.age / patience
            self._worst = max(self._worst, share)
            if share > 1.0:
                self._report(closed, edges, lost, frame)

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

    # --- what never moves --------------------------------------------------------------

    def _lost(
        self, edges: dict[int, list[BlockedBy]], frame: Frame
    ) -> tuple[set[int], set[BlockedBy]]:
        """Robots without hope, by striking out those that wait for something that may move."""
        time = frame.sensed.time
        idle = {i for i, own in edges.items() if own[0].cause == "task"}
        permanent = {
            edge
            for own in edges.values()
            for edge in own
            if edge.cause != "task" and self._is_permanent(edge, idle, time)
        }
        cut_off = self._in_outage(time)
        lost = {i for i in edges if i not in idle and i not in cut_off}
        while True:
            hopeful = {
                i
                for i in lost
                if any(
                    edge not in permanent and (edge.cause == "human" or edge.other not in lost)
                    for edge in edges[i]
                )
            }
            if not hopeful:
                return lost, permanent
            lost -= hopeful

    def _is_permanent(self, edge: BlockedBy, idle: set[int], time: float) -> bool:
        if edge.cause == "human":
            human = self._world.humans[edge.other]
            stands = len(human.route) == 1 or human.speed == 0.0
            if stands:
                return human.leaves_at >= self._world.horizon
            return bool(time - self._human_since[edge.other] > self._options.human_patience)
        if edge.other >= 0:
            return edge.other in idle
        return not (edge.resource and self._space.is_temporary(edge.resource))

    def _in_outage(self, time: float) -> set[int]:
        """Robots whose links are down and will come up again before the horizon."""
        cut: set[str] = set()
        for event in self._world.events:
            if not isinstance(event, CommsOutage) or event.end >= self._world.horizon:
                continue
            if event.start <= time < event.end:
                cut.update(event.robots or self._names)
        return {i for i, name in enumerate(self._names) if name in cut}

    def _watch_humans(self, position: Array, time: float) -> None:
        moved = ~(np.hypot(*(position - self._human_place).T) <= HUMAN_STILL)
        self._human_place[moved] = position[moved]
        self._human_since[moved] = time

    # --- how long, how hard ------------------------------------------------------------

    def _remember(self, lost: set[int], time: float) -> None:
        for i in lost:
            if time - self._closed_last[i] > REOPENED_FOR:
                self._closed_since[i] = time
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
        chosen = list(members)
        onset = float(since[chosen].max())
        closed_for = time - float(self._closed_since[chosen].max()) + STILL_FOR
        hard = self._is_hard(members, edges, permanent, frame)
        return _Closed(members, onset, min(time - onset, closed_for), hard)

    def _is_hard(
        self,
        members: tuple[int, ...],
        edges: dict[int, list[BlockedBy]],
        permanent: set[BlockedBy],
        frame: Frame,
    ) -> bool:
        time = frame.sensed.time
        asked_at, answer = self._hardness.get(members, (-np.inf, False))
        if time - asked_at < HARDNESS_FOR:
            return answer
        shown = [edge for i in members for edge in edges[i]]
        idle = {edge.other for edge in shown if edge in permanent and edge.cause != "human"}
        bodies = (set(members) | idle) - {-1}
        answer = all(self._has_no_way_out(i, edges[i], bodies, frame) for i in members)
        self._hardness[members] = (time, answer)
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
        others = {e.other for e in shown if e.cause != "human"} - lost - {-1}
        place = frame.sensed.pose[list(closed.members), :2].mean(axis=0)
        near, distance = Places(self._world).nearest_name(place)
        evidence: dict[str, Any] = {
            "members": [names[i] for i in closed.members],
            "cycle": [self._shown_edge(edge) for edge in shown],
            "victims": [names[i] for i in sorted(_waiting_on(closed.members, lost, edges))],
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
        }
        self._found.append(_Found(closed.members, time, evidence))

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


def _by_robot(edges: Iterable[BlockedBy]) -> dict[int, list[BlockedBy]]:
    grouped: dict[int, list[BlockedBy]] = {}
    for edge in edges:
        grouped.setdefault(edge.robot, []).append(edge)
    return grouped


def _reach(start: int, lost: set[int], edges: dict[int, list[BlockedBy]]) -> set[int]:
    """Lost robots that ``start`` waits for, directly or through others."""
    reached: set[int] = set()
    border = [start]
    while border:
        for edge in edges[border.pop()]:
            if edge.cause != "human" and edge.other in lost and edge.other not in reached:
                reached.add(edge.other)
                border.append(edge.other)
    return reached


def _cores(lost: set[int], edges: dict[int, list[BlockedBy]]) -> list[tuple[int, ...]]:
    """Smallest closed sets: strongly connected components that no edge leaves."""
    reach = {i: _reach(i, lost, edges) for i in sorted(lost)}
    cores = {tuple(sorted(reach[i] | {i})) for i in reach if all(i in reach[j] for j in reach[i])}
    return sorted(cores)


def _waiting_on(
    members: tuple[int, ...], lost: set[int], edges: dict[int, list[BlockedBy]]
) -> set[int]:
    core = set(members)
    return {i for i in lost - core if _reach(i, lost, edges) & core}
