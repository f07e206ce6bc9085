"""Labels by continuation: what never reaches its next stop is stuck, whoever may claim what.

Nothing here uses the oracle or any of its parts: no blocked-by edge, no clock of its progress, no
rule of who is a member. What counts are motion and the stops that robots reach.

- A robot is *stuck* at a moment if it does not reach its next stop (of an idle robot on its way
  to a parking spot: the spot) in most of five continuations of 3,600 s without outside events. The
  first one is the run itself; in the others all robots are shifted by up to 3 mm. One that gets
  through only after all have stood or crept for 120 s counts as stuck; its label is *borderline*.
- Members and victims: see :mod:`benchmarks.oracle.membership`.
- The *onset* of a deadlock is the later one of two moments. *Sealed*: the latest fork time from
  which most of three continuations with small differences still let a member through. *Standing*:
  since when each member stands or creeps for good on the way to this stop.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from benchmarks.oracle.continuing import CONTINUE, Fate, Outcome, Run
from benchmarks.oracle.membership import Group, groups_of
from mrta_falsify.core.arrays import IntArray
from mrta_falsify.core.config import StackConfig
from mrta_falsify.core.world import World

CONTINUATIONS = 5  # the run itself, and four with small differences
FORKS = 3  # continuations with small differences from each fork time
FREE_WITHIN = 300.0  # s in which others must get through once a robot is gone: 13 m at 5 cm/s
STALLED_FOR = 8.0  # s of standing that make a moment before an outside event worth a label
WANDERING_FOR = 60.0  # s on the way to one stop that do so as well
JUST_BEFORE = 0.2  # s; two ticks
RESOLUTION = 0.5  # s of fork times
LOOK_BACK = 8.0  # s before the members stand; whether the deadlock was sealed earlier still is open
AFTER_ONSET = 2.0  # s; when robots are removed, if outside events come between
SETTLED = 60.0  # s after a moment; robots that come to rest later are on the move


@dataclass(frozen=True)
class Deadlock:
    """Robots that keep each other, or something keeps, from ever reaching their next stops."""

    members: tuple[int, ...]
    victims: tuple[int, ...]
    onset: float  #: [s]
    sealed: float | None  #: latest fork time that lets a member through [s]; None: before 8 s ...
    #: ... before the members stand
    is_moving: bool  #: a member drives about in vain for good
    is_borderline: bool  #: continuations differ, a robot creeps through late, or members move
    moment: float  #: from which it was found [s]

    @property
    def group(self) -> tuple[int, ...]:
        """Members and victims."""
        return tuple(sorted(self.members + self.victims))


@dataclass(frozen=True)
class Label:
    """What became of a run."""

    deadlocks: tuple[Deadlock, ...]
    is_borderline: bool  #: there is none, but in some continuations there is
    ended: float  #: end of the run [s]
    continued: float  #: simulated in all continuations of votes [s]


@dataclass(frozen=True)
class Votes:
    """What several continuations from one moment say."""

    moment: float
    stuck: frozenset[int]  #: in most of them
    doubtful: frozenset[int]  #: the continuations differ, or it crept through
    fates: tuple[Fate, ...]

    @property
    def reference(self) -> Fate:
        """The first continuation in which most of the stuck robots are."""
        return max(self.fates, key=lambda fate: len(fate.stuck & self.stuck))


def label(world: World, config: StackConfig, *, thorough: bool = False) -> Label:
    """Find all deadlocks of a run up to the world's horizon.

    Args:
        world: what to simulate.
        config: the stack under test.
        thorough: simulate all 3,600 s, even if the poses repeat themselves.
    """
    run = Run(world, config, thorough=thorough)
    found: list[Deadlock] = []
    doubtful, continued = False, 0.0
    try:
        for moment in _moments(world):
            run.advance(moment)
            if run.is_over:
                break
            known = {i for deadlock in found for i in deadlock.group}
            if not _suspects(run) - known:
                continue
            votes = vote(run)
            continued += sum(fate.ended - run.time for fate in votes.fates)
            doubtful = doubtful or bool(votes.doubtful)
            new = [d for d in _deadlocks(run, votes) if not _is_known(d, found)]
            found += new
        ended = run.time
    finally:
        run.close()
    return Label(tuple(found), doubtful and not found, ended, continued)


def vote(run: Run) -> Votes:
    """Let several continuations say who is stuck, until no further one can change the majority.

    Two that last all of the 3,600 s and agree are enough.
    """
    fates: list[Fate] = []
    majority = CONTINUATIONS // 2 + 1
    for shift in range(CONTINUATIONS):
        fates.append(run.fate(shift=shift))
        stuck, free = _ballots(fates)
        whole = sum(fate.ended - run.time >= CONTINUE - 1.0 for fate in fates)
        enough = 2 if whole >= 2 else majority
        if (np.maximum(stuck, free) >= enough).all() and (stuck * free == 0).all():
            break
        if (np.maximum(stuck, free) >= majority).all():
            break
    crept = {i for fate in fates for i, o in enumerate(fate.outcomes) if o is Outcome.CREPT}
    split = set(np.flatnonzero((stuck > 0) & (free > 0)).tolist())
    won = frozenset(np.flatnonzero(stuck > free).tolist())
    return Votes(run.time, won, frozenset(split | crept), tuple(fates))


def _ballots(fates: list[Fate]) -> tuple[IntArray, IntArray]:
    """In how many continuations each robot is stuck, and free ``(N,)``."""
    stuck = np.array([[o is not Outcome.FREE for o in fate.outcomes] for fate in fates])
    return stuck.sum(axis=0), (~stuck).sum(axis=0)


def _moments(world: World) -> Iterator[float]:
    """When to look: before each outside event, and at the end."""
    times = {task.arrival for task in world.tasks} | {event.start for event in world.events}
    yield from sorted(t - JUST_BEFORE for t in times if STALLED_FOR < t < world.horizon)
    yield world.horizon


def _suspects(run: Run) -> set[int]:
    """Robots that have made no way to their next stop for long."""
    waited = run.time - run.count.waiting_since
    stood = np.minimum(waited, run.time - run.still_since())
    slow = (stood >= STALLED_FOR) | (waited >= WANDERING_FOR)
    return set(np.flatnonzero(slow & run.count.wants).tolist())


def _is_known(deadlock: Deadlock, found: list[Deadlock]) -> bool:
    return any(set(deadlock.members) & set(known.group) for known in found)


def _deadlocks(run: Run, votes: Votes) -> Iterator[Deadlock]:
    """Find groups, onsets and members of the robots that are stuck at a moment."""
    for group in groups_of(votes.stuck, _removals(run, votes.stuck)):
        standing = _standing(run, votes, group)
        is_moving = standing > votes.moment + SETTLED
        sealed = None if is_moving else _sealed(run, group, standing)
        onset = votes.moment if is_moving else max(standing, sealed or 0.0)
        final = group
        if not is_moving and _events_between(run.world, onset + AFTER_ONSET, votes.moment):
            final = _group_at(run, votes, group, onset + AFTER_ONSET)
        yield Deadlock(
            members=final.members,
            victims=final.victims,
            onset=onset,
            sealed=sealed,
            is_moving=is_moving,
            is_borderline=is_moving or bool(set(group.members) & votes.doubtful),
            moment=votes.moment,
        )


def _removals(run: Run, stuck: frozenset[int]):
    """A trial of removals from the run's moment."""

    def freed_without(gone: tuple[int, ...]) -> set[int]:
        fate = run.fate(without=gone, among=stuck - set(gone), limit=FREE_WITHIN)
        return set(stuck) - fate.stuck - set(gone)

    return freed_without


