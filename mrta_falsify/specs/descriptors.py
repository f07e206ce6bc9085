"""Behaviour descriptors for the search: what kind of trouble a run came closest to.

A quality-diversity search keeps one elite per kind of behaviour. The descriptors say which kind a
run showed. All of them lie in [0, 1] and exist for every run, failing or not:

    ``x``, ``y``: where on the floor the worst wait took place (or the narrowest passing of
        two robots, if no robot waited), as a share of the bounds;
    ``robots``: how many robots were blocked at the worst moment, as a share of the fleet;
    ``cause``: what blocked the robot that waited longest, by ``CAUSES``;
    ``wait``: how long it waited, 60 s or more being 1;
    ``cycle``, ``encroachment``: how near it came to a deadlock (:mod:`.near_deadlock`);
    the loads of the run (:mod:`.loads`).

Beside them stand the situations of a run (:mod:`.situations`), and who took part when it was
nearest to a deadlock: what a search changes first.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.feedback import ENCROACHMENT_COUNTS, LOADS
from mrta_falsify.core.fleet import BlockedBy, Frame, Phase
from mrta_falsify.core.world import World
from mrta_falsify.specs.deadlock.place_kind import kind_of_place
from mrta_falsify.specs.loads import Loads
from mrta_falsify.specs.near_deadlock import AlmostCycles, Encroachments, chain_role
from mrta_falsify.specs.waits import in_cycles, waits_of

#: events that any run has
EVERYDAY = frozenset(("waypoint", "assigned", "allocated", "picked-up", "dropped-off", "joined"))


@dataclass(slots=True)
class Situations:
    """Folds frames into the set of situations of a run; one object per episode."""

    world: World
    seen: set[str] = field(default_factory=set)
    _edges: tuple[BlockedBy, ...] = ()

    def update_events(self, frame: Frame) -> None:
        """Take in the stack's decisions of a tick."""
        for event in frame.events:
            if event.kind not in EVERYDAY:
                self.seen.add(" ".join(filter(None, ("event", event.kind, event.resource))))

    def update_waits(self, frame: Frame) -> None:
        """Take in who waits for whom; edges that stand already are passed over."""
        if frame.blocked_by is self._edges:
            return
        known, self._edges = set(self._edges), frame.blocked_by
        waits = waits_of(frame.blocked_by)
        members = in_cycles(waits)
        for edge in frame.blocked_by:
            if edge.cause != "task" and edge not in known:
                role = chain_role(waits, edge.robot, members)
                phase = Phase(int(frame.intent.phase[edge.robot])).name.lower()
                self.seen.add(f"{edge.cause} {self._place(edge, frame)} {role} {phase}")

    def _place(self, edge: BlockedBy, frame: Frame) -> str:
        return edge.resource or kind_of_place(
            self.world, frame.sensed.pose[edge.robot : edge.robot + 1, :2]
        )


#: resources and obstacles told apart, in the order of the descriptor ``cause``
CAUSES = ("none", "cluster", "barrier", "queue", "no-path", "wall", "human", "stalled")
NAMES = ("x", "y", "robots", "cause", "wait", "cycle", "encroachment", *LOADS)
LONGEST_WAIT = 60.0  # s; longer waits have the same descriptor
DESCRIBE_EVERY = 0.5  # s between two looks


class Descriptors:
    """Folds frames into the descriptors of a run; one object per episode."""

    def __init__(self, world: World, dt: float) -> None:
        self._world = world
        self._bounds = world.bounds
        self._cycles = AlmostCycles(world)
        self._encroachments = Encroachments(world)
        self._situations = Situations(world)
        self._loads = Loads(len(world.robots))
        self._tasks: dict[int, set[int]] = {}  # told of, by robot
        self._robots = max(len(world.robots), 1)
        self._stride = max(1, round(DESCRIBE_EVERY / dt))
        self._since = np.full(len(world.robots), np.nan)  # blocked since [s], nan: is not
        self._wait = 0.0
        self._cause = "none"
        self._blocked = 0
        self._gap = np.inf
        self._place: Array = 0.5 * (world.bounds[:2] + world.bounds[2:])

    def update(self, frame: Frame) -> None:
        """Take in one tick."""
        sensed = frame.sensed
        if frame.events:
            self._situations.update_events(frame)
            self._loads.update_events(frame)
            for event in frame.events:
                if event.robot >= 0 and event.task >= 0:
                    self._tasks.setdefault(event.robot, set()).add(event.task)
        if sensed.tick % self._stride:
            return
        self._situations.update_waits(frame)
        self._loads.update(frame)
        self._cycles.update(frame)
        self._encroachments.update(frame)
        causes = {edge.robot: edge.cause for edge in frame.blocked_by if edge.cause != "task"}
        for i in range(len(self._since)):
            if i not in causes:
                self._since[i] = np.nan
            elif np.isnan(self._since[i]):
                self._since[i] = sensed.time
        if causes:
            self._look_at_waits(causes, frame)
        elif self._wait == 0.0 and sensed.gap_robot.min(initial=np.inf) < self._gap:
            closest = int(sensed.gap_robot.argmin())
            self._gap = float(sensed.gap_robot[closest])
            self._place = sensed.pose[closest, :2]

    def _look_at_waits(self, causes: dict[int, str], frame: Frame) -> None:
        longest = min(causes, key=lambda i: (self._since[i], i))
        wait = frame.sensed.time - float(self._since[longest])
        if wait < self._wait:
            return
        self._wait = wait
        self._cause = causes[longest]
        self._blocked = len(causes)
        self._place = frame.sensed.pose[longest, :2]

    def values(self) -> dict[str, float]:
        """Give the descriptors to date, by ``NAMES``."""
        low, high = self._bounds[:2], self._bounds[2:]
        x, y = np.clip((self._place - low) / (high - low), 0.0, 1.0)
        known = self._cause if self._cause in CAUSES else "none"
        return {
            "x": float(x),
            "y": float(y),
            "robots": self._blocked / self._robots,
            "cause": CAUSES.index(known) / (len(CAUSES) - 1),
            "wait": min(self._wait / LONGEST_WAIT, 1.0),
            "cycle": self._cycles.nearest.closeness,
            "encroachment": self._encroachments.nearest.closeness,
            **self._loads.values(),
        }

    def situations(self) -> tuple[str, ...]:
        """List what has happened to date, sorted (see :mod:`.situations`)."""
        return tuple(sorted(self._situations.seen))

    def involved(self) -> tuple[str, ...]:
        """Name who took part when the run was nearest to a deadlock, sorted.

        Robots, people and things by their names, tasks of these robots as ``tasks[3]``.
        """
        cycle, encroachment = self._cycles.nearest, self._encroachments.nearest
        near = (
            cycle
            if cycle.closeness >= ENCROACHMENT_COUNTS * encroachment.closeness
            else encroachment
        )
        world = self._world
        names = {world.robots[robot].name for robot in near.robots}
        names |= {f"tasks[{task}]" for i in near.robots for task in self._tasks.get(i, ())}
        for edge in near.edges:
            if edge.cause == "human" and edge.other >= 0:
                names.add(world.humans[edge.other].name)
            if edge.robot in near.robots and edge.cause in ("wall", "no-path") and edge.resource:
                names.add(edge.resource)
        return tuple(sorted(names))
