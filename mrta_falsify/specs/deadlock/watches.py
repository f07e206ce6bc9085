"""What the deadlock oracle looks for in a continuation of the run, and in a counterfactual.

A *continuation* is a copy of the run that goes on, without outside events or with those that are
still to come. A *counterfactual* is a continuation without one of the robots.
"""

from __future__ import annotations

import bisect
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from mrta_falsify.core import codec
from mrta_falsify.core.arrays import Array, BoolArray, IntArray
from mrta_falsify.core.fleet import BlockedBy, Frame
from mrta_falsify.core.protocols import SteadyRun
from mrta_falsify.core.world import World
from mrta_falsify.specs.deadlock.bystanders import BystanderClock, Bystanders, bystanders_of
from mrta_falsify.specs.deadlock.progress_clock import ProgressClock, has_stop_to_reach
from mrta_falsify.specs.deadlock.rest import ProvenRest
from mrta_falsify.specs.deadlock.wait_graph import EdgesByRobot, awaited_by, edges_by_robot

SAME_TIME = 1e-6  # s
SETS_OUT = 4  # steps of progress by which a robot comes nearer that was held up, a metre
A_MINUTE = 60.0  # s; progress this soon in a continuation is noted of all robots
#: s without progress at the end of a continuation, after which a robot that was not asked about is
#: asked about as well. It is claimed only once it has stood for a whole continuation
ALSO_STANDS = 30.0


@dataclass(frozen=True, slots=True, kw_only=True)
class ContinuationAnswer:
    """What a continuation showed; robots by number, as text."""

    stuck: dict[str, float]  #: since when each robot that stays to the end stands or creeps [s]
    freed: dict[str, float]  #: when each robot in question made progress [s]
    edges: tuple[BlockedBy, ...]  #: at the end
    driven: dict[str, float] = field(default_factory=dict)  #: way of each robot in question [m]
    #: last progress in the first minute of each robot that does not stay to the end [s]
    soon: dict[str, float] = field(default_factory=dict)
    #: when a robot that each stuck robot waited for made progress last, by that robot's number [s]
    passed: dict[str, dict[str, float]] = field(default_factory=dict)
    ended: float = 0.0  #: until when the robots that stay were seen, or are proven, to stand [s]
    proven: bool = False  #: nothing moves any more for good
    bystanders: Bystanders = Bystanders()  #: furniture and people at the end
    #: all robots asked about make progress; nothing else is told then
    as_expected: bool = False


AS_EXPECTED = ContinuationAnswer(stuck={}, freed={}, edges=(), as_expected=True)


@dataclass(frozen=True, slots=True, kw_only=True)
class CounterfactualAnswer:
    """What a counterfactual showed."""

    freed: tuple[int, ...]  #: robots that reached their next stop
    nearer: tuple[int, ...] = ()  #: robots that set out for it within a minute
    edges: tuple[BlockedBy, ...] = ()  #: of the robots asked about, at the end


class Question(NamedTuple):
    """What a continuation is asked."""

    #: robots in question: it goes on until all of them have made progress, or to its bound
    queried: frozenset[int]
    others: frozenset[int]  #: they are in question if one of ``queried`` makes no progress
    time: float  #: of the question [s]
    settled: float  #: rest counts from this time on [s]
    until: float  #: it goes on no longer than this [s]


class _Looks:
    """Looks at the frames of a copy.

    Args:
        world: of the episode.
        stride: ticks from one look to the next.
        to_come: whether what is to come from outside comes in the copy.
    """

    def __init__(self, world: World, stride: int, *, to_come: bool = False) -> None:
        self._stride = stride
        self.rest = ProvenRest(world, to_come=to_come)
        self.edges: EdgesByRobot = {}  # of each robot, as it last had any
        self.time = 0.0
        self.driven = np.zeros(len(world.robots))  # (N,) since the first look [m]
        self._places = np.full((len(world.robots), 2), np.nan)  # at the last look [m]

    def are_due(self, frame: Frame) -> bool:
        """Take in a frame; whether it is looked at."""
        if frame.sensed.tick % self._stride:
            return False
        self.time = frame.sensed.time
        self.edges.update(edges_by_robot(frame.blocked_by))
        self.rest.update(frame.sensed)
        places = frame.sensed.pose[:, :2].copy()
        self.driven += np.nan_to_num(np.hypot(*(places - self._places).T))
        self._places = places
        return True

    def are_settled(self, until: float) -> bool:
        """Whether nothing moves any more before ``until`` [s], as is proven."""
        return self.rest.lasts_until(self.time) >= until


