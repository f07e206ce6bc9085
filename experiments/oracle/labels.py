"""Labels by continuation: what never reaches its next stop is stuck, whoever may claim what.

Nothing here uses the oracle or any of its parts: no blocked-by edge, no clock of its progress, no
rule of who is a member. What counts are motion and the stops that robots reach.

- The *ways* of a robot are the times from one stop to the next, in the run of the whole world,
  which goes on for up to 3,600 s past its horizon. A way without end is one of a stuck robot. A
  claim "for at least B s" is compared with them.
- A *deadlock* is a set of robots that are stuck at the horizon in most of five continuations. The
  first one is the run itself; in the others all robots are shifted by up to 3 mm. One that gets
  through only after all have stood or crept for 120 s counts as stuck; its label is *borderline*.
- Members and victims: see :mod:`experiments.oracle.membership`; of stacks outside
  :mod:`experiments.oracle.own_state`.
- It *stands* from when the last member stands or creeps for good on the way to this stop. Before
  it may have stood within 1 m of there: robots move a little when a timer ends in vain.
- What is *held until new work arrives* stays without arrivals, but not in the whole world. Before
  each arrival of a task and each begin of a blockage or outage, the robots that have long been on
  their way are followed without arrivals.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from experiments.oracle.continuing import CONTINUE, NEVER, Fate, Outcome, Run
from experiments.oracle.membership import Group, groups_of
from experiments.oracle.own_state import groups_by_state, state_at
from experiments.oracle.shut_off import is_shut_off
from experiments.oracle.stacks import with_state_file
from mrta_falsify.core.arrays import IntArray
from mrta_falsify.core.config import StackConfig
from mrta_falsify.core.world import World

CONTINUATIONS = 5  # the run itself, and four with small differences
FREE_WITHIN = 300.0  # s in which others must get through once a robot is gone: 13 m at 5 cm/s
STALLED_FOR = 8.0  # s of standing that make a moment before an outside event worth a label
WANDERING_FOR = 60.0  # s on the way to one stop that do so as well
JUST_BEFORE = 0.2  # s; two ticks
AFTER_STANDING = 2.0  # s; when robots are removed, if outside events come between
SETTLED = 60.0  # s after a moment; robots that come to rest later are on the move


@dataclass(frozen=True)
class Deadlock:
    """Robots that keep each other, or something keeps, from ever reaching their next stops."""

    members: tuple[int, ...]
    victims: tuple[int, ...]
    kind: str  #: deadlock: several members; shut: no way leads to its goal; else stuck
    stands: float  #: when the last member stands for good [s]
    there: float  #: when the last member is within 1 m of where it stands then [s]
    is_moving: bool  #: a member drives about in vain for good
    is_borderline: bool  #: continuations differ, a robot creeps through late, or members move

    @property
    def group(self) -> tuple[int, ...]:
        """Members and victims."""
        return tuple(sorted(self.members + self.victims))


@dataclass(frozen=True)
class Held:
    """A robot that has been on its way for long just before something comes from outside."""

    robot: int
    moment: float  #: [s]
    until: float | None  #: without arrivals [s]; None: for good


@dataclass(frozen=True)
class Label:
    """What became of a run."""

    deadlocks: tuple[Deadlock, ...]
    #: of each robot, from and until when it was on the way to a stop [s]; None: for good
    ways: tuple[tuple[tuple[float, float | None], ...], ...]
    held: tuple[Held, ...]
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
        config: the stack under test; one outside must be of :mod:`experiments.oracle.outside`.
        thorough: simulate all 3,600 s, even if the poses repeat themselves.
    """
    with tempfile.TemporaryDirectory() as folder:
        state = Path(folder) / "state.jsonl"
        watched = config if config.stack is None else with_state_file(config, state)
        run = Run(world, watched, thorough=thorough)
        try:
            return _label(run, state)
        finally:
            run.close()


def _label(run: Run, state: Path) -> Label:
    held: list[Held] = []
    continued = 0.0
    for moment in _moments(run.world):
        run.advance(moment)
        if run.is_over:
            break
        suspects = _suspects(run)
        if suspects:
            fate = run.fate(among=suspects)
            continued += fate.ended - run.time
            held += [Held(i, round(run.time, 2), _end(fate, i)) for i in sorted(suspects)]
    run.advance(run.world.horizon)
    if run.is_over:
        return Label((), _ways(run, None), tuple(held), False, run.time, continued)
    votes = vote(run)
    continued += sum(fate.ended - run.time for fate in votes.fates)
    found = tuple(_deadlocks(run, votes, state)) if votes.stuck else ()
    doubtful = bool(votes.doubtful) and not found
    return Label(found, _ways(run, votes), tuple(held), doubtful, run.time, continued)


