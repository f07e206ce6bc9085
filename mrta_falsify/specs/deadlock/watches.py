"""What the deadlock oracle looks for in a continuation of the run, and in a counterfactual.

A *continuation* is a copy of the run that goes on without outside events. A *counterfactual* is
a continuation without one of the robots.
"""

from __future__ import annotations

import bisect
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from mrta_falsify.core import codec
from mrta_falsify.core.arrays import Array, BoolArray, IntArray
from mrta_falsify.core.fleet import BlockedBy, Frame
from mrta_falsify.core.world import World
from mrta_falsify.specs.deadlock.progress_clock import ProgressClock, has_stop_to_reach
from mrta_falsify.specs.deadlock.rest import ALL_REST_FOR, LastingRest
from mrta_falsify.specs.deadlock.wait_graph import EdgesByRobot, edges_by_robot

SAME_TIME = 1e-6  # s
A_MINUTE = 60.0  # s; progress that comes later in a continuation may be chance ...
HALF_A_MINUTE = 30.0  # s ... after rest of this long


@dataclass(frozen=True, slots=True, kw_only=True)
class ContinuationAnswer:
    """What a continuation showed; robots by number, as text."""

    stuck: dict[str, float]  #: since when each robot that stays for good stands or creeps [s]
    freed: dict[str, float]  #: when each robot in question made progress [s]
    edges: tuple[BlockedBy, ...]  #: at the end
    #: for how long all rested that each robot in question waited for, at most [s]
    rested: dict[str, float] = field(default_factory=dict)
    driven: dict[str, float] = field(default_factory=dict)  #: way of each robot in question [m]
    #: last progress in the first minute of each robot that does not stay for good [s]
    soon: dict[str, float] = field(default_factory=dict)
    #: all robots asked about make progress, and none of them by chance; nothing else is told then
    as_expected: bool = False

    def came_late(self, i: int, settled: float) -> bool:
        """Whether robot ``i`` went free so late, from rest, that it may be chance.

        Args:
            i: a robot in question.
            settled: rest counts from this time on [s].
        """
        is_late = self.freed.get(str(i), -np.inf) > settled + A_MINUTE
        return is_late and self.rested.get(str(i), np.inf) >= HALF_A_MINUTE


AS_EXPECTED = ContinuationAnswer(stuck={}, freed={}, edges=(), as_expected=True)


@dataclass(frozen=True, slots=True, kw_only=True)
class CounterfactualAnswer:
    """What a counterfactual showed."""

    freed: tuple[int, ...]  #: robots that reached their next stop


class Question(NamedTuple):
    """What a continuation is asked."""

    #: robots in question: it goes on until all of them have made progress, or nothing that they
    #: wait for will move again
    asked: frozenset[int]
    others: frozenset[int]  #: they are in question if one of ``asked`` makes no progress
    time: float  #: of the question [s]
    settled: float  #: rest counts from this time on [s]
    until: float  #: it goes on no longer than this [s]


class _Looks:
    """Looks at the frames of a copy.

    Args:
        world: of the episode.
        stride: ticks from one look to the next.
    """

    def __init__(self, world: World, stride: int) -> None:
        self._stride = stride
        self.rest = LastingRest(world)
        self.edges: EdgesByRobot = {}  # of each robot, as it last had any
        self.time = 0.0
        self.driven = np.zeros(len(world.robots))  # (N,) since the first look [m]
        self._places = np.full((len(world.robots), 2), np.nan)  # at the last look [m]

    def are_due(self, frame: Frame) -> bool:
        """Take in a frame; whether it is looked at."""
        if frame.sensed.tick % self._stride:
            return False
        self.time = frame.sensed.time
        edges = edges_by_robot(frame.blocked_by)
        self.edges.update(edges)
        self.rest.update(frame, edges)
        places = frame.sensed.pose[:, :2].copy()
        self.driven += np.nan_to_num(np.hypot(*(places - self._places).T))
        self._places = places
        return True


class _Seen(NamedTuple):
    """What a look showed; what is told of it is kept, since later questions may go back."""

    time: float  #: [s]
    last: Array  #: (N,) last progress [s]
    way: Array  #: (N,) until when each robot was on its way [s]
    waits: BoolArray  #: (N,) who has a stop to reach
    moved: Array  #: (N,) when something that each robot waits for moved last [s]
    driven: Array  #: (N,) since the first look [m]
    edges: EdgesByRobot  #: of each robot, as it last had any since its last progress


