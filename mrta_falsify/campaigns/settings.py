"""What a campaign is: everything that decides its trials, as one value."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal

from mrta_falsify.core.codec import quantity
from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.core.errors import ConfigError
from mrta_falsify.core.feedback import Cube

FORMAT_VERSION = 2


@dataclass(frozen=True, slots=True, kw_only=True)
class TrialSettings:
    """What a worker must know to run any trial of a campaign."""

    scenario: str  #: shipped name or path of a Scenic program
    params: dict[str, Any] = field(default_factory=dict)  #: Scenic's global parameters
    sources_digest: str = ""  #: of the program with all it imports, "" : not checked
    stack: StackConfig = StackConfig()
    specifications: tuple[str, ...] = ()  #: that judge; empty: the default ones
    seed: int = quantity(low=0, default=0)  #: of the campaign
    mode: Literal["repair", "exact"] = "repair"  #: how scenes are accepted: "repair" or "exact"
    early_stop: bool = True  #: end an episode once its verdict is decided
    screen: bool = False  #: kinematic engine first, physics only for its failures
    jittered: int = quantity(low=0, high=100, default=0)
    """Copies with small differences that are run of each failing world. With them the search
    goes for worlds most copies of which fail."""
    keep_every: int = quantity(low=1, default=50)  #: of the passing trials, one in so many traces
    directory: str = ""  #: for worlds and traces, "" : nothing is written

    def __post_init__(self) -> None:
        if self.mode not in ("repair", "exact"):
            raise ConfigError(f"mode is {self.mode!r}; it must be repair or exact")


@dataclass(frozen=True, slots=True, kw_only=True)
class CampaignSettings:
    """A campaign, apart from how much of it is run and on what."""

    version: int = FORMAT_VERSION
    trials: TrialSettings
    target: str = "mrta_falsify.worker:open_trials"  #: what a worker opens, ``module:function``
    sampler: Choice = Choice("random")
    cube: Cube = Cube()
    window: int = quantity(low=1, high=1024, default=8)
    """Proposal n is asked for as soon as results 0 to n - window are told: how far workers may
    run ahead of what the sampler knows. Not the number of workers, so that 1 or 8 of them give
    the same campaign."""
    time_limit: float = quantity(above=0.0, unit="s", default=300.0)  #: wall clock of one trial


@dataclass(frozen=True, slots=True, kw_only=True)
class Limits:
    """How much of a campaign to run; none of it changes any trial."""

    budget: int = quantity(low=1, default=100)  #: simulated candidates
    stop_after: int = quantity(low=0, default=0)  #: failures after which to stop, 0: never
    rejected_in_a_row: int = quantity(low=1, default=200)  #: after which to give up
