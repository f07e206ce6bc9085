"""A claim of the oracle compared with the label of its run."""

from __future__ import annotations

from dataclasses import dataclass

from benchmarks.oracle.rows import Row

LATE = 20.0  # s before the horizon; what stands only then need not be claimed before it
EARLY = 1.0  # s; a claim earlier than this before the deadlock was sealed is examined again


@dataclass(frozen=True)
class Comparison:
    """What a claim, or the lack of one, is worth."""

    is_true: bool  #: the label knows a deadlock in time to be claimed
    is_claimed: bool
    is_hit: bool  #: the claim names a robot of a deadlock
    is_early: bool  #: it came while small differences still let a member through
    is_exact: bool  #: it names the members, all and no other
    is_borderline: bool  #: the label or the deadlock claimed is borderline
    delay: float | None  #: from the run's first onset to the claim [s]
    delay_sealed: float | None  #: the same from the fork time that sealed it; None: over 5 s


def compare(label: Row, claim: Row | None) -> Comparison:
    """Compare a label with what the oracle says of the same run.

    Args:
        label: row of ``benchmarks.oracle.label``.
        claim: evidence of the first claim (members, detected_at), None: the oracle is content.
    """
    found = label["deadlocks"]
    due = [d for d in found if d["onset"] <= label["horizon"] - LATE]
    doubtful = label["borderline"] or any(d["borderline"] for d in found)
    if claim is None:
        return Comparison(
            is_true=bool(due),
            is_claimed=False,
            is_hit=False,
            is_early=False,
            is_exact=False,
            is_borderline=doubtful,
            delay=None,
            delay_sealed=None,
        )
    members, at = set(claim["members"]), claim["detected_at"]
    hits = [d for d in found if members & {*d["members"], *d["victims"]}]
    first = min((d for d in found if not d["moving"]), key=lambda d: d["onset"], default=None)
    return Comparison(
        is_true=bool(due or hits),
        is_claimed=True,
        is_hit=bool(hits),
        is_early=bool(hits) and all(at < _sealed(d) - EARLY for d in hits),
        is_exact=any(members == set(d["members"]) for d in hits),
        is_borderline=doubtful,
        delay=max(0.0, at - first["onset"]) if hits and first else None,
        delay_sealed=max(0.0, at - first["sealed"])
        if hits and first and _is_known(first)
        else None,
    )


def _is_known(deadlock: Row) -> bool:
    return deadlock["sealed"] is not None


def _sealed(deadlock: Row) -> float:
    """Latest fork time that still lets a member through, or what is known of it [s]."""
    if deadlock["moving"]:
        return -float("inf")
    if _is_known(deadlock):
        return float(deadlock["sealed"])
    return float(deadlock["onset"]) - 8.0
