"""Scrambled Halton points: spread more evenly than independent ones, for any budget."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import qmc

from mrta_falsify.core.candidate import Proposal
from mrta_falsify.core.codec import quantity
from mrta_falsify.core.feedback import Cube, Feedback
from mrta_falsify.core.seeding import stream
from samplers.asking import Counter


class HaltonSampler:
    """Owen's randomised Halton sequence (arXiv:1706.02808) of scipy; learns nothing."""

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Options:
        """Options of :class:`HaltonSampler`."""

        cube: Cube = Cube()
        seed: int = quantity(low=0, default=0)

    def __init__(self, options: Options) -> None:
        self._counter = Counter("halton", options.seed)
        dimensions = options.cube.dimensions
        random = stream(options.seed, "sampler/halton")
        self._sequence = qmc.Halton(dimensions, scramble=True, rng=random) if dimensions else None

    def ask(self) -> Proposal:
        """Make the next proposal."""
        u = np.empty(0) if self._sequence is None else self._sequence.random(1)[0]
        return self._counter.proposal(u)

    def tell(self, feedback: Feedback) -> None:
        """Ignored."""