class _Seen(NamedTuple):
    """What a look showed; what is told of it is kept, since later questions may go back."""

    time: float  #: [s]
    last: Array  #: (N,) last progress [s]
    moved: Array  #: (N,) the same, but for new goals [s]
    way: Array  #: (N,) until when each robot was on its way [s]
    waits: BoolArray  #: (N,) who has a stop to reach
    driven: Array  #: (N,) since the first look [m]
    edges: EdgesByRobot  #: of each robot, as it last had any since its last progress
    rests_until: float  #: as is proven [s]
    bystanders: tuple[Array, Array]  #: rows of a :class:`BystanderClock`


class ContinuationWatch:
    """Watches which robots still make progress, and which never again.

    One copy may answer several questions of a series, since its frames are the future of them all:
    what it has seen already is told without going on.

    Args:
        progress: of the run so far; the watch advances it, so it belongs into a copy.
        question: the first one.
        stride: ticks from one look to the next, as of ``progress``.
        bystanders: furniture and people of the run so far; advanced as well.
        series: the same for all questions that one copy may answer; None: only this one.
        speculates: whether :data:`AS_EXPECTED` is told of robots that all make progress.
        to_come: whether what is to come from outside comes in the continuation.
    """

    def __init__(
        self,
        progress: ProgressClock,
        question: Question,
        *,
        stride: int,
        bystanders: BystanderClock | None = None,
        series: object | None = None,
        speculates: bool = False,
        to_come: bool = False,
    ) -> None:
        self.series = series
        self.expected: dict[str, Any] | None = codec.encode(AS_EXPECTED) if speculates else None
        self.question = question
        self._progress = progress
        self._bystanders = bystanders or BystanderClock(progress.world)
        self._looks = _Looks(progress.world, stride, to_come=to_come)
        self._seen = [self._look(np.zeros(len(progress.last), dtype=np.bool_))]
        self._begin(question)

    def take_run(self, run: SteadyRun) -> None:
        """See :class:`mrta_falsify.core.protocols.ProvingWatch`."""
        self._looks.rest.take_run(run)

    def update(self, frame: Frame) -> bool:
        """See :class:`mrta_falsify.core.protocols.Watch`."""
        looks = self._looks
        if not looks.are_due(frame):
            return False
        self._bystanders.update(frame.sensed)
        last = self._progress.update(frame)
        for i in np.flatnonzero(last >= looks.time).tolist():
            looks.edges.pop(i, None)
        self._seen.append(self._look(has_stop_to_reach(frame.intent, frame.sensed.pose[:, :2])))
        if looks.time <= self.question.time + SAME_TIME:  # a copy that has fallen behind
            self._begin(self.question)
            return False
        return self._note(self._seen[-1]) or self._is_over(self._seen[-1])

    def resume(self, question: Question) -> bool:
        """See :class:`mrta_falsify.core.protocols.ResumedWatch`."""
        self._begin(question)
        return any(self._note(seen) or self._is_over(seen) for seen in self._seen[1:])

    def is_as_expected(self) -> bool:
        """See :class:`mrta_falsify.core.protocols.SpeculativeWatch`."""
        return self.question.queried <= self._freed.keys()

    def answer(self) -> dict[str, Any]:
        """Give the :class:`ContinuationAnswer`, encoded."""
        if self.expected is not None and self.is_as_expected():
            return self.expected
        encoded: dict[str, Any] = codec.encode(self._answer())
        return encoded

    def _answer(self) -> ContinuationAnswer:
        question, first, end = self.question, self._seen[0], self._end
        in_question = sorted(question.queried | question.others)
        until = min(end.rests_until, question.until) if end.time < question.until else end.time
        stuck = set(np.flatnonzero(end.waits & (until - end.last >= ALSO_STANDS)).tolist())
        stuck |= {i for i in in_question if i not in self._freed}
        soon = set(np.flatnonzero(self._soon > first.last).tolist()) - stuck
        return ContinuationAnswer(
            stuck={str(i): self._stopped(i) for i in sorted(stuck)},
            freed={str(i): time for i, time in self._freed.items()},
            edges=tuple(edge for i in sorted(end.edges) for edge in end.edges[i]),
            driven={str(i): float(end.driven[i] - first.driven[i]) for i in in_question},
            soon={str(i): float(self._soon[i]) for i in sorted(soon)},
            passed={str(i): self._passed[i] for i in sorted(stuck) if self._passed.get(i)},
            ended=float(max(end.time, until)),
            proven=end.rests_until == np.inf,
            bystanders=bystanders_of(end.bystanders),
        )

    def _stopped(self, i: int) -> float:
        """When a stuck robot was on its way last [s]; a goal that it never drove to is no way."""
        first, end, question = self._seen[0], self._end, self.question
        stands = i in question.queried | question.others and end.moved[i] <= first.moved[i]
        return float(min(end.way[i], first.way[i]) if stands else end.way[i])

    def _begin(self, question: Question) -> None:
        """Take up a question: forget what lies before it."""
        self.question = question
        before = bisect.bisect_right(
            self._seen, question.time + SAME_TIME, key=lambda seen: seen.time
        )
        self._seen = self._seen[max(0, before - 1) :]
        self._freed: dict[int, float] = {}
        self._passed: dict[int, dict[str, float]] = {}
        self._end = self._seen[0]
        self._soon = self._end.last  # (N,) last progress in the first minute [s]

    def _look(self, waits: BoolArray) -> _Seen:
        progress, looks = self._progress, self._looks
        return _Seen(
            looks.time,
            progress.last.copy(),
            progress.moved.copy(),
            progress.on_the_way(),
            waits,
            looks.driven.copy(),
            dict(looks.edges),
            looks.rest.lasts_until(looks.time),
            self._bystanders.rows(),
        )

    def _note(self, seen: _Seen) -> bool:
        """Take in what was seen; whether all robots asked about have made progress by now."""
        question, before = self.question, self._seen[0].moved
        moved_on = set(np.flatnonzero(seen.last > self._end.last).tolist())
        self._end = seen
        for i in sorted(question.queried | question.others):
            if i in self._freed:
                continue
            if seen.moved[i] > before[i] or not seen.waits[i]:
                self._freed[i] = seen.time
                continue
            if moved_on:
                ahead = awaited_by(i, moved_on, {i: seen.edges.get(i, [])})
                self._passed.setdefault(i, {}).update({str(j): seen.time for j in ahead - {i}})
        if seen.time <= question.settled + A_MINUTE:
            self._soon = seen.last
        return question.queried <= self._freed.keys()

    def _is_over(self, seen: _Seen) -> bool:
        """Whether the bound is reached, or nothing moves any more until then."""
        return max(seen.time, seen.rests_until) >= self.question.until


