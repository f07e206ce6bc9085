"""A claim of the oracle compared with the label of its run."""

from __future__ import annotations

from dataclasses import dataclass

from experiments.oracle.rows import Row

LATE = 20.0  # s before the horizon; what stands only then need not be claimed before it
WHOLE = 3600.0  # s, bound of a claim that states none, and of the stricter figures
DT = 0.25  # s by which a way may end before a bound; ticks and rounding


@dataclass(frozen=True)
class Comparison:
    """What a claim, or the lack of one, is worth."""

    is_true: bool  #: the label knows a deadlock in time to be claimed, or the claim is right
    is_claimed: bool
    is_right: bool  #: all that it names stand for the bound that it states
    is_right_3600: bool  #: they stand for 3,600 s
    is_held: bool  #: without arrivals they would stand for that bound, but something frees them
    is_exact: bool  #: it names the members of a deadlock, all and no other
    is_kind_right: bool  #: it is of the deadlock's kind; True for a claim that states none
    is_borderline: bool  #: the label or a deadlock of it is borderline
    bound: float | None  #: that the claim states [s]
    delay: float | None  #: from when the first deadlock stands to the claim [s], < 0: before it


def compare(label: Row, claim: Row | None) -> Comparison:
    """Compare a label with what the oracle says of the same run.

    Args:
        label: row of ``experiments.oracle.label``.
        claim: evidence of the first claim (members, detected_at, and what it states of stands_for,
            for_good and kind), None: the oracle is content.
    """
    found = label["deadlocks"]
    due = [d for d in found if d["stands"] <= label["horizon"] - LATE]
    doubtful = label["borderline"] or any(d["borderline"] for d in found)
    if claim is None:
        return Comparison(
            is_true=bool(due),
            is_claimed=False,
            is_right=False,
            is_right_3600=False,
            is_held=False,
            is_exact=False,
            is_kind_right=False,
            is_borderline=doubtful,
            bound=None,
            delay=None,
        )
    members, at, bound = set(claim["members"]), claim["detected_at"], bound_of(claim)
    right = all(stands(label, name, at, bound) for name in members)
    hits = [d for d in found if members & {*d["members"], *d["victims"]}]
    exact = [d for d in hits if members == set(d["members"])]
    first = min((d for d in found if not d["moving"]), key=lambda d: d["stands"], default=None)
    kind = claim.get("kind")
    return Comparison(
        is_true=bool(due) or right,
        is_claimed=True,
        is_right=right,
        is_right_3600=all(stands(label, name, at, WHOLE) for name in members),
        is_held=not right and all(_is_held(label, name, at, bound) for name in members),
        is_exact=bool(exact),
        is_kind_right=kind is None or kind in {d["kind"] for d in exact or hits},
        is_borderline=doubtful,
        bound=bound,
        delay=_delay(first, at) if right and hits and first is not None else None,
    )


def _delay(deadlock: Row, time: float) -> float:
    """From when the last member stands to a claim; < 0: before it was even near its place [s]."""
    if time >= deadlock["stands"]:
        return round(time - deadlock["stands"], 2)
    return round(min(0.0, time - deadlock["there"]), 2)


def bound_of(claim: Row) -> float:
    """For how long a claim says that its members stand [s]."""
    if claim.get("for_good"):
        return WHOLE
    return float(claim.get("stands_for") or WHOLE)


def stands(label: Row, name: str, time: float, bound: float) -> bool:
    """Whether a robot is on the way to a stop at a moment, and still is ``bound`` [s] later."""
    for since, until in label["ways"][name]:
        if since <= time + DT and (until is None or time < until):
            return until is None or until >= time + bound - DT
    return False


def _is_held(label: Row, name: str, time: float, bound: float) -> bool:
    """Whether a robot would stand for the bound if nothing came from outside any more."""
    if stands(label, name, time, bound):
        return True
    later = [h for h in label["held"] if h["robot"] == name and h["moment"] >= time - DT]
    if not later:
        return False
    until = min(later, key=lambda h: h["moment"])["until"]
    return until is None or until >= time + bound - DT
