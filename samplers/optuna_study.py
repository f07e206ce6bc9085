"""What TPE and NSGA-II share: an in-memory Optuna study rebuilt by asking and telling.

Optuna's samplers carry random state, which a resumed study does not get back; here each ask
gets a sampler of its own, seeded by the proposal's number, so that the n-th proposal depends
on the told results alone.
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
        """``u`` ``(k,)`` with the chosen coordinates replaced by what ``sampler`` suggests.

        ``number`` is the proposal's; what the sampler notes about it (its generation) is kept
        for its result.
        """
        self._study.sampler = sampler
        trial = self._study.ask(self._distributions)
        for i in self.chosen:
            value = trial.params[f"u{i}"]
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
