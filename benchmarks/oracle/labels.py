"""Labels by continuation: what never resolves is a deadlock, whoever may claim what.

Nothing here uses blocked-by edges or the oracle's claims. Both share two definitions: what
counts as progress (``progress_clock``) and who is a member (``counterfactual.stuck_groups``).
From the moment under question on, no outside event happens any more (no new task, blockage or
outage; those in force run their course, people walk on), and the same run continues for 600 s.
Robots that then still have a goal and made no progress in all that time are stuck. One of them
is a *member* if the others it is stuck with go free once it is gone; the rest are victims.

The *onset* of a deadlock is the earliest time from which none of its members ever makes
progress again or goes anywhere: the last time at which a member got nearer to its goal, or
was more than 0.5 m from the place where it stands for good. Before that some member was still
trying something. Members that never come to rest are a livelock (``stands`` is false).

The run is continued once; each "what if robot j were not there" is a fork of the process at
the moment, so that nothing is simulated twice.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.core.fleet import Frame
from mrta_falsify.core.world import World
from mrta_falsify.specs.deadlock.progress_clock import ProgressClock
from mrta_falsify.specs.deadlock.stuck_groups import stuck_groups
from simulator_interface.episode import Episode
from simulator_interface.forking import run_in_copy

CONTINUE = 600.0  # s
FREE_WITHIN = 120.0  # s in which the rest must go free once a member is gone
LEFT = 1.0  # m, a robot farther from its place than this went free
SETTLED = 30.0  # s in which a deadlock may still shift before it stands for good
#: s without any motion after which nothing will move any more: six times the
#: longest waiting time in the stack (10 s before a lead passes on); checked by ``--thorough``
AT_REST_FOR = 60.0
GHOST_AT_REST_FOR = 30.0  # s, the same for what-if runs
SAME_POSE = 1e-3  # m, rad
EVERY = 2  # ticks between two looks
BODY = 0.25  # m nearer to the goal: more than this in what is left of the run is going on
PLACE = 0.5  # m, a robot that stays within this of one place stands


@dataclass(frozen=True)
class Deadlock:
    """One group of robots that never goes on."""

    members: tuple[int, ...]  #: without each of whom the others go free
    group: tuple[int, ...]  #: members and victims
    settled: float  #: last time a member got nearer by a body's radius [s]
    onset: float  #: since when its members neither progress nor leave their places [s]
    stands: bool  #: all members stand; else some move about in vain, and onset is the progress's


@dataclass(frozen=True)
class Label:
    """What became of a moment."""

    deadlocks: tuple[Deadlock, ...]
    continued: float  #: simulated after the moment [s]


@dataclass(frozen=True)
class _Fate:
    """How the continuation ended."""

    stuck: list[int]  #: robots with a goal and without progress
    progress: list[float]  #: N last progress [s]
    settled: list[float]  #: N the same by a body's radius [s]
    arrived: list[float]  #: N since when each has been within 0.5 m of its last place [s]
    ended: float  #: [s]


class _RestClock:
    """Since when has nobody moved at all?"""

    def __init__(self) -> None:
        self._pose: Array | None = None
        self._since = 0.0

    def lasts(self, frame: Frame) -> float:
        """For how long [s]; 0 while people walk."""
        pose, time = frame.sensed.pose, frame.sensed.time
        walks = bool((np.abs(frame.sensed.human_velocity) > 1e-3).any())
        if self._pose is None or walks or np.abs(pose - self._pose).max() > SAME_POSE:
            self._pose, self._since = pose.copy(), time
        return time - self._since


def label(
    world: World,
    config: StackConfig,
    moment: float,
    *,
    standing_only: bool = True,
    thorough: bool = False,
) -> Label:
    """Label of the run of ``world`` at ``moment`` [s].

    Args:
        world: what was run.
        config: the stack under test.
        moment: claimed onset [s].
        standing_only: robots that never come to rest are of no interest (a livelock is another
            specification's business); otherwise they are labelled as well.
        thorough: simulate all 600 s, even if nothing moves.
    """
    still = stopped(world, moment)
    episode = Episode(still, dataclasses.replace(config, engine=Choice("kinematic")))
    frames = episode.frames()
    progress, coarse = ProgressClock(still), ProgressClock(still, step=BODY)
    history: list[Array] = []
    for frame in frames:
        if frame.sensed.tick % EVERY == 0:
            progress.update(frame)
            coarse.update(frame)
            history.append(frame.sensed.pose[:, :2].copy())
        if frame.sensed.time >= moment:
            break
    parts = _Forks(episode, frames, moment)
    fate = parts.main((progress, coarse), history, standing_only, thorough)
    stuck = set(fate.stuck)
    # Who wanders about in vain anyway leaves its place without anybody's absence.
    standing = {i for i in stuck if fate.arrived[i] <= moment + SETTLED}
    freed = {i: parts.without(i, standing) if len(stuck) > 1 else set() for i in sorted(stuck)}
    frames.close()
    found = []
    for members, group in stuck_groups(stuck, freed):
        arrived = max(fate.arrived[i] for i in members)
        stands = arrived <= moment + SETTLED
        onset = max(fate.progress[i] for i in members)
        onset = max(onset, arrived) if stands else onset
        settled = max(fate.settled[i] for i in members)
        found.append(
            Deadlock(members=members, group=group, settled=settled, onset=onset, stands=stands)
        )
    return Label(tuple(found), fate.ended - moment)


def stopped(world: World, moment: float) -> World:
    """``world`` in which nothing new comes from outside after ``moment`` [s]."""
    arrivals = [task.arrival for task in world.tasks]
    assert arrivals == sorted(arrivals), "dropping later tasks must not renumber earlier ones"
    tasks = tuple(task for task in world.tasks if task.arrival <= moment)
    events = tuple(event for event in world.events if event.start <= moment)
    return dataclasses.replace(world, tasks=tasks, events=events, horizon=moment + CONTINUE)


class _Forks:
    """Continuations of one run, each in a process of its own, one after the other."""

    def __init__(self, episode: Episode, frames, moment: float) -> None:
        self._episode = episode
        self._frames = frames
        self._moment = moment
        # Blockages and outages in force that end: nothing is settled before that.
        ends = [e.end for e in episode.world.events if e.end < episode.world.horizon]
        leaves = [h.leaves_at for h in episode.world.humans]
        ends += [time for time in leaves if time < episode.world.horizon]
        self._settled = max([moment, *ends])

    def main(
        self,
        clocks: tuple[ProgressClock, ProgressClock],
        history: list[Array],
        standing_only: bool,
        thorough: bool,
    ) -> _Fate:
        """What becomes of everybody if nothing is changed; ``clocks`` are fine and coarse."""
        progress, coarse = clocks

        def run() -> dict[str, object]:
            rest, place = _RestClock(), None
            left = np.zeros(len(progress.last), dtype=np.bool_)
            horizon = self._episode.world.horizon
            for frame in self._frames:
                time = frame.sensed.time
                resting = rest.lasts(frame)
                if frame.sensed.tick % EVERY:
                    continue
                progress.update(frame)
                coarse.update(frame)
                history.append(frame.sensed.pose[:, :2].copy())
                with_goal = np.isfinite(frame.intent.goal).all(axis=1)
                if self._episode.all_done and not with_goal.any():
                    break
                if not thorough and time >= self._settled and resting >= AT_REST_FOR:
                    break
                if time >= self._moment + SETTLED:
                    place = frame.sensed.pose[:, :2] if place is None else place
                    if standing_only:
                        left |= np.hypot(*(frame.sensed.pose[:, :2] - place).T) > 2.0 * PLACE
                    went_on = coarse.last > self._moment + SETTLED
                    if not thorough and (left | went_on | ~with_goal).all():
                        break
                if time >= horizon:
                    break
            stuck = with_goal & ~left & (coarse.last <= self._moment + SETTLED)
            way = np.array(history)
            away = np.hypot(*(way - way[-1]).transpose(2, 0, 1)) > PLACE
            looks = np.where(away.any(axis=0), len(way) - np.argmax(away[::-1], axis=0), 0)
            return {
                "stuck": np.flatnonzero(stuck).tolist(),
                "progress": progress.last.tolist(),
                "settled": coarse.last.tolist(),
                "arrived": (looks * EVERY * self._episode.dt).tolist(),
                "ended": time,
            }

        return _Fate(**run_in_copy(run))

    def without(self, gone: int, stuck: set[int]) -> set[int]:
        """Stuck robots that leave their place once ``gone`` has vanished."""
        rest = stuck - {gone}

        def run() -> dict[str, object]:
            self._episode.remove(gone)
            freed: set[int] = set()
            place: Array | None = None
            resting = _RestClock()
            for frame in self._frames:
                time = frame.sensed.time
                if place is None:
                    place = frame.sensed.pose[:, :2].copy()
                away = np.hypot(*(frame.sensed.pose[:, :2] - place).T)
                goal = np.isfinite(frame.intent.goal[:, 0])
                freed |= {i for i in rest if away[i] > LEFT or not goal[i]}
                at_rest = time >= self._settled and resting.lasts(frame) >= GHOST_AT_REST_FOR
                if freed == rest or at_rest or time >= self._moment + FREE_WITHIN:
                    break
            return {"freed": sorted(freed)}

        return set(run_in_copy(run)["freed"])
