"""Bayesian search: a model of each margin, and the scene most likely to violate one."""

from __future__ import annotations

import functools
from collections import Counter as Counts
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import log_ndtr, logsumexp

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.candidate import Proposal
from mrta_falsify.core.codec import quantity
from mrta_falsify.core.feedback import DEMANDS, LOADS, Cube, Feedback
from mrta_falsify.core.protocols import Preflight
from samplers.asking import ALIKE, STEPS, BestResults, Counter, Mutator, evenly_in_logarithm
from samplers.gathering import Gathering
from samplers.margin_models import (
    DEFAULT,
    Margin,
    Model,
    Outlook,
    Parts,
    likeliest,
    loads_of,
    margins_of,
)
from samplers.preflights import Preflights, standardised
from samplers.scene_features import Features, Points, as_coordinates

PARENTS = 8  # best scenes that have children
REFIT = 10  # weights are chosen anew when a tenth more results are known
BESIDE = 0.1  # distance in the cube within which a known failure repels
HALVED_AFTER = 10  # results without success after which something is tried half as often
PREFLIGHTED = 16  # candidates that are looked at for one proposal
CLIMBING = 32  # children of these that are looked at after them
OPTIMISM = 1.0  # standard deviations that are hoped for beyond the mean where a load is driven up


class SurrogateSampler:
    """Gaussian processes, one per specification, choose among many children of good scenes.

    The kernel is a sum of four parts: a linear one over all coordinates or one of their products,
    a smooth one of each object, one of coincidences (which kin coordinates are about one value),
    and a rough one that only about the same scenes share (an additive Gaussian process, Duvenaud
    et al. 2011). So dozens of coordinates can be learnt from dozens of results. Its few weights are
    those of largest marginal likelihood on a small grid.

    Some hundred candidates are drawn, mostly children of the best scenes as
    :class:`~samplers.evolution.EvolutionSampler` makes them. The one most likely to violate some
    specification is proposed. A chance counts less beside known failures (local penalisation,
    Gonzalez et al. 2016), and the less the more often that specification was violated already. Of
    failures with one signature only the first has children, so that other ones are looked for.
    Where robust failures are wanted the rough part is noise: what only it violates is a knife
    edge.

    Where scenes can be rehearsed, what they ask of a stack are coordinates like the others, and one
    more kind that alone may explain a margin. The most promising candidates are looked at.
    """

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Options:
        """Options of :class:`SurrogateSampler`."""

        cube: Cube = Cube()
        seed: int = quantity(low=0, default=0)
        initial: int = quantity(low=2, default=10)  #: uniform proposals at first
        candidates: int = quantity(low=2, default=128)  #: that a proposal is chosen from
        memory: int = quantity(low=8, default=128)  #: results the models are made from
        explore: float = quantity(low=0.0, high=1.0, default=0.05)  #: chance of a uniform proposal
        robust: bool = False  #: whether knife edges are not wanted
        loads: float = quantity(low=0.0, high=1.0, default=0.5)
        """Share of the proposals that drive a load up instead of a margin down."""

    def __init__(self, options: Options) -> None:
        self._options = options
        self._counter = Counter("surrogate", options.seed)
        self._mutator = Mutator(options.cube, alike=ALIKE)
        self._gathering = Gathering(options.cube)
        self._features = Features(options.cube)
        self._best = BestResults(PARENTS)
        self._kept = BestResults(options.memory // 2)
        self._recent: list[Feedback] = []
        self._signatures: set[str] = set()
        self._violations: Counts[str] = Counts()  # by specification
        self._models: dict[str, Model] = {}
        self._refit_at = 0
        self._edges = 0  # knife edges since the last robust failure
        self._preflights: Preflights | None = None
        self._heaviest = dict.fromkeys(LOADS, 0.0)
        self._since_heaviest = dict.fromkeys(LOADS, 0)  # results told

    def rehearse_by(self, preflight: Preflight) -> None:
        """See :class:`~mrta_falsify.core.protocols.PreflightSampler`."""
        self._preflights = Preflights.remembering(preflight)
        self._features = Features(self._options.cube, demands=len(DEMANDS))

    def ask(self) -> Proposal:
        """Make the next proposal."""
        random = self._counter.stream()
        options = self._options
        young = self._kept.told < options.initial or not options.cube.dimensions
        if young or random.random() < options.explore:
            return self._counter.proposal(random.random(options.cube.dimensions))
        load = self._load(random) if random.random() < self._share_of_loads() else None
        parents = self._best.best
        promise = self._promise
        if load is not None:
            name = load.name
            parents = sorted(self.results(), key=lambda of: -of.descriptors.get(name, 0.0))
            parents = parents[:PARENTS]
            promise = functools.partial(self._heaviness, load=load)
        candidates = self._candidates(random, parents)
        if self._preflights is not None:
            first = np.argsort(-promise(candidates, looked_at=False), kind="stable")[:PREFLIGHTED]
            scenes = self._preflights.of(candidates[first])
            if scenes:
                best = self._preflights.climb(
                    scenes,
                    lambda scenes: promise(np.array([scene.u for scene in scenes])),
                    self._mutator,
                    random=random,
                    looks=CLIMBING,
                )
                return self._counter.proposal(best.u)
        return self._counter.proposal(candidates[int(np.argmax(promise(candidates)))])

    def _share_of_loads(self) -> float:
        """Say how often a load is driven up: more often, if margins lead to knife edges only."""
        margins = (1.0 - self._options.loads) * HALVED_AFTER / (HALVED_AFTER + self._edges)
        return 1.0 - margins if self._options.loads else 0.0

    def _load(self, random: np.random.Generator) -> Margin | None:
        """Choose a load to drive up, less often one that has not gone up for long."""
        varying = loads_of(self.results())
        if not varying:
            return None
        weight = np.array(
            [1.0 / (HALVED_AFTER + self._since_heaviest[load.name]) for load in varying]
        )
        return varying[int(random.choice(len(varying), p=weight / weight.sum()))]

    def skip(self) -> None:
        """See :class:`~mrta_falsify.core.protocols.SkippingSampler`."""
        self._counter.next += 1

    def tell(self, feedback: Feedback) -> None:
        """Take in a result, also of a point that another sampler proposed."""
        if feedback.fate != "judged":
            return
        if not feedback.failed or feedback.signature not in self._signatures:
            self._best.add(feedback)
        if feedback.failed:
            self._signatures.add(feedback.signature)
            self._edges = self._edges + 1 if feedback.score >= 0.0 else 0
            self._violations.update(n for n, margin in feedback.objectives.items() if margin < 0.0)
        for name, most in self._heaviest.items():
            self._since_heaviest[name] += 1
            if feedback.descriptors.get(name, 0.0) > most:
                self._heaviest[name] = feedback.descriptors[name]
                self._since_heaviest[name] = 0
        self._kept.add(feedback)
        self._recent.append(feedback)
        del self._recent[: -self._options.memory // 2]
        # Here and not in ``ask``, so that a resumed campaign may skip proposals.
        if self._options.cube.dimensions and self._kept.told >= max(
            self._options.initial, self._refit_at
        ):
            self._refit_at = self._kept.told + max(1, self._kept.told // REFIT)
            self._refit()

    def results(self) -> list[Feedback]:
        """List what the models are made from: the best results and the last ones."""
        known = {feedback.number: feedback for feedback in (*self._kept.best, *self._recent)}
        return [known[number] for number in sorted(known)]

    def promise(self, points: Array) -> Array:
        """Estimate the logarithm of the chance of a new violation at points ``(n, k)``, ``(n,)``.

        All are alike as long as nothing is known.
        """
        return self._promise(points) if self._recent else np.zeros(len(points))

    def _candidates(self, random: np.random.Generator, parents: Sequence[Feedback]) -> Array:
        """Draw children of ``parents``, and one in five anew; gather half of these, and parents."""
        rows = []
        for i in range(self._options.candidates):
            if i % 5 == 0:
                u = random.random(self._options.cube.dimensions)
                rows.append(self._gathering.gathered(u, random) if i % 10 == 0 else u)
                continue
            if i % 10 == 1:
                parent = parents[int(random.integers(len(parents)))]
                rows.append(self._gathering.one_gathered(parent.u, random))
                continue
            first, second = random.integers(len(parents), size=2)
            u = parents[int(min(first, second))].u
            if random.random() < 0.3:
                u = self._mutator.crossed(u, parents[int(max(first, second))].u, random)
            step = evenly_in_logarithm(random, *STEPS)
            rows.append(self._mutator.child(u, step, random))
        return np.array(rows)

    def _points(
        self, points: Array, results: Sequence[Feedback], *, looked_at: bool = True
    ) -> Points:
        """See points ``(n, k)`` as the kernel does.

        Args:
            points: to see.
            results: whose demands scale those of the points.
            looked_at: whether the demands of the points are known; else they are as usual.
        """
        if self._preflights is None:
            return self._features.of(points)
        demands = np.zeros((len(points), len(DEMANDS)))
        if looked_at:
            told = self._preflights.demands(feedback.u for feedback in results)
            demands = standardised(self._preflights.demands(points), told)
        return self._features.of(np.hstack([points, as_coordinates(demands)]))

    def _refit(self) -> None:
        """Choose the model of each margin anew."""
        results = self.results()
        seen = self._points(np.array([feedback.u for feedback in results]), results)
        inside = Parts.between(seen, seen)
        insides = [inside.only(kind, seen, seen) for kind in self._features.kinds]
        told = [*margins_of(results), *(loads_of(results) if self._options.loads else ())]
        self._models = likeliest(inside, insides, told)

    def _outlook(
        self, results: Sequence[Feedback], candidates: Array, *, looked_at: bool
    ) -> Outlook:
        """See ``candidates`` ``(n, k)`` beside the results."""
        seen = self._points(np.array([feedback.u for feedback in results]), results)
        proposed = self._points(candidates, results, looked_at=looked_at)
        return Outlook(seen, proposed, self._features.kinds)

    def _heaviness(self, candidates: Array, *, load: Margin, looked_at: bool = True) -> Array:
        """Estimate how heavy ``load`` may get, in standard deviations, ``(n,)``."""
        outlook = self._outlook(self.results(), candidates, looked_at=looked_at)
        model = self._models.get(load.name, DEFAULT)
        mean, deviation = outlook.predict(model, [load], robust=self._options.robust)
        return mean[:, 0] + OPTIMISM * deviation

    def _promise(self, candidates: Array, *, looked_at: bool = True) -> Array:
        """Estimate the logarithm of the chance of a new violation, ``(n,)``."""
        results = self.results()
        outlook = self._outlook(results, candidates, looked_at=looked_at)
        by_model: dict[Model, list[Margin]] = {}  # one factor serves all of them
        for margin in margins_of(results):
            by_model.setdefault(self._models.get(margin.name, DEFAULT), []).append(margin)
        chances = [np.full(len(candidates), -50.0)]
        for model, alike in by_model.items():
            mean, deviation = outlook.predict(model, alike, robust=self._options.robust)
            z = -(np.array([of.centre / of.scale for of in alike]) + mean) / deviation[:, None]
            known = np.array([self._violations[of.name] for of in alike])
            chances.extend((log_ndtr(z) - np.log1p(known)).T)
        promise: Array = logsumexp(np.array(chances), axis=0)
        failed = [i for i, feedback in enumerate(results) if feedback.failed]
        if failed:
            beside = np.exp(-outlook.apart[failed].min(axis=0) / (2.0 * BESIDE**2))
            promise = promise + np.log1p(-np.minimum(beside, 1.0 - 1e-9))
        return promise
