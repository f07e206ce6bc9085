"""Search in the neighbourhood of the best scene so far."""

from __future__ import annotations

from dataclasses import dataclass

from mrta_falsify.core.candidate import Proposal
from mrta_falsify.core.codec import quantity
from mrta_falsify.core.feedback import Cube, Feedback
from samplers.asking import BestResults, Counter, Mutator, evenly_in_logarithm


class LocalSearchSampler:
    """Moves one object at a time about an anchor, ever less far.

    The anchor is the best scene told so far, failing or not. Around a failure this maps how
    far it reaches and finds failures of other signatures beside it; around a near miss it
    looks for the missing bit. When an anchor is used up, the next best one is taken.
    """

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Options:
        """Options of :class:`LocalSearchSampler`."""

        cube: Cube = Cube()
        seed: int = quantity(low=0, default=0)
        initial: int = quantity(low=1, default=8)  #: uniform proposals at first
        anchors: int = quantity(low=1, default=5)  #: scenes kept to search around
        tries: int = quantity(low=1, default=25)  #: results about an anchor, then the next
        widest: float = quantity(above=0.0, high=1.0, default=0.3)
        narrowest: float = quantity(above=0.0, high=1.0, default=0.01)

    def __init__(self, options: Options) -> None:
        self._options = options
        self._counter = Counter("local_search", options.seed)
        self._mutator = Mutator(options.cube, redraw=0.1, mean_blocks=1.2)
        self._memory = BestResults(options.anchors)

    def ask(self) -> Proposal:
        """Make the next proposal."""
        random = self._counter.stream()
        options, memory = self._options, self._memory
        if memory.told < options.initial or not memory.best:
            return self._counter.proposal(random.random(options.cube.dimensions))
        turn = memory.since_best // options.tries
        anchor = memory.best[min(turn, len(memory.best) - 1)]
        step = evenly_in_logarithm(random, options.narrowest, options.widest)
        return self._counter.proposal(
            self._mutator.child(anchor.u, step, random, blamed=anchor.blamed)
        )

    def tell(self, feedback: Feedback) -> None:
        """Take in a result, also of a point that another sampler proposed."""
        self._memory.add(feedback)
