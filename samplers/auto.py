"""A portfolio of samplers; those that find something get more of the budget."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np

from mrta_falsify.core.candidate import Proposal
from mrta_falsify.core.codec import quantity
from mrta_falsify.core.feedback import NEAR_DEADLOCK, Cube, Feedback
from mrta_falsify.core.protocols import Rehearsal, RehearsingSampler, Sampler, SkippingSampler
from samplers.asking import Counter
from samplers.coincidences import CoincidencesSampler
from samplers.cross_entropy import CrossEntropySampler
from samplers.demanding import DemandingSampler
from samplers.evolution import EvolutionSampler
from samplers.local_search import LocalSearchSampler
from samplers.rehearsals import Rehearsals
from samplers.situations import SituationsSampler
from samplers.surrogate import SurrogateSampler

#: share of proposals that the model of all results has: nothing comes near it on smooth margins
CERTAIN = 0.65
#: share that it has together with ``demanding`` where scenes can be rehearsed, and of that what
#: ``demanding`` has: it leads from the first proposal, but learns nothing
CERTAIN_REHEARSED = 0.75
DEMANDING_AT_FIRST, DEMANDING_LATER = 0.6, 0.1
EARLY = 20.0  # results
LOADS_SHARE = 0.5  # of what the model of all results proposes
SLOPE = 0.3  # of the score of a run that passes
LEAST = 0.05  # margin to a deadlock of a run without one
DEADLOCK = "no_deadlock"
DEMANDING = "demanding"


class AutoSampler:
    """A bandit over samplers that share all results.

    Each arm is told every result, also of other arms' proposals. An arm is rewarded for a new best
    score, for a failure of a signature not seen before, and for situations not seen before. Scores
    count by rank, so that their scale does not matter. Rewards fade, and every arm keeps a share.

    How near a run came to a deadlock is a margin of its own, and part of the score, so that there
    is a slope where no specification has one. Where no margin leads, loads are driven up, and
    coincidences are tried (:class:`~samplers.coincidences.CoincidencesSampler`). Where scenes can
    be rehearsed, those are tried that ask for much
    (:class:`~samplers.demanding.DemandingSampler`), and the model knows what scenes ask for.

    The first proposals are uniform, and so is one in five after them, whatever has been found: they
    say what a search cannot, how probable a failure is and how much is still unseen.
    """

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Options:
        """Options of :class:`AutoSampler`; the switches show what each part is worth."""

        cube: Cube = Cube()
        seed: int = quantity(low=0, default=0)
        initial: int = quantity(low=1, default=1)  #: uniform proposals at first
        uniform_every: int = quantity(low=0, default=5)  #: one in so many is uniform, 0: none
        floor: float = quantity(low=0.0, high=0.05, default=0.03)  #: least share of an arm
        fade: float = quantity(above=0.0, high=1.0, default=0.93)  #: of rewards, per result
        robust: bool = False  #: whether knife edges are not wanted
        slope: bool = True  #: whether how near a run came to a deadlock counts
        coverage: bool = True  #: whether new situations count
        blame: bool = True  #: whether children change first who took part
        loads: bool = True  #: whether loads are driven up
        kin: bool = True  #: whether coincidences are proposed and learnt
        rehearse: bool = True  #: whether scenes are looked at, where they can be

    def __init__(self, options: Options) -> None:
        self._options = options
        self._counter = Counter("auto", options.seed)
        cube, seed = options.cube, options.seed
        if not options.kin:
            cube = dataclasses.replace(cube, kin=())
        self._arms: dict[str, Sampler] = {
            "surrogate": SurrogateSampler(
                SurrogateSampler.Options(
                    cube=cube,
                    seed=seed,
                    initial=2,
                    explore=0.0,
                    robust=options.robust,
                    loads=LOADS_SHARE if options.loads else 0.0,
                )
            ),
            "evolution": EvolutionSampler(EvolutionSampler.Options(cube=cube, seed=seed)),
            "local_search": LocalSearchSampler(LocalSearchSampler.Options(cube=cube, seed=seed)),
            "cross_entropy": CrossEntropySampler(CrossEntropySampler.Options(cube=cube, seed=seed)),
        }
        if options.coverage:
            self._arms["situations"] = SituationsSampler(
                SituationsSampler.Options(cube=cube, seed=seed)
            )
        if cube.families():
            self._arms["coincidences"] = CoincidencesSampler(
                CoincidencesSampler.Options(cube=cube, seed=seed)
            )
        self._reward = dict.fromkeys(self._arms, 1.0)
        self._cost = dict.fromkeys(self._arms, 1.0)
        self._by: dict[int, str] = {}
        self._scores: list[float] = []
        self._signatures: set[str] = set()
        self._situations: set[str] = set()

    def rehearse_by(self, rehearsal: Rehearsal) -> None:
        """See :class:`~mrta_falsify.core.protocols.RehearsingSampler`."""
        if not self._options.rehearse:
            return
        cube, seed = self._options.cube, self._options.seed
        self._arms[DEMANDING] = DemandingSampler(DemandingSampler.Options(cube=cube, seed=seed))
        self._reward[DEMANDING] = self._cost[DEMANDING] = 1.0
        shared = Rehearsals(rehearsal)
        for arm in self._arms.values():
            if isinstance(arm, RehearsingSampler):
                arm.rehearse_by(shared)

    def ask(self) -> Proposal:
        """Make the next proposal."""
        if self._is_uniform():
            return self._counter.uniform(self._options.cube.dimensions)
        return self._counter.proposal(np.array(self._next_arm().ask().u))

    def skip(self) -> None:
        """See :class:`~mrta_falsify.core.protocols.SkippingSampler`."""
        if not self._is_uniform():
            arm = self._next_arm()
            if isinstance(arm, SkippingSampler):
                arm.skip()
            else:
                arm.ask()
        self._counter.next += 1

    def _is_uniform(self) -> bool:
        """Whether the next proposal is uniform; that hangs on its number alone."""
        number, every = self._counter.next, self._options.uniform_every
        return number < self._options.initial or (every > 0 and number % every == 0)

    def _next_arm(self) -> Sampler:
        """Choose the arm of the next proposal, and remember it."""
        names = list(self._arms)
        value = np.array([self._reward[name] / self._cost[name] for name in names])
        shares = self._certain_shares()
        certain = np.array([shares.get(name, self._options.floor) for name in names])
        share = certain + (1.0 - certain.sum()) * value / value.sum()
        name = str(self._counter.stream().choice(names, p=share / share.sum()))
        self._by[self._counter.next] = name
        return self._arms[name]

    def _certain_shares(self) -> dict[str, float]:
        """Say which share of proposals arms have for certain, by name."""
        if DEMANDING not in self._arms:
            return {"surrogate": CERTAIN}
        early = EARLY / (EARLY + len(self._scores))
        share = DEMANDING_LATER + (DEMANDING_AT_FIRST - DEMANDING_LATER) * early
        return {DEMANDING: share, "surrogate": CERTAIN_REHEARSED - share}

    def tell(self, feedback: Feedback) -> None:
        """Tell all arms; reward the one that proposed it."""
        feedback = self._seen_by_arms(feedback)
        for arm in self._arms.values():
            arm.tell(feedback)
        proposer = self._by.pop(feedback.number, None)
        reward = self._worth(feedback)
        for name in self._arms:
            self._reward[name] *= self._options.fade
            self._cost[name] *= self._options.fade
        if proposer is not None:
            self._reward[proposer] += reward
            self._cost[proposer] += 1.0

    def _seen_by_arms(self, feedback: Feedback) -> Feedback:
        """Add the margin to a deadlock, and leave out what is switched off."""
        if not self._options.blame:
            feedback = dataclasses.replace(feedback, blamed=())
        if not self._options.slope or feedback.fate != "judged":
            return feedback
        margin = max(1.0 - feedback.nearness, LEAST)
        known = feedback.objectives.get(DEADLOCK, margin)
        objectives = {**feedback.objectives, NEAR_DEADLOCK: min(margin, known)}
        noise = dict(feedback.noise)
        if known < margin and DEADLOCK in noise:
            noise[NEAR_DEADLOCK] = noise[DEADLOCK]
        score = feedback.score
        if not feedback.failed:
            score = (1.0 - SLOPE) * score + SLOPE * margin
        return dataclasses.replace(feedback, objectives=objectives, noise=noise, score=score)

    def _worth(self, feedback: Feedback) -> float:
        if feedback.fate != "judged":
            return 0.0
        new = set(feedback.situations) - self._situations
        self._situations |= new
        reward = 0.5 if new and self._options.coverage else 0.0
        if feedback.failed and feedback.signature in self._signatures:
            return reward  # the same failure again
        known = np.array(self._scores)
        self._scores.append(feedback.score)
        better = float((known > feedback.score).mean()) if len(known) else 0.5
        reward += max(0.0, 4.0 * (better - 0.75))  # the best quarter, 0 to 1
        if feedback.failed:
            self._signatures.add(feedback.signature)
            reward += 2.0
        return reward
