"""Scenes that ask for much: the most demanding of many that were looked at is run."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from mrta_falsify.core.arrays import Array, BoolArray
from mrta_falsify.core.candidate import Proposal
from mrta_falsify.core.codec import quantity
from mrta_falsify.core.feedback import Cube, Feedback, SceneLoads
from mrta_falsify.core.protocols import Preflight
from mrta_falsify.core.seeding import stream
from samplers.asking import Counter, Mutator
from samplers.gathering import Gathering
from samplers.preflights import LEAST_SPREAD, Preflights, standardised

USUAL = 48  # scenes drawn evenly that say what is heavy
HEAVY = 0.9  # share of them that ask for less of what is heavy
EXTRA_LOAD_PROB = 0.03  # chance of each other demand to be driven up, too
NO_PARENT_PROB = 0.5  # chance that what was run has no children
WEIGHED = 0.75  # share of the proposals that are chosen, where somebody weighs scenes
CHOICE = 4  # scenes that one is chosen from
MIN_RESULTS_FOR_MODEL = 10  # results without which nobody can weigh a scene


class DemandingSampler:
    """Takes the demand that was heavy in fewest runs, and looks for a scene heavy in it.

    Nothing is learnt from how runs end; so it works from the first proposal, and where no margin
    leads. A third of the scenes it looks at are drawn evenly or gathered
    (:class:`~samplers.gathering.Gathering`), the others are children of the most demanding ones
    and of their children, now and then also of those that have been run. So all heavy tails are run
    about equally often, as novelty search visits what few have visited (Lehman and Stanley 2011).
    Without a preflight it draws evenly.

    Who learns from runs may weigh scenes (:meth:`weigh_by`). From the tenth result on three in four
    proposals are then the best of four scenes: this one, and three that are heavy in demands drawn
    by lot, the more likely the fewer runs they were heavy in.
    """

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Options:
        """Options of :class:`DemandingSampler`."""

        cube: Cube = Cube()
        seed: int = quantity(low=0, default=0)
        looked_at: int = quantity(low=2, default=48)  #: scenes for each heavy one
        memory: int = quantity(low=0, default=256)  #: results that count

    def __init__(self, options: Options) -> None:
        self._options = options
        self._counter = Counter("demanding", options.seed)
        self._gathering = Gathering(options.cube)
        self._mutator = Mutator(options.cube)
        self._preflights: Preflights | None = None
        self._weigh: Callable[[Array], Array] | None = None
        draws = stream(options.seed, "sampler/demanding/usual")
        self._usual = draws.random((USUAL, options.cube.dimensions))
        self._told: list[Array] = []

    def rehearse_by(self, preflight: Preflight) -> None:
        """See :class:`~mrta_falsify.core.protocols.PreflightSampler`."""
        self._preflights = Preflights.remembering(preflight)

    def weigh_by(self, promise: Callable[[Array], Array]) -> None:
        """Let ``promise`` of points ``(n, k)``, larger being better, choose among scenes."""
        self._weigh = promise

    def ask(self) -> Proposal:
        """Make the next proposal."""
        random = self._counter.stream()
        if self._preflights is None or not self._options.cube.dimensions:
            return self._counter.uniform(self._options.cube.dimensions)
        first = max(1, self._options.looked_at // 3)
        drawn = self._preflights.of(self._drawn(random, first))
        if not drawn:
            return self._counter.uniform(self._options.cube.dimensions)
        run = self._preflights.of(self._told)
        usual = _demands(self._preflights.of(self._usual) or drawn)
        among = np.vstack([usual, _demands(drawn), *(scene.demands for scene in run)])
        varies = np.ptp(among, axis=0) > LEAST_SPREAD
        heavy = _times_heavy(run, usual, among)
        best = [
            self._preflights.climb(
                drawn,
                functools.partial(_worth, weights=weights * varies, among=among),
                self._mutator,
                random=random,
                looks=self._options.looked_at - first,
                others=() if random.random() < NO_PARENT_PROB else run,
            )
            for weights in self._weights(random, heavy, varies)
        ]
        if self._weigh is None or len(best) == 1:
            return self._counter.proposal(best[0].u)
        points = np.array([scene.u for scene in best])
        return self._counter.proposal(points[int(np.argmax(self._weigh(points)))])

    def _weights(
        self, random: np.random.Generator, heavy: Array, varies: BoolArray
    ) -> Iterator[Array]:
        """Weigh one demand and few others ``(m,)``, once or for each scene of a choice.

        Args:
            random: decides between demands that were heavy equally often.
            heavy: runs in which each demand was heavy, ``(m,)``.
            varies: which demands do.
        """
        least = int(np.argmin(np.where(varies, heavy + random.random(len(heavy)), np.inf)))
        others = np.setdiff1d(np.flatnonzero(varies), least)
        has_model = self._weigh is not None and len(self._told) >= MIN_RESULTS_FOR_MODEL
        driven_up = [least]
        if has_model and len(others) and random.random() < WEIGHED:
            chances = 1.0 / (1.0 + heavy[others])
            count = min(CHOICE - 1, len(others))
            driven_up += list(random.choice(others, count, False, chances / chances.sum()))
        for demand in driven_up:
            weights = random.random(len(heavy)) * (random.random(len(heavy)) < EXTRA_LOAD_PROB)
            weights[demand] = 1.0
            yield weights

    def skip(self) -> None:
        """See :class:`~mrta_falsify.core.protocols.SkippingSampler`."""
        self._counter.next += 1

    def tell(self, feedback: Feedback) -> None:
        """Take in a scene, also one that another sampler proposed."""
        if feedback.fate == "judged":
            self._told.append(feedback.u)
            del self._told[: -self._options.memory or None]

    def _drawn(self, random: np.random.Generator, count: int) -> list[Array]:
        """Draw points evenly, and gather every other one."""
        points = random.random((count, self._options.cube.dimensions))
        return [
            self._gathering.gathered(u, random) if number % 2 else u
            for number, u in enumerate(points)
        ]


def _times_heavy(run: Sequence[SceneLoads], usual: Array, among: Array) -> Array:
    """Count the runs in which each demand was heavy, ``(m,)``.

    Args:
        run: scenes that were run.
        usual: demands of scenes drawn evenly, ``(a, m)``; more than most of them is heavy.
        among: demands of all that is known; as much as the most of it is heavy, too. Else a demand
            that many scenes bring to its most would be driven up for ever.
    """
    bounds, most = np.quantile(usual, HEAVY, axis=0), among.max(axis=0)
    heavy = np.zeros(len(most))
    for scene in run:
        heavy += (scene.demands > bounds) | (scene.demands >= most)
    return heavy


def _worth(scenes: Sequence[SceneLoads], *, weights: Array, among: Array) -> Array:
    """Weigh what scenes ask for, ``(n,)``, in deviations of what is known."""
    worth: Array = standardised(_demands(scenes), among) @ weights
    return worth


def _demands(scenes: Sequence[SceneLoads]) -> Array:
    """Stack what scenes ask for, ``(n, m)``."""
    return np.array([scene.demands for scene in scenes])
