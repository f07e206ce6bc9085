"""Children of failures that half of their copies share: one of them may be robust."""

from __future__ import annotations

from dataclasses import dataclass

from mrta_falsify.core.candidate import Proposal
from mrta_falsify.core.codec import quantity
from mrta_falsify.core.feedback import Cube, Feedback
from samplers.asking import Counter, Mutator, evenly_in_logarithm

STEPS = (0.01, 0.2)  # spread of small moves of a child
HALF = 0.05  # score of a knife edge, at most: about half of its copies fail
CHILDREN = 6  # of each knife edge


@dataclass(slots=True)
class _Parent:
    """A knife edge, and how many children it has."""

    edge: Feedback
    children: int = 0


class KnifeEdgesSampler:
    """Gives knife edges that about half of their copies share a few children each.

    Few knife edges lie beside a robust failure; those whose chance of failure is nearly that of
    one do. A child whose chance is as high has children, too: so the chance is climbed. The knife
    edge with the fewest children has the next one, the latest of several. It is left once a robust
    failure of its mode is known. While there is none, proposals are uniform.
    """

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Options:
        """Options of :class:`KnifeEdgesSampler`."""

        cube: Cube = Cube()
        seed: int = quantity(low=0, default=0)

    def __init__(self, options: Options) -> None:
        self._dimensions = options.cube.dimensions
        self._counter = Counter("knife_edges", options.seed)
        self._mutator = Mutator(options.cube)
        self._parents: list[_Parent] = []  # from the latest to the first
        self._robust: set[str] = set()  # modes

    @property
    def has_any(self) -> bool:
        """Whether a knife edge may have one more child."""
        return any(parent.children < CHILDREN for parent in self._parents)

    def ask(self) -> Proposal:
        """Make the next proposal."""
        if not self._parents:
            return self._counter.uniform(self._dimensions)
        random = self._counter.stream()
        step = evenly_in_logarithm(random, *STEPS)
        return self._counter.proposal(self._mutator.child(self._next_parent().u, step, random))

    def skip(self) -> None:
        """See :class:`~mrta_falsify.core.protocols.SkippingSampler`."""
        if self._parents:
            self._next_parent()
        self._counter.next += 1

    def tell(self, feedback: Feedback) -> None:
        """Take in a result, also of a point that another sampler proposed."""
        if not feedback.failed:
            return
        if feedback.score < 0.0:
            self._robust.add(feedback.mode)
            self._parents = [p for p in self._parents if p.edge.mode not in self._robust]
        elif feedback.score <= HALF and feedback.mode not in self._robust:
            self._parents.insert(0, _Parent(feedback))

    def _next_parent(self) -> Feedback:
        """Choose whose the next child is, and count it."""
        parent = min(self._parents, key=lambda of: of.children)
        parent.children += 1
        return parent.edge
