"""From verdicts to what a search minimises: normalised margins and one score.

Robustness comes in metres, seconds and shares. A margin divides it by the scale at which the
specification counts as comfortably safe (``SpecProfile.scale``), and cuts it to [-1, 1], so that no
specification drowns the others. The score is the smallest margin with a small part of the mean of
all. So two runs with the same worst margin differ by the rest, and the score is not flat where the
worst specification cannot tell safe from safer.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence

from mrta_falsify.core.spec_profile import profile_of
from mrta_falsify.core.verdict import Verdict

MEAN_SHARE = 0.1  # of the mean margin in the score
LAST_COUNTS = 0.5  # of a secondary specification
SMALLEST = 1e-9  # a margin of this size only says on which side of 0 it is


def objectives(verdicts: Sequence[Verdict]) -> dict[str, float]:
    """Normalise verdicts to margins in [-1, 1] by specification; below 0 is a violation.

    What was not judged has no margin: it is neither safe nor unsafe.
    """
    return {verdict.spec: _margin(verdict) for verdict in verdicts if not verdict.not_judged}


def _margin(verdict: Verdict) -> float:
    share = verdict.robustness / profile_of(verdict.spec).scale
    if verdict.violated:
        return max(-1.0, min(share, -SMALLEST))
    return min(max(share, 0.0), 1.0)


def search_score(margins: dict[str, float], then: Collection[str] = ()) -> float:
    """Combine margins into one number to minimise; below 0 only if a specification is violated.

    Args:
        margins: by specification, as of :func:`objectives`. Without any, nothing was judged,
            and the score is that of the safest run.
        then: secondary specifications: they count half, and never below 0.
    """
    if not margins:
        return 1.0
    counted = [
        LAST_COUNTS * max(margin, 0.0) + 1.0 - LAST_COUNTS if name in then else margin
        for name, margin in margins.items()
    ]
    worst = min(counted)
    if worst < 0.0:
        return worst
    mean = math.fsum(counted) / len(counted)
    return (1.0 - MEAN_SHARE) * worst + MEAN_SHARE * mean


def differing(margin: float, other: float) -> float:
    """Combine margins of two stacks in one world into that of "one fails, the other passes".

    The stack that is to fail comes first: as long as it passes, its own margin counts. Once it
    fails, the larger of its margin and the other's negated one does, as of a conjunction.

    Args:
        margin: of the stack that is to fail.
        other: of the stack that is to pass; it does from 0 on.

    Returns:
        A margin in [-1, 1]; below 0 only if the one fails and the other passes.
    """
    if margin >= 0.0:
        return margin
    return max(margin, min(-other, -SMALLEST) if other >= 0.0 else -other)
