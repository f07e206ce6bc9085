"""Samplers of VerifAI, to be compared with (see docs/campaigns.md for how to install them).

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
    from verifai.samplers.domain_sampler import SplitSampler
    from verifai.samplers.feature_sampler import default_sampler_params
    from verifai.samplers.halton import HaltonSampler
    from verifai.samplers.multi_armed_bandit import MultiArmedBanditSampler
    from verifai.samplers.random_sampler import RandomSampler
except ImportError:  # said when one of them is built
    HAS_VERIFAI = False
else:
    HAS_VERIFAI = True

STRIDE = 409  # points of Halton's sequence between the starts of two seeds


@dataclass(frozen=True, slots=True, kw_only=True)
class VerifaiSamplerOptions:
    """Options of the samplers of VerifAI; theirs are at their defaults."""

    cube: Cube = Cube()
    seed: int = quantity(low=0, default=0)


class VerifaiSampler:
    """What VerifAI's samplers share; discrete coordinates are discrete for them, too."""

    Options = VerifaiSamplerOptions
    name = ""  #: in VerifAI

    def __init__(self, options: VerifaiSamplerOptions) -> None:
        if not HAS_VERIFAI:
            raise ConfigError(
                f"sampler verifai_{self.name} needs VerifAI: pip install --no-deps verifai==2.2.0, "
                "and the extra mrta-falsify[verifai]"
            )
        self._options = options
        self._counter = Counter(f"verifai_{self.name}", options.seed)
        cube = options.cube
        self._discrete = [i for i in range(cube.dimensions) if cube.level(i)]
        self._continuous = [i for i in range(cube.dimensions) if not cube.level(i)]
        self._sampler = self._build(default_sampler_params(self.name)) if cube.dimensions else None
        self._asked: dict[int, tuple[Any, Any]] = {}  # what VerifAI wants back, by number

    def _build(self, params: Any) -> Any:
        raise NotImplementedError

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


class VerifaiCrossEntropy(VerifaiSampler):
    """VerifAI's ``ce``: histograms per coordinate that lean to violations."""

    name = "ce"

    def _build(self, params: Any) -> Any:
        return CrossEntropySampler(self._domain(), params)


class VerifaiBandit(VerifaiSampler):
    """VerifAI's ``mab``: one bandit per coordinate, over five buckets."""

    name = "mab"

    def _build(self, params: Any) -> Any:
        return MultiArmedBanditSampler(self._domain(), params)


class VerifaiHalton(VerifaiSampler):
    """VerifAI's ``halton``: the plain sequence, begun elsewhere for each seed."""

    name = "halton"

    def _build(self, params: Any) -> Any:
        params.sample_index = STRIDE * self._options.seed
        return SplitSampler.fromPredicate(
            self._domain(),
            lambda domain: domain.standardizedDimension > 0,
            lambda domain: HaltonSampler(domain, params),
            RandomSampler,
        )


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
