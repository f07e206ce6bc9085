"""Deadlocks by continuation and counterfactual.

A robot is stuck if it never reaches its next stop although nothing more comes from outside. A
robot holds those who reach theirs without it; members of a deadlock hold each other. Both are read
off copies of the run. Copies with small differences vote on robots that stay, or get going late.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mrta_falsify.core import codec
from mrta_falsify.core.arrays import Array, BoolArray
from mrta_falsify.core.protocols import Forecast
from mrta_falsify.core.world import World
from mrta_falsify.specs.deadlock.blocked_by import look_stride
from mrta_falsify.specs.deadlock.progress_clock import ProgressClock
from mrta_falsify.specs.deadlock.stuck_groups import StuckGroup, stuck_groups
from mrta_falsify.specs.deadlock.wait_graph import EdgesByRobot, edges_by_robot
from mrta_falsify.specs.deadlock.watches import (
    A_MINUTE,
    ContinuationAnswer,
    ContinuationWatch,
    CounterfactualAnswer,
    CounterfactualWatch,
    Question,
)

COPIES = 5  # of the run that vote at most, all but the first with poses moved by millimetres
#: s between two questions about a robot; doubled, to a minute, while it makes no progress
ASK_SOONEST = 1.0
HALFWAY = 0.5  # of the time to what copies foretell, after which they vote again
AWAITED_WITHIN = 300.0  # s; events in force that end this soon are waited for
LOOK_AHEAD = 240.0  # s that a continuation goes on for at most, once no event is awaited
NOTHING_SEEN = ContinuationAnswer(stuck={}, freed={}, edges=())


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FoundDeadlock:
    """A deadlock as the continuation shows it."""

    group: StuckGroup
    edges: EdgesByRobot  #: at the end of the continuation
    last: dict[int, float]  #: last progress of each robot of the group [s]


class Prospect(NamedTuple):
    """What becomes of the robots in a continuation."""

    last: dict[int, float]  #: last progress of each robot that is stuck at its end [s]
    driven: dict[int, float]  #: way of each robot in question [m]
    edges: EdgesByRobot  #: at the end


class _Vote(NamedTuple):
    """What copies with small differences say."""

    stuck: dict[int, bool]  #: of each robot in doubt
    freed: dict[int, float]  #: first progress in a copy, of each robot that makes any [s]


class _Span(NamedTuple):
    """The time that a copy of the run is looked at."""

    time: float  #: it is made [s]
    settled: float  #: before, rest means nothing [s]
    until: float  #: [s]


class _Removals:
    """Asks who goes free without a robot; each question once.

    Args:
        world: of the episode.
        forecast: from the moment in question.
        span: that is looked at.
        stride: ticks from one look to the next.
    """

    def __init__(self, world: World, forecast: Forecast, span: _Span, stride: int) -> None:
        self.span = span
        self._world = world
        self._forecast = forecast
        self._stride = stride
        self._answers: dict[int, set[int] | None] = {}

    def freed_without(self, i: int, stuck: set[int]) -> set[int] | None:
        """Find who of the others in ``stuck`` goes free; None: that cannot be tried."""
        if i not in self._answers:
            question = Question(frozenset(stuck - {i}), frozenset(), *self.span)
            watch = CounterfactualWatch(self._world, question, stride=self._stride)
            answer = self._forecast(watch, without=(i,))
            self._answers[i] = (
                None
                if answer is None
                else set(codec.decode(CounterfactualAnswer, answer, where="forecast").freed)
            )
        return self._answers[i]

    def freed_by(self, stuck: set[int]) -> dict[int, set[int]]:
        """Find who goes free without each of ``stuck``; all others, if that cannot be tried."""
        freed = {i: stuck - {i} for i in stuck}
        for i in sorted(stuck) if len(stuck) > 1 else ():
            answer = self.freed_without(i, stuck)
            if answer is None:
                break
            freed[i] = answer
        return freed


class CounterfactualTest:
    """Finds the deadlocks of a run by forecasts; one object per episode.

    Args:
        world: of the episode.
        dt: control period [s].
        progress: of the run so far; kept up to date by its owner.
        look_ahead: how long the robots may stand once no event is awaited [s].
        copies: of the run that vote at most, the run itself among them; 1: it decides alone.
        members: whether copies without a robot each tell members and victims; otherwise all who
            are stuck are members.
    """

    def __init__(
        self,
        world: World,
        dt: float,
        progress: ProgressClock,
        look_ahead: float,
        *,
        copies: int = COPIES,
        members: bool = True,
    ) -> None:
        robots = len(world.robots)
        self._copies = copies
        self._tells_members = members
        self._world = world
        self._stride = look_stride(dt)
        self._future: object | None = None  # one as long as nothing comes from outside
        self._look_ahead = look_ahead
        self._progress = progress
        self._events = begin_times(world)
        self._begun = 0  # of the events
        #: (N,) until then a robot is known to be no part of a deadlock [s]
        self.free_until = np.full(robots, -np.inf)
        self._pause = np.full(robots, ASK_SOONEST)  # (N,) until the next question [s]
        self._asked_at = np.full(robots, -np.inf)  # (N,) [s]
        #: (N,) last progress of robots that will make more, as a forecast says; -inf: unknown [s]
        self._before = np.full(robots, -np.inf)

    def is_open(self, i: int, time: float) -> bool:
        """Whether it is worth asking about robot ``i`` at ``time`` [s]."""
        will_progress = self._before[i] >= self._progress.last[i]
        return bool(self.free_until[i] <= time and not will_progress)

    def note(self, time: float, waits: BoolArray) -> None:
        """Forget the forecasts that no longer hold.

        Args:
            time: [s]; an event that has begun by then overtakes them.
            waits: ``(N,)`` who has a stop to reach; what was foretold of others is over.
        """
        self._before[~waits] = -np.inf
        begun = int(np.searchsorted(self._events, time, side="right"))
        if begun != self._begun or self._future is None:
            self._begun, self._future = begun, object()
            self.free_until[:] = self._before[:] = -np.inf

    def deadlocks(self, forecast: Forecast, asked: set[int], time: float) -> list[FoundDeadlock]:
        """Find the deadlocks that stand at ``time`` [s].

        Robots in ``asked`` that are part of none are not :meth:`open <is_open>` before they make
        progress, or the deadlock that they will be part of is complete.

        Args:
            forecast: from this moment on.
            asked: robots that may be part of a deadlock.
            time: [s].
        """
        span = self._span(time)
        removals = _Removals(self._world, forecast, span, self._stride)
        seen = self._first(forecast, asked, time, span, speculates=True)
        if seen.as_expected:
            for i in asked:
                self._before[i] = self._progress.last[i]
                self.free_until[i] = max(self.free_until[i], time + self._pause[i])
            return []
        if self._tells_members and self._is_incomplete(seen, asked, removals, time):
            return []
        last, _, edges = self._voted(forecast, seen, asked, time, span)
        if not any(last[i] <= time for i in asked & set(last)):
            return []
        if self._tells_members:
            freed_by = removals.freed_by(set(last))
        else:
            last = {i: progress for i, progress in last.items() if progress <= time}
            freed_by = {i: set(last) - {i} for i in last}
        return self._standing(last, freed_by, edges, time)

    def prospect(self, forecast: Forecast, asked: set[int], time: float) -> Prospect:
        """Find which robots are stuck, whether or not they are part of a deadlock.

        Args:
            forecast: from this moment on.
            asked: robots in question.
            time: [s].
        """
        span = self._span(time)
        seen = self._first(forecast, asked, time, span)
        return self._voted(forecast, seen, asked, time, span)

    def _first(
        self,
        forecast: Forecast,
        asked: set[int],
        time: float,
        span: _Span,
        *,
        speculates: bool = False,
    ) -> ContinuationAnswer:
        """Continue the run as it is, and note who makes progress soon."""
        seen = self._continue(forecast, asked, span, speculates=speculates) or NOTHING_SEEN
        if not seen.as_expected:
            self._lengthen_pauses(asked, time)
        for i, progress in seen.soon.items():
            self.free_until[int(i)] = max(self.free_until[int(i)], progress)
        return seen

    def _is_incomplete(
        self, seen: ContinuationAnswer, asked: set[int], removals: _Removals, time: float
    ) -> bool:
        """Say whether all of ``asked`` are free or held by robots that get stuck only later.

        No copies vote then; those held are asked about again once the first such robot is stuck.
        """
        last = {int(i): progress for i, progress in seen.stuck.items()}
        later = sorted((progress, i) for i, progress in last.items() if progress > time)
        here = {i for i in asked & set(last) if last[i] <= time}
        if not here or not later or _late_ones(seen, asked, removals.span):
            return False
        until: dict[int, float] = {}
        for progress, i in later:
            freed_without = removals.freed_without(i, set(last)) or set()
            until.update(dict.fromkeys(here & freed_without - set(until), progress))
            if set(until) == here:
                break
        else:
            return False
        freed = {int(i): at for i, at in seen.freed.items()}
        self._note_free(asked - here, {i: at for at, i in later if i in asked}, freed, time)
        for i, progress in until.items():
            self.free_until[i] = max(progress, time + self._pause[i])
        return True

    def _voted(
        self,
        forecast: Forecast,
        seen: ContinuationAnswer,
        asked: set[int],
        time: float,
        span: _Span,
    ) -> Prospect:
        """Let copies with small differences vote on what ``seen`` shows."""
        last = {int(i): progress for i, progress in seen.stuck.items()}
        freed = {int(i): at for i, at in seen.freed.items()}
        edges = edges_by_robot(seen.edges)
        # Robots that stay, or get going late, may do so only because nothing pushes them off a
        # balance; only copies with small differences tell.
        doubtful = _late_ones(seen, asked, span) | set(last)
        vote = self._vote(forecast, asked, doubtful, set(last), span)
        for i, is_stuck in vote.stuck.items():
            if is_stuck:
                last.setdefault(i, float(self._progress.on_the_way()[i]))
            else:
                last.pop(i, None)
        self._note_free(asked, last, freed, time)
        self._note_outvoted(asked & set(vote.freed) - set(last) - set(freed), vote.freed, time)
        return Prospect(last, {int(i): way for i, way in seen.driven.items()}, edges)

    def _continue(
        self,
        forecast: Forecast,
        asked: set[int],
        span: _Span,
        *,
        others: Iterable[int] = (),
        nudge: int = 0,
        speculates: bool = False,
    ) -> ContinuationAnswer | None:
        """Continue a copy of the run; None: the copy cannot be made, or the stack fails in it."""
        watch = ContinuationWatch(
            self._progress,
            Question(frozenset(asked), frozenset(others), *span),
            stride=self._stride,
            series=None if nudge else self._future,
            speculates=speculates,
        )
        answer = forecast(watch, nudge=nudge) if nudge else forecast(watch)
        if answer is None:
            return None
        return codec.decode(ContinuationAnswer, answer, where="forecast")

    def _vote(
        self,
        forecast: Forecast,
        asked: set[int],
        doubtful: set[int],
        stuck: set[int],
        span: _Span,
    ) -> _Vote:
        """Decide which of ``doubtful`` are stuck in most copies; no more are made than it takes.

        None are made once all of ``asked`` are free: the others do not matter then. Where a copy
        cannot be made, the first continuation alone decides.
        """
        votes = {i: int(i in stuck) for i in doubtful}
        freed: dict[int, float] = {}
        for nudge in range(1, self._copies):
            free = {i for i in doubtful if 2 * (nudge - votes[i]) > self._copies}
            open_ = {i for i in doubtful - free if 2 * votes[i] < self._copies}
            if not open_ or not asked & doubtful - free:
                break
            first = asked & open_ or open_
            seen = self._continue(forecast, first, span, others=open_ - first, nudge=nudge)
            if seen is None:
                return _Vote({i: i in stuck for i in doubtful}, {})
            for i in open_ & {int(i) for i in seen.stuck}:
                votes[i] += 1
            for name, progress in seen.freed.items():
                freed[int(name)] = min(progress, freed.get(int(name), np.inf))
        return _Vote({i: 2 * votes[i] > self._copies for i in doubtful}, freed)

    def _lengthen_pauses(self, asked: set[int], time: float) -> None:
        for i in asked:
            has_moved = self._progress.last[i] > self._asked_at[i]
            self._pause[i] = ASK_SOONEST if has_moved else min(2.0 * self._pause[i], A_MINUTE)
            self._asked_at[i] = time

    def _note_free(
        self, asked: set[int], last: Mapping[int, float], freed: Mapping[int, float], time: float
    ) -> None:
        """Note until when robots need not be asked about."""
        for i in asked - set(last):
            known = max(freed.get(i, time), time + self._pause[i])
            self.free_until[i] = max(self.free_until[i], known)
        for i, progress in last.items():
            self.free_until[i] = max(self.free_until[i], progress)

    def _note_outvoted(self, robots: set[int], freed: Mapping[int, float], time: float) -> None:
        """Note when to ask again about robots that the run itself does not free, but most copies.

        The run shows nothing new for long: what the copies foretell is some way off. So all of them
        are asked about again together, halfway to the first progress in a copy.
        """
        if not robots:
            return
        halfway = time + HALFWAY * (min(freed[i] for i in robots) - time)
        again = max(halfway, time + float(self._pause[list(robots)].max()))
        for i in robots:
            self.free_until[i] = max(self.free_until[i], again)

    def _standing(
        self,
        last: Mapping[int, float],
        freed_by: Mapping[int, set[int]],
        edges: EdgesByRobot,
        time: float,
    ) -> list[FoundDeadlock]:
        """Find the deadlocks complete at ``time`` [s]; the others are asked about later."""
        here = {i for i in last if last[i] <= time}
        # A robot that gets stuck later counts if one that is stuck now depends on it.
        party = here | {i for i in last if freed_by[i] & here}
        standing = []
        for members, robots in stuck_groups(party, {i: freed_by[i] & party for i in party}, edges):
            complete = max(last[i] for i in members)
            if complete > time:
                for i in robots:
                    self.free_until[i] = max(complete, time + self._pause[i])
                continue
            held = set(robots).union(*(freed_by[i] for i in members))
            group = StuckGroup(members, tuple(sorted(held)))
            known = {i: last[i] for i in group.robots}
            standing.append(FoundDeadlock(group=group, edges=edges, last=known))
        return standing

    def _span(self, time: float) -> _Span:
        """Find the time to look at, once blockages, outages and people who leave have gone."""
        ends = [event.end for event in self._world.events if event.start <= time]
        ends += [human.leaves_at for human in self._world.humans]
        settled = max([time, *(end for end in ends if end <= time + AWAITED_WITHIN)])
        return _Span(time, settled, settled + self._look_ahead)


def _late_ones(seen: ContinuationAnswer, asked: set[int], span: _Span) -> set[int]:
    """Find the robots in question that may have gone free by chance."""
    return {i for i in asked if seen.came_late(i, span.settled)}


def begin_times(world: World) -> Array:
    """List when something comes from outside, sorted [s]."""
    times = [event.start for event in world.events]
    times += [task.arrival for task in world.tasks]
    times += [robot.joins_at for robot in world.robots]
    return np.sort(np.array(times, dtype=np.float64))
