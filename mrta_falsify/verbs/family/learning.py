"""Learning a failure family: which dimensions matter, and how far they may move.

First, groups of dimensions move over their whole range while the others stay as in the failure.
A group whose runs keep failing with the same signature does not matter; any other group is halved
(delta debugging over dimensions). Then neighbours at several distances are run, and a box around
the failure is peeled until runs in it fail (:mod:`.peeling`). Choices that matter stay as they
are.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.candidate import Candidate
from mrta_falsify.core.seeding import candidate_seed, stream
from mrta_falsify.verbs.family.peeling import peeled_box
from mrta_falsify.verbs.family.samples import Box, PointRun, SampleRuns

DISTANCES = (0.02, 0.05, 0.1, 0.2, 0.4)  # shares of a dimension's range, of neighbours
REPEATS = 4  # runs that must all fail before dimensions count as free
ROUNDS = 3  # of neighbours, each around the box of the round before
DIMENSIONS_SHARE = 2 / 3  # of the budget, for finding out which dimensions matter
GRADED = ("range", "normal", "point")  # kinds of dimensions in which near values mean something
SEEDS = 2**31  # seeds of fresh noise are drawn from a campaign seed below this


@dataclass(slots=True)
class BoxSearch:
    """Learns the box; points are shares of the dimensions' ranges."""

    runs: SampleRuns
    case: Candidate
    budget: int  #: runs at most
    free: list[int] = field(default_factory=list)  #: dimensions that do not matter
    ruling: list[int] = field(default_factory=list)  #: dimensions that were tried and matter
    fresh_noise: bool = True  #: whether the failure stays under other noise
    box: Box = field(default_factory=dict)  #: of the dimensions that may move
    drawn: int = 0  #: points, including those without a scene
    passing: list[Array] = field(default_factory=list)  #: points around the failure that pass

    def learn(self) -> None:
        """Find out which dimensions matter, then how far they may move."""
        self.fresh_noise = self._all_fail([])
        share = int(DIMENSIONS_SHARE * self.budget)
        waiting = [list(range(len(self.case.u)))]
        while waiting and self.runs.count + REPEATS <= share:
            group = waiting.pop(0)
            if self._all_fail(group):
                self.free += group
            elif len(group) == 1:
                self.ruling += group
            else:
                half = len(group) // 2
                waiting += [group[:half], group[half:]]
        self.free.sort()
        self.ruling.sort()
        dimensions = self.runs.program.space.dimensions
        graded = [i for i in self.ruling if dimensions[i].kind in GRADED]
        if graded:
            self._widen(graded)

    def _all_fail(self, group: Sequence[int]) -> bool:
        """Whether runs fail with ``group`` and the free dimensions anywhere in their range."""
        intervals = self._intervals(dict.fromkeys(group, (0.0, 1.0)))
        return all(self._draw(intervals).failed for _ in range(REPEATS))

    def _intervals(self, moved: Box) -> Box:
        """Hold every dimension as in the failure, except ``moved`` and the free ones."""
        free = set(self.free)
        held = {i: (float(x), float(x)) for i, x in enumerate(self.case.u) if i not in free}
        return held | moved

    def _draw(self, intervals: Box) -> PointRun:
        """Run a uniform point of a box; the sample's point is in shares of the whole ranges."""
        k, number = len(self.case.u), self.drawn
        self.drawn += 1
        seed = self.case.seed
        candidate = dataclasses.replace(
            self.case,
            number=number,
            u=stream(seed, f"family/{number}").random(k),
            seed=candidate_seed(seed % SEEDS, number) if self.fresh_noise else seed,
        )
        sample = self.runs.within(intervals, candidate)
        if sample.u is None:
            return sample
        ends = np.array([intervals.get(i, (0.0, 1.0)) for i in range(k)])
        point = ends[:, 0] + (ends[:, 1] - ends[:, 0]) * sample.u
        return PointRun(u=point, failed=sample.failed)

    def _widen(self, graded: list[int]) -> None:
        """Run neighbours at several distances, and keep the box that remains after peeling."""
        center = self.case.u[graded]
        points, failed = [center], [True]
        left = self.budget - self.runs.count
        box = np.stack([center, center], axis=1)
        for number in range(left):
            reach = DISTANCES[number % len(DISTANCES)]
            if number < left // ROUNDS or number % 2:
                ends = np.clip(center[:, None] + reach * np.array([-1.0, 1.0]), 0.0, 1.0)
            else:
                ends = box
            sample = self._draw(self._intervals(_as_box(graded, ends)))
            if sample.u is not None:
                points.append(sample.u[graded])
                failed.append(sample.failed)
                if not sample.failed:
                    self.passing.append(sample.u)
            if (number + 1) % max(left // ROUNDS, 1) == 0 or number + 1 == left:
                box = peeled_box(np.array(points), np.array(failed), center)
        self.box = _as_box(graded, box)


def _as_box(dimensions: Sequence[int], ends: Array) -> Box:
    """Give each of ``dimensions`` its row of ``ends`` ``(d, 2)``."""
    return {i: (float(low), float(high)) for i, (low, high) in zip(dimensions, ends, strict=True)}
