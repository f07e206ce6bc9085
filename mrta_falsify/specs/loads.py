"""Loads: how much a run asked of the stack, whether or not anything went wrong.

Faults show where much comes together: a queue longer than any before, more robots in one spot.
Margins announce few of them. A search that drives each load beyond what was seen gets there (as
performance fuzzing does with counts of steps: Lemieux et al., "PerfFuzz", ISSTA 2018).

Each load is the largest of a run, as a share of the fleet, in [0, 1]. A robot that waits counts the
more, the longer it has waited, so that a load grows without steps.

    ``queue``: robots that wait for one resource, or for one robot;
    ``waiting``: robots that wait at once;
    ``chain``: robots that one robot waits for, directly or through others;
    ``crowd``: robots in one spot, nearer ones counting more;
    ``waited``: the time that all robots waited, ``LONG`` each being all;
    ``rerouted``: decisions to plan again or to make room, ``OFTEN`` for each robot being all.
"""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass, field

import numpy as np

from mrta_falsify.core.feedback import LOADS
from mrta_falsify.core.fleet import BlockedBy, Frame
from mrta_falsify.specs.waits import awaited, waits_of

PATIENCE = 5.0  # s of waiting after which a robot counts by two thirds
NEAR = 1.0  # m; a robot at this distance counts 1/e in a crowd
LONG = 60.0  # s
OFTEN = 40  # decisions
REROUTES = frozenset(("replanned", "makes-room"))


@dataclass(slots=True)
class Loads:
    """Folds frames into the loads of a run; one object per episode."""

    robots: int
    _most: dict[str, float] = field(default_factory=lambda: dict.fromkeys(LOADS, 0.0))
    _since: dict[int, float] = field(default_factory=dict)  #: waits since [s], by robot
    _before: float = 0.0  #: time of the last look [s]
    _waited: float = 0.0  #: s, all robots
    _reroutes: int = 0

    def update_events(self, frame: Frame) -> None:
        """Take in the stack's decisions of a tick."""
        self._reroutes += sum(event.kind in REROUTES for event in frame.events)

    def update(self, frame: Frame) -> None:
        """Take in a moment."""
        time = frame.sensed.time
        elapsed, self._before = time - self._before, time
        self._keep("crowd", _crowd(frame))
        edges = [edge for edge in frame.blocked_by if edge.cause != "task"]
        if not edges:
            self._since.clear()
            return
        self._since = {edge.robot: self._since.get(edge.robot, time) for edge in edges}
        counts = {i: 1.0 - np.exp(-(time - t) / PATIENCE) for i, t in self._since.items()}
        self._waited += elapsed * len(counts)
        self._keep("waiting", sum(counts.values()))
        self._keep("queue", max(_by_place(edges, counts).values(), default=0.0))
        waits = waits_of(edges)
        self._keep("chain", max((len(awaited(waits, i) - {i}) for i in waits), default=0))

    def _keep(self, name: str, load: float) -> None:
        self._most[name] = max(self._most[name], float(load))

    def values(self) -> dict[str, float]:
        """Give the loads to date, by ``LOADS``."""
        most = self._most | {"waited": self._waited / LONG, "rerouted": self._reroutes / OFTEN}
        return {name: min(most[name] / max(self.robots, 1), 1.0) for name in LOADS}


def _crowd(frame: Frame) -> float:
    """Count the robots about the robot that has most about it, itself left out."""
    place = frame.sensed.pose[:, :2]
    if len(place) < 2:
        return 0.0
    apart = np.hypot(*(place[:, None] - place[None, :]).transpose(2, 0, 1))
    return float(np.exp(-apart / NEAR).sum(axis=1).max() - 1.0)


def _by_place(edges: list[BlockedBy], counts: dict[int, float]) -> dict[Hashable, float]:
    """Count the robots that wait for each resource, or for each robot."""
    who: dict[Hashable, set[int]] = {}
    for edge in edges:
        place = edge.resource or edge.other
        if place != -1:
            who.setdefault(place, set()).add(edge.robot)
    return {place: sum(counts[i] for i in robots) for place, robots in who.items()}
