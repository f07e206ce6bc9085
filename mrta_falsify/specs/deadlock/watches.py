"""What the deadlock oracle looks for in a continuation of the run, and in a counterfactual.

A *continuation* is a copy of the run that goes on without outside events. A *counterfactual* is
a continuation without one of the robots.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from mrta_falsify.core import codec
from mrta_falsify.core.arrays import BoolArray, IntArray
from mrta_falsify.core.fleet import BlockedBy, Frame
from mrta_falsify.core.world import World
from mrta_falsify.specs.deadlock.blocked_by import EDGES_EVERY
from mrta_falsify.specs.deadlock.progress_clock import ProgressClock, has_stop_to_reach
from mrta_falsify.specs.deadlock.rest import ALL_REST_FOR, LastingRest
from mrta_falsify.specs.deadlock.wait_graph import EdgesByRobot, edges_by_robot

A_MINUTE = 60.0  # s; progress that comes later in a continuation may be chance


@dataclass(frozen=True, slots=True, kw_only=True)
class ContinuationAnswer:
    """What a continuation showed; robots by number, as text."""

    stuck: dict[str, float]  #: since when each robot that stays for good stands or creeps [s]
    freed: dict[str, float]  #: when each robot in question made progress [s]
    edges: tuple[BlockedBy, ...]  #: at the end
    driven: dict[str, float] = field(default_factory=dict)  #: way of each robot in question [m]
    #: last progress in the first minute of each robot that does not stay for good [s]
    soon: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class CounterfactualAnswer:
    """What a counterfactual showed."""

    freed: tuple[int, ...]  #: robots that reached their next stop


class _Looks:
    """Looks at the frames of a copy every quarter of a second."""

    def __init__(self, world: World, settled: float, until: float) -> None:
        self._next = -np.inf
        self._until = until
        self.rest = LastingRest(world, settled)
        self.edges: EdgesByRobot = {}  # of each robot, as it last had any
        self.time = 0.0
        self.driven = np.zeros(len(world.robots))  # (N,) since the first look [m]
        self._places = np.full((len(world.robots), 2), np.nan)  # at the last look [m]

    def are_due(self, frame: Frame) -> bool:
        """Take in a frame; whether it is looked at."""
        time = frame.sensed.time
        if time < self._next:
            return False
        self._next = time + EDGES_EVERY - 1e-6
        self.time = time
        edges = edges_by_robot(frame.blocked_by)
        self.edges.update(edges)
        self.rest.update(frame, edges)
        places = frame.sensed.pose[:, :2].copy()
        self.driven += np.nan_to_num(np.hypot(*(places - self._places).T))
        self._places = places
        return True

    @property
    def are_over(self) -> bool:
        """Whether the copy has gone on for long enough."""
        return self.time >= self._until


class ContinuationWatch:
    """Watches which robots still make progress before ``until``, and which never again.

    Args:
        progress: of the run so far; the watch advances it, so it belongs into a copy.
        asked: robots in question; the watch ends once all of them have made progress, or nothing
            that they wait for will move again.
        others: they are in question if one of ``asked`` makes no progress.
        settled: rest counts from this time on [s].
        until: [s].
    """

    def __init__(
        self,
        progress: ProgressClock,
        asked: Iterable[int],
        others: Iterable[int] = (),
        *,
        settled: float,
        until: float,
    ) -> None:
        self._progress = progress
        self._first = frozenset(asked)
        self._asked = sorted({*self._first, *others})
        self._before = progress.last.copy()
        self._soon = self._before  # (N,) last progress in the first minute [s]
        self._minute_ends = settled + A_MINUTE
        self._freed: dict[int, float] = {}
        self._waits: BoolArray = np.zeros(len(self._before), dtype=np.bool_)
        self._looks = _Looks(progress.world, settled, until)

    def update(self, frame: Frame) -> bool:
        """See :class:`mrta_falsify.core.protocols.Watch`."""
        looks = self._looks
        if not looks.are_due(frame):
            return False
        last = self._progress.update(frame)
        self._waits = has_stop_to_reach(frame.intent, frame.sensed.pose[:, :2])
        for i in self._asked:
            if i not in self._freed and (last[i] > self._before[i] or not self._waits[i]):
                self._freed[i] = looks.time
        for i in np.flatnonzero(last >= looks.time).tolist():
            looks.edges.pop(i, None)
        if looks.time <= self._minute_ends:
            self._soon = last.copy()
        are_known = self._first <= self._freed.keys() or all(
            i in self._freed or looks.rest.keeps(i) for i in self._asked
        )
        return are_known or looks.rest.is_complete() or looks.are_over

    def answer(self) -> dict[str, Any]:
        """Give the :class:`ContinuationAnswer`, encoded."""
        looks, last = self._looks, self._progress.last
        way = self._progress.on_the_way()
        stuck = set(np.flatnonzero(self._waits & (looks.time - last >= ALL_REST_FOR)).tolist())
        stuck |= {i for i in self._asked if i not in self._freed}
        soon = set(np.flatnonzero(self._soon > self._before).tolist()) - stuck
        seen = ContinuationAnswer(
            stuck={str(i): float(way[i]) for i in sorted(stuck)},
            freed={str(i): time for i, time in self._freed.items()},
            edges=tuple(edge for i in sorted(looks.edges) for edge in looks.edges[i]),
            driven={str(i): float(looks.driven[i]) for i in self._asked},
            soon={str(i): float(self._soon[i]) for i in sorted(soon)},
        )
        encoded: dict[str, Any] = codec.encode(seen)
        return encoded


class CounterfactualWatch:
    """Watches which of ``others`` reach their next stop now that a robot is gone.

    Args:
        world: of the episode.
        others: robots in question; the watch ends once all of them have reached it.
        settled: rest counts from this time on [s].
        until: [s].
    """

    def __init__(
        self, world: World, others: Iterable[int], *, settled: float, until: float
    ) -> None:
        self._others = frozenset(others)
        self._served: IntArray | None = None
        self.freed: set[int] = set()  #: who has reached it
        self._looks = _Looks(world, settled, until)

    def update(self, frame: Frame) -> bool:
        """See :class:`mrta_falsify.core.protocols.Watch`."""
        looks = self._looks
        if not looks.are_due(frame):
            return False
        if self._served is None:
            self._served = frame.served
        reached = frame.served > self._served
        reached |= ~has_stop_to_reach(frame.intent, frame.sensed.pose[:, :2])
        self.freed |= self._others & set(np.flatnonzero(reached).tolist())
        left = self._others - self.freed
        is_at_rest = looks.rest.is_complete() or all(looks.rest.keeps(i) for i in left)
        return not left or is_at_rest or looks.are_over

    def answer(self) -> dict[str, Any]:
        """Give the :class:`CounterfactualAnswer`, encoded."""
        encoded: dict[str, Any] = codec.encode(
            CounterfactualAnswer(freed=tuple(sorted(self.freed)))
        )
        return encoded
