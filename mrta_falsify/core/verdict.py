"""Verdicts of specifications."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True, slots=True, kw_only=True)
class Verdict:
    """How one specification fared; larger robustness is safer, below zero is a violation."""

    spec: str
    robustness: float  #: unit of the specification (m, s or a share); never NaN
    violated: bool
    violated_at: float | None = None  #: first time of violation [s]
    who: tuple[str, ...] = ()  #: names of the robots, humans or tasks concerned
    evidence: dict[str, Any] = field(default_factory=dict)  #: JSON-shaped, shows the work

    def __post_init__(self) -> None:
        if self.violated != (self.robustness < 0.0):
            raise AssertionError(f"{self.spec}: violated {self.violated}, rho {self.robustness}")
