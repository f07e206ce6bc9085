"""Which violation came first, and which ones follow from it.

A run may violate many specifications for one reason. These rules choose the one to tell first:

1. The violation whose cause began first leads. What ``no_deadlock`` claims begins at its onset,
   not when it is found; lost progress begins when progress ended; anything else when it is
   violated.
2. What says only that work was late or left undone never leads if something else is violated:
   whatever cost the time came before.
3. A robot that stands gets no nearer, drives in vain and starves. Such a violation follows from
   ``no_deadlock`` if it comes after the onset, even if the last progress was before it.
4. A person who is touched was passed too closely just before. That is one event: the contact.
5. A place that the world shut during the run leads only if nothing is violated but what follows
   from it, and what says that work was late or undone: it is no failure of the stack.
6. At the same instant ``SpecProfile.tie`` decides: what ended the run, what was said wrongly or
   done beyond the limits, what touched, what stands still.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Mapping, Sequence
from typing import Any, Literal, TypeAlias

from mrta_falsify.core.claims import (
    SPEC,
    ClaimKind,
    claim_kind,
    claims_of,
    earliest,
    leading_claim,
)
from mrta_falsify.core.run_result import RunResult
from mrta_falsify.core.spec_profile import profile_of
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.core.wait_account import wait_account

DEADLOCK = SPEC


def leading(verdicts: Sequence[Verdict]) -> Verdict | None:
    """Choose the violated verdict that explains the run, None if nothing is violated."""
    return next((verdict for verdict in by_cause(verdicts) if verdict.violated), None)


def by_cause(verdicts: Sequence[Verdict]) -> tuple[Verdict, ...]:
    """Sort verdicts: the leading one, the other violated ones by time, then those that hold."""
    shut = next(filter(is_shut, verdicts), None)

    def key(verdict: Verdict) -> tuple[bool, int, bool, float, int, str]:
        place = profile_of(verdict.spec).tie
        if not verdict.violated:
            return (True, 0, bool(verdict.not_judged), 0.0, place, verdict.spec)
        is_effect = any(_is_led_by(verdict, other) for other in verdicts if other is not verdict)
        begins = cause_begins(verdict)
        level = 1 if is_outcome(verdict) else 0
        if shut is not None and (verdict is shut or _only_follows(verdict, shut)):
            level = 2 if verdict is shut else 3
        return (False, level, is_effect, begins, place, verdict.spec)

    return tuple(sorted(verdicts, key=key))


def kind_of(verdicts: Sequence[Verdict]) -> ClaimKind | Literal[""]:
    """Tell the kind of a failing run: deadlock, stuck or shut; empty if it is none of them.

    A run in which the world shut a place is of that kind only if this leads (rule 5).
    """
    claimed = next((v for v in verdicts if v.spec == DEADLOCK and v.violated), None)
    if claimed is None:
        return ""
    if is_shut(claimed):
        return "shut" if leading(verdicts) is claimed else ""
    return claim_kind(leading_claim(claimed.evidence), claimed.who)


#: what a failing run is counted as: what only follows is *secondary*, whatever its kind
FailureGroup: TypeAlias = Literal["deadlock", "stuck", "shut", "other", "secondary", ""]


def group_of(result: RunResult | None) -> FailureGroup:
    """Tell what a run is counted as; empty if it does not fail."""
    if result is None or result.rank == "none":
        return ""
    kind = kind_of(result.verdicts)
    if result.rank == "secondary":
        return "shut" if kind == "shut" else "secondary"
    return kind or "other"


def primary(verdicts: Sequence[Verdict], then: Collection[str] = ()) -> tuple[Verdict, ...]:
    """List the violations that a search looks for first.

    Args:
        verdicts: of one run.
        then: secondary specifications.

    Returns:
        The violated ones, without ``then``, without a place that the world shut, and without what
        only follows from that.
    """
    shut = next(filter(is_shut, verdicts), None)
    return tuple(
        verdict
        for verdict in verdicts
        if verdict.violated
        and verdict.spec not in then
        and not is_shut(verdict)
        and not (shut is not None and _only_follows(verdict, shut))
    )


def secondary(verdicts: Sequence[Verdict], then: Collection[str] = ()) -> frozenset[str]:
    """Name the specifications that a search does not look for first.

    These are ``then``, and those that are violated but not :func:`primary`.
    """
    sought = {verdict.spec for verdict in primary(verdicts, then)}
    violated = {verdict.spec for verdict in verdicts if verdict.violated}
    return frozenset((*then, *(violated - sought)))


def is_shut(verdict: Verdict) -> bool:
    """Whether all that a violated verdict claims is that the world shut a place."""
    if verdict.spec != DEADLOCK or not verdict.violated:
        return False
    return claim_kind(leading_claim(verdict.evidence), verdict.who) == "shut"


def cause_begins(verdict: Verdict) -> float:
    """Tell when the cause of a violation began [s]; inf if that is not known."""
    found = float("inf") if verdict.violated_at is None else verdict.violated_at
    if verdict.spec == DEADLOCK:
        claims = claims_of(verdict.evidence)
        own = [claim for claim in claims if claim_kind(claim, verdict.who) != "shut"]
        begun = earliest(own or claims).get("onset")
    else:
        begun = verdict.evidence.get("since")
    # the evidence is of the worst moment, which may come after the first violation
    return min(float(begun), found) if isinstance(begun, (int, float)) else found


def root_onsets(verdict: Verdict) -> tuple[float, ...]:
    """List when each member of the leading claim stopped [s], as far as that is known."""
    onsets = leading_claim(verdict.evidence).get("onsets", {})
    return tuple(float(time) for time in onsets.values())


def first_claim(evidence: Mapping[str, Any]) -> str:
    """Name the kind of the first claim that motion contradicts; empty if there is none."""
    claims = evidence.get("claims")
    first = claims[0] if isinstance(claims, (list, tuple)) and claims else None
    return str(first.get("kind", "")) if isinstance(first, Mapping) else ""


def is_outcome(verdict: Verdict) -> bool:
    """Whether it says only that work was late, undone or dear."""
    return profile_of(verdict.spec).role == "outcome"


def follows_from(verdict: Verdict, cause: Verdict) -> bool:
    """Whether a violation is a consequence of ``cause``, a violated ``no_deadlock``.

    It is if it came after the onset and concerns one of the robots that stand or are held up, or
    names no robot.
    """
    if verdict is cause or cause.spec != DEADLOCK or not cause.violated or not verdict.violated:
        return False
    concerned = {name for name in _concerned(verdict) if name}
    for claim in claims_of(cause.evidence):
        alone = dataclasses.replace(cause, evidence={**claim, "others": []})
        is_later = verdict.violated_at is None or verdict.violated_at >= cause_begins(alone)
        if is_later and (not concerned or concerned & set(wait_account(alone).robots)):
            return True
    return False


def _only_follows(verdict: Verdict, shut: Verdict) -> bool:
    """Whether a violation is there only because the world shut a place."""
    return profile_of(verdict.spec).role != "cause" and follows_from(verdict, shut)


def _is_led_by(verdict: Verdict, other: Verdict) -> bool:
    """Whether ``other`` comes first whatever their times are (rules 3 and 4)."""
    profile = profile_of(verdict.spec)
    if profile.role == "standstill":
        return follows_from(verdict, other)
    is_same_event = other.spec == profile.part_of and bool(set(verdict.who) & set(other.who))
    return is_same_event and other.violated


def _concerned(verdict: Verdict) -> tuple[str, ...]:
    """Name the robots that a violation concerns, as far as it names any."""
    if is_outcome(verdict):
        late = verdict.evidence.get("late")
        rows = late if isinstance(late, (list, tuple)) else ()
        return tuple(str(row.get("robot", "")) for row in rows if isinstance(row, dict))
    return tuple(name for name in verdict.who if not name.startswith("task"))
