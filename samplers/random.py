"""Independent uniform sampling: the baseline of every other sampler."""

from __future__ import annotations

from dataclasses import dataclass

from mrta_falsify.core.candidate import Proposal
from mrta_falsify.core.codec import quantity
from mrta_falsify.core.feedback import Cube, Feedback
from mrta_falsify.core.seeding import stream


class RandomSampler:
    """Proposes independent uniform points; learns nothing.

    Each proposal has a random stream of its own, so proposal n is the same however many
    were asked for before, by whom, or in which process.
    """

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Options:
        """Options of :class:`RandomSampler`."""

        cube: Cube = Cube()
        seed: int = quantity(low=0, default=0)  #: of the campaign

    def __init__(self, options: Options) -> None:
        self._options = options
        self._next = 0

    def ask(self) -> Proposal:
        """Make the next proposal, ``u`` of shape ``(k,)``, uniform in [0, 1)."""
        number = self._next
        self._next += 1
        random = stream(self._options.seed, f"sampler/random/{number}")
        u = random.random(self._options.cube.dimensions)
        u.setflags(write=False)
        return Proposal(number=number, u=u, uniform=True)

    def tell(self, feedback: Feedback) -> None:
        """Ignored: the next proposal does not depend on any score."""
