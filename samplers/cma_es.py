"""CMA-ES of the library ``cmaes``: for few dimensions, or smooth scores."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from cmaes import CMA, SepCMA

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.candidate import Proposal
from mrta_falsify.core.codec import quantity
from mrta_falsify.core.feedback import Cube, Feedback
from samplers.asking import Counter

FULL_UP_TO = 40  # dimensions; beyond, the covariance is kept diagonal


class CmaEsSampler:
    """Covariance matrix adaptation (Hansen), separable beyond 40 dimensions.

    Learns from the realised points, in generations of the library's size. A point asked for
    before its generation is complete comes from the distribution as it is then. Rejected
    points count as worse than the worst of their generation. Restarts when it has converged.
    """

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Options:
        """Options of :class:`CmaEsSampler`."""

        cube: Cube = Cube()
        seed: int = quantity(low=0, default=0)
        sigma: float = quantity(above=0.0, high=1.0, default=0.3)  #: initial step

    def __init__(self, options: Options) -> None:
        self._options = options
        self._counter = Counter("cma_es", options.seed)
        self._restarts = 0
        self._waiting: list[tuple[Array, float | None]] = []
        self._search = self._begin()

    def _begin(self) -> CMA | SepCMA | None:
        dimensions = self._options.cube.dimensions
        if dimensions < 2:  # the library needs two; one is searched uniformly
            return None
        kind = CMA if dimensions <= FULL_UP_TO else SepCMA
        words = np.random.SeedSequence([self._options.seed, self._restarts]).generate_state(1)
        return kind(
            mean=np.full(dimensions, 0.5),
            sigma=self._options.sigma,
            bounds=np.tile([0.0, 1.0], (dimensions, 1)),
            seed=int(words[0]),
        )

    def ask(self) -> Proposal:
        """Make the next proposal."""
        if self._search is None:
            u = self._counter.stream().random(self._options.cube.dimensions)
            return self._counter.proposal(u)
        return self._counter.proposal(self._search.ask())

    def tell(self, feedback: Feedback) -> None:
        """Learn once a generation is complete."""
        if self._search is None:
            return
        judged = feedback.fate == "judged"
        self._waiting.append((np.array(feedback.u), feedback.score if judged else None))
        if len(self._waiting) < self._search.population_size:
            return
        worst = max((score for _, score in self._waiting if score is not None), default=0.0)
        generation = [(u, worst + 1.0 if score is None else score) for u, score in self._waiting]
        self._search.tell(generation)
        self._waiting = []
        if self._search.should_stop():
            self._restarts += 1
            self._search = self._begin()
