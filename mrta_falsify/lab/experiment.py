"""What the lab is asked: a world under a stack, with what is changed in the run."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

from mrta_falsify.core import codec
from mrta_falsify.core.config import StackConfig
from mrta_falsify.core.stack_failure import StackLimits
from mrta_falsify.core.world import World
from mrta_falsify.specs.library import default_specifications
from simulator_interface.external.transcript import Transcript


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
