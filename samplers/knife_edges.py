"""Search about failures that most of their copies do not share, for one that most do."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mrta_falsify.core.arrays import Array, IntArray
from mrta_falsify.core.candidate import Proposal
from mrta_falsify.core.codec import quantity
from mrta_falsify.core.feedback import Cube, Feedback
from samplers.asking import Counter, reflect

STEPS = (0.02, 0.08)  # spread of moves of who took part, drawn evenly in its logarithm
BESIDE = 0.15  # distance along each coordinate of who took part, within which a result counts
PRIOR = 0.5  # of the Beta distribution of a chance of failure (Jeffreys)


class KnifeEdgesSampler:
    """Takes knife edges for what lies beside robust failures.

    A knife edge shows a place where the chance of failure is above none. What is known of that
    chance are the copies of the scene, and the results near by in all objects that took part. A
    chance is drawn from each such posterior, and the knife edge with the largest one has the next
    child (Thompson sampling, 1933). In a child who took part moves a little. In every other child
    half of the other objects are drawn anew: what stays then did not hang on them.

    A knife edge is left once a robust failure of its signature is known. While there is none to
    search about, proposals are uniform.
    """

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Options:
        """Options of :class:`KnifeEdgesSampler`."""

        cube: Cube = Cube()
        seed: int = quantity(low=0, default=0)
        memory: int = quantity(low=1, default=64)  #: knife edges kept, the last ones

    def __init__(self, options: Options) -> None:
        self._options = options
        self._counter = Counter("knife_edges", options.seed)
        self._blocks = options.cube.blocks()
        self._edges: list[_KnifeEdge] = []
        self._robust: set[str] = set()  # signatures

    @property
    def has_any(self) -> bool:
        """Whether there is a knife edge to search about."""
        return bool(self._edges)

    def ask(self) -> Proposal:
        """Make the next proposal."""
        if not self._edges:
            return self._counter.uniform(self._options.cube.dimensions)
        random = self._counter.stream()
        chances = [random.beta(PRIOR + edge.failed, PRIOR + edge.passed) for edge in self._edges]
        return self._counter.proposal(self._child(self._edges[int(np.argmax(chances))], random))

    def skip(self) -> None:
        """See :class:`~mrta_falsify.core.protocols.SkippingSampler`."""
        self._counter.next += 1

    def tell(self, feedback: Feedback) -> None:
        """Take in a result, also of a point that another sampler proposed."""
        if feedback.fate != "judged":
            return
        for edge in self._edges:
            if edge.is_near(feedback.u):
                edge.failed += feedback.failed
                edge.passed += not feedback.failed
        if feedback.failed and not feedback.is_knife_edge:
            self._robust.add(feedback.signature)
            self._edges = [edge for edge in self._edges if edge.signature not in self._robust]
        elif feedback.is_knife_edge and feedback.signature not in self._robust:
            self._edges.append(self._edge_of(feedback))
            del self._edges[: -self._options.memory]

    def _edge_of(self, feedback: Feedback) -> _KnifeEdge:
        """Make a knife edge of a result; where nobody is known to have taken part, all did."""
        part = sorted(feedback.blamed) or range(len(self._blocks))
        failed, runs = feedback.copies
        return _KnifeEdge(
            u=feedback.u,
            signature=feedback.signature,
            part=np.array([i for n in part for i in self._blocks[n]], dtype=np.int64),
            others=tuple(n for n in range(len(self._blocks)) if n not in part),
            failed=failed,
            passed=runs - failed,
        )

    def _child(self, edge: _KnifeEdge, random: np.random.Generator) -> Array:
        u = np.array(edge.u, dtype=np.float64)
        step = float(np.exp(random.uniform(*np.log(STEPS))))
        for i in edge.part:
            if self._options.cube.level(int(i)) == 0:
                u[i] = reflect(u[i] + float(random.normal(0.0, step)))
        if random.random() < 0.5:
            for n in edge.others:
                if random.random() < 0.5:
                    block = list(self._blocks[n])
                    u[block] = random.random(len(block))
        return u


@dataclass(slots=True)
class _KnifeEdge:
    """A failure that most of its copies do not share, and what is known of its chance."""

    u: Array  #: (k,)
    signature: str
    part: IntArray  #: coordinates of the objects that took part
    others: tuple[int, ...]  #: blocks of the other objects
    failed: int  #: copies, and results near by
    passed: int

    def is_near(self, u: Array) -> bool:
        """Whether a point ``(k,)`` is beside it in all that took part."""
        return bool((np.abs(u[self.part] - self.u[self.part]) <= BESIDE).all())