class ContinuationWatch:
    """Watches which robots still make progress, and which never again.

    One copy may answer several questions of a series, since its frames are the future of them all:
    what it has seen already is told without going on.

    Args:
        progress: of the run so far; the watch advances it, so it belongs into a copy.
        question: the first one.
        stride: ticks from one look to the next, as of ``progress``.
        series: the same for all questions that one copy may answer; None: only this one.
        speculates: whether :data:`AS_EXPECTED` is told of robots that all make progress.
    """

    def __init__(
        self,
        progress: ProgressClock,
        question: Question,
        *,
        stride: int,
        series: object | None = None,
        speculates: bool = False,
    ) -> None:
        self.series = series
        self.expected: dict[str, Any] | None = codec.encode(AS_EXPECTED) if speculates else None
        self.question = question
        self._progress = progress
        self._looks = _Looks(progress.world, stride)
        self._seen = [self._look(np.zeros(len(progress.last), dtype=np.bool_))]
        self._begin(question)

    def update(self, frame: Frame) -> bool:
        """See :class:`mrta_falsify.core.protocols.Watch`."""
        looks = self._looks
        if not looks.are_due(frame):
            return False
        last = self._progress.update(frame)
        for i in np.flatnonzero(last >= looks.time).tolist():
            looks.edges.pop(i, None)
        self._seen.append(self._look(has_stop_to_reach(frame.intent, frame.sensed.pose[:, :2])))
        if looks.time <= self.question.time + SAME_TIME:  # a copy that has fallen behind
            self._begin(self.question)
            return False
        return self._note(self._seen[-1]) or self._is_over()

    def resume(self, question: Question) -> bool:
        """See :class:`mrta_falsify.core.protocols.ResumedWatch`."""
        self._begin(question)
        return any(self._note(seen) for seen in self._seen[1:]) or self._is_over()

    def is_as_expected(self) -> bool:
        """See :class:`mrta_falsify.core.protocols.SpeculativeWatch`."""
        asked, settled = self.question.asked, self.question.settled
        seen = self._answer()
        return asked <= self._freed.keys() and not any(seen.came_late(i, settled) for i in asked)

    def answer(self) -> dict[str, Any]:
        """Give the :class:`ContinuationAnswer`, encoded."""
        if self.expected is not None and self.is_as_expected():
            return self.expected
        encoded: dict[str, Any] = codec.encode(self._answer())
        return encoded

    def _answer(self) -> ContinuationAnswer:
        question, first, end = self.question, self._seen[0], self._end
        in_question = sorted(question.asked | question.others)
        stuck = set(np.flatnonzero(end.waits & (end.time - end.last >= ALL_REST_FOR)).tolist())
        stuck |= {i for i in in_question if i not in self._freed}
        soon = set(np.flatnonzero(self._soon > first.last).tolist()) - stuck
        return ContinuationAnswer(
            stuck={str(i): float(end.way[i]) for i in sorted(stuck)},
            freed={str(i): time for i, time in self._freed.items()},
            rested={str(i): time for i, time in self._rested.items()},
            edges=tuple(edge for i in sorted(end.edges) for edge in end.edges[i]),
            driven={str(i): float(end.driven[i] - first.driven[i]) for i in in_question},
            soon={str(i): float(self._soon[i]) for i in sorted(soon)},
        )

    def _begin(self, question: Question) -> None:
        """Take up a question: forget what lies before it."""
        self.question = question
        before = bisect.bisect_right(
            self._seen, question.time + SAME_TIME, key=lambda seen: seen.time
        )
        self._seen = self._seen[max(0, before - 1) :]
        self._freed: dict[int, float] = {}
        self._rested = dict.fromkeys(question.asked | question.others, 0.0)
        self._end = self._seen[0]
        self._soon = self._end.last  # (N,) last progress in the first minute [s]

    def _look(self, waits: BoolArray) -> _Seen:
        progress, looks = self._progress, self._looks
        moved = np.zeros(len(waits))
        for i in np.flatnonzero(waits).tolist():
            moved[i] = looks.rest.party_moved(i)
        return _Seen(
            looks.time,
            progress.last.copy(),
            progress.on_the_way(),
            waits,
            moved,
            looks.driven.copy(),
            dict(looks.edges),
        )

    def _note(self, seen: _Seen) -> bool:
        """Take in what was seen; whether all robots asked about have made progress by now."""
        question, before = self.question, self._seen[0].last
        self._end = seen
        for i in sorted(question.asked | question.others):
            if i in self._freed:
                continue
            if seen.last[i] > before[i] or not seen.waits[i]:
                self._freed[i] = seen.time
                continue
            rested = seen.time - max(float(seen.moved[i]), question.settled)
            self._rested[i] = max(self._rested[i], rested)
        if seen.time <= question.settled + A_MINUTE:
            self._soon = seen.last
        return question.asked <= self._freed.keys()

    def _is_over(self) -> bool:
        """Whether nothing that the robots wait for will move again, or it takes too long."""
        question, rest = self.question, self._looks.rest
        return (
            self._looks.time >= question.until
            or rest.is_complete(question.settled)
            or all(
                i in self._freed or rest.keeps(i, question.settled)
                for i in question.asked | question.others
            )
        )


class CounterfactualWatch:
    """Watches which of the robots asked about reach their next stop now that another is gone.

    Args:
        world: of the episode.
        question: the watch ends once all robots asked about have reached it.
        stride: ticks from one look to the next.
    """

    def __init__(self, world: World, question: Question, *, stride: int) -> None:
        self._question = question
        self._served: IntArray | None = None
        self.freed: set[int] = set()  #: who has reached it
        self._looks = _Looks(world, stride)

    def update(self, frame: Frame) -> bool:
        """See :class:`mrta_falsify.core.protocols.Watch`."""
        looks = self._looks
        if not looks.are_due(frame):
            return False
        if self._served is None:
            self._served = frame.served
        reached = frame.served > self._served
        reached |= ~has_stop_to_reach(frame.intent, frame.sensed.pose[:, :2])
        self.freed |= self._question.asked & set(np.flatnonzero(reached).tolist())
        left, settled = self._question.asked - self.freed, self._question.settled
        is_at_rest = looks.rest.is_complete(settled) or all(
            looks.rest.keeps(i, settled) for i in left
        )
        return not left or is_at_rest or looks.time >= self._question.until

    def answer(self) -> dict[str, Any]:
        """Give the :class:`CounterfactualAnswer`, encoded."""
        encoded: dict[str, Any] = codec.encode(
            CounterfactualAnswer(freed=tuple(sorted(self.freed)))
        )
        return encoded
