"""Runs of a case to a moment, and what becomes of its robots from there on.

A continuation is a fork of the run. In the *whole world* everything comes that the world holds.
In one *without arrivals* nothing comes from outside any more: no task arrives, no blockage or
outage begins. Those in force run their course and people walk on.
"""

from __future__ import annotations

import enum
from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from experiments.oracle.recurrence import LONGEST, REPEATED, repeats_itself
from experiments.oracle.shifting import ShiftingEpisode
from experiments.oracle.stacks import clock_of, timed_until
from experiments.oracle.stops import StopCount
from mrta_falsify.core.arrays import Array, IntArray
from mrta_falsify.core.config import StackConfig
from mrta_falsify.core.directives import Wait, WaitUntil
from mrta_falsify.core.fleet import Frame, Phase
from mrta_falsify.core.world import World
from mrta_falsify.process.supervisor import run_supervised

CONTINUE = 3600.0  # s, as issue 15 says
#: s; who gets through after the whole building has done nothing but stand and creep for so long,
#: although nothing was to be waited for, got through by creeping
CREPT = 120.0
SETTLED_BY = 600.0  # s after the fork by which who stands has come to stand
LOOK_BACK = LONGEST + REPEATED  # s of poses that are compared
CHECK_EVERY = 10.0  # s between two looks whether the poses repeat themselves
WINDOW = 10.0  # s over which a robot's speed is taken
#: of its top speed; who makes less way than this stands or creeps (4 cm/s for a Waffle)
CREEPING = 0.03
NEAR = 1.0  # m; who is no farther from where it ends up may have moved a little since it stood
PLACE = 0.25  # m, about a robot's radius; who stays within this of one place for good stands too
MOVED = 1e-7  # m or rad in a tick; less is rounding
DRIFT = 0.002  # m/s; a slower person stands
NEVER = -1.0


class Outcome(enum.StrEnum):
    """What became of a robot in a continuation."""

    FREE = "free"  #: reached its next stop, or wants none
    CREPT = "crept"  #: reached it after all had stood or crept for 120 s
    STUCK = "stuck"  #: never reached it


@dataclass(frozen=True)
class Fate:
    """What became of all robots in a continuation."""

    outcomes: tuple[Outcome, ...]  #: N
    freed_at: tuple[float, ...]  #: N when each reached its next stop [s], -1: never
    #: N since when each stands or creeps, up to the end or to 600 s after the fork [s]
    still_since: tuple[float, ...]
    #: N since when each stays within 1 m of its place then [s]
    there_since: tuple[float, ...]
    ended: float  #: [s]
    proved: bool  #: it ended because the poses repeated themselves
    furniture: tuple[tuple[float, ...], ...] = ()  #: (F, 3) poses of movable furniture at the end
    people: tuple[tuple[float, ...], ...] = ()  #: (H, 2) where people stand at the end, nan: away

    @property
    def stuck(self) -> frozenset[int]:
        """Robots that did not get through other than by creeping."""
        return frozenset(i for i, o in enumerate(self.outcomes) if o is not Outcome.FREE)


