"""Tree-structured Parzen estimator of Optuna, on the coordinates that seem to matter."""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import numpy as np
import optuna
from scipy.stats import rankdata

from mrta_falsify.core.arrays import Array, IntArray
from mrta_falsify.core.candidate import Proposal
from mrta_falsify.core.codec import quantity
from mrta_falsify.core.feedback import Cube, Feedback
from mrta_falsify.core.seeding import candidate_seed
from samplers.asking import BestResults, Counter, Mutator
from samplers.optuna_study import Study


class TpeSampler:
    """TPE (Bergstra et al. 2011) over the coordinates that correlate most with the score.

    TPE's cost grows with coordinates times results, and with 300 coordinates most of its
    suggestions are noise. So coordinates are screened every ``review`` results, and the study holds
    at most ``window`` results (the best half and the latest half). The other coordinates come
    from a good scene with a few objects changed.
    """

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Options:
        """Options of :class:`TpeSampler`."""

        cube: Cube = Cube()
        seed: int = quantity(low=0, default=0)
        initial: int = quantity(low=2, default=20)  #: uniform proposals at first
        screened: int = quantity(low=1, high=200, default=30)  #: coordinates that TPE suggests
        review: int = quantity(low=1, default=25)  #: results between two screenings
        window: int = quantity(low=10, default=200)  #: results that TPE sees

    def __init__(self, options: Options) -> None:
        self._options = options
        self._counter = Counter("tpe", options.seed)
        self._mutator = Mutator(options.cube)
        self._memory = BestResults(8)
        self._history: list[Feedback] = []
        self._study: Study | None = None
        self._reviewed = 0

    def ask(self) -> Proposal:
        """Make the next proposal."""
        random = self._counter.stream()
        options = self._options
        if self._memory.told < options.initial or not options.cube.dimensions:
            return self._counter.proposal(random.random(options.cube.dimensions))
        best = self._memory.best
        u = self._mutator.child(best[int(random.integers(len(best)))].u, 0.1, random)
        seed = candidate_seed(options.seed, self._counter.next) % 2**32
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", optuna.exceptions.ExperimentalWarning)
            sampler = optuna.samplers.TPESampler(seed=seed, n_startup_trials=0, group=False)
        return self._counter.proposal(self._current().ask(sampler, u, self._counter.next))

    def tell(self, feedback: Feedback) -> None:
        """Take in a result."""
        if feedback.fate != "judged":
            return
        self._history.append(feedback)
        self._memory.add(feedback)
        if self._study is not None:
            self._study.tell(feedback.u, [feedback.score], feedback.number)

    def _current(self) -> Study:
        due = len(self._history) - self._reviewed >= self._options.review
        if self._study is None or due:
            self._study = Study(self._options.cube, self._screen(), 1)
            self._reviewed = len(self._history)
            for known in self._kept():
                self._study.tell(known.u, [known.score], known.number)
        return self._study

    def _kept(self) -> list[Feedback]:
        half = self._options.window // 2
        latest = self._history[-half:]
        earlier = sorted(self._history[:-half], key=lambda known: (known.score, known.number))
        return sorted([*earlier[:half], *latest], key=lambda known: known.number)

    def _screen(self) -> list[int]:
        kept = self._kept()
        points = np.array([known.u for known in kept])
        scores = np.array([known.score for known in kept])
        relevance = np.abs(rank_correlation(points, scores))
        order: IntArray = np.argsort(-relevance, kind="stable")
        return sorted(int(i) for i in order[: self._options.screened])


def rank_correlation(points: Array, scores: Array) -> Array:
    """Correlate the ranks of coordinates ``(n, k)`` and ``scores`` ``(n,)``: Spearman, ``(k,)``.

    0 where either does not vary.
    """
    x = rankdata(points, axis=0) - (len(points) + 1) / 2.0
    y = rankdata(scores) - (len(scores) + 1) / 2.0
    scale = np.sqrt((x * x).sum(axis=0) * (y * y).sum())
    agreement: Array = np.divide(y @ x, scale, out=np.zeros(points.shape[1]), where=scale > 0.0)
    return agreement
