"""The record of one trial: what a campaign stores."""

from __future__ import annotations

import functools
import importlib.metadata
import platform
from dataclasses import dataclass, field
from typing import Any, Literal

from mrta_falsify.core.candidate import Candidate
from mrta_falsify.core.codec import later
from mrta_falsify.core.external import Coupling
from mrta_falsify.core.probability import (
    Chance,
    Probability,
    chance_of_failure,
    interval_text,
)
from mrta_falsify.core.renamed import renamed_attribute
from mrta_falsify.core.tight_ways import TightWay
from mrta_falsify.core.verdict import Verdict

#: ok: simulated and judged; rejected: no scene; crashed, timeout: the toolkit failed
#: ``impossible``: no stack can keep the specifications in this world, so it was not run
Status = Literal["ok", "rejected", "impossible", "crashed", "timeout"]


@dataclass(frozen=True, slots=True, kw_only=True)
class PerturbedRuns:
    """What became of copies of a failing world with small differences."""

    runs: int
    failed: int  #: of them
    objectives: dict[str, float] = field(default_factory=dict)
    """Margins as copies tell them (:func:`mrta_falsify.perturbed_runs.expected_margin`)."""
    noise: dict[str, float] = later(dict)  #: variances of these, where above 0

    def __str__(self) -> str:
        """Write it as in ``3 of 4 copies with small differences fail too``."""
        return f"{self.failed} of {self.runs} copies with small differences fail too"

    @property
    def robust(self) -> bool:
        """Whether most copies fail too; a failure of few of them stands on a knife edge."""
        return 2 * self.failed > self.runs

    @property
    def chance(self) -> Chance:
        """Of failure among copies of this world."""
        return chance_of_failure(self.failed, self.runs)


