"""Gaussian processes of margins and loads over scenes, for :mod:`samplers.surrogate`."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.linalg import solve_triangular

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.feedback import LOADS, Feedback
from samplers.scene_features import Kind, Points

LINEAR = (0.9, 0.5, 0.1)  # share of the linear part in what points explain
LENGTHS = (0.5, 0.2)  # of the smooth part, in the unit cube
DEGREES = (1, 2)  # of the polynomial that the linear part is
KINS = (0.0, 0.4, 0.8)  # share of what pairs of kin coordinates explain that are about one value
ROUGHS = (0.02, 0.2, 0.6)  # share of the variance that only points close by explain
CLOSE = 0.1  # distance in the cube at which they do: about the same scene, about the same run
NUGGET = 1e-6  # so that equal points do not make the covariance singular
SPARE = 1e-6  # margins that vary less than this say nothing


@dataclass(frozen=True, slots=True, eq=False)
class Parts:
    """The parts of the kernel between two sets of points, ``(n, m)`` each."""

    linear: Array  #: about 1 for a point with itself
    kin: Array  #: likewise, of what is alike among kin
    smooth: dict[float, Array]  #: mean over objects of a rational quadratic, by length scale
    apart: Array  #: squared distance over all objects

    def only(self, kind: Kind, some: Points, others: Points) -> Parts:
        """Compute the parts that one kind of object makes; what is about the same scene stays."""
        own = Parts.between(some.of_kind(kind), others.of_kind(kind))
        return dataclasses.replace(own, apart=self.apart)

    @classmethod
    def between(cls, some: Points, others: Points, lengths: Iterable[float] = LENGTHS) -> Parts:
        """Compute the parts between all pairs, the smooth one for some length scales."""
        width = max(some.linear.shape[1], 1)
        smooth = {length: np.zeros((len(some.linear), len(others.linear))) for length in lengths}
        apart = np.zeros((len(some.linear), len(others.linear)))
        for mine, theirs in zip(some.blocks, others.blocks, strict=True):
            squares = (mine**2).sum(axis=1)[:, None] + (theirs**2).sum(axis=1)[None, :]
            squares = np.maximum(squares - 2.0 * (mine @ theirs.T), 0.0)
            apart += squares
            for length, total in smooth.items():
                np.add(total, 1.0 / (1.0 + squares / (2.0 * length**2)), out=total)
        count = max(len(some.blocks), 1)
        shares = {length: total / count for length, total in smooth.items()}
        kin = some.pairs @ others.pairs.T / max(some.pairs.shape[1], 1)
        return cls(some.linear @ others.linear.T / width, kin, shares, apart)

    @classmethod
    def of_points(cls, points: Points) -> Parts:
        """Compute the parts of each point with itself, ``(n,)``."""
        ones = np.ones(len(points.linear))
        linear = (points.linear**2).sum(axis=1) / max(points.linear.shape[1], 1)
        kin = (points.pairs**2).sum(axis=1) / max(points.pairs.shape[1], 1)
        return cls(linear, kin, dict.fromkeys(LENGTHS, ones), np.zeros(len(points.linear)))


@dataclass(frozen=True, slots=True)
class Model:
    """Weights of the kernel; the values that it explains have mean 0 and variance 1."""

    linear: float  #: share of the linear part
    length: float  #: of the smooth part
    rough: float  #: share of the part that only points close by explain
    kin: float = 0.0  #: share of what coincidences explain
    degree: int = 1  #: of the linear part: 2 has products of two coordinates, too
    kind: int = -1  #: of object that alone explains it, but for the rough part; -1: all do

    def kernel(self, parts: Parts, *, robust: bool = False) -> Array:
        """Compute covariances of results; with ``robust``, of results without the rough part."""
        linear = parts.linear if self.degree == 1 else 0.5 * (parts.linear + parts.linear**2)
        own = self.linear * linear + (1.0 - self.linear) * parts.smooth[self.length]
        far = (1.0 - self.rough) * ((1.0 - self.kin) * own + self.kin * parts.kin)
        if robust:
            return far
        return far + self.rough * np.exp(-parts.apart / (2.0 * CLOSE**2))

    def factor(self, inside: Parts) -> Array:
        """Factor the covariance of results: lower Cholesky factor ``(n, n)``."""
        covariance = self.kernel(inside)
        return np.asarray(np.linalg.cholesky(covariance + NUGGET * np.eye(len(covariance))))

    def log_likelihood(self, inside: Parts, margins: Sequence[Margin]) -> Array:
        """Compute log marginal likelihoods ``(v,)`` of margins, up to constants."""
        lower = self.factor(inside)
        solved = solve_triangular(lower, _columns(margins), lower=True)
        likelihood: Array = -0.5 * (solved**2).sum(axis=0) - np.log(np.diag(lower)).sum()
        return likelihood


DEFAULT = Model(LINEAR[1], LENGTHS[0], ROUGHS[1])  # of a margin that has only begun to vary


class Margin(NamedTuple):
    """A margin of n results, shifted and scaled to mean 0 and variance 1."""

    name: str
    values: Array  #: (n,)
    centre: float
    scale: float


class Outlook:
    """What results say of points that are asked about: one object for all margins and loads.

    Args:
        seen: the n results.
        proposed: the m points asked about.
        kinds: of object, one of which alone may explain a margin.
    """

    def __init__(self, seen: Points, proposed: Points, kinds: Sequence[Kind]) -> None:
        self._seen, self._proposed, self._kinds = seen, proposed, kinds
        self._inside, self._across = Parts.between(seen, seen), Parts.between(seen, proposed)
        self._known: dict[int, tuple[Parts, Parts, Parts]] = {}

    @property
    def apart(self) -> Array:
        """Squared distances over all objects, ``(n, m)``."""
        return self._across.apart

    def predict(
        self, model: Model, margins: Sequence[Margin], *, robust: bool
    ) -> tuple[Array, Array]:
        """Predict means ``(m, v)`` and standard deviations ``(m,)`` at the points asked about.

        Args:
            model: of all the margins.
            margins: of the results, v.
            robust: leave the rough part out of what is predicted.
        """
        inside, across, prior = self._parts(model.kind)
        solved = solve_triangular(
            model.factor(inside),
            np.column_stack([model.kernel(across, robust=robust), _columns(margins)]),
            lower=True,
        )
        points = len(prior.linear)
        shrunk, weights = solved[:, :points], solved[:, points:]
        variance = np.maximum(model.kernel(prior, robust=robust) - (shrunk**2).sum(axis=0), NUGGET)
        return shrunk.T @ weights, np.sqrt(variance)

    def _parts(self, kind: int) -> tuple[Parts, Parts, Parts]:
        """Give the parts between results, to the points, and of these; of one kind or all (-1)."""
        if kind not in self._known:
            self._known[kind] = self._parts_of(kind)
        return self._known[kind]

    def _parts_of(self, kind: int) -> tuple[Parts, Parts, Parts]:
        seen, proposed = self._seen, self._proposed
        if kind < 0:
            return self._inside, self._across, Parts.of_points(proposed)
        of = self._kinds[kind]
        own = Parts.of_points(proposed.of_kind(of))
        return self._inside.only(of, seen, seen), self._across.only(of, seen, proposed), own


def margins_of(results: Sequence[Feedback]) -> list[Margin]:
    """Collect the margins of the specifications that tell results apart, in order of names."""
    names = sorted({name for feedback in results for name in feedback.objectives})
    return _distinguishable(
        {name: [feedback.objectives.get(name, 1.0) for feedback in results] for name in names}
    )


def loads_of(results: Sequence[Feedback]) -> list[Margin]:
    """Collect the loads that tell results apart, in order of ``LOADS``."""
    return _distinguishable(
        {name: [feedback.descriptors.get(name, 0.0) for feedback in results] for name in LOADS}
    )


def _distinguishable(reported: Mapping[str, Sequence[float]]) -> list[Margin]:
    """Shift and scale what varies."""
    found = []
    for name, of in reported.items():
        values = np.array(of)
        if np.ptp(values) > SPARE:
            centre, scale = float(values.mean()), float(values.std())
            found.append(Margin(name, (values - centre) / scale, centre, scale))
    return found


def _columns(margins: Sequence[Margin]) -> Array:
    """Stack the values, ``(n, v)``."""
    return np.array([margin.values for margin in margins]).T


def likeliest(
    inside: Parts, of_kinds: Sequence[Parts], margins: Sequence[Margin]
) -> dict[str, Model]:
    """Choose the model of largest marginal likelihood for each margin.

    Args:
        inside: parts between the results.
        of_kinds: those that one kind of object makes, of each kind.
        margins: of the results.
    """
    if not margins:
        return {}
    kins = KINS if inside.kin.any() else KINS[:1]
    models = [
        Model(*weights) for weights in itertools.product(LINEAR, LENGTHS, ROUGHS, kins, DEGREES)
    ]
    parts = [inside] * len(models)
    for kind, of_kind in enumerate(of_kinds):
        own = KINS if of_kind.kin.any() else KINS[:1]
        few = [
            Model(linear, LENGTHS[0], rough, kin, kind=kind)
            for linear, rough, kin in itertools.product(LINEAR, ROUGHS, own)
        ]
        models += few
        parts += [of_kind] * len(few)
    likelihoods = np.array(
        [model.log_likelihood(of, margins) for model, of in zip(models, parts, strict=True)]
    )
    best = likelihoods.argmax(axis=0)
    return {margin.name: models[i] for margin, i in zip(margins, best, strict=True)}
