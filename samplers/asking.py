"""What all samplers share: numbering, one random stream per proposal, a memory of results."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field

import numpy as np

from mrta_falsify.core.arrays import Array, IntArray
from mrta_falsify.core.candidate import Proposal
from mrta_falsify.core.feedback import Cube, Feedback
from mrta_falsify.core.seeding import stream

ALIKE = 0.4  # usual chance that an object drawn anew takes after one of its kin
NEARLY = 0.03  # spread about the value of one of its kin
STEPS = (0.03, 0.4)  # spread of small moves where children are only looked at
BLAMED = 4.0  # times as often as others is an object changed that took part


@dataclass(slots=True)
class Counter:
    """Numbers proposals and gives each a random stream of its own."""

    name: str  #: of the sampler
    seed: int
    next: int = 0

    def stream(self) -> np.random.Generator:
        """Make the random stream of the next proposal."""
        return stream(self.seed, f"sampler/{self.name}/{self.next}")

    def uniform(self, dimensions: int) -> Proposal:
        """Propose a point ``(k,)`` drawn evenly from the cube next, whatever has been found."""
        return self.proposal(self.stream().random(dimensions), uniform=True)

    def proposal(self, u: Array, *, uniform: bool = False) -> Proposal:
        """Propose ``u`` ``(k,)``, cut to [0, 1], next."""
        point = np.clip(u, 0.0, 1.0)
        point.setflags(write=False)
        number = self.next
        self.next += 1
        return Proposal(number=number, u=point, uniform=uniform)


@dataclass(slots=True)
class BestResults:
    """The best results so far, smallest score first; ties in the order they were told."""

    size: int  #: how many are kept
    best: list[Feedback] = field(default_factory=list)
    told: int = 0  #: judged results, kept or not
    since_best: int = 0  #: judged results since the best one changed

    def add(self, feedback: Feedback) -> bool:
        """Take in a result; whether it is the best so far. Rejected ones are ignored."""
        if feedback.fate != "judged":
            return False
        self.told += 1
        self.since_best += 1
        is_best = not self.best or feedback.score < self.best[0].score
        if is_best:
            self.since_best = 0
        place = sum(known.score <= feedback.score for known in self.best)
        self.best.insert(place, feedback)
        del self.best[self.size :]
        return is_best


@dataclass(slots=True)
class Mutator:
    """Changes a few objects of a scene, not a little of everything.

    A realised point is a valid scene. Moving one object keeps the others valid, so that repair
    has little to do and the child stays near its parent. Moving all of 300 coordinates a
    little would almost surely be rejected, and repaired into something unrelated.
    """

    cube: Cube
    redraw: float = 0.3  #: chance that a chosen object is drawn anew instead of moved
    mean_blocks: float = 2.0  #: objects changed on average, at least one
    alike: float = 0.0  #: chance that an object drawn anew takes after one of its kin
    blocks: tuple[tuple[int, ...], ...] = field(init=False)  #: coordinates by object
    _block_of: IntArray = field(init=False)  #: ``(k,)``
    _kin: tuple[tuple[int, ...], ...] = field(init=False)  #: others of its family, by coordinate

    def __post_init__(self) -> None:
        self.blocks = self.cube.blocks()
        self._block_of = np.zeros(self.cube.dimensions, dtype=np.int64)
        for number, block in enumerate(self.blocks):
            self._block_of[list(block)] = number
        kin: list[tuple[int, ...]] = [()] * self.cube.dimensions
        for family in self.cube.families():
            for i in family:
                kin[i] = tuple(j for j in family if j != i)
        self._kin = tuple(kin)

    def child(
        self,
        parent: Array,
        step: float,
        random: np.random.Generator,
        blamed: Collection[int] = (),
    ) -> Array:
        """Change a copy of ``parent`` ``(k,)``.

        Args:
            parent: a realised point.
            step: spread of small moves.
            random: drawn from.
            blamed: blocks of objects that took part in what the parent showed; they are changed
                ``BLAMED`` times as often as each of the others.
        """
        u = np.array(parent, dtype=np.float64)
        blocks = self.blocks
        if not blocks:
            return u
        count = min(len(blocks), 1 + int(random.poisson(max(self.mean_blocks - 1.0, 0.0))))
        chances = self._chances(blamed) if blamed else None
        for chosen in random.choice(len(blocks), size=count, replace=False, p=chances):
            block = list(blocks[chosen])
            if random.random() < self.redraw:
                u[block] = random.random(len(block))
                if self.alike and random.random() < self.alike:
                    self._fill_alike(u, block, random)
                continue
            for i in block:
                u[i] = self._moved(u[i], self.cube.level(i), step, random)
        return u

    def _fill_alike(self, u: Array, block: Sequence[int], random: np.random.Generator) -> None:
        """Take the coordinates of ``block`` from an object of its kind, or nearly."""
        which = float(random.random())  # the same object for all of them, where there is one
        for i in block:
            if kin := self._kin[i]:
                other = kin[int(which * len(kin))]
                if self.cube.level(i) == 0:
                    u[i] = reflect(u[other] + float(random.normal(0.0, NEARLY)))
                    continue
                label = self.cube.labels_of(other)[int(levels_at(u[other], self.cube.level(other)))]
                u[i] = at_label(label, self.cube.labels_of(i), float(u[i]))

    def _chances(self, blamed: Collection[int]) -> Array:
        """Weigh the blocks, ``(b,)``; the sum is 1."""
        weight = np.ones(len(self.blocks))
        weight[list(blamed)] = BLAMED
        chances: Array = weight / weight.sum()
        return chances

    def _moved(self, value: float, levels: int, step: float, random: np.random.Generator) -> float:
        if levels > 0:  # a neighbour means nothing: keep it, or take any other value
            return float(random.random()) if random.random() < min(1.0, 2.0 * step) else value
        return reflect(value + float(random.normal(0.0, step)))

    def crossed(self, one: Array, other: Array, random: np.random.Generator) -> Array:
        """Take the objects of two parents, each from either with equal chance."""
        is_others = random.random(len(self.blocks)) < 0.5
        return np.where(is_others[self._block_of], other, one)


def levels_at(values: Array, levels: int | IntArray) -> IntArray:
    """Find the levels of discrete coordinates at ``values`` in [0, 1], of the same shape."""
    return np.asarray(np.minimum((values * levels).astype(np.int64), levels - 1))


def at_label(label: int, labels: Sequence[int], otherwise: float) -> float:
    """Find where in [0, 1] a discrete coordinate has the value ``label``, if it can have it."""
    return (labels.index(label) + 0.5) / len(labels) if label in labels else otherwise


def evenly_in_logarithm(random: np.random.Generator, low: float, high: float) -> float:
    """Draw between ``low`` > 0 and ``high``, each factor being as likely as another."""
    return float(np.exp(random.uniform(np.log(low), np.log(high))))


def reflect(value: float) -> float:
    """Fold ``value`` into [0, 1] at the walls, so that mass does not gather there."""
    folded = value % 2.0
    return 2.0 - folded if folded > 1.0 else folded
