"""Deadlocks by continuation and counterfactual.

A deadlock is a set of robots that never resolves although nothing more comes from outside. A
member of it is a robot without which the others go free. Both are read off copies of the run.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Mapping
from typing import NamedTuple

import numpy as np

from mrta_falsify.core import codec
from mrta_falsify.core.arrays import Array, IntArray
from mrta_falsify.core.fleet import Frame
from mrta_falsify.core.protocols import Forecast
from mrta_falsify.core.world import World
from mrta_falsify.specs.deadlock.progress_clock import ProgressClock
from mrta_falsify.specs.deadlock.watches import (
    ContinuationAnswer,
    ContinuationWatch,
    CounterfactualAnswer,
    CounterfactualWatch,
)

BODY_STEP = 0.25  # m, about a robot's radius, nearer to the goal than ever before: progress
SHOWN_AFTER = 1.5  # s until a deadlock shows in the blocked-by edges, for the evidence
ASK_SOONEST = 1.0  # s between two questions about a robot
ASK_AGAIN = 30.0  # s after which a robot that moves in vain is asked about again
FREE_WITHIN = 120.0  # s in which the others must go free once a member is gone
RECORDED_LOOKS = 2400  # looks that are kept of the past: ten minutes
AWAITED_WITHIN = 300.0  # s; events in force that end this soon are waited for


class StuckGroup(NamedTuple):
    """Robots that hold each other up for good."""

    members: tuple[int, ...]  #: without any of whom the others go free
    robots: tuple[int, ...]  #: members and victims


def stuck_groups(stuck: Iterable[int], freed: Mapping[int, set[int]]) -> list[StuckGroup]:
    """Split stuck robots into groups that hold each other up, and name the members.

    Args:
        stuck: robots that never make progress again.
        freed: for each of them, who goes free without it.

    Returns:
        Groups whose members are those without whom all others of the group go free. Where there
        is no such robot, all of them hold it together.
    """
    groups: list[set[int]] = []
    for i in sorted(stuck):
        joined = {i} | freed.get(i, set())
        for group in [group for group in groups if group & joined]:
            joined |= group
            groups.remove(group)
        groups.append(joined)
    found = []
    for group in groups:
        members = tuple(i for i in sorted(group) if freed.get(i, set()) >= group - {i})
        found.append(StuckGroup(members or tuple(sorted(group)), tuple(sorted(group))))
    return found


class _Past(NamedTuple):
    """What the progress clock needs to know of one look at the run."""

    time: float  #: [s]
    position: Array  #: (N, 2) [m]
    goal: Array  #: (N, 2) [m]
    stops_left: IntArray  #: (N,)


class CounterfactualTest:
    """Finds the deadlocks of a run by forecasts; one object per episode."""

    def __init__(self, world: World) -> None:
        robots = len(world.robots)
        self._world = world
        self._progress = ProgressClock(world, step=BODY_STEP)
        self._caught_up = -1.0  # s, up to when the clock knows the past
        self._past: deque[_Past] = deque(maxlen=RECORDED_LOOKS)
        #: (N,) until then a robot is known to be no part of a deadlock [s]
        self.free_until = np.full(robots, -np.inf)

    def update(self, frame: Frame) -> None:
        """Keep what the progress clock will need once a forecast is asked for."""
        sensed, intent = frame.sensed, frame.intent
        position, goal = sensed.pose[:, :2].copy(), intent.goal.copy()
        self._past.append(_Past(sensed.time, position, goal, intent.tasks_left))

    def deadlocks(
        self, forecast: Forecast, asked: set[int], time: float, look_ahead: float
    ) -> list[StuckGroup]:
        """Find the deadlocks that stand at ``time`` [s].

        Robots in ``asked`` that are part of none are not to be asked about before
        ``free_until``: they make progress then, or the deadlock that they will be part of is
        complete then.

        Args:
            forecast: from this moment on.
            asked: robots that may be part of a deadlock.
            time: [s].
            look_ahead: how long the robots may stand once no event is awaited [s].
        """
        settled = self._settled(time)
        watch = ContinuationWatch(
            self._clock_at(time), asked, settled=settled, until=settled + look_ahead
        )
        answer = forecast(watch)
        if answer is None:  # the stack fails in the continuation, which shows nothing
            self.free_until[sorted(asked)] = time + ASK_AGAIN
            return []
        last = self._learn(codec.decode(ContinuationAnswer, answer, where="forecast"), asked, time)
        if not any(last[i] <= time for i in asked & set(last)):
            return []
        freed_by = self._freed_by(forecast, set(last), time, settled)
        return self._standing(last, freed_by, time)

    def _learn(self, seen: ContinuationAnswer, asked: set[int], time: float) -> dict[int, float]:
        """Note until when robots are free; last progress of the stuck ones [s]."""
        for robot, freed in seen.freed.items():
            self.free_until[int(robot)] = max(freed, time + ASK_SOONEST)
        last = {int(i): progress for i, progress in seen.stuck.items()}
        in_vain = asked - set(last) - {int(i) for i in seen.freed}
        self.free_until[sorted(in_vain)] = time + ASK_AGAIN
        for i, progress in last.items():
            self.free_until[i] = max(self.free_until[i], progress)
        return last

    def _standing(
        self, last: Mapping[int, float], freed_by: Mapping[int, set[int]], time: float
    ) -> list[StuckGroup]:
        """Find the deadlocks complete at ``time`` [s]; the others are asked about later."""
        here = {i for i in last if last[i] <= time}
        # A robot that gets stuck later counts if one that is stuck now depends on it.
        party = here | {i for i in last if freed_by[i] & here}
        standing = []
        for members, robots in stuck_groups(party, {i: freed_by[i] & party for i in party}):
            complete = max(last[i] for i in members)
            if complete > time:
                self.free_until[list(robots)] = complete + SHOWN_AFTER
            else:
                standing.append(StuckGroup(members, tuple(sorted(here & set(robots)))))
        return standing

    def _freed_by(
        self, forecast: Forecast, stuck: set[int], time: float, settled: float
    ) -> dict[int, set[int]]:
        """Find who goes free without each of ``stuck``; all others, if that cannot be tried."""
        freed: dict[int, set[int]] = {i: stuck - {i} for i in stuck}
        for i in sorted(stuck) if len(stuck) > 1 else ():
            watch = CounterfactualWatch(stuck - {i}, settled=settled, until=settled + FREE_WITHIN)
            answer = forecast(watch, without=i)
            if answer is None:
                break
            freed[i] = set(codec.decode(CounterfactualAnswer, answer, where="forecast").freed)
        return freed

    def _clock_at(self, time: float) -> ProgressClock:
        """Advance the progress clock to ``time`` [s]; it knows all since each robot's last stop."""
        now = self._past[-1]
        for i in range(len(self.free_until)):
            begin = len(self._past)
            while begin > 0 and self._past[begin - 1].stops_left[i] == now.stops_left[i]:
                begin -= 1
            for k in range(begin, len(self._past)):
                at, position, goal, left = self._past[k]
                if at > self._caught_up:
                    self._progress.advance(i, at, position[i], goal[i], int(left[i]))
        self._caught_up = time
        return self._progress

    def _settled(self, time: float) -> float:
        """Find when blockages and outages in force, and people who leave, will have gone [s]."""
        ends = [event.end for event in self._world.events if event.start <= time]
        ends += [human.leaves_at for human in self._world.humans]
        return max([time, *(end for end in ends if end <= time + AWAITED_WITHIN)])