class Run:
    """A case run to a moment; its continuations are forks of the process."""

    def __init__(self, world: World, config: StackConfig, *, thorough: bool = False) -> None:
        """Begin a run.

        Args:
            world: what to simulate.
            config: the stack under test.
            thorough: continuations last to their limit, even if the poses repeat themselves.
        """
        self.world, self.config, self.thorough = world, config, thorough
        self._episode = ShiftingEpisode(world, config)
        self._frames = self._episode.frames()
        self._poses: list[Array] = []
        self._clock = max(clock_of(config), _longest_pause(world))
        self._quiet_since = 0.0  #: since when neither robot nor person has moved [s]
        self._slowest = CREEPING * np.array([robot.max_speed for robot in world.robots])
        self.count = StopCount(world, is_outside=config.stack is not None)
        self.time = 0.0
        self.is_over = False  #: all is delivered, and no robot wants anything

    def close(self) -> None:
        """Free the engine."""
        self._frames.close()

    def advance(self, until: float) -> None:
        """Go on until ``until`` [s], or until all is delivered."""
        if self._poses and self.time >= until - 1e-9:
            return
        for frame in self._frames:
            self._take(frame)
            if self.is_over or self.time >= until - 1e-9:
                return

    def _take(self, frame: Frame) -> None:
        self.count.update(frame)
        self.last, self.goal = frame.sensed, frame.intent.goal
        self.time = frame.sensed.time
        self._poses.append(frame.sensed.pose)
        before = self._poses[-2] if len(self._poses) > 1 else np.inf
        if np.abs(frame.sensed.pose - before).max() > MOVED or self._walks(frame):
            self._quiet_since = self.time
        self.is_over = self._episode.all_done and not self.count.wants.any()

    def still_since(self, until: float | None = None) -> Array:
        """Since when each robot stands or creeps, or stays at one place ``(N,)`` [s].

        Args:
            until: up to when [s]; None: up to now.
        """
        position, dt = self._positions(until), self._episode.dt
        last = len(position) - 1
        later = np.minimum(np.arange(last + 1) + round(WINDOW / dt), last)
        moves = np.hypot(*(position[later] - position).transpose(2, 0, 1)) > self._slowest * WINDOW
        moves &= np.hypot(*(position - position[last]).transpose(2, 0, 1)) > PLACE
        return _after_the_last(moves) * dt

    def there_since(self, until: float | None = None) -> Array:
        """Since when each robot stays within 1 m of where it is ``(N,)`` [s].

        Args:
            until: up to when [s]; None: up to now.
        """
        position = self._positions(until)
        away = np.hypot(*(position - position[-1]).transpose(2, 0, 1)) > NEAR
        return _after_the_last(away) * self._episode.dt

    def _positions(self, until: float | None) -> Array:
        kept = len(self._poses) if until is None else round(until / self._episode.dt) + 1
        return np.array([pose[:, :2] for pose in self._poses[:kept]])

    def fate(
        self,
        *,
        shift: int = 0,
        without: Collection[int] = (),
        needed: IntArray | None = None,
        among: Collection[int] | None = None,
        limit: float = CONTINUE,
        arrivals: bool = False,
    ) -> Fate:
        """Find out what becomes of the robots in a continuation.

        Args:
            arrivals: whether what the world still holds comes: tasks, blockages, outages.
            shift: seed of the small differences, 0: none.
            without: robots that are taken away.
            needed: ``(N,)`` stops that a robot must have reached to be free; None: one more.
            among: robots of interest; None: all that want something now. Others count as free.
            limit: how long the continuation lasts at most [s].
        """
        goal = self.count.reached + 1 if needed is None else needed
        asked = set(np.flatnonzero(self.count.wants).tolist() if among is None else among)

        def run() -> dict[str, object]:
            self._episode.become_copy()
            if not arrivals:
                self._episode.forget_events()
            self._episode.shift(shift)
            for robot in without:
                self._episode.remove(robot)
            settled = self._settled(limit, arrivals=arrivals)
            return self._continue(asked - set(without), goal, needed is None, limit, settled)

        answer = run_supervised(run)
        return Fate(
            outcomes=tuple(Outcome(outcome) for outcome in answer["outcomes"]),
            freed_at=tuple(answer["freed_at"]),
            still_since=tuple(answer["still_since"]),
            there_since=tuple(answer["there_since"]),
            ended=answer["ended"],
            proved=answer["proved"],
            furniture=tuple(map(tuple, answer["furniture"])),
            people=tuple(map(tuple, answer["people"])),
        )

    def _continue(
        self, asked: set[int], goal: IntArray, idle_is_free: bool, limit: float, settled: float
    ) -> dict[str, object]:
        """Go on in this copy until the fate of all ``asked`` is known."""
        began, count = len(self._poses), self.count
        freed_at = np.full(len(goal), NEVER)
        end, check, proved = self.time + limit, self.time + CHECK_EVERY, False
        settled_by = self.time + SETTLED_BY
        waiting = np.isin(np.arange(len(goal)), sorted(asked))
        crept = np.zeros(len(goal), dtype=np.bool_)
        busy: list[bool] = []
        for frame in self._frames:
            self._take(frame)
            busy.append(self.time <= settled or self._is_served(frame))
            is_free = count.reached >= goal
            is_free |= ~count.wants & (idle_is_free or self.is_over)
            new = waiting & is_free
            if new.any():
                crept |= new & self._has_crept(began, busy)
                freed_at[new] = self.time
                waiting &= ~new
            if not waiting.any() or self.time >= end:
                break
            if busy[-1]:
                settled = max(settled, self.time)
            if self.time >= check:
                check = self.time + CHECK_EVERY
                proved = not self.thorough and self._repeats_itself(began, settled)
                if proved:
                    break
        names = np.where(crept, Outcome.CREPT.value, Outcome.FREE.value)
        names[waiting & count.wants] = Outcome.STUCK.value
        return {
            "outcomes": names.tolist(),
            "freed_at": freed_at.tolist(),
            "still_since": self.still_since(settled_by).tolist(),
            "there_since": self.there_since(settled_by).tolist(),
            "ended": self.time,
            "proved": proved,
            "furniture": self.last.furniture_pose.tolist(),
            "people": self.last.human_position.tolist(),
        }

    def _settled(self, limit: float, *, arrivals: bool) -> float:
        """When nothing is scheduled any more [s]; what lies beyond the limit does not matter."""
        world, now = self.world, self.time
        times = [event.end for event in world.events if event.start <= now or arrivals]
        times.append(timed_until(self.config))
        if arrivals:
            times += [event.start for event in world.events]
            times += [task.arrival for task in world.tasks]
        steps = [step for human in world.humans for step in human.directives]
        times += [step.time for step in steps if isinstance(step, WaitUntil)]
        times += [time for human in world.humans for time in (human.appears_at, human.leaves_at)]
        times += [robot.joins_at for robot in world.robots]
        return max([now, *(time for time in times if time <= now + limit)])

    def _is_served(self, frame: Frame) -> bool:
        """Whether a clock runs that shows in no pose: a service, or a person who walks."""
        serves = bool(
            (frame.intent.phase == int(Phase.SERVING)).any() or self.count.is_served.any()
        )
        return serves or self._walks(frame)

    def _walks(self, frame: Frame) -> bool:
        """Whether a person walks; one who makes room for others comes to rest ever more slowly."""
        return bool(np.abs(np.nan_to_num(frame.sensed.human_velocity)).max(initial=0.0) > DRIFT)

    def _repeats_itself(self, began: int, settled: float) -> bool:
        """Whether the poses have repeated themselves since nothing is scheduled any more."""
        dt = self._episode.dt
        first = max(began, round(settled / dt) + 1)
        # A timer of a stack or a person began with the last move at the latest.
        clock = self._clock if self.time - self._quiet_since < self._clock else 0.0
        kept = round((LOOK_BACK + clock) / dt)
        return repeats_itself(np.array(self._poses[first:][-kept:]), dt, clock=clock)

    def _has_crept(self, began: int, busy: list[bool]) -> bool:
        """Whether this continuation did nothing but stand and creep for 120 s on end.

        Args:
            began: number of its first pose.
            busy: whether anything was to be waited for at each of its ticks.
        """
        dt = self._episode.dt
        position = np.array([pose[:, :2] for pose in self._poses[began:]])
        ahead = round(WINDOW / dt)
        away = np.hypot(*(position[ahead:] - position[:-ahead]).transpose(2, 0, 1))
        stirs = (away > self._slowest * WINDOW).any(axis=1) | np.array(busy[: len(away)], np.bool_)
        ends = np.flatnonzero(np.concatenate([[True], stirs, [True]]))
        return bool((np.diff(ends).max() - 1) * dt + WINDOW >= CREPT)


def _after_the_last(moves: Array) -> Array:
    """Tick of each robot after the last one at which it moves, of ``(T, N)``."""
    last = len(moves) - 1
    behind = np.argmax(moves[::-1], axis=0)
    return np.where(moves.any(axis=0), last - behind + 1, 0)


def _longest_pause(world: World) -> float:
    """Longest time that a person of the world stands by its script [s]."""
    steps = [step for human in world.humans for step in human.directives]
    pauses = [step.duration for step in steps if isinstance(step, Wait)]
    return max((pause for pause in pauses if pause < CONTINUE), default=0.0)
