"""Even draws, demanding scenes, and a model of all results: the sampler of campaigns."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

from mrta_falsify.core.candidate import Proposal
from mrta_falsify.core.codec import quantity
from mrta_falsify.core.feedback import Cube, Feedback
from mrta_falsify.core.protocols import Preflight
from samplers.asking import Counter
from samplers.demanding import DemandingSampler
from samplers.knife_edges import KnifeEdgesSampler
from samplers.preflights import Preflights
from samplers.surrogate import SurrogateSampler

DEMANDING = 0.8  # share of what is not uniform, where scenes can be rehearsed
BESIDE = 0.5  # share of what is not uniform, while a knife edge may have children
LOADS_SHARE = 0.5  # of what the model of all results proposes


class AutoSampler:
    """Draws one proposal in five evenly; the rest are demanding scenes and a model's.

    Where scenes can be rehearsed, four in five of the rest are scenes that ask for much
    (:class:`~samplers.demanding.DemandingSampler`): that leads from the first one, whatever the
    stack. Once there are results, a model of all of them
    (:class:`~samplers.surrogate.SurrogateSampler`) chooses three in four of these scenes. All other
    proposals are the model's own; it knows what scenes ask for, too.

    Where no margin leads, loads are driven up.

    While there is a knife edge that half of its copies share, half of all that is not uniform is a
    child of it (:class:`~samplers.knife_edges.KnifeEdgesSampler`).

    The first proposal is uniform, and so is one in five after it, whatever has been found: they
    say what a search cannot, how probable a failure is and how much is still unseen.
    """

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Options:
        """Options of :class:`AutoSampler`; each switch turns one part off, for ablations."""

        cube: Cube = Cube()
        seed: int = quantity(low=0, default=0)
        uniform_every: int = quantity(low=0, default=5)  #: one in so many is uniform, 0: none
        robust: bool = False  #: whether knife edges are not wanted
        loads: bool = True  #: whether loads are driven up
        kin: bool = True  #: whether coincidences are proposed and learnt
        rehearse: bool = True  #: whether scenes are looked at, where they can be
        weigh: bool = True  #: whether the model chooses among demanding scenes
        edges: bool = True  #: whether knife edges have children

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
        self._knife_edges = KnifeEdgesSampler(
            KnifeEdgesSampler.Options(cube=options.cube, seed=options.seed)
        )

    def rehearse_by(self, preflight: Preflight) -> None:
        """See :class:`~mrta_falsify.core.protocols.PreflightSampler`."""
        if self._options.rehearse:
            shared = Preflights(preflight)
            self._model.rehearse_by(shared)
            self._demanding = DemandingSampler(self._of_demanding)
            self._demanding.rehearse_by(shared)
            if self._options.weigh:
                self._demanding.weigh_by(self._model.promise)

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
        self._model.tell(feedback)
        self._knife_edges.tell(feedback)
        if self._demanding is not None:
            self._demanding.tell(feedback)

    def _is_uniform(self) -> bool:
        """Whether the next proposal is uniform; that hangs on its number alone."""
        every = self._options.uniform_every
        return every > 0 and self._counter.next % every == 0

    def _next(self) -> DemandingSampler | KnifeEdgesSampler | SurrogateSampler:
        """Choose whose the next proposal is."""
        random = self._counter.stream()
        whose = random.random()
        if self._options.edges and self._knife_edges.has_any and random.random() < BESIDE:
            return self._knife_edges
        if self._demanding is not None and whose < DEMANDING:
            return self._demanding
        return self._model
