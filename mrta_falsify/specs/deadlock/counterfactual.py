"""Who gets going again, and who holds up whom: what the deadlock oracle asks of a forecast.

A deadlock is a set of robots that never resolves although nothing more comes from outside; a
member of it is a robot without which the others go free. Both are read off copies of the run.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from mrta_falsify.core.arrays import Array, IntArray
from mrta_falsify.core.fleet import Frame
from mrta_falsify.core.protocols import Forecast
from mrta_falsify.core.world import World
from mrta_falsify.specs.deadlock.progress_clock import Progress

NEARER = 0.25  # m nearer to the goal than ever before: it goes on
STRIDE = 2  # ticks between two looks
AT_REST_FOR = 30.0  # s without any motion in the building: three times our stack's longest wait
ROBOTS_REST_FOR = 60.0  # s the same while people walk
SAME_POSE = 1e-3  # m, rad
LEG = 10.0  # s; who moves in such a time farther than in the one before drifts off ...
DRIFT = 1e-5  # m, rad ... if it is more than this: less may be rounding or jitter
STROLL = 0.1  # m/s; a person who moves, but no faster than this ...
SQUEEZE = 5.0  # s ... for so long, is squeezing past something
PLACE = 0.5  # m; who stays within this of one place stands, even if it shuffles ...
AT_LAST = 60.0  # s ... for so long at the end of a forecast
SHOWN = 1.5  # s after which a deadlock shows in the blocked-by edges, for the evidence
ASK_SOONEST = 1.0  # s between two questions about a robot
ASK_AGAIN = 30.0  # s after which who moves in vain is asked about again
LEFT = 1.0  # m from its place: it has gone free
WITHOUT_FOR = 120.0  # s in which the rest must go free once a member is gone
RECORDED = 2400  # looks that are kept of the past: ten minutes
AWAITED = 300.0  # s; events in force that end this soon are waited for


class _Rest:
    """Will anything move any more?

    Standing is not enough. Robots in an unstable balance creep off it by micrometres first, each
    leg farther than the last; a person pressed against robots takes minutes to slip past them.
    """

    def __init__(self) -> None:
        self._pose: Array | None = None
        self._robots_since = 0.0  # s
        self._crept = 0.0  # s; last time a person squeezed past something
        self._walked = 0.0  # s; last time a person moved
        self._uncrept: Array | None = None  # (H,) last time each stood or walked [s]
        self._legs: deque[Array] = deque(maxlen=3)  # poses LEG apart, since robots rest
        self._leg_began = 0.0  # s

    def is_lasting(self, frame: Frame) -> bool:
        """Whether everything, or at least every robot, has been at rest for long enough."""
        pose, time = frame.sensed.pose, frame.sensed.time
        if self._pose is None or np.abs(pose - self._pose).max() > SAME_POSE:
            self._pose, self._robots_since = pose.copy(), time
            self._legs.clear()
        if not self._legs or time >= self._leg_began + LEG:
            self._legs.append(pose.copy())
            self._leg_began = time
        speed = np.hypot(*frame.sensed.human_velocity.T)
        moves = speed > SAME_POSE
        if moves.any():
            self._walked = time
        if self._uncrept is None:
            self._uncrept = np.full(len(speed), time)
        self._uncrept[~(moves & (speed < STROLL))] = time
        if (time - self._uncrept > SQUEEZE).any():
            self._crept = time
        rests = time - max(self._robots_since, self._walked) >= AT_REST_FOR
        rests = rests or time - max(self._robots_since, self._crept) >= ROBOTS_REST_FOR
        return rests and not self._drifts()

    def _drifts(self) -> bool:
        """Whether a robot moved farther in the last leg than in the one before."""
        if len(self._legs) < 3:
            return False
        first, second, third = self._legs
        before, lately = np.abs(second - first), np.abs(third - second)
        return bool((lately > np.maximum(2.0 * before, DRIFT)).any())


class GoingOn:
    """Which robots still make progress before ``until``, and which never again?

    Args:
        progress: of the run so far; the watch goes on with it, so it belongs into a copy.
        asked: robots in question; once all of them have gone on, that is all.
        settled: before this time, rest means nothing [s].
        until: [s].
    """

    def __init__(
        self, progress: Progress, asked: Iterable[int], *, settled: float, until: float
    ) -> None:
        self._progress = progress
        self._asked = sorted(asked)
        self._settled = settled
        self._until = until
        self._rest = _Rest()
        self._before = progress.last.copy()
        self._freed: dict[int, float] = {}
        self._with_goal = np.zeros(len(self._before), dtype=np.bool_)
        self._way: deque[tuple[float, Array]] = deque()  # of the last minute
        self._at_rest = False
        self._time = 0.0

    def update(self, frame: Frame) -> bool:
        """See :class:`mrta_falsify.core.protocols.Watch`."""
        if frame.sensed.tick % STRIDE:
            return False
        self._time = time = frame.sensed.time
        last = self._progress.update(frame)
        self._with_goal = np.isfinite(frame.intent.goal[:, 0])
        for i in self._asked:
            if i not in self._freed and (last[i] > self._before[i] or not self._with_goal[i]):
                self._freed[i] = time
        self._way.append((time, frame.sensed.pose[:, :2].copy()))
        while self._way[0][0] <= time - AT_LAST:
            self._way.popleft()
        self._at_rest = time >= self._settled and self._rest.is_lasting(frame)
        return self._at_rest or time >= self._until or len(self._freed) == len(self._asked)

    def answer(self) -> dict[str, Any]:
        """Last progress of who stands for good, and when who was asked about went on [s]."""
        last = self._progress.last
        late = np.array([position for _, position in self._way])
        stands = (np.hypot(*(late - late[-1]).transpose(2, 0, 1)) <= PLACE).all(axis=0)
        stands |= self._at_rest
        quiet = self._time - last >= AT_REST_FOR
        stuck = np.flatnonzero(self._with_goal & quiet & stands)
        return {
            "stuck": {str(i): float(last[i]) for i in stuck},
            "freed": {str(i): time for i, time in self._freed.items()},
            "looked": self._time,
        }


class GoingFree:
    """Which of ``rest`` leave their places, now that somebody is gone?"""

    def __init__(self, rest: Iterable[int], *, settled: float, until: float) -> None:
        self._rest_of_them = frozenset(rest)
        self._settled = settled
        self._until = until
        self._still = _Rest()
        self._place: Array | None = None
        self._freed: set[int] = set()

    def update(self, frame: Frame) -> bool:
        """See :class:`mrta_falsify.core.protocols.Watch`."""
        if frame.sensed.tick % STRIDE:
            return False
        time, position = frame.sensed.time, frame.sensed.pose[:, :2]
        if self._place is None:
            self._place = position.copy()
        away = np.hypot(*(position - self._place).T)
        goal = np.isfinite(frame.intent.goal[:, 0])
        self._freed |= {i for i in self._rest_of_them if away[i] > LEFT or not goal[i]}
        at_rest = time >= self._settled and self._still.is_lasting(frame)
        return self._freed == self._rest_of_them or at_rest or time >= self._until

    def answer(self) -> dict[str, Any]:
        """Who went free."""
        return {"freed": sorted(self._freed)}


def groups_of(
    stuck: Iterable[int], freed: Mapping[int, set[int]]
) -> list[tuple[tuple[int, ...], tuple[int, ...]]]:
    """Members and group of each deadlock.

    Args:
        stuck: robots that do not go on.
        freed: for each of them, who goes free without it.

    Returns:
        Members are those without whom all others of the group go free; where there is no such
        robot, all of them hold it together.
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
        found.append((members or tuple(sorted(group)), tuple(sorted(group))))
    return found


