"""Bayesian search: a model of each margin, and the scene most likely to violate one."""

from __future__ import annotations

import dataclasses
import functools
import itertools
import re
from collections import Counter as Counts
from collections.abc import Callable, Hashable, Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.linalg import solve_triangular
from scipy.special import log_ndtr, logsumexp

from mrta_falsify.core.arrays import Array, IntArray
from mrta_falsify.core.candidate import Proposal
from mrta_falsify.core.codec import quantity
from mrta_falsify.core.feedback import DEMANDS, LOADS, Cube, Feedback
from mrta_falsify.core.protocols import Rehearsal
from samplers.asking import (
    ALIKE,
    STEPS,
    BestResults,
    Counter,
    Mutator,
    evenly_in_logarithm,
    levels_at,
)
from samplers.gathering import Gathering
from samplers.rehearsals import Rehearsals, standardised

PARENTS = 8  # best scenes that have children
LINEAR = (0.9, 0.5, 0.1)  # share of the linear part in what points explain
LENGTHS = (0.5, 0.2)  # of the smooth part, in the unit cube
DEGREES = (1, 2)  # of the polynomial that the linear part is
KINS = (0.0, 0.4, 0.8)  # share of what pairs of kin coordinates explain that are about one value
ROUGHS = (0.02, 0.2, 0.6)  # share of the variance that only points close by explain
CLOSE = 0.1  # distance in the cube at which they do: about the same scene, about the same run
NUGGET = 1e-6  # so that equal points do not make the covariance singular
REFIT = 10  # weights are chosen anew when a tenth more results are known
BESIDE = 0.1  # distance in the cube within which a known failure repels
SPARE = 1e-6  # margins that vary less than this say nothing
ABOUT = 0.15  # distance in a coordinate of what is about one value
USUAL, USUAL_GAIN = 0.26, 3.0  # mean of how alike two are, and one over its spread
GATHERED_GAIN = 5.0  # one over the spread of the share of a family that is about one value
TIRED = 10  # results without success after which something is tried half as often
MOST_KINDS = 4  # kinds of object of which one alone may explain a margin
REHEARSED = 32  # candidates that are looked at for one proposal: each takes some 15 ms
DEMAND = "demand"  # kind of the coordinates that rehearsals add
BOLD = 1.0  # standard deviations that are hoped for beyond the mean where a load is driven up


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
    edge. A margin that few copies tell has a variance, which is noise of that result alone.

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
        self._features = _Features(options.cube)
        self._best = BestResults(PARENTS)
        self._kept = BestResults(options.memory // 2)
        self._recent: list[Feedback] = []
        self._signatures: set[str] = set()
        self._violations: Counts[str] = Counts()  # by specification
        self._models: dict[str, _Model] = {}
        self._refit_at = 0
        self._edges = 0  # knife edges since the last robust failure
        self._rehearsals: Rehearsals | None = None
        self._heaviest = dict.fromkeys(LOADS, 0.0)
        self._since_heaviest = dict.fromkeys(LOADS, 0)  # results told

    def rehearse_by(self, rehearsal: Rehearsal) -> None:
        """See :class:`~mrta_falsify.core.protocols.RehearsingSampler`."""
        self._rehearsals = Rehearsals.remembering(rehearsal)
        self._features = _Features(self._options.cube, demands=len(DEMANDS))

    def ask(self) -> Proposal:
        """Make the next proposal."""
        random = self._counter.stream()
        options = self._options
        young = self._kept.told < options.initial or not options.cube.dimensions
        if young or random.random() < options.explore:
            return self._counter.proposal(random.random(options.cube.dimensions))
        load = self._load(random) if random.random() < self._share_of_loads() else ""
        parents = self._best.best
        promise = self._promise
        if load:
            parents = sorted(self.results(), key=lambda of: -of.descriptors.get(load, 0.0))
            parents = parents[:PARENTS]
            promise = functools.partial(self._heaviness, load=load)
        candidates = self._candidates(random, parents)
        if self._rehearsals is not None:
            first = np.argsort(-promise(candidates, looked_at=False), kind="stable")[:REHEARSED]
            scenes = self._rehearsals.of(candidates[first])
            candidates = np.array([scene.u for scene in scenes]) if scenes else candidates
        return self._counter.proposal(candidates[int(np.argmax(promise(candidates)))])

    def _share_of_loads(self) -> float:
        """Say how often a load is driven up: more often, if margins lead to knife edges only."""
        margins = (1.0 - self._options.loads) * TIRED / (TIRED + self._edges)
        return 1.0 - margins if self._options.loads else 0.0

    def _load(self, random: np.random.Generator) -> str:
        """Choose a load to drive up, less often one that has not gone up for long; "": none."""
        told = [feedback.descriptors for feedback in self.results()]
        varying = [
            name
            for name in LOADS
            if max(t.get(name, 0.0) for t in told) - min(t.get(name, 0.0) for t in told) > SPARE
        ]
        if not varying:
            return ""
        weight = np.array([1.0 / (TIRED + self._since_heaviest[name]) for name in varying])
        return str(random.choice(varying, p=weight / weight.sum()))

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
            parent = parents[int(min(first, second))]
            u = parent.u
            if random.random() < 0.3:
                u = self._mutator.crossed(u, parents[int(max(first, second))].u, random)
            step = evenly_in_logarithm(random, *STEPS)
            rows.append(self._mutator.child(u, step, random, blamed=parent.blamed))
        return np.array(rows)

    def _points(
        self, points: Array, results: Sequence[Feedback], *, looked_at: bool = True
    ) -> _Points:
        """See points ``(n, k)`` as the kernel does.

        Args:
            points: to see.
            results: whose demands scale those of the points.
            looked_at: whether the demands of the points are known; else they are as usual.
        """
        if self._rehearsals is None:
            return self._features.of(points)
        demands = np.zeros((len(points), len(DEMANDS)))
        if looked_at:
            told = self._rehearsals.demands(feedback.u for feedback in results)
            demands = standardised(self._rehearsals.demands(points), told)
        return self._features.of(np.hstack([points, as_coordinates(demands)]))

    def _refit(self) -> None:
        """Choose the model of each margin anew."""
        results = self.results()
        seen = self._points(np.array([feedback.u for feedback in results]), results)
        inside = _Parts.between(seen, seen)
        insides = [inside.only(kind, seen, seen) for kind in self._features.kinds]
        self._models = {}
        told = [*_varying(results), *(_loads_of(results) if self._options.loads else ())]
        for alike in _grouped(told, lambda margin: margin.noise.tobytes()):
            self._models |= _likeliest(inside, insides, alike)

    def _heaviness(self, candidates: Array, *, load: str, looked_at: bool = True) -> Array:
        """Estimate how heavy ``load`` may get, in standard deviations, ``(n,)``."""
        results = self.results()
        told = np.array([feedback.descriptors.get(load, 0.0) for feedback in results])
        margin = _margin(load, told, np.zeros(len(told)))
        seen = self._points(np.array([feedback.u for feedback in results]), results)
        asked = self._points(candidates, results, looked_at=looked_at)
        model = self._models.get(load, DEFAULT)
        whole = _Parts.between(seen, seen), _Parts.between(seen, asked)
        inside, across, prior = self._parts(model.kind, *whole, seen, asked)
        mean, deviation = model.predict(
            inside, across, prior, [margin], robust=self._options.robust
        )
        return mean[:, 0] + BOLD * deviation

    def _parts(
        self, kind: int, inside: _Parts, across: _Parts, seen: _Points, asked: _Points
    ) -> tuple[_Parts, _Parts, _Parts]:
        """Give the parts between results, to what is asked, and of the latter; of one kind or all.

        Args:
            kind: of object; -1: all.
            inside: parts between the results, of all.
            across: parts between results and the points asked about, of all.
            seen: the results.
            asked: the points asked about.
        """
        if kind < 0:
            return inside, across, _Parts.of_points(asked)
        of = self._features.kinds[kind]
        own = _Parts.of_points(asked.of_kind(of))
        return inside.only(of, seen, seen), across.only(of, seen, asked), own

    def _promise(self, candidates: Array, *, looked_at: bool = True) -> Array:
        """Estimate the logarithm of the chance of a new violation, ``(n,)``."""
        results = self.results()
        points = np.array([feedback.u for feedback in results])
        seen = self._points(points, results)
        asked = self._points(candidates, results, looked_at=looked_at)
        margins = _varying(results)
        models = {margin.name: self._models.get(margin.name, DEFAULT) for margin in margins}
        whole = _Parts.between(seen, seen), _Parts.between(seen, asked)
        of_kinds = {
            kind: self._parts(kind, *whole, seen, asked)
            for kind in {model.kind for model in models.values()}
        }
        chances = [np.full(len(candidates), -50.0)]
        for alike in _grouped(margins, lambda of: (models[of.name], of.noise.tobytes())):
            model = models[alike[0].name]
            inside, across, prior = of_kinds[model.kind]
            mean, deviation = model.predict(
                inside, across, prior, alike, robust=self._options.robust
            )
            z = -(np.array([of.centre / of.scale for of in alike]) + mean) / deviation[:, None]
            known = np.array([self._violations[of.name] for of in alike])
            chances.extend((log_ndtr(z) - np.log1p(known)).T)
        promise: Array = logsumexp(np.array(chances), axis=0)
        failed = [i for i, feedback in enumerate(results) if feedback.failed]
        if failed:
            beside = np.exp(-whole[1].apart[failed].min(axis=0) / (2.0 * BESIDE**2))
            promise = promise + np.log1p(-np.minimum(beside, 1.0 - 1e-9))
        return promise


# --- models --------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class _Points:
    """Points as the kernel sees them."""

    linear: Array  #: (n, f) centred; levels of discrete coordinates as indicators
    blocks: tuple[Array, ...]  #: by object, (n, f_b): coordinates, indicators over root two
    pairs: Array  #: (n, p) of kin coordinates, how alike they are, and of families as a whole

    def of_kind(self, kind: _Kind) -> _Points:
        """Keep what is of some kind of object."""
        blocks = tuple(self.blocks[number] for number in kind.blocks)
        return _Points(self.linear[:, kind.linear], blocks, self.pairs[:, kind.pairs])


class _Kind(NamedTuple):
    """What of points is of one kind of object."""

    linear: IntArray  #: columns
    blocks: tuple[int, ...]
    pairs: IntArray  #: columns


class _Features:
    """Points of the cube, and their demands behind them, as :class:`_Points`."""

    def __init__(self, cube: Cube, *, demands: int = 0) -> None:
        cube = _with_demands(cube, demands) if demands else cube
        self._families = [
            (list(kin), [np.array(cube.labels_of(i), dtype=np.int64) for i in kin])
            for kin in cube.families()
        ]
        gains: list[float] = []
        shifts: list[float] = []
        self._smooth: list[tuple[int, int]] = []  # coordinate, its column
        self._discrete: list[tuple[int, int, int]] = []  # coordinate, levels, first column
        self._blocks: list[slice] = []
        for block in cube.blocks():
            begin = len(gains)
            for i in block:
                levels = cube.level(i)
                if levels == 0:
                    self._smooth.append((i, len(gains)))
                else:
                    self._discrete.append((i, levels, len(gains)))
                gains += [np.sqrt(2.0 * levels)] * levels or [np.sqrt(12.0)]
                shifts += [-1.0 / np.sqrt(levels)] * levels if levels else [-np.sqrt(3.0)]
            self._blocks.append(slice(begin, len(gains)))
        self._gains, self._shifts = np.array(gains), np.array(shifts)
        self.kinds = self._largest_kinds(cube)

    def _largest_kinds(self, cube: Cube) -> list[_Kind]:
        """List the kinds with most coordinates, and demands; none if there is only one."""
        names = [_kind_name(cube, i) for i in range(cube.dimensions)]
        if len(set(names)) < 2:
            return []
        counts = Counts(name for name in names if name != DEMAND).most_common(MOST_KINDS)
        kinds = [name for name, _ in counts] + [DEMAND] * (DEMAND in names)
        blocks = cube.blocks()
        columns = [names[i] for block in blocks for i in block for _ in range(cube.level(i) or 1)]
        pairs = [
            names[family[0]]
            for family, _ in self._families
            for _ in range(len(family) * (len(family) - 1) // 2 + 1)
        ]
        return [
            _Kind(
                np.flatnonzero(np.array(columns) == name),
                tuple(n for n, block in enumerate(blocks) if names[block[0]] == name),
                np.flatnonzero(np.array(pairs) == name),
            )
            for name in kinds
        ]

    def of(self, points: Array) -> _Points:
        """Convert ``points`` ``(n, k)``."""
        columns = np.empty((len(points), len(self._gains)))
        if self._smooth:
            coordinates, places = map(list, zip(*self._smooth, strict=True))
            columns[:, places] = points[:, coordinates]
        for i, levels, first in self._discrete:
            level = levels_at(points[:, i], levels)
            columns[:, first : first + levels] = np.eye(levels)[level] / np.sqrt(2.0)
        linear = columns * self._gains + self._shifts
        blocks = tuple(columns[:, block] for block in self._blocks)
        pairs = [np.zeros((len(points), 0))]
        for family, labels in self._families:
            alike = _alike(points[:, family], labels)
            each = (alike[:, *np.triu_indices(len(family), 1)] - USUAL) * USUAL_GAIN
            pairs.append(each * np.sqrt(len(family) / each.shape[1]))
            pairs.append((alike.mean(axis=2).max(axis=1)[:, None] - 0.5) * GATHERED_GAIN)
        return _Points(linear, blocks, np.column_stack(pairs))


def as_coordinates(demands: Array) -> Array:
    """Scale demands of mean 0 and deviation 1 as evenly drawn coordinates are, beyond [0, 1]."""
    return np.asarray(0.5 + demands / np.sqrt(12.0))


def _with_demands(cube: Cube, count: int) -> Cube:
    """Add a coordinate for each demand of a scene, an object each."""
    k = cube.dimensions
    groups = cube.groups or tuple(range(k))
    objects = max(groups, default=-1) + 1
    return dataclasses.replace(
        cube,
        dimensions=k + count,
        levels=(cube.levels or (0,) * k) + (0,) * count,
        groups=groups + tuple(range(objects, objects + count)),
        owners=(cube.owners or ("",) * objects) + (DEMAND,) * count,
    )


def _kind_name(cube: Cube, i: int) -> str:
    """Name the kind of the object that coordinate ``i`` belongs to: ``human3`` is a ``human``."""
    if not cube.owners:
        return ""
    return re.split(r"\d", cube.owners[cube.groups[i]], maxsplit=1)[0]


def _alike(values: Array, labels: Sequence[IntArray]) -> Array:
    """Say which of kin coordinates ``(n, m)`` are about one value, ``(n, m, m)`` in [0, 1].

    Args:
        values: of the coordinates.
        labels: numbers of the values of each of the m coordinates, if they are discrete.
    """
    if len(labels[0]):
        levels = np.array([len(of) for of in labels])
        level = levels_at(values, levels)
        label = np.column_stack([of[level[:, i]] for i, of in enumerate(labels)])
        return np.asarray(label[:, :, None] == label[:, None, :], dtype=np.float64)
    return np.exp(-(((values[:, :, None] - values[:, None, :]) / ABOUT) ** 2))


@dataclass(frozen=True, slots=True, eq=False)
class _Parts:
    """The parts of the kernel between two sets of points, ``(n, m)`` each."""

    linear: Array  #: about 1 for a point with itself
    kin: Array  #: likewise, of what is alike among kin
    smooth: dict[float, Array]  #: mean over objects of a rational quadratic, by length scale
    apart: Array  #: squared distance over all objects

    def only(self, kind: _Kind, some: _Points, others: _Points) -> _Parts:
        """Compute the parts that one kind of object makes; what is about the same scene stays."""
        own = _Parts.between(some.of_kind(kind), others.of_kind(kind))
        return dataclasses.replace(own, apart=self.apart)

    @classmethod
    def between(cls, some: _Points, others: _Points, lengths: Iterable[float] = LENGTHS) -> _Parts:
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
    def of_points(cls, points: _Points) -> _Parts:
        """Compute the parts of each point with itself, ``(n,)``."""
        ones = np.ones(len(points.linear))
        linear = (points.linear**2).sum(axis=1) / max(points.linear.shape[1], 1)
        kin = (points.pairs**2).sum(axis=1) / max(points.pairs.shape[1], 1)
        return cls(linear, kin, dict.fromkeys(LENGTHS, ones), np.zeros(len(points.linear)))


@dataclass(frozen=True, slots=True)
class _Model:
    """Weights of the kernel; the values that it explains have mean 0 and variance 1."""

    linear: float  #: share of the linear part
    length: float  #: of the smooth part
    rough: float  #: share of the part that only points close by explain
    kin: float = 0.0  #: share of what coincidences explain
    degree: int = 1  #: of the linear part: 2 has products of two coordinates, too
    kind: int = -1  #: of object that alone explains it, but for the rough part; -1: all do

    def kernel(self, parts: _Parts, *, robust: bool = False) -> Array:
        """Compute covariances of results; with ``robust``, of results without the rough part."""
        linear = parts.linear if self.degree == 1 else 0.5 * (parts.linear + parts.linear**2)
        own = self.linear * linear + (1.0 - self.linear) * parts.smooth[self.length]
        far = (1.0 - self.rough) * ((1.0 - self.kin) * own + self.kin * parts.kin)
        if robust:
            return far
        return far + self.rough * np.exp(-parts.apart / (2.0 * CLOSE**2))

    def factor(self, inside: _Parts, noise: Array) -> Array:
        """Factor the covariance of results: lower Cholesky factor ``(n, n)``."""
        return np.asarray(np.linalg.cholesky(self.kernel(inside) + np.diag(NUGGET + noise)))

    def log_likelihood(self, inside: _Parts, margins: Sequence[_Margin]) -> Array:
        """Compute log marginal likelihoods ``(v,)`` of margins of one noise, up to constants."""
        lower = self.factor(inside, margins[0].noise)
        solved = solve_triangular(lower, _columns(margins), lower=True)
        likelihood: Array = -0.5 * (solved**2).sum(axis=0) - np.log(np.diag(lower)).sum()
        return likelihood

    def predict(
        self,
        inside: _Parts,
        across: _Parts,
        prior: _Parts,
        margins: Sequence[_Margin],
        *,
        robust: bool,
    ) -> tuple[Array, Array]:
        """Predict means ``(m, v)`` and standard deviations ``(m,)`` at the points asked about.

        Args:
            inside: parts between the results.
            across: parts between results and the points asked about.
            prior: parts of the latter with themselves.
            margins: those with these weights, v, all of one noise.
            robust: leave the rough part out of what is predicted.
        """
        solved = solve_triangular(
            self.factor(inside, margins[0].noise),
            np.column_stack([self.kernel(across, robust=robust), _columns(margins)]),
            lower=True,
        )
        points = len(prior.linear)
        shrunk, weights = solved[:, :points], solved[:, points:]
        variance = np.maximum(self.kernel(prior, robust=robust) - (shrunk**2).sum(axis=0), NUGGET)
        return shrunk.T @ weights, np.sqrt(variance)


DEFAULT = _Model(LINEAR[1], LENGTHS[0], ROUGHS[1])  # of a margin that has only begun to vary


class _Margin(NamedTuple):
    """A margin of n results, shifted and scaled to mean 0 and variance 1."""

    name: str
    values: Array  #: (n,)
    noise: Array  #: (n,) variances of the values
    centre: float
    scale: float


def _varying(results: Sequence[Feedback]) -> list[_Margin]:
    """Collect the margins of the specifications that tell results apart, in order of names."""
    margins = []
    for name in sorted({name for feedback in results for name in feedback.objectives}):
        told = np.array([feedback.objectives.get(name, 1.0) for feedback in results])
        if np.ptp(told) > SPARE:
            noise = np.array([feedback.noise.get(name, 0.0) for feedback in results])
            margins.append(_margin(name, told, noise))
    return margins


def _loads_of(results: Sequence[Feedback]) -> list[_Margin]:
    """Collect the loads that tell results apart."""
    nothing = np.zeros(len(results))
    told = {
        name: np.array([feedback.descriptors.get(name, 0.0) for feedback in results])
        for name in LOADS
    }
    return [_margin(name, of, nothing) for name, of in told.items() if np.ptp(of) > SPARE]


def _margin(name: str, told: Array, noise: Array) -> _Margin:
    """Shift and scale values ``(n,)`` with their variances ``(n,)``."""
    centre, scale = float(told.mean()), float(told.std())
    return _Margin(name, (told - centre) / scale, noise / scale**2, centre, scale)


def _grouped(margins: Iterable[_Margin], key: Callable[[_Margin], Hashable]) -> list[list[_Margin]]:
    """Put margins together that need one factor."""
    groups: dict[Hashable, list[_Margin]] = {}
    for margin in margins:
        groups.setdefault(key(margin), []).append(margin)
    return list(groups.values())


def _columns(margins: Sequence[_Margin]) -> Array:
    """Stack the values, ``(n, v)``."""
    return np.array([margin.values for margin in margins]).T


def _likeliest(
    inside: _Parts, of_kinds: Sequence[_Parts], margins: Sequence[_Margin]
) -> dict[str, _Model]:
    """Choose the model of largest marginal likelihood for each of margins of one noise."""
    kins = KINS if inside.kin.any() else KINS[:1]
    models = [
        _Model(*weights) for weights in itertools.product(LINEAR, LENGTHS, ROUGHS, kins, DEGREES)
    ]
    parts = [inside] * len(models)
    for kind, of_kind in enumerate(of_kinds):
        own = KINS if of_kind.kin.any() else KINS[:1]
        few = [
            _Model(linear, LENGTHS[0], rough, kin, kind=kind)
            for linear, rough, kin in itertools.product(LINEAR, ROUGHS, own)
        ]
        models += few
        parts += [of_kind] * len(few)
    likelihoods = np.array(
        [model.log_likelihood(of, margins) for model, of in zip(models, parts, strict=True)]
    )
    best = likelihoods.argmax(axis=0)
    return {margin.name: models[i] for margin, i in zip(margins, best, strict=True)}