class CounterfactualWatch:
    """Watches which of the robots asked about reach their next stop now that another is gone.

    Args:
        progress: of the run so far; the watch advances it, so it belongs into a copy.
        question: the watch ends once all robots asked about have reached it.
        stride: ticks from one look to the next.
    """

    def __init__(self, progress: ProgressClock, question: Question, *, stride: int) -> None:
        self._progress = progress
        self._moved = progress.moved.copy()  # (N,) at the last look [s]
        self._steps = np.zeros(len(progress.moved), dtype=np.int64)  # (N,) of progress
        self._question = question
        self._served: IntArray | None = None
        self.freed: set[int] = set()  #: who has reached it
        self._nearer: set[int] = set()
        self._looks = _Looks(progress.world, stride)

    def take_run(self, run: SteadyRun) -> None:
        """See :class:`mrta_falsify.core.protocols.ProvingWatch`."""
        self._looks.rest.take_run(run)

    def update(self, frame: Frame) -> bool:
        """See :class:`mrta_falsify.core.protocols.Watch`."""
        looks, queried = self._looks, self._question.queried
        if not looks.are_due(frame):
            return False
        if self._served is None:
            self._served = frame.served
        self._progress.update(frame)
        self._steps += self._progress.moved > self._moved
        self._moved = self._progress.moved.copy()
        reached = frame.served > self._served
        reached |= ~has_stop_to_reach(frame.intent, frame.sensed.pose[:, :2])
        self.freed |= queried & set(np.flatnonzero(reached).tolist())
        if looks.time <= self._question.time + A_MINUTE:
            set_out = (self._steps >= SETS_OUT) | reached
            self._nearer |= queried & set(np.flatnonzero(set_out).tolist())
        until = self._question.until
        return not queried - self.freed or looks.time >= until or looks.are_settled(until)

    def answer(self) -> dict[str, Any]:
        """Give the :class:`CounterfactualAnswer`, encoded."""
        edges = self._looks.edges
        answer = CounterfactualAnswer(
            freed=tuple(sorted(self.freed)),
            nearer=tuple(sorted(self._nearer | self.freed)),
            edges=tuple(e for i in sorted(self._question.queried) for e in edges.get(i, ())),
        )
        encoded: dict[str, Any] = codec.encode(answer)
        return encoded
