"""What a campaign is: everything that decides its trials, as one value.

A field with a ``text`` is an option of the command line: its name, default, range and help are
written here and nowhere else. What belongs to :class:`Limits` may change when a campaign is
resumed; everything else belongs to the campaign.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from typing import Any, Literal

from mrta_falsify.core.candidate import SearchSpace
from mrta_falsify.core.codec import later, quantity
from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.core.errors import ConfigError
from mrta_falsify.core.feedback import Cube
from mrta_falsify.core.stack_failure import MEMORY_LIMIT, TICK_LIMIT, StackLimits

FORMAT_VERSION = 3
MAX_TRIALS = 10_000_000  # of a campaign that the clock ends
CONFIRMING_RUNS = 4  # of a failure on another engine, where the campaign asks for none
MAX_PERTURBED_RUNS = 100  # copies of one failing world
COMPARISON_RUNS = 4  # copies by which two stacks are compared unless told otherwise
#: runs again of one failure. Four of four say that it comes again in at least 47 % of runs (Blaker,
#: 95 %), and a failure of half of the runs is taken for one of all in 1 of 16 cases only.
VERIFY = 4

#: what a worker may open, as ``module:function``; a campaign has trials
TARGETS = {
    "trials": "mrta_falsify.worker:open_trials",
    "experiments": "mrta_falsify.lab.laboratory:open_experiments",
}
DEFAULT_TARGET = "trials"
#: what a campaign's file may name, and what older versions called it
STORED_TARGETS = dict.fromkeys(
    ("trials", "mrta_falsify.worker:open_trials", "mrta_falsify.trial:open_trials"), DEFAULT_TARGET
)

#: how scenes are accepted
Mode = Literal["repair", "exact"]


@dataclass(frozen=True, slots=True, kw_only=True)
class TrialSettings:
    """What a worker must know to run any trial of a campaign."""

    scenario: str  #: shipped name or path of a Scenic program
    params: dict[str, Any] = field(default_factory=dict)  #: Scenic's global parameters
    sources_digest: str = ""  #: of the program with all it imports, "" : not checked
    stack: StackConfig = StackConfig()
    #: the other stack, on which failures must not happen; None: none is compared
    against: StackConfig | None = later(None)
    specifications: tuple[str, ...] = ()  #: that judge; empty: the default ones
    then: tuple[str, ...] = later(())  #: of them, the secondary ones
    seed: int = quantity(
        low=0, default=0, text="Seed of the campaign: the same seed gives the same candidates."
    )
    mode: Mode = quantity(
        default="repair",
        text=(
            "Treatment of rejected scenes: `repair` redraws only the objects at fault; "
            "`exact` redraws the whole scene and so keeps Scenic's distribution."
        ),
    )
    early_stop: bool = True  #: end an episode once its verdict is decided
    screen: bool = quantity(
        default=False,
        text=(
            "Run each candidate on the kinematic engine first, and on the physics engine only "
            "if it fails there."
        ),
    )
    jittered: int = quantity(
        low=0,
        high=MAX_PERTURBED_RUNS,
        default=0,
        text="Largest number of perturbed runs (small differences) of each failing world; the "
        "search then prefers failures that most of them share, and only these count for "
        f"--stop-after. Default with --against: {COMPARISON_RUNS}.",
    )
    confirm: tuple[str, ...] = later(())  #: engines that robust failures are run on as well
    verify: int = quantity(
        low=0,
        high=MAX_PERTURBED_RUNS,
        default=VERIFY,
        came_later=True,
        text=(
            "Number of unchanged repeats of each failure of a foreign stack, "
            "to count how often it comes again."
        ),
    )
    with_shut_rooms: bool = quantity(
        default=False,
        came_later=True,
        text="Simulate also worlds in which no robot fits through to a room that a task needs.",
    )
    tick_limit: float = quantity(
        above=0.0,
        unit="s",
        default=TICK_LIMIT,
        text=(
            "Longest time that the stack may take for one tick [s]: CPU time and sleep. "
            "More in two runs is a failure of the stack."
        ),
    )
    memory_limit: float = quantity(
        above=0.0,
        unit="GiB",
        default=MEMORY_LIMIT,
        text=(
            "Largest resident memory that the stack may take up [GiB]; more is a failure of "
            "the stack."
        ),
    )
    keep_every: int = quantity(low=1, default=50)  #: of the passing trials, one in so many traces
    directory: str = ""  #: for worlds and traces, "" : nothing is written

    def __post_init__(self) -> None:
        if self.mode not in ("repair", "exact"):
            raise ConfigError(f"mode is {self.mode!r}; it must be repair or exact")

    @property
    def of_other(self) -> TrialSettings:
        """The same with the other stack under test.

        Raises:
            ConfigError: there is none.
        """
        if self.against is None:
            raise ConfigError("the campaign compares no two stacks; begin one with --against STACK")
        return dataclasses.replace(self, stack=self.against, against=None)

    @property
    def limits(self) -> StackLimits:
        """What the stack may use."""
        return StackLimits(tick=self.tick_limit, memory=self.memory_limit)


@dataclass(frozen=True, slots=True, kw_only=True)
class CampaignSettings:
    """A campaign, apart from how much of it is run and on what."""

    version: int = FORMAT_VERSION
    trials: TrialSettings
    target: str = DEFAULT_TARGET  #: what a worker opens, one of ``TARGETS``
    sampler: Choice = quantity(
        default=Choice("auto"),
        text="Sampler that proposes candidates: a name of `mrta-falsify plugins`, or module:Class.",
    )
    cube: Cube = Cube()
    space: SearchSpace = later(SearchSpace(()))  #: names and ranges; empty: an older version
    window: int = quantity(
        low=1,
        high=1024,
        default=8,
        text="Number of trials that may run at a time, before the sampler has their results.",
    )
    """Proposal n is asked for as soon as results 0 to n - window are told: how far workers may
    run ahead of what the sampler knows. Not the number of workers, so that 1 or 8 of them give
    the same campaign."""
    time_limit: float = quantity(
        above=0.0,
        unit="s",
        default=300.0,
        text=(
            "Longest time of one trial, copies of its run included [s]: CPU time of all its "
            "processes, and time in which all of them sleep. A trial beyond it is killed and "
            "run again."
        ),
    )
    """Changes no trial: one that needs more is not stored."""
    rules: int = quantity(low=1, default=1, came_later=True)
    """Number of its rules, see :mod:`mrta_falsify.campaigns.rules`."""
    budget: int = later(0)
    """Simulated candidates last asked for, which a resumed campaign keeps; 0: none were (the clock
    ends it, or an older version wrote it). Changes no trial."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Limits:
    """How much of a campaign to run; none of it changes any trial."""

    budget: int = quantity(
        low=1, default=100, text="Total number of candidates to simulate, stored ones included."
    )
    stop_after: int = quantity(
        low=0,
        default=0,
        text="Number of primary failures after which the search ends; 0 runs the whole budget.",
    )
    until_saturated: float = quantity(
        low=0.0,
        high=1.0,
        default=0.0,
        text=(
            "Chance that another trial shows a new situation: the search ends once the "
            "upper end of its 95 % interval is below this, for example 0.05. 0 runs the "
            "whole budget."
        ),
    )
    wall_clock: float = quantity(low=0.0, unit="s", default=0.0)
    """After which no trial is begun, those that run are finished; 0: as long as it takes."""
    rejected_in_a_row: int = quantity(low=1, default=200)  #: after which to give up


#: the defaults of a campaign's options, for signatures of functions
DEFAULTS = CampaignSettings(trials=TrialSettings(scenario=""))
DEFAULT_LIMITS = Limits()