def _standing(run: Run, votes: Votes, group: Group) -> float:
    """Since when all members stand or creep on the way to their stops [s]."""
    still, since = votes.reference.still_since, run.count.waiting_since
    return max(max(still[i], float(since[i])) for i in group.members)


def _sealed(run: Run, group: Group, standing: float) -> float | None:
    """Latest fork time [s] that lets a member through, to 0.5 s; None: before all others."""
    needed = run.count.reached + 1
    low, high = max(0.0, standing - LOOK_BACK), standing
    step = RESOLUTION
    while high < run.time and _lets_through(run, group, needed, high):
        low, high, step = high, min(high + step, run.time), 2.0 * step
    if low < standing and not _lets_through(run, group, needed, low):
        return None
    while high - low > RESOLUTION:
        middle = 0.5 * (low + high)
        if _lets_through(run, group, needed, middle):
            low = middle
        else:
            high = middle
    return low


def _lets_through(run: Run, group: Group, needed: IntArray, time: float) -> bool:
    """Whether most continuations from a fork at ``time`` [s] let a member through."""
    again = Run(run.world, run.config, thorough=run.thorough)
    try:
        again.advance(time)
        majority = FORKS // 2 + 1
        through = blocked = 0
        for shift in range(1, FORKS + 1):
            fate = again.fate(
                shift=shift, needed=needed, among=set(group.members), limit=FREE_WITHIN
            )
            if set(group.members) - fate.stuck:
                through += 1
            else:
                blocked += 1
            if max(through, blocked) >= majority:
                break
        return through >= majority
    finally:
        again.close()


def _events_between(world: World, start: float, end: float) -> bool:
    times = [task.arrival for task in world.tasks] + [event.start for event in world.events]
    return any(start < time <= end for time in times)


def _group_at(run: Run, votes: Votes, group: Group, time: float) -> Group:
    """The group as removals at ``time`` [s] show it, before outside events changed it."""
    again = Run(run.world, run.config, thorough=run.thorough)
    try:
        again.advance(time)
        same = (again.count.reached == run.count.reached) & again.count.wants
        asked = frozenset(i for i in votes.stuck if same[i])
        stuck = again.fate(among=asked).stuck & asked
        for other in groups_of(stuck, _removals(again, frozenset(stuck))):
            if set(other.members) & set(group.members):
                return other
        return group
    finally:
        again.close()
