"""What only a continuation of the run can confirm, and how it is told where there is none."""

from __future__ import annotations

from typing import Any

from mrta_falsify.core.verdict import Verdict
from mrta_falsify.core.world import World

CANNOT_COPY = "this run cannot be copied to confirm it"
UNCONFIRMED = 0.95  # of the robustness is all that robots can lose before a continuation decides


def suspected(
    spec: str,
    what: str,
    *,
    who: tuple[str, ...],
    evidence: dict[str, Any],
    why: str = CANNOT_COPY,
) -> Verdict:
    """Give the verdict of a specification whose suspicion no continuation can confirm.

    Args:
        spec: its name.
        what: is suspected, with its article.
        who: names of the robots concerned.
        evidence: JSON-shaped.
        why: it is no more than a suspicion.
    """
    return Verdict(
        spec=spec,
        robustness=0.0,
        violated=False,
        who=who,
        evidence=evidence,
        not_judged=f"{what} is suspected, but {why}",
    )


def awaits_an_end(world: World, time: float) -> bool:
    """Whether an outside event is in force at ``time`` [s] that will end before the horizon."""
    return any(event.start <= time < event.end < world.horizon for event in world.events)
