"""What the toolkit knows of a specification beside how it judges: one record on its class.

Stored verdicts name their specification. So a class that others than its own run should know of is
registered under the name that its verdicts have.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from mrta_falsify.core import registry
from mrta_falsify.core.errors import ConfigError

POINT = "specification"

#: what a violation says. cause: what went wrong; standstill: what a robot that cannot move violates
#: sooner or later; outcome: only that work was late, undone or dear
Role = Literal["cause", "standstill", "outcome"]


@dataclass(frozen=True, slots=True, kw_only=True)
class SpecProfile:
    """A specification as reports, searches and explanations see it."""

    #: of a violation, as a clause that a time and robots follow: "two robots touched" is told as
    #: "Two robots touched at 4.2 s: robot1, robot2."
    meaning: str
    scale: float = 1.0  #: robustness that counts as comfortably safe, in its unit
    role: Role = "cause"
    #: order among violations that begin at the same instant, smaller ones first, each shipped one
    #: with a number of its own; one of the user's own leads
    tie: int = -1
    #: whose violation by the same objects is the same event, and is told in place of this one
    part_of: str = ""
    #: whose task it is to prevent a violation; empty: that is guessed from the trace
    #: (``specs/attribution.py``)
    layer: str = ""
    #: options while it judges perturbed runs: these are the vote on a failure, so that none votes
    #: on them, and only whether one fails counts
    in_votes: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not self.scale > 0.0:
            raise ConfigError(f"the scale of a specification is {self.scale}; it must be > 0")


@functools.lru_cache(maxsize=256)
def profile_of(spec: str) -> SpecProfile:
    """Give the profile of a specification by the name in its verdicts.

    Args:
        spec: a registered name. Of any other name (a formula, a class that is not installed) only
            that it is violated can be said.
    """
    unknown = SpecProfile(meaning=f"{spec} is violated")
    if spec not in registry.names(POINT):
        return unknown
    try:
        found = getattr(registry.load(POINT, spec), "profile", None)
    except Exception:  # whatever a plug-in raises, what is stored can be read without it
        return unknown
    return found if isinstance(found, SpecProfile) else unknown
