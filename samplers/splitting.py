"""Multilevel splitting: the probability of violations too rare for independent trials."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.candidate import Proposal
from mrta_falsify.core.codec import quantity
from mrta_falsify.core.feedback import Cube, Estimates, Feedback
from mrta_falsify.core.seeding import stream
from samplers.asking import Counter, Mutator, evenly_in_logarithm

#: score and a uniform number that breaks ties; smaller is closer to a violation
Rank = tuple[float, float]
VIOLATED = float("-inf")  # score of every violation: they are all below every level
NARROWEST, WIDEST = 0.02, 0.5  # spread of small moves, drawn anew for each


@dataclass(frozen=True, slots=True, eq=False)
class ChainState:
    """A trial as a chain remembers it."""

    u: Array  #: (k,)
    rank: Rank

    @property
    def failed(self) -> bool:
        """Whether a specification was violated."""
        return self.rank[0] == VIOLATED


@dataclass(slots=True, eq=False)
class TrialChain:
    """A Metropolis chain over trials below a level; without a state, a uniform draw."""

    state: ChainState | None
    left: int  #: trials to go
    is_busy: bool = False  #: one of its trials is being run


@dataclass(slots=True, eq=False)
class LevelStage:
    """Chains that stay below one level, side by side."""

    level: Rank | None  #: None: everywhere, by uniform draws
    chains: list[TrialChain]
    population: list[ChainState] = field(default_factory=list)  #: state after each trial

    @property
    def is_done(self) -> bool:
        """Whether all trials are told."""
        return all(chain.left == 0 for chain in self.chains)

    def idle(self) -> TrialChain | None:
        """Find the chain that has most to do; None: all are waiting."""
        free = [chain for chain in self.chains if chain.left and not chain.is_busy]
        return max(free, key=lambda chain: chain.left) if free else None

    def take(self, chain: TrialChain, state: ChainState | None) -> None:
        """Take in how the trial of ``chain`` ended; None: outside the distribution."""
        chain.is_busy = False
        if chain.state is None or self.level is None:
            if state is None:
                return  # a uniform draw has to be made again
            chain.state = state
        elif state is not None and state.rank < self.level:
            chain.state = state
        chain.left -= 1
        self.population.append(chain.state)


@dataclass(slots=True, eq=False)
class SplittingRun:
    """One pass from uniform draws down to violations."""

    name: str  #: of its random numbers
    stage: LevelStage
    passed: int = 0  #: levels
    proposed: int = 0  #: trials
    probability: float = 1.0  #: product of the shares so far
    is_done: bool = False


class SplittingSampler:
    """Estimates the probability of a violation by fixed-level splitting, repeated.

    A violation of probability 1e-5 is a chain of likely events. The score falls below a level that
    a fifth of all trials reach, then, among those, below the next, and so on. Levels are
    chosen by a pilot run (subset simulation, Au and Beck 2001). Then ``repeats`` independent
    runs go down these fixed levels: uniform draws first; from those below a level, Metropolis
    chains that stay below it. The product of the shares that get below the next level is an
    unbiased estimate of the probability, whatever the chains' mixing. The reason is that levels
    are fixed and a chain's moves keep its distribution (Del Moral, Feynman-Kac Formulae, 2004;
    Cerou, Del Moral, Furon and Guyader 2012). The spread between runs gives the interval.

    The distribution is that of the campaign: u uniform among accepted scenes, and everything
    else by the trial's own seed, which each move draws anew. A scene that was not accepted at
    the proposed point is outside the distribution, and the chain stays where it is. A uniform
    number drawn with each trial breaks ties, so plateaus of the score cost efficiency only.

    All runs of a batch have equally many trials. A run that finds no trial below a level counts
    as 0 and spends its remaining trials on uniform draws. So what is found never decides how many
    trials there are.
    """

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Options:
        """Options of :class:`SplittingSampler`."""

        cube: Cube = Cube()
        seed: int = quantity(low=0, default=0)
        repeats: int = quantity(low=4, high=1000, default=10)  #: runs per batch
        chains: int = quantity(low=2, default=20)  #: of a run, at each level
        steps: int = quantity(low=1, default=5)  #: trials of a chain, at each level
        pilot: int = quantity(low=4, default=20)  #: chains of the pilot run
        share: float = quantity(above=0.0, high=0.5, default=0.2)  #: that gets below a level
        most_levels: int = quantity(low=1, high=100, default=15)

    def __init__(self, options: Options) -> None:
        self._options = options
        self._counter = Counter("splitting", options.seed)
        self._blocks = max(1, len(options.cube.blocks()))
        self._levels: tuple[Rank, ...] | None = None  # None: the pilot is looking for them
        self._pilot_levels: list[Rank] = []
        self._runs = [SplittingRun("pilot", _uniform_stage(options.pilot * options.steps))]
        self._batch = 0
        self._flying: dict[int, tuple[SplittingRun, TrialChain, ChainState]] = {}
        self._estimates: list[float] = []
        self._plain_trials = self._plain_failures = 0

    def ask(self) -> Proposal:
        """Make the next proposal; uniform and unused if all chains wait for results."""
        random = self._counter.stream()
        number, tie = self._counter.next, float(random.random())
        u = random.random(self._options.cube.dimensions)
        for run in sorted(self._runs, key=lambda run: run.proposed):
            chain = None if run.is_done else run.stage.idle()
            if chain is None:
                continue
            chain.is_busy = True
            run.proposed += 1
            if chain.state is not None:
                u = self._moved(chain.state.u, random)
            self._flying[number] = (run, chain, ChainState(u, (0.0, tie)))
            break
        return self._counter.proposal(u)

    def _moved(self, u: Array, random: np.random.Generator) -> Array:
        # Symmetric, hence reversible for the uniform distribution; nothing in it looks at u.
        count = evenly_in_logarithm(random, 1.0, self._blocks)
        step = evenly_in_logarithm(random, NARROWEST, WIDEST)
        return Mutator(self._options.cube, mean_blocks=count).child(u, step, random)

    def tell(self, feedback: Feedback) -> None:
        """Take in a result."""
        known = self._flying.pop(feedback.number, None)
        if known is None:
            return
        run, chain, proposed = known
        run.stage.take(chain, self._state(feedback, proposed, is_draw=chain.state is None))
        if run.stage.is_done:
            self._descend(run)

    def _state(
        self, feedback: Feedback, proposed: ChainState, *, is_draw: bool
    ) -> ChainState | None:
        """Turn the trial into a state; None if it is outside the distribution of the campaign."""
        if feedback.fate != "judged":
            return None
        if not is_draw and not np.array_equal(feedback.u, proposed.u):
            return None  # the scene asked for was not accepted, another one was run
        score = VIOLATED if feedback.failed else feedback.score
        return ChainState(np.array(feedback.u), (score, proposed.rank[1]))

    # --- levels ------------------------------------------------------------------------------

    def _descend(self, run: SplittingRun) -> None:
        """Move a run from a finished stage to the next one, or to its end."""
        population = run.stage.population
        if run.passed == 0:
            self._plain_trials += len(population)
            self._plain_failures += sum(state.failed for state in population)
        level = self._level_below(run)
        below = [s for s in population if s.failed or (level is not None and s.rank < level)]
        run.probability *= len(below) / len(population)
        if level is None:
            self._end(run)
            return
        run.passed += 1
        options = self._options
        count = options.pilot if self._levels is None else options.chains
        if not below or run.probability == 0.0:
            run.stage = _uniform_stage(count * options.steps)
            return
        name = f"sampler/splitting/{run.name}/{run.passed}"
        seeds = resample(below, count, stream(options.seed, name))
        run.stage = LevelStage(level, [TrialChain(state, options.steps) for state in seeds])

    def _level_below(self, run: SplittingRun) -> Rank | None:
        """Find the level that ends the stage of ``run``; None: violations end it."""
        if self._levels is not None:
            return self._levels[run.passed] if run.passed < len(self._levels) else None
        ranks = sorted(state.rank for state in run.stage.population)
        aim = max(1, round(self._options.share * len(ranks)))
        if ranks[aim - 1][0] == VIOLATED or len(self._pilot_levels) == self._options.most_levels:
            return None
        # The smallest rank that at least the wanted share is below; copies share a rank.
        above = [rank for rank in ranks if rank > ranks[aim - 1]]
        if not above:
            return None
        self._pilot_levels.append(above[0])
        return above[0]

    def _end(self, run: SplittingRun) -> None:
        run.is_done = True
        if self._levels is None:
            self._levels = tuple(self._pilot_levels)
        elif not all(other.is_done for other in self._runs):
            return
        else:
            self._estimates += [other.probability for other in self._runs]
            self._batch += 1
        size = self._options.chains * self._options.steps
        self._runs = [
            SplittingRun(f"{self._batch}/{i}", _uniform_stage(size))
            for i in range(self._options.repeats)
        ]

    # --- what comes of it --------------------------------------------------------------------

    def estimates(self) -> Estimates:
        """Give the estimates of the finished batches."""
        return Estimates(
            repeats=tuple(self._estimates),
            uniform_trials=self._plain_trials,
            uniform_failures=self._plain_failures,
            waiting_for=self._waiting_for(),
        )

    def _waiting_for(self) -> str:
        options = self._options
        if self._estimates:
            return ""
        if self._levels is None:
            return f"the pilot run is still looking for levels (it has {len(self._pilot_levels)})"
        trials = (len(self._levels) + 1) * options.chains * options.steps * options.repeats
        done = sum(run.proposed for run in self._runs)
        return f"about {max(trials - done, 1)} more trials are needed to finish the first batch"


def _uniform_stage(count: int) -> LevelStage:
    return LevelStage(None, [TrialChain(None, 1) for _ in range(count)])


def resample(
    states: Sequence[ChainState], count: int, random: np.random.Generator
) -> list[ChainState]:
    """Draw ``count`` of ``states``, each equally often up to one; the surplus ones at random."""
    whole, rest = divmod(count, len(states))
    extra = random.choice(len(states), size=rest, replace=False)
    return [*list(states) * whole, *(states[i] for i in sorted(extra))]
