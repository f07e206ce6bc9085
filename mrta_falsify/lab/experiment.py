"""What the lab is asked, and what it answers."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Literal, TypeAlias

from mrta_falsify.campaigns.statistics import failure_probability, one_sided_bounds
from mrta_falsify.core import codec
from mrta_falsify.core.config import StackConfig
from mrta_falsify.core.probability import Probability
from mrta_falsify.core.stack_failure import StackLimits
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.core.world import World
from mrta_falsify.lab.course import Course
from mrta_falsify.specs.library import default_specifications
from simulator_interface.external.transcript import Transcript

#: a run that could not be judged tells nothing; an *impossible* world cannot be run at all
Status: TypeAlias = Literal["judged", "not_judged", "impossible", "error"]
#: what a violation counts for: what a search looks for first, what only follows, none
Rank: TypeAlias = Literal["none", "secondary", "primary"]

BOUND = 0.9  #: with which each bound of a vote holds


@dataclass(frozen=True, slots=True, kw_only=True)
class Edit:
    """What is changed in a run, from a moment on."""

    at: float  #: [s]; the first tick not before it is the first that is changed
    stack: StackConfig | None = None  #: that takes over, None: the one that runs
    without: tuple[int, ...] = ()  #: robots that are taken away
    nudge: int = 0  #: number of a copy whose robots stand millimetres away, 0: they stay


@dataclass(frozen=True, slots=True, kw_only=True)
class Situation:
    """Robots that are at a place together."""

    robots: tuple[int, ...]
    place: tuple[float, float]  #: x, y [m], map frame
    reach: float  #: of each robot from the place [m]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Experiment:
    """One run of a world under a stack, with what is changed in it."""

    world: World
    stack: StackConfig
    specs: tuple[str, ...] = default_specifications()
    then: tuple[str, ...] = ()  #: specifications whose violation ends no run early
    early_stop: bool = True  #: ends 3 s after the first violation that is looked for
    #: ends once all of these tasks are; empty: with all. A run that is not forked goes on
    until_delivered: tuple[int, ...] = ()
    ends_late: bool = False  #: ends, too, once one of these is late, which decides it
    limits: StackLimits = StackLimits()
    perturbation: int = 0  #: number of the world's copy with small differences; 0: the world itself
    transcript: Transcript | None = None  #: what a stack outside has said; it is not asked
    edits: tuple[Edit, ...] = ()  #: by time
    situation: Situation | None = None  #: the result says when it came about
    with_course: bool = False  #: whether the result tells the course of a run that fails
    rules: int = 0  #: in whose form failures are signed; 0: today's

    def digest(self) -> str:
        """Hash every field but limits. The journal adds the code that is run."""
        fields = [f.name for f in dataclasses.fields(self) if f.name not in ("limits", "world")]
        return codec.digest([self.world.digest(), *(getattr(self, name) for name in fields)])

    @property
    def begins_at(self) -> float:
        """When the first thing is changed that cannot be changed before the run begins [s]."""
        return self.edits[0].at if self.edits else 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class RunResult:
    """What one experiment gave."""

    status: Status
    verdicts: tuple[Verdict, ...] = ()
    margins: dict[str, float] = dataclasses.field(default_factory=dict)
    signature: str = ""
    rank: Rank = "none"
    ended: str = ""  #: why
    detail: str = ""  #: why it could not be judged
    trace: str = ""  #: digest of its trace
    sim_time: float = 0.0  #: simulated [s]
    wall_s: float = 0.0  #: measured; never part of a digest
    met: float | None = None  #: when the situation came about [s]
    course: Course | None = None  #: of a run that fails

    @property
    def failed(self) -> bool:
        """Whether what is looked for first is violated."""
        return self.rank == "primary"


@dataclass(frozen=True, slots=True, kw_only=True)
class Vote:
    """What runs of a world with small differences say."""

    runs: int  #: that were judged
    failed: int  #: of them
    undecided: int = 0  #: runs beside these that tell nothing

    @property
    def robust(self) -> bool:
        """Whether more than half of the runs fail."""
        return 2 * self.failed > self.runs

    @property
    def knife_edge(self) -> bool:
        """Whether there are runs, and at least half of them pass."""
        return self.runs > 0 and not self.robust

    @property
    def chance(self) -> Probability:
        """How probably a run fails, with its 95 % interval."""
        return failure_probability(self.failed, self.runs, undecided=self.undecided)

    @property
    def bounds(self) -> tuple[float, float]:
        """Bounds of the chance of failure, each holding with 90 % (Clopper and Pearson 1934)."""
        return one_sided_bounds(self.failed, self.runs, undecided=self.undecided, level=BOUND)

    def add(self, *, failed: bool | None) -> Vote:
        """Count one more run; None: it tells nothing."""
        if failed is None:
            return dataclasses.replace(self, undecided=self.undecided + 1)
        return dataclasses.replace(self, runs=self.runs + 1, failed=self.failed + failed)
