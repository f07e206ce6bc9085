"""A portfolio of samplers; those that find something get more of the budget."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mrta_falsify.core.candidate import Proposal
from mrta_falsify.core.codec import quantity
from mrta_falsify.core.feedback import Cube, Feedback
from mrta_falsify.core.protocols import Sampler, SkippingSampler
from samplers.asking import Counter
from samplers.cross_entropy import CrossEntropySampler
from samplers.evolution import EvolutionSampler
from samplers.local_search import LocalSearchSampler
from samplers.sobol import SobolSampler
from samplers.surrogate import SurrogateSampler

ARMS = ("surrogate", "evolution", "local_search", "cross_entropy", "sobol")
#: share that the model of all results has for certain: on smooth margins nothing comes near it
CERTAIN = {"surrogate": 0.65}


class AutoSampler:
    """A bandit over samplers that share all results.

    Each arm is told every result, also of other arms' proposals. An arm is rewarded for a new best
    score, and for a failure of a signature not seen before. Scores count by rank, so that their
    scale does not matter. Rewards fade, and every arm keeps a share. The first proposals come from
    an even spread.
    """

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Options:
        """Options of :class:`AutoSampler`."""

        cube: Cube = Cube()
        seed: int = quantity(low=0, default=0)
        initial: int = quantity(low=1, default=8)  #: proposals from the even spread at first
        floor: float = quantity(low=0.0, high=0.1, default=0.04)  #: least share of an arm
        fade: float = quantity(above=0.0, high=1.0, default=0.93)  #: of rewards, per result
        robust: bool = False  #: whether knife edges are not wanted

    def __init__(self, options: Options) -> None:
        self._options = options
        self._counter = Counter("auto", options.seed)
        cube, seed = options.cube, options.seed
        self._arms: dict[str, Sampler] = {
            "sobol": SobolSampler(SobolSampler.Options(cube=cube, seed=seed)),
            "evolution": EvolutionSampler(EvolutionSampler.Options(cube=cube, seed=seed)),
            "local_search": LocalSearchSampler(LocalSearchSampler.Options(cube=cube, seed=seed)),
            "cross_entropy": CrossEntropySampler(CrossEntropySampler.Options(cube=cube, seed=seed)),
            "surrogate": SurrogateSampler(
                SurrogateSampler.Options(
                    cube=cube, seed=seed, initial=2, explore=0.0, robust=options.robust
                )
            ),
        }
        self._reward = dict.fromkeys(ARMS, 1.0)
        self._cost = dict.fromkeys(ARMS, 1.0)
        self._by: dict[int, str] = {}
        self._scores: list[float] = []
        self._signatures: set[str] = set()

    def ask(self) -> Proposal:
        """Make the next proposal."""
        return self._counter.proposal(np.array(self._next_arm().ask().u))

    def skip(self) -> None:
        """See :class:`~mrta_falsify.core.protocols.SkippingSampler`."""
        arm = self._next_arm()
        if isinstance(arm, SkippingSampler):
            arm.skip()
        else:
            arm.ask()
        self._counter.next += 1

    def _next_arm(self) -> Sampler:
        """Choose the arm of the next proposal, and remember it."""
        name = self._choose()
        self._by[self._counter.next] = name
        return self._arms[name]

    def _choose(self) -> str:
        if self._counter.next < self._options.initial:
            return "sobol"
        value = np.array([self._reward[name] / self._cost[name] for name in ARMS])
        certain = np.array([CERTAIN.get(name, self._options.floor) for name in ARMS])
        share = certain + (1.0 - certain.sum()) * value / value.sum()
        return str(self._counter.stream().choice(ARMS, p=share / share.sum()))

    def tell(self, feedback: Feedback) -> None:
        """Tell all arms; reward the one that proposed it."""
        for name in ARMS:
            self._arms[name].tell(feedback)
        proposer = self._by.pop(feedback.number, None)
        reward = self._worth(feedback)
        for name in ARMS:
            self._reward[name] *= self._options.fade
            self._cost[name] *= self._options.fade
        if proposer is not None:
            self._reward[proposer] += reward
            self._cost[proposer] += 1.0

    def _worth(self, feedback: Feedback) -> float:
        if feedback.fate != "judged":
            return 0.0
        if feedback.failed and feedback.signature in self._signatures:
            return 0.0  # the same failure again
        known = np.array(self._scores)
        self._scores.append(feedback.score)
        better = float((known > feedback.score).mean()) if len(known) else 0.5
        reward = max(0.0, 4.0 * (better - 0.75))  # the best quarter, 0 to 1
        if feedback.failed:
            self._signatures.add(feedback.signature)
            reward += 2.0
        return reward