class Future:
    """What is known about the rest of one run, from forecasts; one object per episode."""

    def __init__(self, world: World) -> None:
        robots = len(world.robots)
        self._world = world
        self._progress = Progress(world, step=NEARER)
        self._noted = -1.0  # s, up to when the clock knows the record
        self._record: deque[tuple[float, Array, Array, IntArray]] = deque(maxlen=RECORDED)
        #: (N,) until then a robot is known to be no part of a deadlock [s]
        self.free_at = np.full(robots, -np.inf)

    def note(self, frame: Frame) -> None:
        """Keep what the clock of progress will want to know once it is asked."""
        sensed, intent = frame.sensed, frame.intent
        entry = (sensed.time, sensed.pose[:, :2].copy(), intent.goal.copy(), intent.tasks_left)
        self._record.append(entry)

    def deadlocks(
        self, forecast: Forecast, asked: set[int], time: float, look_ahead: float
    ) -> list[tuple[tuple[int, ...], tuple[int, ...]]]:
        """Deadlocks that stand at ``time`` [s]: members and group of each.

        Robots in ``asked`` that are not part of one are not to be asked about before
        ``free_at``: they go on then, or the deadlock they will be part of is complete then.

        Args:
            forecast: from this moment on.
            asked: robots that may be part of one.
            time: [s].
            look_ahead: for how long, once nothing is awaited, nobody may get nearer [s].
        """
        settled = self._settled(time)
        watch = GoingOn(self._clock(time), asked, settled=settled, until=settled + look_ahead)
        found = forecast(watch)
        assert found is not None
        for i, freed in found["freed"].items():
            self.free_at[int(i)] = max(freed, time + ASK_SOONEST)
        last = {int(i): progress for i, progress in found["stuck"].items()}
        in_vain = asked - set(last) - {int(i) for i in found["freed"]}
        self.free_at[sorted(in_vain)] = time + ASK_AGAIN
        for i, progress in last.items():
            self.free_at[i] = max(self.free_at[i], progress)
        if not any(last[i] <= time for i in asked & set(last)):
            return []
        freed_by = self._freed_by(forecast, set(last), time, settled)
        here = {i for i in last if last[i] <= time}
        # Who gets here later counts if somebody here depends on it.
        party = here | {i for i in last if freed_by[i] & here}
        standing = []
        for members, group in groups_of(party, {i: freed_by[i] & party for i in party}):
            complete = max(last[i] for i in members)
            if complete > time:
                self.free_at[list(group)] = complete + SHOWN
            else:
                standing.append((members, tuple(sorted(here & set(group)))))
        return standing

    def _freed_by(
        self, forecast: Forecast, stuck: set[int], time: float, settled: float
    ) -> dict[int, set[int]]:
        """Who of the others goes free without each of ``stuck``; all, if that cannot be tried."""
        freed: dict[int, set[int]] = {i: stuck - {i} for i in stuck}
        for i in sorted(stuck) if len(stuck) > 1 else ():
            watch = GoingFree(stuck - {i}, settled=settled, until=settled + WITHOUT_FOR)
            answer = forecast(watch, without=i)
            if answer is None:
                break
            freed[i] = set(answer["freed"])
        return freed

    def _clock(self, time: float) -> Progress:
        """The clock of progress at ``time`` [s]; it knows all since each robot's last stop."""
        now = self._record[-1]
        for i in range(len(self.free_at)):
            begin = len(self._record)
            while begin > 0 and self._record[begin - 1][3][i] == now[3][i]:
                begin -= 1
            for k in range(begin, len(self._record)):
                at, position, goal, left = self._record[k]
                if at > self._noted:
                    self._progress.note(i, at, position[i], goal[i], int(left[i]))
        self._noted = time
        return self._progress

    def _settled(self, time: float) -> float:
        """When blockages and outages in force, and people who leave, will have gone [s]."""
        ends = [event.end for event in self._world.events if event.start <= time]
        ends += [human.leaves_at for human in self._world.humans]
        return max([time, *(end for end in ends if end <= time + AWAITED)])