def _end(fate: Fate, robot: int) -> float | None:
    return None if fate.freed_at[robot] == NEVER else round(fate.freed_at[robot], 2)


def _ways(run: Run, votes: Votes | None) -> tuple[tuple[tuple[float, float | None], ...], ...]:
    """All ways to stops, those that are under way with their ends in the run itself."""
    ways: list[list[tuple[float, float | None]]] = [[*own] for own in run.count.ways]
    if votes is not None:
        for i in np.flatnonzero(run.count.wants).tolist():
            ways[i].append((round(float(run.count.waiting_since[i]), 2), _end(votes.fates[0], i)))
    return tuple(tuple(own) for own in ways)


def vote(run: Run) -> Votes:
    """Let several continuations say who is stuck, until no further one can change the majority.

    One in which nobody is stuck is enough if nobody has been on the way for long. Two that last all
    of the 3,600 s and agree are enough.
    """
    fates: list[Fate] = []
    majority = CONTINUATIONS // 2 + 1
    for shift in range(CONTINUATIONS):
        fates.append(run.fate(shift=shift, arrivals=True))
        stuck, free = _ballots(fates)
        if not stuck.any() and not _suspects(run):
            break
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
    """When to look: before each outside event."""
    times = {task.arrival for task in world.tasks} | {event.start for event in world.events}
    yield from sorted(t - JUST_BEFORE for t in times if STALLED_FOR < t < world.horizon)


def _suspects(run: Run) -> set[int]:
    """Robots that have made no way to their next stop for long."""
    waited = run.time - run.count.waiting_since
    stood = np.minimum(waited, run.time - run.still_since())
    slow = (stood >= STALLED_FOR) | (waited >= WANDERING_FOR)
    return set(np.flatnonzero(slow & run.count.wants).tolist())


def _deadlocks(run: Run, votes: Votes, state: Path) -> Iterator[Deadlock]:
    """Find groups, members and when they stand, of the robots that are stuck at the horizon."""
    place, goal = run.last.pose[:, :2], run.goal
    shut = {i for i in votes.stuck if is_shut_off(run.world, votes.reference, i, place[i], goal[i])}
    if run.config.stack is not None:
        groups = groups_by_state(votes.stuck, state_at(state, run.time), shut)
    else:
        groups = groups_of(votes.stuck, _removals(run, votes.stuck))
    for group in groups:
        stands = _stands(run, votes, group)
        is_moving = stands > votes.moment + SETTLED
        final = group
        moment = stands + AFTER_STANDING
        is_old = not is_moving and _events_between(run.world, moment, votes.moment)
        if is_old and run.config.stack is None:
            final = _group_at(run, votes, group, moment)
        is_shut = len(final.members) == 1 and final.members[0] in shut
        yield Deadlock(
            members=final.members,
            victims=final.victims,
            kind="shut" if is_shut else "stuck" if len(final.members) == 1 else "deadlock",
            stands=stands,
            there=min(stands, _there(run, votes, group)),
            is_moving=is_moving,
            is_borderline=is_moving or bool(set(group.members) & votes.doubtful),
        )


def _removals(run: Run, stuck: frozenset[int]):
    """A trial of removals from the run's moment."""

    def freed_without(gone: tuple[int, ...]) -> set[int]:
        fate = run.fate(without=gone, among=stuck - set(gone), limit=FREE_WITHIN, arrivals=True)
        return set(stuck) - fate.stuck - set(gone)

    return freed_without


def _stands(run: Run, votes: Votes, group: Group) -> float:
    """Since when all members stand or creep on the way to their stops [s]."""
    still, since = votes.reference.still_since, run.count.waiting_since
    return max(max(still[i], float(since[i])) for i in group.members)


def _there(run: Run, votes: Votes, group: Group) -> float:
    """Since when all members are within 1 m of where they stand [s]."""
    there, since = votes.reference.there_since, run.count.waiting_since
    return max(max(there[i], float(since[i])) for i in group.members)


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
