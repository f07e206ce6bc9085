"""Claims of ``no_deadlock``: robots that stand, as the evidence of its verdict has them.

The first claim of a verdict is its evidence, further ones are under ``others``. Each is of a kind:

- *deadlock*: two or more robots wait for each other;
- *stuck*: one robot cannot go on, or several of which each cannot;
- *shut*: a place was shut during the run by something that was pushed, or by a person who stays.
  The world did that, no layer of the stack.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from typing import Any, Literal, TypeAlias, get_args

ClaimKind: TypeAlias = Literal["deadlock", "stuck", "shut"]
Claim: TypeAlias = Mapping[str, Any]

SPEC = "no_deadlock"
KINDS: tuple[ClaimKind, ...] = get_args(ClaimKind)  #: the gravest first
KIND_TEXT: dict[str, str] = {"deadlock": "deadlock", "stuck": "stuck", "shut": "shut by the world"}


def claims_of(evidence: Mapping[str, Any]) -> tuple[Claim, ...]:
    """List the claims in the evidence of a violated ``no_deadlock``, in their order."""
    return (evidence, *(row for row in evidence.get("others", ()) if isinstance(row, dict)))


def claim_kind(claim: Claim, who: Collection[str] = ()) -> ClaimKind:
    """Tell the kind of a claim.

    Args:
        claim: of any version; older ones do not name the kind, the number of members tells it.
        who: the robots that the verdict names, of evidence without members.
    """
    named = claim.get("kind")
    for kind in KINDS:
        if kind == named:
            return kind
    members = claim.get("members") or who or {row["robot"] for row in claim.get("cycle", ())}
    return "deadlock" if len(members) > 1 else "stuck"


def leading_claim(evidence: Mapping[str, Any]) -> Claim:
    """Choose the claim to tell: of the gravest kind, the one whose onset came first."""
    return min(claims_of(evidence), key=lambda row: (KINDS.index(claim_kind(row)), _onset(row)))


def earliest(claims: Iterable[Claim]) -> Claim:
    """Choose the claim whose onset came first, whatever its kind."""
    return min(claims, key=lambda row: (_onset(row), row.get("detected_at", 0.0)))


def _onset(claim: Claim) -> float:
    return float(claim.get("onset", 0.0))


def members_by_onset(claim: Claim) -> tuple[str, ...]:
    """List the members of a claim: the root first, the others in the order they stopped."""
    members = list(claim.get("members", ()))
    onsets, root = claim.get("onsets", {}), claim.get("root", "")
    members.sort(key=lambda name: (name != root, onsets.get(name, 0.0)))
    return tuple(members)


def claim_as_before(claim: Claim) -> dict[str, Any]:
    """Write a claim as versions did that knew no kinds: with the edges that geometry showed."""
    before = {key: value for key, value in claim.items() if key not in ("kind", "others")}
    before["cycle"] = claim.get("cycle_seen") or claim.get("cycle", ())
    before["members"] = claim.get("members_alone") or claim.get("members", ())
    if claim.get("cycle_seen"):
        before["objects"] = _objects_on(before)
    return before


def _objects_on(claim: Claim) -> list[Mapping[str, Any]]:
    """List the things and people on the edges of a claim, and what those people push."""
    rows = [*claim.get("cycle", ()), *claim.get("chain", ())]
    named = {row["resource"] for row in rows if row["cause"] in ("wall", "no-path")}
    people = {row["blocked_by"] for row in rows if row["cause"] == "human"}
    return [
        item
        for item in claim.get("objects", ())
        if item["name"] in named | people or item.get("carried_by") in people
    ]
