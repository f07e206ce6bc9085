"""What TPE and NSGA-II share: an in-memory Optuna study rebuilt by asking and telling.

Optuna's samplers carry random state, which a resumed study does not get back. So each ask gets a
sampler of its own, seeded by the proposal's number, and the n-th proposal depends on the told
results alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import optuna
from optuna.distributions import BaseDistribution, CategoricalDistribution, FloatDistribution
from optuna.trial import FrozenTrial, TrialState, create_trial

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.feedback import Cube

optuna.logging.set_verbosity(optuna.logging.WARNING)


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


class Study:
    """An Optuna study over chosen coordinates of the cube."""

    def __init__(self, cube: Cube, chosen: Sequence[int], objectives: int) -> None:
        self.chosen = tuple(chosen)
        self._cube = cube
        self._objectives = objectives
        self._distributions = {f"u{i}": self._distribution(i) for i in self.chosen}
        self._study = optuna.create_study(directions=["minimize"] * objectives)
        self._notes: dict[int, dict[str, Any]] = {}

    def _distribution(self, i: int) -> BaseDistribution:
        levels = self._cube.level(i)
        if 0 < levels <= 20:
            return CategoricalDistribution(tuple(range(levels)))
        return FloatDistribution(0.0, 1.0)

    def ask(self, sampler: optuna.samplers.BaseSampler, u: Array, number: int) -> Array:
        """Replace the chosen coordinates of ``u`` ``(k,)`` by what ``sampler`` suggests.

        ``number`` is the proposal's; what the sampler notes about it (its generation) is kept
        for its result.
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

    def tell(self, u: Array, values: Sequence[float], number: int) -> None:
        """Add the result of proposal ``number``, realised at ``u`` ``(k,)``."""
        self._study.add_trial(self._trial(u, values, self._notes.pop(number, {})))

    def forget_generations(self, sampler: optuna.samplers.NSGAIISampler) -> None:
        """Drop what a genetic sampler will not look at any more, so that it stays quick.

        Kept are the parents of the latest generation, which become generation 0, and that
        generation, which becomes 1; so do proposals on their way.
        """
        done = self._study.get_trials(deepcopy=False, states=(TrialState.COMPLETE,))
        latest = max((_generation(trial.system_attrs) for trial in done), default=0)
        if latest <= 1:
            return
        parents = sampler.get_parent_population(self._study, latest)
        young = [trial for trial in done if _generation(trial.system_attrs) == latest]
        self._study = optuna.create_study(directions=["minimize"] * self._objectives)
        for generation, trials in ((0, parents), (1, young)):
            for trial in trials:
                key = _generation_key(trial.system_attrs)
                self._study.add_trial(
                    create_trial(
                        params=trial.params,
                        distributions=trial.distributions,
                        values=trial.values,
                        system_attrs={key: generation},
                    )
                )
        for notes in self._notes.values():
            key = _generation_key(notes)
            notes[key] = max(0, notes[key] - latest + 1)

    def _trial(self, u: Array, values: Sequence[float], notes: dict[str, Any]) -> FrozenTrial:
        params: dict[str, float | int] = {}
        for i in self.chosen:
            levels = self._cube.level(i)
            value = float(u[i])
            params[f"u{i}"] = min(int(value * levels), levels - 1) if 0 < levels <= 20 else value
        return create_trial(
            params=params,
            distributions=self._distributions,
            values=list(values[: self._objectives]),
            system_attrs=notes,
        )


def _generation_key(notes: dict[str, Any]) -> str:
    return next((key for key in notes if key.endswith("generation")), "")


def _generation(notes: dict[str, Any]) -> int:
    return int(notes.get(_generation_key(notes), -1))
