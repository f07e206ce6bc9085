"""NSGA-II of Optuna: several specifications at once, none traded for another."""

from __future__ import annotations

from dataclasses import dataclass

import optuna

from mrta_falsify.core.candidate import Proposal
from mrta_falsify.core.codec import quantity
from mrta_falsify.core.feedback import Cube, Feedback
from mrta_falsify.core.seeding import candidate_seed
from samplers.asking import Counter
from samplers.optuna_study import Study

REVIEW = 10  # generations after which earlier ones are forgotten


class Nsga2Sampler:
    """Deb's NSGA-II over the margins of all specifications, each minimised for itself.

    The front keeps the scene that comes nearest to a deadlock beside the one that comes nearest
    to a missed deadline; a weighted sum would keep one of them.
    """

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Options:
        """Options of :class:`Nsga2Sampler`."""

        cube: Cube = Cube()
        seed: int = quantity(low=0, default=0)
        population: int = quantity(low=4, default=24)

    def __init__(self, options: Options) -> None:
        self._options = options
        self._counter = Counter("nsga2", options.seed)
        self._told = 0
        self._names: tuple[str, ...] = ()
        self._study: Study | None = None

    def ask(self) -> Proposal:
        """Make the next proposal."""
        options = self._options
        u = self._counter.stream().random(options.cube.dimensions)
        if self._study is None or not len(u):
            return self._counter.proposal(u)
        sampler = self._sampler(candidate_seed(options.seed, self._counter.next) % 2**32)
        return self._counter.proposal(self._study.ask(sampler, u, self._counter.next))

    def _sampler(self, seed: int) -> optuna.samplers.NSGAIISampler:
        return optuna.samplers.NSGAIISampler(population_size=self._options.population, seed=seed)

    def tell(self, feedback: Feedback) -> None:
        """Take in a result."""
        if feedback.fate != "judged" or not feedback.objectives:
            return
        if self._study is None:
            self._names = tuple(sorted(feedback.objectives))
            dimensions = range(self._options.cube.dimensions)
            self._study = Study(self._options.cube, dimensions, len(self._names))
        values = [feedback.objectives.get(name, 1.0) for name in self._names]
        self._study.tell(feedback.u, values, feedback.number)
        self._told += 1
        if self._told % (REVIEW * self._options.population) == 0:
            self._study.forget_generations(self._sampler(0))
