"""What happened, in one canonical line: failures with the same signature are one mode.

A signature names the violated specification that explains the others. For ``no_deadlock`` it goes
on with what its leading claim is:

- a deadlock: the canonical wait-for cycle over what blocks whom, the kind of place, and the kinds
  of things and people that took part: ``no_deadlock/2:barrier>barrier/corridor with furniture``;
- stuck: what holds each robot, and the same: ``no_deadlock/stuck:wall/doorway with furniture``;
- shut by the world: the kinds of what shut the place, as in
  ``no_deadlock/shut:pushed furniture/doorway``.

It has no names of robots, rooms or queues, and no parameters of the scenario: two very different
worlds in which two robots meet beside a bed fail in the same mode, in whatever corridor that is.

Versions whose campaigns have rules 1 told no kinds apart. :func:`signature_before` signs as they
did, so that what they stored is compared with what is found now.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

from mrta_falsify.core.claims import Claim, claim_as_before, claims_of, earliest, leading_claim
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.core.wait_account import PresentObject, WaitAccount, wait_account
from mrta_falsify.specs.causes import DEADLOCK, first_claim, leading
from mrta_falsify.specs.deadlock.place_kind import place_kind
from mrta_falsify.specs.holds import main_kinds

#: evidence that tells modes of one specification apart
DISTINGUISHED_BY = {"stack_runs": ("kind", "layer", "exception"), "repeatable": ("field",)}
#: whether a robot ahead stands in the way or merely goes first may hang on a centimetre
SAME_IN_A_CYCLE = {"cluster": "barrier"}


def signature(verdicts: Sequence[Verdict]) -> str:
    """Write the signature of a run, empty if nothing is violated.

    Args:
        verdicts: of one run, as judged or as stored by any version.

    Returns:
        For example ``no_deadlock/2:barrier>barrier/doorway with pushed furniture``.
    """
    verdict = leading(verdicts)
    if verdict is None:
        return ""
    if verdict.spec != DEADLOCK:
        return _of_other(verdict, _holders(verdict) if verdict.spec == "progress" else "")
    account, claim = wait_account(verdict), leading_claim(verdict.evidence)
    if account.kind == "shut":
        what = f"shut:{_object_kinds(_shutting(account, claim))}".rstrip(":")
        return _joined(verdict.spec, what, _place_kind(claim))
    what = canonical_cycle(account)
    if account.kind == "stuck":
        what = f"stuck:{what.partition(':')[2]}"
    return _joined(verdict.spec, what, _where(account, claim))


def mechanism(verdicts: Sequence[Verdict]) -> str:
    """Write what a smaller world must keep of a failure.

    That is its signature without what a bystander or one more robot changes: how many robots wait,
    in which order, and what else stood there.

    Args:
        verdicts: of one run.

    Returns:
        For example ``no_deadlock/deadlock:barrier/doorway``; empty if nothing is violated.
    """
    verdict = leading(verdicts)
    if verdict is None or verdict.spec != DEADLOCK:
        return signature(verdicts)
    account, claim = wait_account(verdict), leading_claim(verdict.evidence)
    if account.kind == "shut":
        return signature(verdicts)
    labels = canonical_cycle(account).partition(":")[2]
    causes = {cause for label in labels.replace(">", ",").split(",") for cause in label.split("+")}
    what = f"{account.kind}:{'+'.join(sorted(causes))}"
    return _joined(verdict.spec, what, _place_kind(claim))


def signature_before(verdicts: Sequence[Verdict]) -> str:
    """Write the signature of a run as versions did that told no kinds apart (rules 1).

    Args:
        verdicts: of one run, as judged or as stored by any version.

    Returns:
        For example ``no_deadlock/1:wall/doorway with furniture``; empty if nothing is violated.
    """
    verdict = leading([_as_before(verdict) for verdict in verdicts])
    if verdict is None:
        return ""
    if verdict.spec != DEADLOCK:
        return _of_other(verdict, _last_holders(verdict) if verdict.spec == "progress" else "")
    account = wait_account(verdict)
    return _joined(verdict.spec, canonical_cycle(account), _where(account, verdict.evidence))


def _as_before(verdict: Verdict) -> Verdict:
    if verdict.spec != DEADLOCK or not verdict.violated:
        return verdict
    return dataclasses.replace(
        verdict, evidence=claim_as_before(earliest(claims_of(verdict.evidence)))
    )


def _of_other(verdict: Verdict, holders: str) -> str:
    """Sign a violation of any specification but ``no_deadlock``."""
    told = [first_claim(verdict.evidence)]
    told += [str(verdict.evidence.get(key, "")) for key in DISTINGUISHED_BY.get(verdict.spec, ())]
    return _joined(verdict.spec, *told, holders)


def _joined(*parts: str) -> str:
    return "/".join(part for part in parts if part)


def _where(account: WaitAccount, claim: Claim) -> str:
    """Write the kind of place, and the kinds of what took part there."""
    where, took_part = _place_kind(claim), _object_kinds(account.objects)
    return f"{where} with {took_part}".strip() if took_part else where


def _place_kind(claim: Claim) -> str:
    place = claim.get("place")
    return place_kind(place) if isinstance(place, Mapping) else ""


def _shutting(account: WaitAccount, claim: Claim) -> Sequence[PresentObject]:
    """List what shut a place; all that took part where the evidence does not tell."""
    names = set(claim.get("shut_by", ()))
    return [item for item in account.objects if item.name in names] or account.objects


def _holders(verdict: Verdict) -> str:
    """Name the kinds of what held the robot; empty if the evidence does not tell."""
    kinds = main_kinds(verdict.evidence)
    if kinds is None:  # of an older version, which tells the last instant at most
        kinds = verdict.evidence.get("held_by")
    if not isinstance(kinds, Sequence) or isinstance(kinds, str):
        return ""
    return "+".join(map(str, kinds)) or "nothing"


def _last_holders(verdict: Verdict) -> str:
    """Name the kinds of what held the robot at the last instant, as rules 1 did."""
    held_by = verdict.evidence.get("held_by")
    if not isinstance(held_by, Sequence) or isinstance(held_by, str):
        return ""
    return "+".join(map(str, held_by)) or "nothing"


def canonical_cycle(account: WaitAccount) -> str:
    """Write the wait-for cycle of robots that stand without names.

    A member's label is the cause for which it waits for other members. If it waits for none of
    them, it has all its causes.

    Returns:
        Number of members, then their labels. If each member waits for one other member, they are
        in the order of the cycle, in its smallest rotation; otherwise they are sorted.
    """
    members = set(account.members)
    waits: dict[str, set[str]] = {}
    labels: dict[str, str] = {}
    for robot in members:
        own = account.of(robot)
        inside = [w for w in own if w.blocked_by in members and w.cause != "human"]
        waits[robot] = {wait.blocked_by for wait in inside}
        labels[robot] = "+".join(sorted({wait.cause for wait in inside or own}))
    if "barrier" in labels.values():
        labels = {robot: SAME_IN_A_CYCLE.get(label, label) for robot, label in labels.items()}
    ring = _ring(waits, members)
    if ring:
        words = [labels[robot] for robot in ring]
        turns = [words[i:] + words[:i] for i in range(len(words))]
        return f"{len(words)}:" + ">".join(min(turns))
    return f"{len(labels)}:" + ",".join(sorted(labels.values()))


def _ring(waits: dict[str, set[str]], members: set[str]) -> list[str]:
    """Order the members if each waits for exactly one other and all are on one ring."""
    if not members or any(len(waits[robot]) != 1 for robot in members):
        return []
    ring = [min(members)]
    while True:
        (following,) = waits[ring[-1]]
        if following == ring[0]:
            return ring if len(ring) == len(members) else []
        if following in ring:
            return []
        ring.append(following)


def _object_kinds(objects: Sequence[PresentObject]) -> str:
    """List the kinds of things and people that took part; walls are everywhere."""
    kinds = {
        f"pushed {item.kind}" if item.carried_by else item.kind
        for item in objects
        if item.kind and item.kind != "wall"
    }
    # a person who pushes something took part with what they push
    pushing = {item.carried_by for item in objects if item.carried_by}
    if all(item.name in pushing for item in objects if item.kind == "person"):
        kinds.discard("person")
    return " and ".join(sorted(kinds))
