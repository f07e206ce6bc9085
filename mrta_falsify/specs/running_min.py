"""Running minimum of a margin with its evidence: what several specifications keep."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from mrta_falsify.core.verdict import Verdict


@dataclass(slots=True)
class RunningMin:
    """The smallest margin so far, and what happened when the specification was first violated."""

    spec: str  #: name
    margin: float  #: in the specification's unit; at first the largest possible
    #: of the first violation; before there is one, of the moment of ``margin``
    evidence: dict[str, Any] = field(default_factory=dict)
    who: tuple[str, ...] = ()  #: of the first violation, empty as long as there is none
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
        self.margin = margin
        if self.violated_at is not None:
            return
        self.evidence = evidence
        if margin < 0.0:
            self.who, self.violated_at = who, time

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
