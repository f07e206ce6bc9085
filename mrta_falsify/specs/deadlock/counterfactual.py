"""Deadlocks by continuation and counterfactual.

A robot is stuck if it never reaches its next stop although nothing more comes from outside, nor if
all comes that is still to come. A robot holds those who reach theirs without it; members of a
deadlock hold each other, or wait for each other in a ring. All of it is read off copies of the run.
Copies with small differences vote on robots that stay.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mrta_falsify.core import codec
from mrta_falsify.core.arrays import Array, BoolArray
from mrta_falsify.core.protocols import Forecast
from mrta_falsify.core.world import World
from mrta_falsify.specs.deadlock.blocked_by import look_stride
from mrta_falsify.specs.deadlock.bystanders import BystanderClock, Bystanders
from mrta_falsify.specs.deadlock.corrections import Removals, corrected
from mrta_falsify.specs.deadlock.progress_clock import ProgressClock
from mrta_falsify.specs.deadlock.rest import timed
from mrta_falsify.specs.deadlock.stuck_groups import StuckGroup, stuck_groups
from mrta_falsify.specs.deadlock.wait_graph import (
    EdgesByRobot,
    awaited_by,
    edges_by_robot,
    is_unexplained,
    rings_of,
)
from mrta_falsify.specs.deadlock.watches import (
    A_MINUTE,
    ContinuationAnswer,
    ContinuationWatch,
    Question,
)

COPIES = 5  # of the run that vote at most, all but the first with poses moved by millimetres
#: s between two questions about a robot; doubled, to a minute, while it makes no progress
ASK_SOONEST = 1.0
HALFWAY = 0.5  # of the time to what copies foretell, after which they vote again
AWAITED_WITHIN = 300.0  # s; events in force that end this soon, or by the horizon, are waited for
LOOK_AHEAD = 240.0  # s that a continuation goes on for, once no event is awaited
LOOK_WITHOUT = 120.0  # s in which a robot should get going that another one has held up
NOTHING_SEEN = ContinuationAnswer(stuck={}, freed={}, edges=())


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FoundDeadlock:
    """A deadlock as continuations show it."""

    group: StuckGroup
    edges: EdgesByRobot  #: at the end of the continuation, as removals correct them
    seen: EdgesByRobot  #: the same as geometry alone shows them
    members_alone: tuple[int, ...]  #: members as removals alone tell them
    last: dict[int, float]  #: last progress of each robot of the group [s]
    ended: float  #: until when the members stand at least, whatever is still to come [s]
    proven: bool  #: for good
    bystanders: Bystanders  #: furniture and people at the end

    @property
    def is_mutual(self) -> bool:
        """Whether several robots wait for each other."""
        return len(self.group.members) > 1

    def shown_by(self, end: ContinuationAnswer) -> FoundDeadlock:
        """Take in the continuation that shows for how long the members stand."""
        return dataclasses.replace(
            self, ended=end.ended, proven=end.proven, bystanders=end.bystanders
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class HeldUntilWork:
    """Robots that stand until something new comes from outside, and then go on."""

    robots: tuple[int, ...]
    since: float  #: when the last of them stopped [s]
    until: float  #: when the first of them goes on [s]


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
        self.bystanders = BystanderClock(world)  #: kept up to date by the owner
        self.held: list[HeldUntilWork] = []  #: found so far
        #: (N,) until then a robot stands only because nothing new comes [s]
        self._held_until = np.full(robots, -np.inf)
        self._seen_to_come: ContinuationAnswer | None = None  #: of a continuation with all to come
        self._copies = copies
        self._tells_members = members
        self._world = world
        self._stride = look_stride(dt)
        self._future: object | None = None  # one as long as nothing comes from outside
        self._look_ahead = look_ahead
        self._progress = progress
        self._events = begin_times(world)
        self._to_come = timed(world, to_come=True, deadlines=False)  # sorted [s]
        self._begun = 0  # of the events
        #: (N,) until then a robot is known to be no part of a deadlock [s]
        self.free_until = np.full(robots, -np.inf)
        self._pause = np.full(robots, ASK_SOONEST)  # (N,) until the next question [s]
        self._queried_at = np.full(robots, -np.inf)  # (N,) [s]
        #: (N,) last progress of robots that will make more, as a forecast says; -inf: unknown [s]
        self._before = np.full(robots, -np.inf)

    def is_open(self, i: int, time: float) -> bool:
        """Whether it is worth asking about robot ``i`` at ``time`` [s]."""
        will_progress = self._before[i] >= self._progress.last[i]
        is_known = max(self.free_until[i], self._held_until[i]) > time
        return not is_known and not will_progress

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

    def deadlocks(
        self, forecast: Forecast, queried: set[int], time: float, now: EdgesByRobot
    ) -> list[FoundDeadlock]:
        """Find the deadlocks that stand at ``time`` [s].

        Robots in ``queried`` that are part of none are not :meth:`open <is_open>` before they make
        progress, or the deadlock that they will be part of is complete.

        Args:
            forecast: from this moment on.
            queried: robots that may be part of a deadlock.
            time: [s].
            now: edges of this moment. They count for robots that have crept out of reach of what
                holds them up at the end, and whose edges explain nothing there.
        """
        span = self._span(time)
        removals = Removals(forecast, self._progress, span.time, LOOK_WITHOUT, self._stride)
        # What a foreign stack does in a copy is no promise; when it should go on is kept instead.
        seen = self._first(forecast, queried, time, span, speculates=not removals.is_outside)
        if seen.as_expected:
            for i in queried:
                self._before[i] = self._progress.last[i]
            self._ask_later(queried, time)
            return []
        last = {int(i): progress for i, progress in seen.stuck.items()}
        here = {i for i in queried & set(last) if last[i] <= time}
        end = self._end_of(forecast, seen, here, time) if here else seen
        held = {i for i in here if end is None or not _stands(i, end, time)}
        if here and (end is None or held == here):
            freed = {int(i): at for i, at in seen.freed.items()}
            self._note_free(queried - here, last, freed, time)
            self._ask_later(here, time)
            return []
        assert end is not None
        if self._tells_members and (
            self._is_incomplete(seen, queried, removals, time)
            or (removals.is_outside and self._awaits_what_comes(here, end, time))
        ):
            return []
        last, _, edges = self._voted(forecast, seen, queried, time, span)
        for i in last:
            if all(is_unexplained(edge) for edge in edges.get(i, ())):
                edges[i] = now.get(i) or edges.get(i, [])
        if not any(last[i] <= time for i in queried & set(last)):
            return []
        return [
            group.shown_by(end)
            for group in self._groups(last, edges, removals, time)
            if not self._is_passed(group, seen, removals, time)
            and not self._is_held(group.group.members, last, end, time)
        ]

    def _is_passed(
        self, group: FoundDeadlock, seen: ContinuationAnswer, removals: Removals, time: float
    ) -> bool:
        """Whether others who go on pass again and again a robot that waits for them.

        It is asked about again once they have. Where they are not to blame, it stays without them,
        or for as long again after the last of them has passed.
        """
        if group.is_mutual:
            return False
        held_by: dict[int, float] = {}
        for i in group.group.members:
            passed = seen.passed.get(str(i), {})
            held_by |= {int(j): at for j, at in passed.items() if int(j) not in group.last}
        last = max(held_by.values(), default=time)
        if last <= time or last - time < seen.ended - last:
            return False
        members = set(group.group.members)
        stays = removals.without(tuple(sorted(held_by)), members)
        if stays is not None and not removals.is_outside and not members & set(stays.freed):
            return False
        for i in group.group.robots:
            self.free_until[i] = max(self.free_until[i], *held_by.values())
        return True

    def _end_of(
        self, forecast: Forecast, seen: ContinuationAnswer, here: set[int], time: float
    ) -> ContinuationAnswer | None:
        """Continue the run with all that is still to come, and note whom that frees.

        What was seen before of the same future is used again.

        Args:
            forecast: from this moment on.
            seen: what a continuation without anything new shows; the answer, if nothing is to come.
            here: robots that stand in that one.
            time: [s].

        Returns:
            What that continuation shows; None: it cannot be made, or the stack fails in it.
        """
        ahead = self._to_come[(self._to_come > time) & (self._to_come <= self._world.horizon)]
        if not len(ahead):
            return seen
        known = self._seen_to_come
        if known is None or not _still_tells(known, here, time, self._look_ahead):
            settled = float(ahead[-1])
            span = _Span(time, settled, settled + self._look_ahead)
            others = {int(i) for i in seen.stuck} - here
            known = self._continue(forecast, here, span, others=others, to_come=True)
            if known is None:
                return None
            self._seen_to_come = known
        self._is_held(here, {int(i): at for i, at in seen.stuck.items()}, known, time)
        return known

    def _is_held(
        self,
        robots: Collection[int],
        last: Mapping[int, float],
        end: ContinuationAnswer,
        time: float,
    ) -> bool:
        """Note robots that stand at ``time`` [s] and that what is to come frees; if there are any.

        Args:
            robots: that stand as long as nothing new comes.
            last: since when [s].
            end: a continuation with all that is to come.
            time: [s].
        """
        goes_on = [i for i in sorted(robots) if not _stands(i, end, time)]
        freed = {i: end.freed[str(i)] for i in goes_on if str(i) in end.freed}
        new = {i: at for i, at in freed.items() if at > max(time, self._held_until[i])}
        for i, at in new.items():
            self._held_until[i] = at
        if new:
            since, until = max(last[i] for i in new), min(new.values())
            self.held.append(HeldUntilWork(robots=tuple(new), since=since, until=until))
        self._ask_later(goes_on, time)
        return bool(goes_on)

    def prospect(self, forecast: Forecast, queried: set[int], time: float) -> Prospect:
        """Find which robots are stuck, whether or not they are part of a deadlock.

        Args:
            forecast: from this moment on.
            queried: robots in question.
            time: [s].
        """
        span = self._span(time)
        seen = self._first(forecast, queried, time, span)
        found = self._voted(forecast, seen, queried, time, span)
        here = {i for i in queried & set(found.last) if found.last[i] <= time}
        end = self._end_of(forecast, seen, here, time) if here else seen
        stays = {
            i: at
            for i, at in found.last.items()
            if end is not None and _stands(i, end, max(time, at))
        }
        return found._replace(last=stays)

    def _first(
        self,
        forecast: Forecast,
        queried: set[int],
        time: float,
        span: _Span,
        *,
        speculates: bool = False,
    ) -> ContinuationAnswer:
        """Continue the run as it is, and note who makes progress soon."""
        seen = self._continue(forecast, queried, span, speculates=speculates) or NOTHING_SEEN
        if not seen.as_expected:
            self._lengthen_pauses(queried, time)
        for i, progress in seen.soon.items():
            self.free_until[int(i)] = max(self.free_until[int(i)], progress)
        return seen

    def _is_incomplete(
        self, seen: ContinuationAnswer, queried: set[int], removals: Removals, time: float
    ) -> bool:
        """Say whether all of ``queried`` are free or held by robots that get stuck only later.

        No copies vote then; those held are asked about again once the first such robot is stuck.
        """
        last = {int(i): progress for i, progress in seen.stuck.items()}
        later = sorted((progress, i) for i, progress in last.items() if progress > time)
        here = {i for i in queried & set(last) if last[i] <= time}
        if not here or not later:
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
        self._note_free(queried - here, {i: at for at, i in later if i in queried}, freed, time)
        for i, progress in until.items():
            self.free_until[i] = max(progress, time + self._pause[i])
        return True

    def _awaits_what_comes(
        self, here: Collection[int], end: ContinuationAnswer, time: float
    ) -> bool:
        """Say whether all of ``here`` wait for robots that get stuck once something has come.

        The edges tell, where a stack may remember what a robot that is gone has locked.
        """
        later = {int(i): at for i, at in end.stuck.items() if at > time}
        edges = edges_by_robot(end.edges)
        stuck = {int(i) for i in end.stuck}
        until = {i: [later[j] for j in awaited_by(i, stuck, edges) & later.keys()] for i in here}
        if not until or not all(until.values()):
            return False
        for i, times in until.items():
            self.free_until[i] = max(*times, time + self._pause[i])
        return True

    def _voted(
        self,
        forecast: Forecast,
        seen: ContinuationAnswer,
        queried: set[int],
        time: float,
        span: _Span,
    ) -> Prospect:
        """Let copies with small differences vote on what ``seen`` shows."""
        last = {int(i): progress for i, progress in seen.stuck.items()}
        freed = {int(i): at for i, at in seen.freed.items()}
        edges = edges_by_robot(seen.edges)
        # Robots that stay may do so only because nothing pushes them off a balance; only copies
        # with small differences tell.
        vote = self._vote(forecast, queried, set(last), span)
        last = {i: progress for i, progress in last.items() if vote.stuck[i]}
        self._note_free(queried, last, freed, time)
        self._note_outvoted(queried & set(vote.freed) - set(last) - set(freed), vote.freed, time)
        return Prospect(last, {int(i): way for i, way in seen.driven.items()}, edges)

    def _continue(
        self,
        forecast: Forecast,
        queried: set[int],
        span: _Span,
        *,
        others: Iterable[int] = (),
        nudge: int = 0,
        speculates: bool = False,
        to_come: bool = False,
    ) -> ContinuationAnswer | None:
        """Continue a copy of the run; None: the copy cannot be made, or the stack fails in it."""
        watch = ContinuationWatch(
            self._progress,
            Question(frozenset(queried), frozenset(others), *span),
            stride=self._stride,
            bystanders=self.bystanders,
            series=None if nudge or to_come else self._future,
            speculates=speculates,
            to_come=to_come,
        )
        if to_come:
            answer = forecast(watch, to_come=True)
        else:
            answer = forecast(watch, nudge=nudge) if nudge else forecast(watch)
        if answer is None:
            return None
        return codec.decode(ContinuationAnswer, answer, where="forecast")

    def _vote(
        self,
        forecast: Forecast,
        queried: set[int],
        stuck: set[int],
        span: _Span,
    ) -> _Vote:
        """Decide which of ``stuck`` are so in most copies; no more are made than it takes.

        None are made once all of ``queried`` are free: the others do not matter then. Where a copy
        cannot be made, the first continuation alone decides.
        """
        votes = dict.fromkeys(stuck, 1)
        freed: dict[int, float] = {}
        for nudge in range(1, self._copies):
            free = {i for i in stuck if 2 * (nudge - votes[i]) > self._copies}
            open_ = {i for i in stuck - free if 2 * votes[i] < self._copies}
            if not open_ or not queried & stuck - free:
                break
            first = queried & open_ or open_
            seen = self._continue(forecast, first, span, others=open_ - first, nudge=nudge)
            if seen is None:
                return _Vote(dict.fromkeys(stuck, True), {})
            for i in open_ & {int(i) for i in seen.stuck}:
                votes[i] += 1
            for name, progress in seen.freed.items():
                freed[int(name)] = min(progress, freed.get(int(name), np.inf))
        return _Vote({i: 2 * votes[i] > self._copies for i in stuck}, freed)

    def _ask_later(self, robots: Collection[int], time: float) -> None:
        """Ask about robots again after their pause, at the soonest."""
        for i in robots:
            self.free_until[i] = max(self.free_until[i], time + self._pause[i])

    def _lengthen_pauses(self, queried: set[int], time: float) -> None:
        for i in queried:
            has_moved = self._progress.last[i] > self._queried_at[i]
            self._pause[i] = ASK_SOONEST if has_moved else min(2.0 * self._pause[i], A_MINUTE)
            self._queried_at[i] = time

    def _note_free(
        self, queried: set[int], last: Mapping[int, float], freed: Mapping[int, float], time: float
    ) -> None:
        """Note until when robots need not be asked about."""
        for i in queried - set(last):
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

    def _groups(
        self,
        last: Mapping[int, float],
        seen: EdgesByRobot,
        removals: Removals,
        time: float,
    ) -> list[FoundDeadlock]:
        """Find the deadlocks complete at ``time`` [s]; the others are asked about later."""
        if self._tells_members:
            freed_by = removals.freed_by(set(last))
            edges = corrected(seen, set(last), removals)
        else:
            last = {i: progress for i, progress in last.items() if progress <= time}
            freed_by, edges = {i: set(last) - {i} for i in last}, seen
        here = {i for i in last if last[i] <= time}
        rings = [
            ring
            for ring in rings_of(last, edges)
            if removals.is_outside or not any(freed_by[i] & set(ring) for i in ring)
        ]
        # A robot that gets stuck later counts if one that is stuck now depends on it.
        party = {i for i in last if i in here or freed_by[i] & here}
        party |= {i for ring in rings if here & set(ring) for i in ring}
        if removals.is_outside:
            party |= {j for i in here for j in awaited_by(i, last, edges)}
        freed = {i: freed_by[i] & party for i in party}
        found = []
        for alone, others in stuck_groups(party, freed, edges):
            ring = next((ring for ring in rings if set(alone) <= set(ring)), ())
            members = ring if len(ring) > len(alone) else alone
            robots = {*others, *members}
            complete = max(last[i] for i in members)
            if complete > time:
                for i in robots:
                    self.free_until[i] = max(complete, time + self._pause[i])
                continue
            held = robots.union(*(freed_by[i] for i in members))
            found.append(
                FoundDeadlock(
                    group=StuckGroup(members, tuple(sorted(held))),
                    edges=edges,
                    seen=seen,
                    members_alone=alone,
                    last={i: last[i] for i in held},
                    ended=time,
                    proven=False,
                    bystanders=Bystanders(),
                )
            )
        return _without_parts(found)

    def _span(self, time: float) -> _Span:
        """Find the time to look at, once blockages, outages and people who leave have gone."""
        ends = [event.end for event in self._world.events if event.start <= time]
        ends += [human.leaves_at for human in self._world.humans]
        latest = max(time + AWAITED_WITHIN, self._world.horizon)
        settled = max([time, *(end for end in ends if end <= latest)])
        return _Span(time, settled, settled + self._look_ahead)


def _without_parts(found: list[FoundDeadlock]) -> list[FoundDeadlock]:
    """Leave out deadlocks whose members are all members of one found before, or of a larger one."""
    kept: list[FoundDeadlock] = []
    for one in sorted(found, key=lambda found: -len(found.group.members)):
        if not any(set(one.group.members) <= set(other.group.members) for other in kept):
            kept.append(one)
    return sorted(kept, key=lambda found: found.group.members)


def _stands(i: int, end: ContinuationAnswer, time: float) -> bool:
    """Whether robot ``i`` stands from ``time`` [s] to the end of a continuation."""
    return end.stuck.get(str(i), np.inf) <= time


def _still_tells(
    known: ContinuationAnswer, here: Collection[int], time: float, look_ahead: float
) -> bool:
    """Whether a continuation seen before tells that robots stand from ``time`` [s] on."""
    lasts = known.proven or known.ended - time >= look_ahead
    return lasts and all(_stands(i, known, time) for i in here)


def begin_times(world: World) -> Array:
    """List when something comes from outside, sorted [s]."""
    times = [event.start for event in world.events]
    times += [task.arrival for task in world.tasks]
    times += [robot.joins_at for robot in world.robots]
    return np.sort(np.array(times, dtype=np.float64))
