"""Scrambled Sobol points: the most even spread for budgets that are powers of two."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import qmc

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.candidate import Proposal
from mrta_falsify.core.codec import quantity
from mrta_falsify.core.feedback import Cube, Feedback
from mrta_falsify.core.seeding import stream
from samplers.asking import Counter

BLOCK = 64  # points drawn at once; a power of two keeps their balance


class SobolSampler:
    """Owen-scrambled Sobol' sequence of scipy (Joe and Kuo's directions); learns nothing."""

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Options:
        """Options of :class:`SobolSampler`."""

        cube: Cube = Cube()
        seed: int = quantity(low=0, default=0)

    def __init__(self, options: Options) -> None:
        self._counter = Counter("sobol", options.seed)
        dimensions = options.cube.dimensions
        random = stream(options.seed, "sampler/sobol")
        self._sequence = qmc.Sobol(dimensions, scramble=True, rng=random) if dimensions else None
        self._block: Array = np.empty((0, dimensions))

    def ask(self) -> Proposal:
        """Make the next proposal."""
        place = self._counter.next % BLOCK
        if place == 0:
            self._block = (
                np.empty((BLOCK, 0)) if self._sequence is None else self._sequence.random(BLOCK)
            )
        return self._counter.proposal(self._block[place])

    def tell(self, feedback: Feedback) -> None:
        """Ignored."""
