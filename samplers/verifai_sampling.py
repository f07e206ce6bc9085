"""A sampler of VerifAI, to be compared with (docs/campaigns.md says how to install it).

VerifAI draws from the global generators of ``random`` and ``numpy``. Here each draw gets them
seeded by the proposal's number and restores them afterwards. So nothing else is disturbed, and
the n-th proposal depends on the told results alone.
"""

from __future__ import annotations

import contextlib
import random
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.candidate import Proposal
from mrta_falsify.core.codec import quantity
from mrta_falsify.core.errors import ConfigError
from mrta_falsify.core.feedback import Cube, Feedback
from mrta_falsify.core.seeding import candidate_seed
from samplers.asking import Counter

try:
    from verifai.features import Box, DiscreteBox, Struct
    from verifai.samplers.cross_entropy import CrossEntropySampler
    from verifai.samplers.feature_sampler import default_sampler_params
except ImportError:  # reported when it is built
    HAS_VERIFAI = False
else:
    HAS_VERIFAI = True


class VerifaiCrossEntropy:
    """VerifAI's cross-entropy: histograms per coordinate that lean to violations.

    Discrete coordinates are discrete for it, too.
    """

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Options:
        """Options of :class:`VerifaiCrossEntropy`; VerifAI's own are at their defaults."""

        cube: Cube = Cube()
        seed: int = quantity(low=0, default=0)

    def __init__(self, options: Options) -> None:
        if not HAS_VERIFAI:
            raise ConfigError(
                "sampler verifai_ce needs VerifAI: pip install --no-deps verifai==2.2.0, "
                "and the extra mrta-falsify[verifai]"
            )
        self._options = options
        self._counter = Counter("verifai_ce", options.seed)
        cube = options.cube
        self._discrete = [i for i in range(cube.dimensions) if cube.level(i)]
        self._continuous = [i for i in range(cube.dimensions) if not cube.level(i)]
        params = default_sampler_params("ce")
        self._sampler = CrossEntropySampler(self._domain(), params) if cube.dimensions else None
        self._asked: dict[int, tuple[Any, Any]] = {}  # what VerifAI wants back, by number

    def _domain(self) -> Any:
        parts: dict[str, Any] = {}
        if self._continuous:
            parts["continuous"] = Box(*[(0.0, 1.0)] * len(self._continuous))
        if self._discrete:
            levels = [self._options.cube.level(i) for i in self._discrete]
            parts["discrete"] = DiscreteBox(*[(0, level - 1) for level in levels])
        return Struct(parts)

    def ask(self) -> Proposal:
        """Make the next proposal."""
        u = np.empty(self._options.cube.dimensions)
        if self._sampler is not None:
            seed = candidate_seed(self._options.seed, self._counter.next) % 2**32
            with _global_generators_seeded(seed):
                sample, note = self._sampler.getSample()
            self._asked[self._counter.next] = (sample, note)
            self._fill_point(u, sample)
        return self._counter.proposal(u)

    def _fill_point(self, u: Array, sample: Any) -> None:
        if self._continuous:
            u[self._continuous] = sample.continuous
        if self._discrete:
            levels = np.array([self._options.cube.level(i) for i in self._discrete])
            u[self._discrete] = (np.array(sample.discrete) + 0.5) / levels

    def tell(self, feedback: Feedback) -> None:
        """Take in a result, for the point that was asked for; rejected ones are left out."""
        asked = self._asked.pop(feedback.number, None)
        if asked is None or feedback.fate != "judged" or self._sampler is None:
            return
        sample, note = asked
        self._sampler.update(sample, note, feedback.score)


@contextlib.contextmanager
def _global_generators_seeded(seed: int) -> Iterator[None]:
    kept, kept_numpy = random.getstate(), np.random.get_state()  # noqa: NPY002 - VerifAI's own
    random.seed(seed)
    np.random.seed(seed)  # noqa: NPY002 - VerifAI's own
    try:
        yield
    finally:
        random.setstate(kept)
        np.random.set_state(kept_numpy)  # noqa: NPY002 - VerifAI's own
