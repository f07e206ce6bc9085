"""Evolution that moves whole objects: for scenes with hundreds of coordinates."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mrta_falsify.core.candidate import Proposal
from mrta_falsify.core.codec import quantity
from mrta_falsify.core.feedback import Cube, Feedback
from samplers.asking import ALIKE, BestResults, Counter, Mutator

SMALLEST_STEP, LARGEST_STEP = 0.02, 0.4


class EvolutionSampler:
    """Steady-state (mu + 1) evolution with repair-aware mutation.

    The first proposals are uniform. Then each child has one or two of the best parents so far,
    takes whole objects from either, and has a few objects moved or drawn anew (see
    :class:`~samplers.asking.Mutator`). The step grows when children improve on the best and
    shrinks when they do not (Rechenberg's 1/5 rule). After ``patience`` results without a new
    best the population is forgotten, so that a search with a large budget finds other failures.
    """

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Options:
        """Options of :class:`EvolutionSampler`."""

        cube: Cube = Cube()
        seed: int = quantity(low=0, default=0)
        initial: int = quantity(low=1, default=16)  #: uniform proposals at first
        parents: int = quantity(low=1, default=8)  #: mu
        step: float = quantity(above=0.0, high=1.0, default=0.15)  #: spread of small moves at first
        crossover: float = quantity(low=0.0, high=1.0, default=0.3)  #: chance of two parents
        explore: float = quantity(low=0.0, high=1.0, default=0.05)  #: chance of a uniform proposal
        patience: int = quantity(low=1, default=80)  #: results without a new best, then restart

    def __init__(self, options: Options) -> None:
        self._options = options
        self._counter = Counter("evolution", options.seed)
        self._mutator = Mutator(options.cube, alike=ALIKE)
        self._memory = BestResults(options.parents)
        self._step = options.step

    def ask(self) -> Proposal:
        """Make the next proposal."""
        random = self._counter.stream()
        options, parents = self._options, self._memory.best
        dimensions = options.cube.dimensions
        young = self._memory.told < options.initial or not parents
        if young or random.random() < options.explore:
            return self._counter.proposal(random.random(dimensions))
        parent = self._parent(random)
        u = parent.u
        if random.random() < options.crossover:
            u = self._mutator.crossed(u, self._parent(random).u, random)
        return self._counter.proposal(
            self._mutator.child(u, self._step, random, blamed=parent.blamed)
        )

    def _parent(self, random: np.random.Generator) -> Feedback:
        # The better of two: the best are chosen more often, but the others, too.
        first, second = random.integers(len(self._memory.best), size=2)
        return self._memory.best[int(min(first, second))]

    def tell(self, feedback: Feedback) -> None:
        """Take in a result, also of a point that another sampler proposed."""
        if feedback.fate != "judged":
            return
        better = self._memory.add(feedback)
        if self._memory.told <= self._options.initial:
            return
        factor = 1.5 if better else 1.5**-0.25
        self._step = float(np.clip(self._step * factor, SMALLEST_STEP, LARGEST_STEP))
        if self._memory.since_best >= self._options.patience:
            self._memory = BestResults(self._options.parents)
            self._step = self._options.step
