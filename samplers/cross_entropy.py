"""Cross-entropy search with independent histograms per coordinate."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.candidate import Proposal
from mrta_falsify.core.codec import quantity
from mrta_falsify.core.feedback import Cube, Feedback
from samplers.asking import Counter


class CrossEntropySampler:
    """Draws each coordinate from a histogram that leans toward the elite of recent batches.

    The method of Rubinstein and Kroese, with a floor under every bin so that no value is ever
    given up. Coordinates are treated as independent, so it needs many results where what
    matters is a combination.
    """

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Options:
        """Options of :class:`CrossEntropySampler`."""

        cube: Cube = Cube()
        seed: int = quantity(low=0, default=0)
        bins: int = quantity(low=2, high=64, default=6)  #: of a continuous coordinate
        batch: int = quantity(low=4, default=20)  #: judged results between two updates
        elite: float = quantity(above=0.0, high=0.9, default=0.25)  #: share of a batch
        rate: float = quantity(above=0.0, high=1.0, default=0.5)  #: how fast histograms move
        floor: float = quantity(above=0.0, high=1.0, default=0.15)  #: share drawn uniformly

    def __init__(self, options: Options) -> None:
        self._options = options
        self._counter = Counter("cross_entropy", options.seed)
        cube = options.cube
        self._bins = np.array(
            [cube.level(i) or options.bins for i in range(cube.dimensions)], dtype=np.int64
        )
        widest = int(self._bins.max(initial=1))
        inside = np.arange(widest)[None, :] < self._bins[:, None]
        self._weights = inside / np.maximum(self._bins[:, None], 1)
        self._batch: list[Feedback] = []

    def ask(self) -> Proposal:
        """Make the next proposal."""
        random = self._counter.stream()
        dimensions = self._options.cube.dimensions
        uniform = random.random(dimensions)
        within = random.random(dimensions)
        chosen = random.random(dimensions)
        edges = self._weights.cumsum(axis=1)
        bins = (chosen[:, None] * edges[:, -1:] >= edges).sum(axis=1)
        bins = np.minimum(bins, self._bins - 1)
        leaning = (bins + within) / self._bins
        u = np.where(random.random(dimensions) < self._options.floor, uniform, leaning)
        return self._counter.proposal(u)

    def tell(self, feedback: Feedback) -> None:
        """Learn once a batch is full."""
        if feedback.fate != "judged":
            return
        self._batch.append(feedback)
        if len(self._batch) < self._options.batch:
            return
        self._batch.sort(key=lambda known: (known.score, known.number))
        count = max(2, round(self._options.elite * len(self._batch)))
        if self._batch[0].score < self._batch[-1].score:  # a flat batch teaches nothing
            self._learn(np.array([known.u for known in self._batch[:count]]))
        self._batch = []

    def _learn(self, elite: Array) -> None:
        bins = np.minimum((elite * self._bins).astype(np.int64), self._bins - 1)
        counts = np.zeros_like(self._weights)
        for row in bins:
            counts[np.arange(len(row)), row] += 1.0
        rate = self._options.rate
        self._weights = (1.0 - rate) * self._weights + rate * counts / len(elite)
