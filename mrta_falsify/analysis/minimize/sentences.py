"""What a smallest world is the smallest of, in words."""

from __future__ import annotations

from mrta_falsify.core.findings import Minimisation
from mrta_falsify.core.probability import failure_probability, interval_text
from mrta_falsify.core.record import PerturbedRuns


def minimal_text(found: Minimisation) -> str:
    """Say exactly what was tried, and how often the result fails.

    Returns:
        For example ``no single thing and none of 66 pairs can go; fails in 9 of 10 perturbed runs
        (95% interval 0.56 to 0.99)``.
    """
    told = _rate(found.jittered) if found.other is None else ""
    return "; ".join(part for part in (*_tried(found), told) if part)


def _tried(found: Minimisation) -> tuple[str, ...]:
    if not found.one_minimal:
        return ("out of runs (--max-runs): it may get smaller",)
    if not found.pairs:
        return ("no single thing can go",)
    first = f"no single thing and none of {found.pairs} pairs can go"
    if found.pairs_tried < found.pairs:
        first = (
            f"no single thing can go, nor any of the {found.pairs_tried} of {found.pairs} pairs "
            "that were tried before the runs ran out (--max-runs)"
        )
    if not found.pairs_unsure:
        return (first,)
    some = "1 pair" if found.pairs_unsure == 1 else f"{found.pairs_unsure} pairs"
    return (first, f"without {some} the run itself fails, but most perturbed runs pass")


def _rate(jittered: PerturbedRuns | None) -> str:
    if jittered is None or not jittered.runs:
        return ""
    chance = failure_probability(jittered.failed, jittered.runs)
    text = interval_text(chance.low, chance.high, chance.level)
    rate = f"fails in {jittered.failed} of {jittered.runs} perturbed runs ({text})"
    return rate if jittered.robust else f"{rate}: a knife edge"
