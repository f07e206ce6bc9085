"""Search by novelty: scenes that showed what few others show have children."""

from __future__ import annotations

from collections import Counter as Counts
from dataclasses import dataclass

import numpy as np

from mrta_falsify.core.candidate import Proposal
from mrta_falsify.core.codec import quantity
from mrta_falsify.core.feedback import Cube, Feedback
from samplers.asking import ALIKE, Counter, Mutator


class SituationsSampler:
    """Goes where something new happens, whether or not a margin tells.

    A scene is worth the rarity of the situations that it showed: each counts one over the number of
    scenes that showed it, as in coverage-guided fuzzing. Parents are drawn by their worth and
    chosen less often the more children they have had (AFLFast, Boehme et al. 2016). How near the
    scene came to a deadlock counts as much as one situation that no other scene shows.
    """

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Options:
        """Options of :class:`SituationsSampler`."""

        cube: Cube = Cube()
        seed: int = quantity(low=0, default=0)
        initial: int = quantity(low=1, default=8)  #: uniform proposals at first
        memory: int = quantity(low=2, default=256)  #: scenes that may have children
        step: float = quantity(above=0.0, high=1.0, default=0.2)  #: largest spread of small moves

    def __init__(self, options: Options) -> None:
        self._options = options
        self._counter = Counter("situations", options.seed)
        self._mutator = Mutator(options.cube, alike=ALIKE)
        self._told: list[Feedback] = []
        self._seen: Counts[str] = Counts()
        self._children: Counts[int] = Counts()  # by number of the parent
        self._judged = 0

    def ask(self) -> Proposal:
        """Make the next proposal."""
        dimensions = self._options.cube.dimensions
        if self._judged < self._options.initial or not dimensions or not self._told:
            return self._counter.uniform(dimensions)
        random = self._counter.stream()
        worth = np.array([self._worth(scene) for scene in self._told])
        parent = self._told[int(random.choice(len(worth), p=worth / worth.sum()))]
        self._children[parent.number] += 1
        step = self._options.step * float(random.uniform(0.1, 1.0))
        return self._counter.proposal(
            self._mutator.child(parent.u, step, random, blamed=parent.blamed)
        )

    def tell(self, feedback: Feedback) -> None:
        """Take in a result, also of a point that another sampler proposed."""
        if feedback.fate != "judged":
            return
        self._judged += 1
        self._seen.update(feedback.situations)
        self._told.append(feedback)
        if len(self._told) > self._options.memory:
            self._told.remove(min(self._told, key=self._worth))

    def _worth(self, scene: Feedback) -> float:
        rarity = sum(1.0 / self._seen[name] for name in scene.situations)
        tired = 1.0 + self._children[scene.number]
        return float((1e-3 + rarity + scene.nearness) / tired)
