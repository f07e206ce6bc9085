"""MAP-Elites and CMA-ME of pyribs: one elite per kind of behaviour."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from ribs.archives import GridArchive
from ribs.emitters import EvolutionStrategyEmitter

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.candidate import Proposal
from mrta_falsify.core.codec import quantity
from mrta_falsify.core.feedback import Cube, Feedback
from samplers.asking import Counter, Mutator

#: what tells kinds of trouble apart, with the number of cells of each
DESCRIPTORS = {"x": 5, "y": 5, "robots": 3, "cause": 8}


class MapElitesSampler:
    """Keeps the worst scene of every kind and changes one of them at a time.

    Kinds are cells of a grid over where on the floor the trouble was, how many robots were in
    it, and what blocked them. ``emitter`` ``objects`` changes whole objects of an elite drawn
    from all cells alike (MAP-Elites, Mouret and Clune 2015, with repair-aware mutation).
    ``cma`` follows the archive's improvement with separable CMA-ES (CMA-ME, Fontaine et al. 2020).
    """

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Options:
        """Options of :class:`MapElitesSampler`."""

        cube: Cube = Cube()
        seed: int = quantity(low=0, default=0)
        emitter: Literal["objects", "cma"] = "objects"
        initial: int = quantity(low=1, default=16)  #: uniform proposals at first
        step: float = quantity(above=0.0, high=1.0, default=0.15)
        batch: int = quantity(low=2, default=12)  #: of the ``cma`` emitter

    def __init__(self, options: Options) -> None:
        self._options = options
        self._counter = Counter("map_elites", options.seed)
        self._mutator = Mutator(options.cube)
        dimensions = max(options.cube.dimensions, 1)
        self._archive = GridArchive(
            solution_dim=dimensions,
            dims=list(DESCRIPTORS.values()),
            ranges=[(0.0, 1.0)] * len(DESCRIPTORS),
            seed=options.seed,
        )
        self._told = 0
        self._emitted: list[Array] = []  # asked for and not told, oldest first
        self._emitter: EvolutionStrategyEmitter | None = None
        if options.emitter == "cma" and options.cube.dimensions:
            self._emitter = EvolutionStrategyEmitter(
                self._archive,
                x0=np.full(dimensions, 0.5),
                sigma0=0.3,
                es="sep_cma_es",
                bounds=[(0.0, 1.0)] * dimensions,
                batch_size=options.batch,
                seed=options.seed,
            )
        self._batch: list[tuple[Array, float, list[float]]] = []

    def ask(self) -> Proposal:
        """Make the next proposal."""
        random = self._counter.stream()
        dimensions = self._options.cube.dimensions
        if self._told < self._options.initial or not dimensions or self._archive.empty:
            return self._counter.proposal(random.random(dimensions))
        if self._emitter is not None and not self._emitted and not self._batch:
            self._emitted = list(self._emitter.ask())
        if self._emitted:
            return self._counter.proposal(self._emitted.pop(0))
        return self._counter.proposal(self._changed_elite(random))

    def _changed_elite(self, random: np.random.Generator) -> Array:
        elites = self._archive.data(["solution", "index"])
        order = np.argsort(elites["index"], kind="stable")
        parent = elites["solution"][order[int(random.integers(len(order)))]]
        return self._mutator.child(parent, self._options.step, random)

    def tell(self, feedback: Feedback) -> None:
        """Put a result in its cell."""
        if feedback.fate != "judged" or not self._options.cube.dimensions:
            return
        self._told += 1
        measures = [feedback.descriptors.get(name, 0.0) for name in DESCRIPTORS]
        if self._emitter is None or self._told <= self._options.initial:
            self._archive.add_single(feedback.u, -feedback.score, measures)
            return
        self._batch.append((np.array(feedback.u), -feedback.score, measures))
        if len(self._batch) >= self._options.batch:
            self._learn()

    def _learn(self) -> None:
        solutions = np.array([u for u, _, _ in self._batch])
        objective = np.array([value for _, value, _ in self._batch])
        measures = np.array([place for _, _, place in self._batch])
        added = self._archive.add(solutions, objective, measures)
        if self._emitter is not None:
            self._emitter.tell(solutions, objective, measures, added)
        self._batch = []
        self._emitted = []
