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
    Probability,
    interval_text,
)
from mrta_falsify.core.renamed import Said, renamed_attribute
from mrta_falsify.core.run_result import Rank, RunResult, Vote
from mrta_falsify.core.tight_ways import TightWay
from mrta_falsify.core.verdict import Verdict

#: ok: simulated and judged; rejected: no scene; crashed, timeout: the toolkit failed
#: ``impossible``: no stack can keep the specifications in this world, so it was not run
Status = Literal["ok", "rejected", "impossible", "crashed", "timeout"]


@dataclass(frozen=True, slots=True, kw_only=True)
class PerturbedRuns(Vote):
    """What became of the perturbed runs of a failing world, margins included."""

    objectives: dict[str, float] = field(default_factory=dict)
    """Margins as copies tell them (:func:`mrta_falsify.perturbed_runs.expected_margin`)."""
    noise: dict[str, float] = later(dict)  #: variances of these, where above 0

    @staticmethod
    def vote(runs: PerturbedRuns | None) -> Vote | None:
        """Give the counts alone; None where no copies were run."""
        return Vote(runs=runs.runs, failed=runs.failed) if runs is not None else None


@dataclass(frozen=True, slots=True, kw_only=True)
class EngineRun:
    """How a world fares on another engine than the one its verdicts come from."""

    engine: str
    failed: bool
    violated: tuple[str, ...] = ()  #: specifications
    trace_digest: str = ""
    sim_time: float = 0.0  #: [s]
    wall_s: float = 0.0
    vote: Vote | None = later(None)  #: of perturbed runs on that engine; none for a screening

    @property
    def total(self) -> Vote:
        """The run of the world itself and its perturbed runs, as one vote."""
        vote = self.vote or Vote(runs=0, failed=0)
        return vote.add(failed=self.failed)

    def __str__(self) -> str:
        """Write it as in ``mujoco 4 of 4``."""
        return f"{self.engine} {self.total.failed} of {self.total.runs}"


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
        more = f"; it fails in another way in {self.otherwise}" if self.otherwise else ""
        more += f"; {same.undecided} could not be judged" if same.undecided else ""
        return f"the same run fails again in {same.failures} of {self.runs} ({interval}){more}"

    @property
    def runs(self) -> int:
        """Runs again, those that could not be judged included."""
        return self.same.trials + self.same.undecided


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class OtherRun:
    """What the other stack did in a world in which the stack under test fails."""

    fate: Literal["passes", "fails", "not judged"]  #: by primary specifications
    score: float  #: smaller is closer to a violation, below 0 if it fails
    verdicts: tuple[Verdict, ...] = ()
    signature: str = ""  #: of its failure, empty if nothing is violated
    signature_before: str = later("")  #: the same, as in a trial record
    #: the same perturbed runs; null where they would decide nothing
    jittered: PerturbedRuns | None = None
    trace_file: str = ""  #: relative to the campaign directory, empty if not kept
    trace_digest: str = ""
    ended: str = ""  #: why the episode ended
    sim_time: float = 0.0  #: simulated, of the world itself [s]
    runs: int = 1  #: of the world and its perturbed runs
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
        return self.passes and self.jittered is not None and self.jittered.most_pass


