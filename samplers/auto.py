"""Even draws, demanding scenes, and a model of all results: the sampler of campaigns."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

from mrta_falsify.core.candidate import Proposal
from mrta_falsify.core.codec import quantity
from mrta_falsify.core.feedback import NEAR_DEADLOCK, Cube, Feedback
from mrta_falsify.core.protocols import Rehearsal
from samplers.asking import Counter
from samplers.demanding import DemandingSampler
from samplers.rehearsals import Rehearsals
from samplers.surrogate import SurrogateSampler

DEMANDING = 0.5  # share of what is not uniform, where scenes can be rehearsed
LOADS_SHARE = 0.5  # of what the model of all results proposes
SLOPE = 0.3  # of the score of a run that passes
LEAST = 0.05  # margin to a deadlock of a run without one
DEADLOCK = "no_deadlock"


class AutoSampler:
    """Draws one proposal in five evenly; ``demanding`` and a model have half of the rest each.

    Where scenes can be rehearsed, half of the proposals are scenes that ask for much
    (:class:`~samplers.demanding.DemandingSampler`): that leads from the first one, whatever the
    stack, but learns nothing. All others are of the model of all results
    (:class:`~samplers.surrogate.SurrogateSampler`), which knows what scenes ask for, too.

    How near a run came to a deadlock is a margin of its own, and part of the score, so that there
    is a slope where no specification has one. Where no margin leads, loads are driven up.

    The first proposal is uniform, and so is one in five after it, whatever has been found: they
    say what a search cannot, how probable a failure is and how much is still unseen.
    """

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Options:
        """Options of :class:`AutoSampler`; the switches show what each part is worth."""

        cube: Cube = Cube()
        seed: int = quantity(low=0, default=0)
        uniform_every: int = quantity(low=0, default=5)  #: one in so many is uniform, 0: none
        robust: bool = False  #: whether knife edges are not wanted
        slope: bool = True  #: whether how near a run came to a deadlock counts
        blame: bool = True  #: whether children change first who took part
        loads: bool = True  #: whether loads are driven up
        kin: bool = True  #: whether coincidences are proposed and learnt
        rehearse: bool = True  #: whether scenes are looked at, where they can be

    def __init__(self, options: Options) -> None:
        self._options = options
        self._counter = Counter("auto", options.seed)
        cube = options.cube if options.kin else dataclasses.replace(options.cube, kin=())
        self._model = SurrogateSampler(
            SurrogateSampler.Options(
                cube=cube,
                seed=options.seed,
                initial=2,
                explore=0.0,
                robust=options.robust,
                loads=LOADS_SHARE if options.loads else 0.0,
            )
        )
        self._demanding: DemandingSampler | None = None  # where scenes can be rehearsed
        self._of_demanding = DemandingSampler.Options(cube=cube, seed=options.seed)

    def rehearse_by(self, rehearsal: Rehearsal) -> None:
        """See :class:`~mrta_falsify.core.protocols.RehearsingSampler`."""
        if self._options.rehearse:
            shared = Rehearsals(rehearsal)
            self._model.rehearse_by(shared)
            self._demanding = DemandingSampler(self._of_demanding)
            self._demanding.rehearse_by(shared)

    def ask(self) -> Proposal:
        """Make the next proposal."""
        if self._is_uniform():
            return self._counter.uniform(self._options.cube.dimensions)
        return self._counter.proposal(self._next().ask().u)

    def skip(self) -> None:
        """See :class:`~mrta_falsify.core.protocols.SkippingSampler`."""
        if not self._is_uniform():
            self._next().skip()
        self._counter.next += 1

    def tell(self, feedback: Feedback) -> None:
        """Take in a result, also of an even draw."""
        feedback = self._seen(feedback)
        self._model.tell(feedback)
        if self._demanding is not None:
            self._demanding.tell(feedback)

    def _is_uniform(self) -> bool:
        """Whether the next proposal is uniform; that hangs on its number alone."""
        every = self._options.uniform_every
        return every > 0 and self._counter.next % every == 0

    def _next(self) -> DemandingSampler | SurrogateSampler:
        """Choose whose the next proposal is."""
        if self._demanding is not None and self._counter.stream().random() < DEMANDING:
            return self._demanding
        return self._model

    def _seen(self, feedback: Feedback) -> Feedback:
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