@dataclass(frozen=True, slots=True, kw_only=True)
class EngineRun:
    """How a world fares on another engine than the one its verdicts come from."""

    engine: str
    failed: bool
    violated: tuple[str, ...] = ()  #: specifications
    trace_digest: str = ""
    sim_time: float = 0.0  #: [s]
    wall_s: float = 0.0
    #: copies of the world on that engine; not of a screening
    jittered: PerturbedRuns | None = later(None)

    @property
    def runs(self) -> int:
        """Runs of the world and its copies."""
        return 1 + (self.jittered.runs if self.jittered else 0)

    @property
    def failures(self) -> int:
        """Of the runs."""
        return int(self.failed) + (self.jittered.failed if self.jittered else 0)

    @property
    def fails(self) -> bool:
        """Whether most runs fail."""
        return 2 * self.failures > self.runs

    def __str__(self) -> str:
        """Write it as in ``mujoco 4 of 4``."""
        return f"{self.engine} {self.failures} of {self.runs}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Repeats:
    """What became of a failing world that was run again, nothing changed.

    The run that was found failing does not count: it is repeated because it failed.
    """

    same: Probability  #: of a failure with the same signature
    otherwise: int  #: runs that failed in another way
    identical: int  #: runs with the same trace digest

    def __str__(self) -> str:
        """Write it as in ``the same run fails again in 30 of 40 (95% interval 0.59 to 0.87)``."""
        same = self.same
        interval = interval_text(same.low, same.high, same.level)
        more = f"; it fails otherwise in {self.otherwise}" if self.otherwise else ""
        more += f"; {same.undecided} could not be judged" if same.undecided else ""
        return f"the same run fails again in {same.failures} of {self.runs} ({interval}){more}"

    @property
    def runs(self) -> int:
        """Runs again, those that could not be judged included."""
        return self.same.trials + self.same.undecided


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class OtherRun:
    """What the other stack did in a world in which the stack under test fails."""

    fate: Literal["passes", "fails", "not judged"]  #: in what the campaign looks for first
    score: float  #: smaller is closer to a violation, below 0 if it fails
    verdicts: tuple[Verdict, ...] = ()
    signature: str = ""  #: of its failure, empty if nothing is violated
    signature_before: str = later("")  #: the same, as of a trial
    #: the same copies as of the stack under test; None where they would decide nothing
    jittered: PerturbedRuns | None = None
    trace_file: str = ""  #: relative to the campaign directory, empty if not kept
    trace_digest: str = ""
    ended: str = ""  #: why the episode ended
    sim_time: float = 0.0  #: simulated, of the world itself [s]
    runs: int = 1  #: of the world and of copies
    wall_s: float = 0.0  #: measured, of all runs [s]

    def __str__(self) -> str:
        """Write it as in ``the other stack passes``."""
        if self.fate == "not judged":
            return "the other stack cannot be judged"
        return f"the other stack {self.fate}" + (f", too: {self.signature}" * (not self.passes))

    @property
    def passes(self) -> bool:
        """Whether it passes in the world itself."""
        return self.fate == "passes"

    @property
    def passes_most(self) -> bool:
        """Whether it passes in the world itself and in more than half of the copies."""
        copies = self.jittered
        return self.passes and copies is not None and 2 * copies.failed < copies.runs


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TrialRecord:
    """One trial, finished."""

    candidate: Candidate
    status: Status
    proposal_digest: str = ""  #: of the point the sampler asked for, before repair
    #: in the program's units, by dimension; None: no number; empty: not known
    values: tuple[float | None, ...] = later(())
    world_digest: str = ""
    verdicts: tuple[Verdict, ...] = ()  #: those that the executed part decides
    objectives: dict[str, float] = field(default_factory=dict)  #: see specs.objectives
    descriptors: dict[str, float] = field(default_factory=dict)
    situations: tuple[str, ...] = later(())  #: what happened, see specs.situations
    #: objects that took part when the run was nearest to a deadlock, or in its failure
    blamed: tuple[str, ...] = later(())
    uniform: bool = later(False)  #: proposed evenly from the whole cube, whatever had been found
    #: fails only in what the campaign looks for last
    is_afterthought: bool = later(False)
    score: float = 0.0  #: what the search minimises
    #: fails only because the world shut a place during the run: no failure of the stack
    is_shut: bool = later(False)
    signature: str = ""  #: of the failure mode, empty if nothing failed
    #: the same by the rules of campaigns that told no kinds apart (rules 1)
    signature_before: str = later("")
    layer: str = ""  #: suspected, empty if not attributed
    trace_file: str = ""  #: relative to the campaign directory, empty if not kept
    trace_digest: str = ""
    engine: str = ""  #: that the verdicts come from
    screening: EngineRun | None = None  #: on the quick engine, before physics was asked
    jittered: PerturbedRuns | None = None  #: of a failure, where the campaign asks for copies
    confirmed: tuple[EngineRun, ...] = later(())  #: of a robust failure, on other engines
    #: of a failure of a stack in a process of its own
    repeated: Repeats | None = later(None)
    #: of a failure that is looked for first, where the campaign compares two stacks
    other: OtherRun | None = later(None)
    coupling: Coupling | None = later(None)  #: of a stack in a process of its own
    ended: str = ""  #: why the episode ended
    sim_time: float = 0.0  #: simulated [s]
    scene_s: float = 0.0  #: measured time to sample the world [s]
    wall_s: float = 0.0  #: measured time to simulate and judge [s]
    attempts: int = 0  #: scenes tried until one was accepted
    versions: dict[str, str] = field(default_factory=dict)
    error: str = ""  #: for every status but ok: why
    #: ways that no robot fits through that may serve the task; where such worlds are simulated, of
    #: a judged one as well
    shut: tuple[TightWay, ...] = later(())
    notes: tuple[str, ...] = later(())  #: what is narrow in the world, and what is pushed in vain

    def __repr__(self) -> str:
        """Write it in one line."""
        what = self.signature or (self.error if self.status != "ok" else "violates nothing")
        return f"<TrialRecord {self.id}: {self.status}, score {self.score:+.3g}, {what}>"

    @property
    def number(self) -> int:
        """Position in the campaign, from 0."""
        return self.candidate.number

    @property
    def id(self) -> str:
        """Name of the trial in its campaign, as ``0042``."""
        return f"{self.number:04d}"

    @property
    def was_run(self) -> bool:
        """Whether there was a world to run, and one that a stack can do."""
        return self.status not in ("rejected", "impossible")

    @property
    def failed(self) -> bool:
        """Whether a specification was violated; an error is not a failure."""
        return any(verdict.violated for verdict in self.verdicts)

    @property
    def is_robust(self) -> bool:
        """Whether it counts for ``stop_after``: a primary failure that perturbed runs share.

        Not in what the campaign looks for last, and not by the world's doing; robust where it asks
        for perturbed runs. Where two stacks are compared, the other one passes in most of them.
        """
        is_shared = self.jittered is None or self.jittered.robust
        return self.is_primary and is_shared and (self.other is None or self.other.passes_most)

    def __getattr__(self, name: str) -> Any:
        names = {"wanted": "is_robust", "is_sought": "is_primary"}
        return renamed_attribute(self, name, names)

    @property
    def confirmation(self) -> str:
        """Write on how many of how many runs it fails on other engines, empty: not asked."""
        if not self.confirmed:
            return ""
        fails = [str(run) for run in self.confirmed if run.fails]
        holds = [str(run) for run in self.confirmed if not run.fails]
        parts = [f"fails on {', '.join(fails)}"] if fails else []
        parts += [f"not on {', '.join(holds)}"] if holds else []
        return "; ".join(parts)

    @property
    def is_primary(self) -> bool:
        """Whether it fails in what the campaign looks for first, robust or not.

        A place that the world shut is none. Where two stacks are compared, only if the other one
        passes in the world itself.
        """
        is_first = self.failed and not self.is_afterthought and not self.is_shut
        return is_first and (self.other is None or self.other.passes)

    @property
    def is_reported(self) -> bool:
        """Whether it is a failure, and not one that the other stack does not pass either."""
        return self.is_primary or self.is_afterthought or self.is_shut

    @property
    def fails_on_both(self) -> bool:
        """Whether the other stack fails in what the campaign looks for first, too."""
        return self.other is not None and self.other.fate == "fails"


@functools.cache
def _versions() -> tuple[tuple[str, str], ...]:
    names = (
        *("mrta-falsify", "scenic", "pybullet", "mujoco"),
        *("numpy", "scipy", "numba", "osqp", "ompl"),
    )
    found = {"python": platform.python_version(), "machine": platform.machine()}
    for name in names:
        try:
            found[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            found[name] = "absent"
    return tuple(found.items())


def versions() -> dict[str, str]:
    """List the versions and the machine type that a trace digest depends on."""
    return dict(_versions())
