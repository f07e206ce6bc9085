"""The search for the smallest world: hierarchical delta debugging, then nominal values.

The first guess comes from the run itself. What is left is taken apart group by group, from large
chunks down to single things (ddmin of Zeller and Hildebrandt, "Simplifying and isolating
failure-inducing input", IEEE TSE 2002). A robot goes together with the tasks it had, so that the
others keep theirs. Once nothing single can go, all pairs of things are tried: two robots that cross
may be needed by each other only. A pair goes if most runs with small differences still fail.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

from mrta_falsify.analysis.minimize.edits import (
    GROUPS,
    HORIZON_MARGIN,
    Thing,
    tasks_along,
    things_of,
    ways_to_remove,
    without,
    without_things,
)
from mrta_falsify.analysis.minimize.first_guess import concerned, end_of_interest
from mrta_falsify.analysis.minimize.later_starts import later_starts
from mrta_falsify.analysis.minimize.nominal import NOMINAL, all_nominal
from mrta_falsify.analysis.minimize.reruns import Reruns, Smaller
from mrta_falsify.core.trace import Trace
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.core.world import World
from mrta_falsify.lab import Course


class _Way(NamedTuple):
    """A way to take two things away."""

    pair: int  #: number of the pair
    things: tuple[Thing, ...]
    along: Sequence[int]  #: tasks that go along


class SmallestSearch:
    """Holds the smallest failing world so far, and the course of its run."""

    def __init__(self, world: World, course: Course, reruns: Reruns) -> None:
        self.world = world
        self._course = course
        self._reruns = reruns
        self.one_minimal = False  #: whether nothing single can go
        #: pairs without which the world fails, but few runs with small differences
        self.unsure: set[int] = set()
        self._pending: set[int] = set()  # pairs that the runs do not suffice to vote on

    def _take(self, worlds: Iterable[Smaller]) -> Smaller | None:
        """Go on with the first of some smaller worlds that fails; None if none fails."""
        found = self._reruns.first_failing(worlds)
        if found is None:
            return None
        smaller, self._course = found
        self.world = smaller.world
        return smaller

    def begin(self, verdict: Verdict, trace: Trace) -> None:
        """Keep what the run points to; failing that, what comes before the violation."""
        self._take(self._guesses(verdict, trace))

    def _guesses(self, verdict: Verdict, trace: Trace) -> Iterator[Smaller]:
        for wide, what in ((False, "what the failure does not name"), (True, "what is far away")):
            guess = concerned(self.world, verdict, trace, wide=wide)
            if guess is not None:
                yield Smaller(guess, what)
        until = end_of_interest(verdict)
        if until == float("inf"):
            return
        known = tuple(task for task in self.world.tasks if task.arrival <= until)
        shorter = dataclasses.replace(
            self.world,
            tasks=known or self.world.tasks[:1],  # a world has a task
            horizon=min(self.world.horizon, until + HORIZON_MARGIN),
        )
        yield Smaller(shorter, "what comes after the violation")

    def finish(self) -> None:
        """Make the world smaller until nothing single can go, and no pair.

        Raises:
            OutOfRunsError: the runs are used up.
        """
        for group in GROUPS:
            self._shrink(group, len(getattr(self.world, group)))
        self._move_to_nominal()  # now, since all single things are tried again after a change
        while True:
            self._remove_singles()
            self.one_minimal = True
            if not self._remove_pair():
                return
            self.one_minimal = False

    def _remove_singles(self) -> None:
        while True:
            before = self.world
            while self._take(self._later()):
                pass
            for group in GROUPS:
                self._shrink(group, 1)
            if self.world is before:
                return

    def _remove_pair(self) -> bool:
        """Remove the first pair of things without which most runs still fail, if there is one."""
        self.unsure, place, ways = set(), 0, self._ways()
        while found := self._reruns.first_failing(self._pairs(place)):
            smaller, course = found
            pair = ways[smaller.place].pair
            self._pending = {pair}
            is_robust = self._reruns.is_robust(smaller.world)
            self._pending = set()
            if is_robust:
                self.world, self._course = smaller.world, course
                return True
            self.unsure.add(pair)
            place = smaller.place + 1
        return False

    def _ways(self) -> list[_Way]:
        """List the ways to take two things away: with a robot, its tasks go along, or stay."""
        ways = []
        for number, pair in enumerate(itertools.combinations(things_of(self.world), 2)):
            along = tasks_along(pair, self.world, self._course.had)
            ways += [_Way(number, pair, tasks) for tasks in ((along, ()) if along else ((),))]
        return ways

    def _pairs(self, place: int = 0) -> Iterator[Smaller]:
        """Yield worlds without two things, from the way at ``place`` on."""
        for number, way in enumerate(self._ways()[place:], start=place):
            smaller = without_things(self.world, way.things, way.along)
            if smaller is not None:
                yield Smaller(smaller, "two things", number)

    def count_pairs(self) -> tuple[int, int]:
        """Count the pairs of things that are left, and those of them that were tried.

        A pair without which no valid world is left counts as tried.
        """
        count = math.comb(len(things_of(self.world)), 2)
        ways = self._ways()
        missing = {ways[s.place].pair for s in self._pairs() if not self._reruns.knows(s.world)}
        return count, count - len(missing | self._pending)

    def _shrink(self, group: str, size: int) -> None:
        """Remove chunks of at most ``size`` things of a group, down to single things."""
        while size >= 1:
            place = 0
            while taken := self._take(self._removals(group, size, place)):
                place = taken.place
            if size == 1:
                return
            size = max(1, min(size, len(getattr(self.world, group))) // 2)

    def _removals(self, group: str, size: int, place: int) -> Iterator[Smaller]:
        """Yield worlds without one chunk of a group, from the chunk at ``place`` on."""
        items = getattr(self.world, group)
        for start in range(place, len(items), size):
            gone = range(len(items))[start : start + size]
            for tasks, text in ways_to_remove(self.world, group, gone, self._course.had):
                smaller = without(self.world, group, gone, tasks)
                if smaller is not None:
                    yield Smaller(smaller, text, start)

    def _later(self) -> Iterator[Smaller]:
        return (Smaller(world, what) for what, world in later_starts(self.world, self._course))

    def _move_to_nominal(self) -> None:
        """Move noise, delays, odd speeds and times to nominal where the failure allows it."""
        calm = all_nominal(self.world)
        if calm.digest() == self.world.digest() or self._take([Smaller(calm, "anything odd")]):
            return
        place = 0
        while taken := self._take(self._calmer(place)):
            place = taken.place + 1

    def _calmer(self, place: int) -> Iterator[Smaller]:
        """Yield worlds with one kind of value nominal, from that at ``place`` on."""
        for number, change in list(enumerate(NOMINAL))[place:]:
            calm = change.apply(self.world)
            if calm.digest() != self.world.digest():
                yield Smaller(calm, change.what, number)
