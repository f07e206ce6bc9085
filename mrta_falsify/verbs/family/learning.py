"""Learning a failure family: which dimensions matter, and how far they may move.

First, groups of dimensions are let go over their whole range while the others stay as in the
failure; a group whose runs keep failing with the same signature does not matter, any other one
is halved (delta debugging over dimensions). Then neighbours at several distances are run, and a
box around the failure is peeled until runs in it fail (the Patient Rule Induction Method of
Friedman and Fisher, "Bump hunting in high-dimensional data", Statistics and Computing 9, 1999,
with the failure always inside). Choices that matter stay as they are.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from mrta_falsify.core.arrays import Array, BoolArray
from mrta_falsify.core.candidate import Candidate, Dimension
from mrta_falsify.core.seeding import candidate_seed, stream
from mrta_falsify.verbs.family.rule import Condition
from mrta_falsify.verbs.family.samples import Answer, Box, Runs

DISTANCES = (0.02, 0.05, 0.1, 0.2, 0.4)  # shares of a dimension's range, of neighbours
REPEATS = 4  # runs that must all fail before dimensions count as free
ROUNDS = 3  # of neighbours, each around the box of the round before
PURE = 0.95  # share of failures in a box at which peeling stops
PEEL = 0.1  # share of a box's points that one cut removes
NEIGHBOURS = 3  # that pass, told of
FEWEST = 6  # points in a box below which nothing is cut any more
GRADED = ("range", "normal", "point")  # kinds of dimensions of which near values mean something


@dataclass(slots=True)
class Search:
    """Learns the box; points are shares of the dimensions' ranges."""

    runs: Runs
    case: Candidate
    budget: int
    free: list[int] = field(default_factory=list)
    ruling: list[int] = field(default_factory=list)  #: tried, and they matter
    fresh_noise: bool = True
    box: Box = field(default_factory=dict)
    drawn: int = 0
    passing: list[Array] = field(default_factory=list)  #: points around the failure that pass

    def learn(self) -> None:
        """Which dimensions matter, then how far they may move."""
        self.fresh_noise = self._all_fail([])
        share = 2 * self.budget // 3
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
        graded = [i for i in self.ruling if self._dimension(i).kind in GRADED]
        if graded:
            self._widen(graded)

    def _dimension(self, number: int) -> Dimension:
        return self.runs.program.space.dimensions[number]

    def _all_fail(self, group: Sequence[int]) -> bool:
        """Whether runs fail with ``group`` and what is free already anywhere in their range."""
        intervals = self._intervals(dict.fromkeys(group, (0.0, 1.0)))
        for _ in range(REPEATS):
            answer = self._run(intervals)
            if answer is None or not answer.failed:
                return False
        return True

    def _intervals(self, moved: Box) -> Box:
        """Everything as in the failure but ``moved`` and what is free."""
        free = set(self.free)
        held = {i: (float(x), float(x)) for i, x in enumerate(self.case.u) if i not in free}
        return held | moved

    def _run(self, intervals: Box) -> Answer | None:
        """A uniform point of a box, as shares of the whole ranges, and whether it fails."""
        k, number = len(self.case.u), self.drawn
        self.drawn += 1
        seed = candidate_seed(self.case.seed % 2**31, number) if self.fresh_noise else None
        candidate = dataclasses.replace(
            self.case,
            number=number,
            u=stream(self.case.seed, f"family/{number}").random(k),
            seed=self.case.seed if seed is None else seed,
        )
        answer = self.runs.within(intervals, candidate)
        if answer is None:
            return None
        ends = np.array([intervals.get(i, (0.0, 1.0)) for i in range(k)])
        return Answer(ends[:, 0] + (ends[:, 1] - ends[:, 0]) * answer.u, answer.failed)

    def _widen(self, graded: list[int]) -> None:
        """Neighbours at several distances, and the box that remains after peeling."""
        center = self.case.u[graded]
        points, failed = [center], [True]
        left = self.budget - self.runs.count
        box = np.stack([center, center], axis=1)
        for number in range(left):
            near = number % len(DISTANCES)
            if number < left // ROUNDS or number % 2:
                ends = np.clip(center[:, None] + DISTANCES[near] * np.array([-1.0, 1.0]), 0.0, 1.0)
            else:
                ends = box
            pairs = {i: (float(a), float(b)) for i, (a, b) in zip(graded, ends, strict=True)}
            answer = self._run(self._intervals(pairs))
            if answer is not None:
                points.append(answer.u[graded])
                failed.append(answer.failed)
                if not answer.failed:
                    self.passing.append(answer.u)
            if (number + 1) % max(left // ROUNDS, 1) == 0 or number + 1 == left:
                box = peeled_box(np.array(points), np.array(failed), center)
        self.box = {i: (float(a), float(b)) for i, (a, b) in zip(graded, box, strict=True)}

    def conditions(self) -> tuple[Condition, ...]:
        """The rule, in the order of the dimensions."""
        free = set(self.free)
        matter = [i for i in range(len(self.case.u)) if i not in free]
        ends = [self.box.get(i, (float(self.case.u[i]),) * 2) for i in matter]
        return tuple(
            Condition(
                dimension=self._dimension(i).name,
                fate="unknown" if i not in self.ruling else "interval" if high > low else "held",
                low=low,
                high=high,
                text=self._text(i, low, high),
            )
            for i, (low, high) in zip(matter, ends, strict=True)
        )

    def neighbours(self) -> tuple[str, ...]:
        """The nearest points that pass, each by what of it lies outside the rule."""
        graded = sorted(self.box)
        near = sorted(self.passing, key=lambda u: float(np.abs(u - self.case.u)[graded].max()))
        texts = []
        for u in near:
            outside = [i for i in graded if not self.box[i][0] <= u[i] <= self.box[i][1]]
            if outside:
                texts.append(", ".join(self._text(i, float(u[i]), float(u[i])) for i in outside))
        return tuple(dict.fromkeys(texts))[:NEIGHBOURS]

    def _text(self, number: int, low: float, high: float) -> str:
        """A condition in the program's units, at the other values of the failure."""
        dimension = self._dimension(number)
        values: list[float] = []
        for share in (low, high):
            u = np.array(self.case.u)
            u[number] = share
            (value,) = self.runs.program.values_at(u, [number])
            if value is None and dimension.low is not None and dimension.high is not None:
                value = dimension.low + share * (dimension.high - dimension.low)
            if value is None or dimension.kind == "opaque":
                return f"{dimension.name} as in the failure"
            values.append(value)
        if dimension.kind == "choice":
            return f"{dimension.name} is option {values[0] + 1:.0f} of {dimension.choices}"
        if low == high:
            return f"{dimension.name} = {values[0]:.4g}"
        return f"{dimension.name} from {min(values):.4g} to {max(values):.4g}"


def peeled_box(points: Array, failed: BoolArray, center: Array) -> Array:
    """Box around ``center`` in which points fail, by peeling.

    Begins with all points. Each cut takes away the outermost tenth on one side of one dimension,
    never the centre; the cut that leaves the largest share of failures is made, until 95 % fail,
    few points are left, or no cut raises the share. The ends are those of the failing points
    that remain, so the box claims nothing beyond where a failure was seen.

    Args:
        points: ``(n, d)``, the centre among them.
        failed: ``(n,)``.
        center: ``(d,)``, which fails.

    Returns:
        ``(d, 2)`` lower and upper ends.
    """
    inside = np.ones(len(points), dtype=np.bool_)
    while inside.sum() > FEWEST and failed[inside].mean() < PURE:
        cuts = [
            cut
            for d in range(points.shape[1])
            for cut in _cuts(points[:, d], inside, float(center[d]))
        ]
        shares = [(float(failed[cut].mean()), int(cut.sum())) for cut in cuts]
        if not shares or max(shares)[0] <= failed[inside].mean():
            break
        inside = cuts[shares.index(max(shares))]
    kept = points[inside & failed]
    ends: Array = np.stack([kept.min(axis=0), kept.max(axis=0)], axis=1)
    return ends


def _cuts(values: Array, inside: BoolArray, center: float) -> list[BoolArray]:
    """What stays inside after a cut from below and one from above, along one dimension."""
    count = max(1, int(PEEL * inside.sum()))
    order = np.sort(values[inside])
    cuts = [inside & (values > min(order[count - 1], np.nextafter(center, -np.inf)))]
    cuts.append(inside & (values < max(order[-count], np.nextafter(center, np.inf))))
    return [cut for cut in cuts if cut.sum() < inside.sum()]
