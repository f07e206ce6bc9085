"""What is found out about a stored failure: why it happens, how small it gets, what is proved.

Each value is kept in a file of its own beside the trial
(:mod:`mrta_falsify.campaigns.finding_files`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Literal, TypeAlias

from mrta_falsify.core import codec
from mrta_falsify.core.codec import later
from mrta_falsify.core.difference import Difference
from mrta_falsify.core.inevitability import Inevitability
from mrta_falsify.core.record import OtherRun, PerturbedRuns
from mrta_falsify.core.run_result import Vote
from mrta_falsify.core.verdict import Verdict

# --- why it happens ----------------------------------------------------------------------


@dataclass(frozen=True, slots=True, kw_only=True)
class Counterfactual:
    """What became of a failure in a continuation with one layer of the stack changed."""

    layer: str  #: that was replaced
    change: str  #: in words
    failure_gone: bool
    detail: str = ""  #: how the continuation ended
    restores: bool = False  #: whether the shipped layer replaced another one
    answered: bool = later(True)  #: False: the run could not be judged, so it tells nothing


@dataclass(frozen=True, slots=True, kw_only=True)
class LayerRow:
    """What became of a failure in perturbed runs of its world, with one layer exchanged.

    ``mrta_falsify/analysis/explain/rows.py`` says what counts as what.
    """

    layer: str  #: layer that was exchanged; empty: the stack as it is
    change: str  #: in words
    at: float  #: when it was exchanged [s]
    runs: int  #: runs that came to the situation and failed or passed
    failed: int  #: those of ``runs`` that failed
    otherwise: int = 0  #: runs beside these that failed in another way
    avoided: int = 0  #: runs beside these that never came to the situation
    unknown: int = 0  #: runs beside these that could not be judged
    restores: bool = False  #: whether the shipped layer replaced another one

    @property
    def copies(self) -> int:
        """All runs."""
        return self.runs + self.otherwise + self.avoided + self.unknown

    @property
    def beside(self) -> str:
        """What became of the runs that neither failed in the same way nor passed, in words."""
        counts = (
            (self.otherwise, "fails in another way"),
            (self.avoided, "avoids the situation"),
            (self.unknown, "could not be judged"),
        )
        return ", ".join(f"{what} in {count}" for count, what in counts if count)


#: what became of a failure: gone; there again; the same specification violated in another way; the
#: run could not be judged, or the world is not valid; there were no runs left
Fate: TypeAlias = Literal["gone", "stays", "otherwise", "unknown", "untried"]


@dataclass(frozen=True, slots=True, kw_only=True)
class ChangedRun:
    """What became of a failure in runs of the whole world with one thing changed."""

    group: str  #: kind of the things left out, such as ``robots`` or ``humans``; or ``schedule``
    things: tuple[str, ...] = ()  #: names of what was left out
    change: str  #: in words, behind ``without`` or ``with``
    fate: Fate  #: ``otherwise``: it failed in another way; ``unknown``: not judged
    detail: str = ""  #: how the run ended; of a vote, its counts
    #: runs in which it fails, of the world and its perturbed copies; null: of one run, or no answer
    vote: Vote | None = later(None)


@dataclass(frozen=True, slots=True, kw_only=True)
class Removal:
    """What became of the other robots when one robot of a deadlock was taken away."""

    robot: str
    time: float  #: of the removal [s]
    go_on: tuple[str, ...] = ()  #: robots that drive on
    stay: tuple[str, ...] = ()  #: robots that still stand


@dataclass(frozen=True, slots=True, kw_only=True)
class Explanation:
    """Why a failure happens, as far as re-runs can tell."""

    layer: str  #: suspected layer; empty: no single layer
    guess: str  #: layer that rules suspect from the trace alone
    reason: str  #: why this layer is suspected
    changed_at: float  #: when layers were exchanged [s]
    #: of explanations by earlier versions, without ``rows``
    counterfactuals: tuple[Counterfactual, ...]
    jittered: Vote  #: perturbed runs of the stack as it is
    runs: int  #: simulations spent
    removals: tuple[Removal, ...] = ()  #: one for each robot of a deadlock
    absences: tuple[ChangedRun, ...] = later(())  #: runs without some things
    schedules: tuple[ChangedRun, ...] = later(())  #: runs with other thinking times and orders
    #: the stack as it is, then with one layer exchanged; from shortly before the onset, or from the
    #: start where that decides nothing
    rows: tuple[LayerRow, ...] = later(())
    #: when the failure was decided; null: it was not determined
    inevitability: Inevitability | None = later(None)

    def __repr__(self) -> str:
        """Write it in one line."""
        return f"<Explanation: layer {self.layer or 'none'}, {self.reason}; {self.runs} runs>"


# --- how small it gets -------------------------------------------------------------------


@dataclass(frozen=True, slots=True, kw_only=True)
class Minimisation:
    """The smallest world that still fails in the same way, compared with the original."""

    DERIVED: ClassVar[tuple[str, ...]] = ("share_removed",)

    signature: str
    removed: tuple[str, ...]  #: what was removed, in words
    runs: int  #: simulations, those of earlier calls included
    one_minimal: bool  #: no single thing more can go; false: the runs did not suffice to say so
    counts: dict[str, tuple[int, int]]  #: things before and after, by group
    world_digest: str
    trace_digest: str
    verdicts: tuple[Verdict, ...]  #: violated by the smallest world
    program: str = ""
    """How the world written as a Scenic program runs: ``identical``, ``same failure``, or why
    there is no program."""
    jittered: PerturbedRuns | None = later(None)  #: perturbed runs of the smallest world
    pairs: int = later(0)  #: pairs of things that are left
    pairs_tried: int = later(0)  #: pairs without which it was run
    pairs_unsure: int = later(0)  #: pairs without which it fails, but most perturbed runs pass
    other: OtherRun | None = later(None)  #: what the other stack does in it, with ``--against``

    def __repr__(self) -> str:
        """Write it in one line."""
        before, after = (sum(pair[k] for pair in self.counts.values()) for k in (0, 1))
        return f"<Minimisation {self.signature}: {before} to {after} things, {self.runs} runs>"

    @property
    def share_removed(self) -> float:
        """Share of robots, people, furniture, tasks and events that were removed."""
        before = sum(pair[0] for pair in self.counts.values())
        after = sum(pair[1] for pair in self.counts.values())
        return 1.0 - after / before if before else 0.0


# --- what is proved -----------------------------------------------------------------------


@dataclass(frozen=True, slots=True, kw_only=True)
class Standing:
    """A robot that stands, and is not going to move on its own."""

    name: str
    pose: tuple[float, float]  #: x, y [m]


@dataclass(frozen=True, slots=True, kw_only=True)
class CertifiedMember(Standing):
    """A member of a certified deadlock, and why it stands."""

    goal: tuple[float, float]  #: x, y [m]
    area: str  #: resource that ``robots`` fill; empty: they cut the member off from its goal
    robots: tuple[str, ...]  #: members and robots at rest; empty: solids alone are in the way


@dataclass(frozen=True, slots=True, kw_only=True)
class Certificate:
    """A closed circle of waits that follows from a trial's World and trace.

    ``mrta_falsify/analysis/certify/checker.py`` says what it claims, and checks it.
    """

    world: str  #: digest
    trace: str  #: digest
    read: str  #: sha256 of the columns of the trace that the claim rests on
    since: float  #: when the last of its robots came to rest [s]
    until: float  #: end of the trace [s]
    members: tuple[CertifiedMember, ...]
    resting: tuple[Standing, ...] = ()  #: robots without work that take part
    digest: str = ""  #: of all that is above


# --- whether it happens again ------------------------------------------------------------


@dataclass(frozen=True, slots=True, kw_only=True)
class ReplayCheck:
    """Replays of a trial, compared with its record."""

    runs: int
    identical: int  #: runs with the recorded trace digest
    #: runs that violate the same specifications; at the same times, too, if the version is the same
    same_verdicts: int
    same_machine: bool  #: whether versions and machine type are the recorded ones
    first_difference: Difference | None = None  #: of the first other run from the stored trace


RecheckFate: TypeAlias = Literal["fixed", "still failing", "flaky", "timeout", "not judged"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Recheck:
    """What became of a stored failure on a changed stack.

    It is *still failing* if its world fails. It is *flaky* if only jittered copies fail: the
    change has moved the failure instead of removing it. It is a *timeout* if nothing failed, but
    a run exceeded its time limit. It is *not judged* if nothing failed, but what failed before
    could not be judged, because the changed stack does not tell enough. Otherwise it is *fixed*.
    """

    id: str
    fate: RecheckFate
    signature: str  #: of the stored failure
    violated: tuple[str, ...]  #: specifications violated by the stored world on the changed stack
    signature_now: str  #: of the run on the changed stack
    jittered_failures: int  #: perturbed runs that fail
    jittered: int  #: perturbed runs
    sentence: str = later("")  #: what happens on the changed stack
    copy_signatures: tuple[str, ...] = later(())  #: of the perturbed runs that fail
    picture: str = later("")  #: file of the run that ``sentence`` is about (``--pictures``)
    kind_now: str = later("")  #: deadlock, stuck or shut
    #: signature of the run by today's rules, and by rules 1
    forms_now: tuple[str, str] = later(("", ""))


# --- as data -----------------------------------------------------------------------------

Finding: TypeAlias = Explanation | Minimisation | ReplayCheck | Certificate


def finding_data(finding: Finding) -> dict[str, Any]:
    """Encode a finding as JSON-shaped data, together with what follows from its fields."""
    derived = {name: codec.encode(getattr(finding, name)) for name in derived_names(type(finding))}
    return {**codec.encode(finding), **derived}


def derived_names(kind: type[Finding]) -> tuple[str, ...]:
    """Names of the properties that :func:`finding_data` adds to the fields of ``kind``."""
    names: tuple[str, ...] = getattr(kind, "DERIVED", ())
    return names