@dataclass(frozen=True, slots=True, kw_only=True)
class Origin:
    """Where the world of a trial comes from, and what was found before it was run."""

    proposal: str = later("")  #: digest of the point the sampler asked for, before repair
    uniform: bool = later(False)  #: proposed evenly from the whole cube, whatever had been found
    #: in the program's units, by dimension; None: no number; empty: not known
    values: tuple[float | None, ...] = later(())
    world: str = later("")  #: digest
    attempts: int = later(0)  #: scenes tried until one was accepted
    scene_s: float = later(0.0)  #: measured time to sample the world [s]
    #: ways that no robot fits through that may serve the task; where such worlds are simulated, of
    #: a judged one as well
    shut: tuple[TightWay, ...] = later(())
    notes: tuple[str, ...] = later(())  #: what is narrow in the world, and what is pushed in vain
    screening: EngineRun | None = later(None)  #: on the quick engine, before physics was asked
    versions: dict[str, str] = later(dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class SearchData:
    """What a sampler learns from a trial beside its result."""

    score: float = 0.0  #: what the search minimises
    descriptors: dict[str, float] = later(dict)
    situations: tuple[str, ...] = later(())  #: what happened, see specs.descriptors
    #: objects that took part when the run was nearest to a deadlock, or in its failure
    blamed: tuple[str, ...] = later(())
    #: margins near the world, as its perturbed runs tell (perturbed_runs.expected_margin)
    expected: dict[str, float] = later(dict)
    noise: dict[str, float] = later(dict)  #: variances of these, where above 0


#: status of a trial by that of its result
STATUS: dict[str, Status] = {
    "judged": "ok",
    "not_judged": "ok",
    "impossible": "impossible",
    "error": "crashed",
    "timeout": "timeout",
}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TrialRecord:
    """One trial, finished.

    What is asked of it most often can be read from it directly: ``record.verdicts`` is
    ``record.result.verdicts``, and empty where there is no result.
    """

    candidate: Candidate
    origin: Origin = Origin()
    result: RunResult | None = later(None)  #: None: no scene was accepted
    vote: Vote | None = later(None)  #: of perturbed runs of a failure, where the campaign asks
    repeats: Repeats | None = later(None)  #: of a failure of a foreign stack
    #: of a primary failure, where the campaign compares two stacks
    other: OtherRun | None = later(None)
    engines: dict[str, EngineRun] = later(dict)  #: others that a robust failure was run on, by name
    search: SearchData = later(SearchData())
    error: str = later("")  #: for every status but ok: why

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
    def status(self) -> Status:
        """What became of the trial as a whole."""
        return "rejected" if self.result is None else STATUS[self.result.status]

    @property
    def was_run(self) -> bool:
        """Whether there was a world to run, and one that a stack can do."""
        return self.status not in ("rejected", "impossible")

    @property
    def rank(self) -> Rank:
        """What its failure counts for; none where the other stack does not pass either."""
        if self.result is None or (self.other is not None and not self.other.passes):
            return "none"
        return self.result.rank

    @property
    def is_primary(self) -> bool:
        """Whether it fails in what the campaign looks for first, robust or not."""
        return self.rank == "primary"

    @property
    def is_robust(self) -> bool:
        """Whether it counts for ``stop_after``: a primary failure that perturbed runs share.

        Where two stacks are compared, the other one passes in most of them.
        """
        is_shared = self.vote is None or self.vote.robust
        return self.is_primary and is_shared and (self.other is None or self.other.passes_most)

    @property
    def failed(self) -> bool:
        """Whether a specification was violated; an error is not a failure."""
        return any(verdict.violated for verdict in self.verdicts)

    @property
    def verdicts(self) -> tuple[Verdict, ...]:
        """Those that the executed part decides."""
        return () if self.result is None else self.result.verdicts

    @property
    def margins(self) -> dict[str, float]:
        """Normalised margins by specification, see specs.objectives."""
        return {} if self.result is None else self.result.margins

    @property
    def coupling(self) -> Coupling | None:
        """Of a foreign stack to simulated time."""
        return None if self.result is None else self.result.coupling

    @property
    def signature(self) -> str:
        """Signature of the failure mode, empty if nothing failed."""
        return "" if self.result is None else self.result.signature

    @property
    def score(self) -> float:
        """What the search minimises."""
        return self.search.score

    @property
    def layer(self) -> str:
        """Suspected layer of the stack, empty if none is."""
        return "" if self.result is None else self.result.layer

    @property
    def engine(self) -> str:
        """Engine that the verdicts come from."""
        return "" if self.result is None else self.result.engine

    @property
    def trace_file(self) -> str:
        """Trace, relative to the campaign directory; empty if not kept."""
        return "" if self.result is None else self.result.trace_file

    @property
    def trace_digest(self) -> str:
        """Digest of the trace."""
        return "" if self.result is None else self.result.trace

    @property
    def ended(self) -> str:
        """Why the episode ended."""
        return "" if self.result is None else self.result.ended

    @property
    def sim_time(self) -> float:
        """Simulated time [s]."""
        return 0.0 if self.result is None else self.result.sim_time

    @property
    def wall_s(self) -> float:
        """Measured time to simulate and judge [s]."""
        return 0.0 if self.result is None else self.result.wall_s

    @property
    def world_digest(self) -> str:
        """Digest of the world."""
        return self.origin.world

    @property
    def confirmation(self) -> str:
        """Write on how many of how many runs it fails on other engines, empty: not asked."""
        fails = [str(run) for run in self.engines.values() if run.total.robust]
        holds = [str(run) for run in self.engines.values() if not run.total.robust]
        parts = [f"fails on {', '.join(fails)}"] if fails else []
        parts += [f"not on {', '.join(holds)}"] if holds else []
        return "; ".join(parts)

    def __getattr__(self, name: str) -> Any:
        return renamed_attribute(self, name, OLD_NAMES)


#: what campaigns of format 2 and their readers called parts of a record
OLD_NAMES: dict[str, str | Said] = {
    "wanted": "is_robust",
    "is_sought": "is_primary",
    "is_reported": ('rank != "none"', lambda record: record.rank != "none"),
    "is_afterthought": ('rank == "secondary"', lambda record: record.rank == "secondary"),
    "fails_on_both": (
        'other.fate == "fails"',
        lambda record: record.other is not None and record.other.fate == "fails",
    ),
    "confirmed": ("engines", lambda record: tuple(record.engines.values())),
    "jittered": "vote",
    "repeated": "repeats",
    "screening": "origin.screening",
    "proposal_digest": "origin.proposal",
    "uniform": "origin.uniform",
    "values": "origin.values",
    "attempts": "origin.attempts",
    "scene_s": "origin.scene_s",
    "shut": "origin.shut",
    "notes": "origin.notes",
    "versions": "origin.versions",
    "objectives": "margins",
    "descriptors": "search.descriptors",
    "situations": "search.situations",
    "blamed": "search.blamed",
}


@functools.cache
def _versions() -> tuple[tuple[str, str], ...]:
    names = (
        *("mrta-falsify", "scenic", "pybullet", "mujoco"),
        *("numpy", "scipy", "numba", "osqp", "ompl", "ortools"),
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
