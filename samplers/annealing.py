"""Simulated annealing over whole objects."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mrta_falsify.core.candidate import Proposal
from mrta_falsify.core.codec import quantity
from mrta_falsify.core.feedback import Cube, Feedback
from mrta_falsify.core.seeding import stream
from samplers.asking import Counter, Mutator


class AnnealingSampler:
    """One chain that accepts worse scenes with a chance that falls as it cools.

    Metropolis' rule on the score; the temperature is a share of the spread of the scores seen,
    so it needs no tuning to the specification. Proposals asked for before the last result is
    known start from the state known then.
    """

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Options:
        """Options of :class:`AnnealingSampler`."""

        cube: Cube = Cube()
        seed: int = quantity(low=0, default=0)
        hot: float = quantity(above=0.0, default=0.5)  #: temperature at first, in spreads
        cold: float = quantity(above=0.0, default=0.02)  #: temperature at the end
        length: int = quantity(low=1, default=100)  #: results until it is cold, then hot again
        step: float = quantity(above=0.0, high=1.0, default=0.2)

    def __init__(self, options: Options) -> None:
        self._options = options
        self._counter = Counter("annealing", options.seed)
        self._mutator = Mutator(options.cube)
        self._state: Feedback | None = None
        self._scores: list[float] = []

    def ask(self) -> Proposal:
        """Make the next proposal."""
        random = self._counter.stream()
        if self._state is None:
            return self._counter.proposal(random.random(self._options.cube.dimensions))
        step = self._options.step * (0.2 + 0.8 * (1.0 - self._progress()))
        return self._counter.proposal(self._mutator.child(self._state.u, step, random))

    def tell(self, feedback: Feedback) -> None:
        """Accept or refuse a result as the new state."""
        if feedback.fate != "judged":
            return
        self._scores.append(feedback.score)
        if self._state is None or feedback.score <= self._state.score:
            self._state = feedback
            return
        rise = (feedback.score - self._state.score) / max(self._spread(), 1e-9)
        heat = self._options.hot * (self._options.cold / self._options.hot) ** self._progress()
        random = stream(self._options.seed, f"sampler/annealing/accept/{feedback.number}")
        if random.random() < np.exp(-rise / heat):
            self._state = feedback

    def _progress(self) -> float:
        return (len(self._scores) % self._options.length) / self._options.length

    def _spread(self) -> float:
        low, high = np.quantile(self._scores, (0.1, 0.9))
        return float(high - low)
