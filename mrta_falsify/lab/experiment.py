"""What the lab is asked, and what it answers."""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

from mrta_falsify.core import codec
from mrta_falsify.core.candidate import Candidate
from mrta_falsify.core.config import StackConfig
from mrta_falsify.core.errors import HarnessError, InputError
from mrta_falsify.core.run_result import RunResult
from mrta_falsify.core.stack_failure import StackLimits
from mrta_falsify.core.world import World
from mrta_falsify.specs.library import default_specifications, vote_specifications
from simulator_interface.external.transcript import Transcript


@dataclass(frozen=True, slots=True, kw_only=True)
class Edit:
    """What is changed in a run, from a moment on."""

    at: float  #: [s]; the first tick not before it is the first that is changed
    stack: StackConfig | None = None  #: that takes over, None: the one that runs
    without: tuple[int, ...] = ()  #: robots that are taken away
    without_people: tuple[int, ...] = ()  #: people who leave
    nudge: int = 0  #: number of a copy whose robots stand millimetres away, 0: they stay


@dataclass(frozen=True, slots=True, kw_only=True)
class Situation:
    """Robots that are at a place together."""

    robots: tuple[int, ...]
    place: tuple[float, float]  #: x, y [m], map frame
    reach: float  #: of each robot from the place [m]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SceneSource:
    """The Scenic scene that a scripted world cannot do without, as what it is drawn from."""

    program: str  #: shipped name or path
    params: dict[str, Any]  #: Scenic's global parameters
    sources_digest: str  #: of the program with all it imports; empty: not checked
    candidate: Candidate
    mode: Literal["repair", "exact"] = "repair"  #: how the scene was accepted


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class KeptTrace:
    """A stored trace that a run is compared with."""

    file: str
    digest: str


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
    transcript: Transcript | None = None  #: what a foreign stack has said; it is not asked
    edits: tuple[Edit, ...] = ()  #: by time
    situation: Situation | None = None  #: the result says when it came about
    with_course: bool = False  #: whether the result tells the course of a run that fails
    rules: int = 0  #: in whose form failures are signed; 0: today's
    scene: SceneSource | None = None  #: of a world whose program goes on in the run
    repeat: int = 0  #: number of the repetition: the same run is run again for each number
    compared_with: KeptTrace | None = None  #: the result says where the run differs from it
    picture: str = ""  #: file for a picture of the run if it fails; empty: none

    def digest(self) -> str:
        """Hash every field but limits. The lab adds the code that is run."""
        fields = [f.name for f in dataclasses.fields(self) if f.name not in _HASHED_APART]
        others = [getattr(self, name) for name in fields]
        return codec.digest([self.world.digest(), _digest_of(self.transcript), *others])

    def for_vote(self) -> Experiment:
        """Judge by the specifications that decide pass or fail when perturbed runs vote."""
        return dataclasses.replace(self, specs=vote_specifications(self.specs))

    def with_perturbation(self, number: int) -> Experiment:
        """Take the copy of the world with small differences that has this number, from 1 on."""
        return dataclasses.replace(self, perturbation=number)

    @property
    def begins_at(self) -> float:
        """When the first thing is changed that cannot be changed before the run begins [s]."""
        return self.edits[0].at if self.edits else 0.0


_HASHED_APART = ("limits", "world", "transcript")


def _digest_of(transcript: Transcript | None) -> str:
    if transcript is None:
        return ""
    seen = hashlib.sha256(transcript.packed)
    seen.update(repr(dataclasses.replace(transcript, packed=b"")).encode())
    return seen.hexdigest()


def certain(result: RunResult) -> RunResult:
    """Give the result of a run that must have been run.

    Raises:
        InputError: the world, or the stack in it, cannot be run.
        HarnessError: the toolkit failed, or the run was killed.
    """
    if result.status == "impossible":
        raise InputError(result.detail)
    if result.status in ("error", "timeout"):
        raise HarnessError(result.detail)
    return result


#: whether a run fails; None: it tells nothing
Fails: TypeAlias = Callable[[RunResult], bool | None]


def is_failed(result: RunResult) -> bool | None:
    """Whether a primary specification is violated; None: the run could not be judged."""
    return result.failed if result.status == "judged" else None
