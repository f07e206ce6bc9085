"""Tree-structured Parzen estimator of Optuna, on the coordinates that seem to matter.

Optuna's sampler carries random state, which a resumed study does not get back. So each ask gets a
sampler of its own, seeded by the proposal's number, and the n-th proposal depends on the reported
results alone.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import optuna
from optuna.distributions import BaseDistribution, CategoricalDistribution, FloatDistribution
from optuna.trial import FrozenTrial, TrialState, create_trial
from scipy.stats import rankdata

from mrta_falsify.core.arrays import Array, IntArray
from mrta_falsify.core.candidate import Proposal
from mrta_falsify.core.codec import quantity
from mrta_falsify.core.feedback import Cube, Feedback
from mrta_falsify.core.seeding import candidate_seed
from samplers.asking import BestResults, Counter, Mutator

optuna.logging.set_verbosity(optuna.logging.WARNING)


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
        self._study: _Study | None = None
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
            self._study.tell(feedback.u, feedback.score, feedback.number)

    def _current(self) -> _Study:
        due = len(self._history) - self._reviewed >= self._options.review
        if self._study is None or due:
            self._study = _Study(self._options.cube, self._screen())
            self._reviewed = len(self._history)
            for known in self._kept():
                self._study.tell(known.u, known.score, known.number)
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


class _AllAtOnce(optuna.samplers.BaseSampler):
    """A sampler asked for all coordinates in one go.

    ``Trial.suggest_float`` copies what was suggested before at each coordinate, and each ask finds
    the search space anew from all trials. That takes nine tenths of the time, for what we know.
    """

    def __init__(
        self, inner: optuna.samplers.BaseSampler, space: dict[str, BaseDistribution]
    ) -> None:
        self._inner = inner
        self._space = space

    def before_trial(self, study: optuna.Study, trial: FrozenTrial) -> None:
        self._inner.before_trial(study, trial)

    def infer_relative_search_space(
        self, study: optuna.Study, trial: FrozenTrial
    ) -> dict[str, BaseDistribution]:
        return self._space

    def sample_relative(
        self, study: optuna.Study, trial: FrozenTrial, search_space: dict[str, BaseDistribution]
    ) -> dict[str, Any]:
        suggested = self._inner.sample_relative(study, trial, search_space)
        for name, distribution in search_space.items():
            if name not in suggested:
                value = self._inner.sample_independent(study, trial, name, distribution)
                suggested[name] = value
        return suggested

    def sample_independent(
        self,
        study: optuna.Study,
        trial: FrozenTrial,
        param_name: str,
        param_distribution: BaseDistribution,
    ) -> Any:
        raise AssertionError("all coordinates are drawn at once")


class _Study:
    """An Optuna study over chosen coordinates of the cube."""

    def __init__(self, cube: Cube, chosen: Sequence[int]) -> None:
        self.chosen = tuple(chosen)
        self._cube = cube
        self._distributions = {f"u{i}": self._distribution(i) for i in self.chosen}
        self._study = optuna.create_study(direction="minimize")
        self._notes: dict[int, dict[str, Any]] = {}

    def _distribution(self, i: int) -> BaseDistribution:
        levels = self._cube.level(i)
        if 0 < levels <= 20:
            return CategoricalDistribution(tuple(range(levels)))
        return FloatDistribution(0.0, 1.0)

    def ask(self, sampler: optuna.samplers.BaseSampler, u: Array, number: int) -> Array:
        """Replace the chosen coordinates of ``u`` ``(k,)`` by what ``sampler`` suggests.

        ``number`` is the proposal's; what the sampler notes about it is kept for its result.
        """
        self._study.sampler = _AllAtOnce(sampler, self._distributions)
        trial = self._study.ask()
        suggested = trial.relative_params
        for i in self.chosen:
            value = suggested[f"u{i}"]
            levels = self._cube.level(i)
            # a category is searched by name; its middle is its place in the cube
            u[i] = (value + 0.5) / levels if 0 < levels <= 20 else value
        seen = self._study.get_trials(deepcopy=False)[trial.number]
        self._notes[number] = dict(seen.system_attrs)
        self._study.tell(trial, state=TrialState.FAIL)  # the result is told as a trial of its own
        return u

    def tell(self, u: Array, score: float, number: int) -> None:
        """Add the result of proposal ``number``, realised at ``u`` ``(k,)``."""
        self._study.add_trial(self._trial(u, score, self._notes.pop(number, {})))

    def _trial(self, u: Array, score: float, notes: dict[str, Any]) -> FrozenTrial:
        params: dict[str, float | int] = {}
        for i in self.chosen:
            levels = self._cube.level(i)
            value = float(u[i])
            params[f"u{i}"] = min(int(value * levels), levels - 1) if 0 < levels <= 20 else value
        return create_trial(
            params=params,
            distributions=self._distributions,
            values=[score],
            system_attrs=notes,
        )
