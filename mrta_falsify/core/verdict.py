"""Verdicts of specifications."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal, TypeAlias

from mrta_falsify.core.evidence import check_evidence

VerdictOutcome: TypeAlias = Literal["holds", "violated", "not_judged"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Verdict:
    """How one specification fared; larger robustness is safer, below zero is a violation."""

    spec: str
    robustness: float  #: unit of the specification (m, s or a share); never NaN; 0: not judged
    violated: bool
    violated_at: float | None = None  #: first time of violation [s]
    who: tuple[str, ...] = ()  #: names of the robots, humans or tasks concerned
    evidence: dict[str, Any] = field(default_factory=dict)  #: JSON-shaped, shows the work
    not_judged: str = ""  #: what was missing to judge it, in words; empty: it was judged

    def __post_init__(self) -> None:
        if self.violated != (self.robustness < 0.0):
            raise AssertionError(f"{self.spec}: violated {self.violated}, rho {self.robustness}")
        if self.violated and self.not_judged:
            raise AssertionError(f"{self.spec}: violated, but not judged: {self.not_judged}")

    def check_stored(self) -> None:
        """Refuse evidence that was read and that no reader could tell.

        Raises:
            InputError: what is wrong with it.
        """
        check_evidence(self.spec, self.evidence)

    def __repr__(self) -> str:
        """Write it in one line."""
        when = f" at {self.violated_at:.1f} s" if self.violated_at is not None else ""
        who = f", {', '.join(self.who)}" if self.who else ""
        outcome = self.outcome.replace("_", " ")
        return f"<Verdict {self.spec}: {outcome}{when}, robustness {self.robustness:+.3g}{who}>"

    @property
    def outcome(self) -> VerdictOutcome:
        """Whether the specification holds, is violated, or could not be judged."""
        if self.not_judged:
            return "not_judged"
        return "violated" if self.violated else "holds"


def unjudged(spec: str, missing: str) -> Verdict:
    """Give the verdict of a specification that cannot be judged.

    Args:
        spec: its name.
        missing: what was missing, for example ``the stack tells no deliveries``.
    """
    return Verdict(spec=spec, robustness=0.0, violated=False, not_judged=missing)
