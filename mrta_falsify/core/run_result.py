"""What one run gave, what a vote of perturbed runs says, and the course of a failing run."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal, TypeAlias

from mrta_falsify.core.codec import later
from mrta_falsify.core.difference import Difference
from mrta_falsify.core.errors import InputError
from mrta_falsify.core.external import Coupling
from mrta_falsify.core.probability import (
    Chance,
    Probability,
    chance_of_failure,
    failure_probability,
    one_sided_bounds,
)
from mrta_falsify.core.verdict import Verdict

#: a run that could not be judged tells nothing; an *impossible* world cannot be run at all; a run
#: that exceeded its time limit was killed
Status: TypeAlias = Literal["judged", "not_judged", "impossible", "error", "timeout"]
#: what a violation counts for: what a search looks for first, what only follows, none
Rank: TypeAlias = Literal["none", "secondary", "primary"]

BOUND = 0.9  #: with which each bound of a vote holds


@dataclass(frozen=True, slots=True, kw_only=True)
class TimedPose:
    """Where a robot was at a moment."""

    time: float  #: [s]
    pose: tuple[float, ...]  #: x [m], y [m], yaw [rad], map frame


@dataclass(frozen=True, slots=True, kw_only=True)
class Course:
    """What a failing run says about where it can be shortened."""

    found: float | None  #: time of the violation [s]
    had: dict[str, tuple[int, ...]]  #: tasks by the robot that had them last
    delivered: dict[str, tuple[TimedPose, ...]]  #: by robot, one for each of its deliveries
    rests: tuple[tuple[TimedPose, ...], ...]  #: of all robots when nothing was left to do


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
    engine: str = later("")  #: that it was run on, in records
    layer: str = later("")  #: suspected by rules on the trace, in records; empty: none
    trace_file: str = later("")  #: relative to the campaign directory, empty if not kept
    coupling: Coupling | None = later(None)  #: of a foreign stack
    #: first difference from the trace that the run is compared with
    difference: Difference | None = later(None)
    picture: str = later("")  #: file; empty: none was asked for, or the run does not fail

    def check_stored(self) -> None:
        """Refuse a failure that counts for nothing: readers would count it and not find it."""
        if self.rank == "none" and self.violated:
            raise InputError(f"rank is 'none', but {', '.join(self.violated)} is violated")

    @property
    def failed(self) -> bool:
        """Whether a primary specification is violated."""
        return self.rank == "primary"

    @property
    def violated(self) -> tuple[str, ...]:
        """Specifications that are violated."""
        return tuple(verdict.spec for verdict in self.verdicts if verdict.violated)


@dataclass(frozen=True, slots=True, kw_only=True)
class Vote:
    """What runs of a world with small differences say."""

    runs: int  #: perturbed runs that were judged
    failed: int  #: of them
    undecided: int = later(0)  #: further runs, which could not be judged

    def __str__(self) -> str:
        """Write it as in ``3 of 4 perturbed runs fail too``."""
        return f"{self.failed} of {self.runs} perturbed runs fail too"

    @property
    def robust(self) -> bool:
        """Whether more than half of the runs fail."""
        return 2 * self.failed > self.runs

    @property
    def knife_edge(self) -> bool:
        """Whether there are runs, and at least half of them pass."""
        return self.runs > 0 and not self.robust

    @property
    def most_pass(self) -> bool:
        """Whether more than half of the runs pass."""
        return 2 * self.failed < self.runs

    @property
    def posterior(self) -> Chance:
        """How probably a run fails, as what a search expects of it."""
        return chance_of_failure(self.failed, self.runs)

    @property
    def chance(self) -> Probability:
        """How probably a run fails, with its 95 % interval."""
        return failure_probability(self.failed, self.runs, undecided=self.undecided)

    @property
    def bounds(self) -> tuple[float, float]:
        """Bounds of the chance of failure, each holding with 90 % (Clopper and Pearson 1934)."""
        return one_sided_bounds(self.failed, self.runs, undecided=self.undecided, level=BOUND)

    def is_settled(self, most: int) -> bool:
        """Whether further runs, up to ``most``, cannot change whether more than half fail."""
        return 2 * self.failed > most or 2 * (self.runs - self.failed) >= most

    @staticmethod
    def of(fails: Iterable[bool | None]) -> Vote:
        """Count runs, each of which fails or not; None: it tells nothing."""
        vote = Vote(runs=0, failed=0)
        for failed in fails:
            vote = vote.add(failed=failed)
        return vote

    def add(self, *, failed: bool | None) -> Vote:
        """Count one more run; None: it tells nothing."""
        if failed is None:
            return dataclasses.replace(self, undecided=self.undecided + 1)
        return dataclasses.replace(self, runs=self.runs + 1, failed=self.failed + failed)
