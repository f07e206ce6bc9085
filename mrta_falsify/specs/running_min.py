"""Running minimum of a margin with its evidence: what several specifications keep."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from mrta_falsify.core.verdict import Verdict


@dataclass(slots=True)
class RunningMin:
    """The smallest margin so far, where that was, and who has violated the specification."""

    spec: str  #: name
    margin: float  #: in the specification's unit; at first the largest possible
    evidence: dict[str, Any] = field(default_factory=dict)  #: of the moment of ``margin``
    who: tuple[str, ...] = ()  #: empty as long as nothing is violated
    violated_at: float | None = None  #: [s]

    def note(
        self, margin: float, time: float, who: tuple[str, ...], evidence: dict[str, Any]
    ) -> None:
        """Take in a margin that is smaller than all before.

        Args:
            margin: in the specification's unit, below 0: violated.
            time: now [s].
            who: robots, people or tasks that violate it, if it is violated.
            evidence: of the moment.
        """
        self.margin, self.evidence = margin, evidence
        if margin < 0.0:
            self.who = who
            if self.violated_at is None:
                self.violated_at = time

    def verdict(self, **more: Any) -> Verdict:
        """Give the verdict to date.

        Args:
            **more: further evidence, of the whole run.
        """
        return Verdict(
            spec=self.spec,
            robustness=self.margin,
            violated=self.margin < 0.0,
            violated_at=self.violated_at,
            who=self.who,
            evidence={**self.evidence, **more},
        )
