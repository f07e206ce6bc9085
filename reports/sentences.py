"""Verdicts in plain words: what happened, when, to whom, and why."""

from __future__ import annotations

import json
import math
import statistics
from collections.abc import Mapping, Sequence
from typing import Any

from mrta_falsify.core import codec
from mrta_falsify.core.claims import Claim, leading_claim
from mrta_falsify.core.external import Coupling
from mrta_falsify.core.spec_profile import profile_of
from mrta_falsify.core.trace import Trace
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.core.wait_account import (
    STALLED,
    PresentObject,
    WaitAccount,
    WaitsFor,
    wait_account,
)
from mrta_falsify.core.words import listed
from mrta_falsify.specs.attribution import Guess
from mrta_falsify.specs.causes import DEADLOCK, cause_begins, follows_from
from mrta_falsify.specs.holds import main_kinds

APART = 2.0  # m from their mean; members farther apart have no place in common
AT_PLACE = 0.5  # m; nearer than this, something happened at a place
MAX_NAMES = 4  # robots, people or tasks of a verdict that a table names
SHOWN_FROM = 0.1  # s of blocked time below which a cause is not worth a word
MAX_EVIDENCE = 4000  # characters of the evidence of one verdict
#: what a blocked-by cause means, said of the robot that is blocked; {other} and {resource}
CAUSES = {
    "queue": "waits for {resource}: {other} holds it or is ahead in the queue",
    "barrier": "cannot drive on because {other} stands in its path",
    "cluster": "has a free path but stands while {other}, which is near, moves",
    "human": "stands still because {other}, a person, is in the way",
    "wall": "is held back by a solid{solid}",
    "no-path": "has a goal but no path to it{because}",
    "stalled": "has a goal and nothing in its way, but does not drive",
    "task": "waits for a task",
}

#: what held a robot, by the kinds of the evidence
HOLDERS = {"person": "people", "robot": "robots", "solid": "solids"}


def violation_sentence(verdict: Verdict) -> str:
    """Describe a violated verdict in one sentence, with time, robots and place."""
    when = f" at {verdict.violated_at:.1f} s" if verdict.violated_at is not None else ""
    if verdict.spec == DEADLOCK:
        return _standing_sentence(verdict, when)
    if verdict.spec == "stack_runs":
        return stack_failure_sentence(verdict)
    if verdict.spec == "repeatable":
        return repeated_sentence(verdict)
    if verdict.spec.startswith("stl"):
        return f"The formula is false{when} (robustness {verdict.robustness:+.3g})."
    late = verdict.evidence.get("late")
    if verdict.spec == "deadlines" and isinstance(late, (list, tuple)) and len(late) > 1:
        return _late_sentence(late)
    meaning = profile_of(verdict.spec).meaning
    who, where = listed(verdict.who), _place(_place_of(verdict.evidence))
    concerned = f": {who}" if who else ""
    return f"{meaning[0].upper()}{meaning[1:]}{when}{concerned}{where}{_detail(verdict)}."


def _late_sentence(late: Sequence[Mapping[str, Any]]) -> str:
    """Name the tasks that were late, each with its own deadline, the first one first."""
    rows = sorted(late, key=lambda row: float(row["deadline"]))
    tasks = [f"task{row['task']} (due at {row['deadline']:.1f} s)" for row in rows]
    return f"Deadlines were missed: {listed(tasks)}."


def _place_of(evidence: Mapping[str, Any]) -> Any:
    """Find where something happened: the place, else the nearest pass of a contact."""
    nearest = evidence.get("nearest")
    at_pass = {**nearest, "near": ""} if isinstance(nearest, dict) and "x" in nearest else None
    return evidence.get("place") or at_pass


def _detail(verdict: Verdict) -> str:
    """Say what the evidence adds to what a violated specification means; may be empty."""
    evidence = verdict.evidence
    if verdict.spec == "exclusive_use" and evidence.get("resource"):
        return f"; {evidence['resource']} has room for {evidence.get('capacity', 1)}"
    if verdict.spec == "honest_events" and evidence.get("claims"):
        claim = evidence["claims"][0]
        room = f" at {claim['room']}" if claim.get("room") else ""
        task = f" of task{claim['task']}" if claim.get("task", -1) >= 0 else ""
        return f"; it claimed {claim['kind']}{task}{room}: {claim['reason']}"
    if verdict.spec == "progress":
        return _held_text(evidence)
    return ""


def _held_text(evidence: Mapping[str, Any]) -> str:
    """Say how long a robot was held while it made no progress, and by what; may be empty."""
    kinds = main_kinds(evidence)
    if kinds is None:
        return ""
    robot, held, since = evidence["robot"], evidence.get("held_s", 0.0), evidence["since"]
    span = f"{evidence.get('time', 0.0) - since:.1f} s since {since:.1f} s"
    if not kinds:
        return f"; {robot} was held for only {held:.1f} of the {span}"
    by = [
        f"{HOLDERS.get(kind, kind)} for {seconds:.1f} s"
        for kind, seconds in evidence["held"].items()
    ]
    names = f" (longest by {listed(list(evidence['holders']))})" if evidence["holders"] else ""
    return f"; {robot} was held for {held:.1f} of the {span}: by {listed(by)}{names}"


def _standing_sentence(verdict: Verdict, when: str) -> str:
    """Name the members, the root first, what took part, the place, and who is held up."""
    account, claim = wait_account(verdict), leading_claim(verdict.evidence)
    alone = len(account.members) == 1
    beside, shut = _beside(account), ""
    if account.kind == "deadlock":
        what = "wait for each other" if account.is_closed else "hold each other up"
    elif account.kind == "stuck":
        what = "is stuck" if alone else "are stuck"
    else:
        what, beside, shut = "cannot go on", "", f"{shut_text(account, claim)}: "
    place = "" if _are_apart(account) else _place(claim.get("place"))
    where = f"{_for_how_long(claim)}{beside}{place}"
    since = ""
    if account.onset is not None:
        stood = "it has" if alone else "they have"
        since = f"; {stood} made no progress since {account.onset:.1f} s"
    victims = [name for name in account.victims if name not in account.members]
    held_up = ""
    if victims:
        stands = "it stands" if alone else "they stand"
        gets = "does" if len(victims) == 1 else "do"
        held_up = f"; while {stands}, {listed(victims)} {gets} not get to the next stop either"
    return f"{shut}{listed(account.members)} {what}{where} (found{when}){since}{held_up}."


def shut_text(account: WaitAccount, claim: Claim) -> str:
    """Say which place the world shut, by what and since when."""
    texts = {item.name: object_text(item) for item in account.objects}
    by = listed([texts.get(name, name) for name in claim.get("shut_by", ())])
    since = claim.get("shut_since")
    when = f" since {float(since):.0f} s" if isinstance(since, (int, float)) else ""
    room = claim.get("shut_room") or "the way"
    return f"{room} is shut{f' by {by}' if by else ''}{when}"


def _for_how_long(claim: Claim) -> str:
    """Say for how long a continuation showed robots standing; empty: older evidence says not."""
    if claim.get("for_good"):
        return " for good"
    bound = claim.get("stands_for")
    return f" for at least {float(bound):.0f} s" if isinstance(bound, (int, float)) else ""


def _beside(account: WaitAccount) -> str:
    """Name the things and people that took part, walls only where nothing else did."""
    carriers = {item.carried_by for item in account.objects if item.carried_by}
    loose = [item for item in account.objects if item.kind != "wall" and item.name not in carriers]
    named = [object_text(item) for item in loose or account.objects]
    if not named:
        return ""
    return f" {'beside' if account.is_closed else 'behind'} {listed(named)}"


def object_text(item: PresentObject) -> str:
    """Name a thing or a person that took part, and say who pushes it or what it is."""
    if item.carried_by:
        return f"{item.name} (pushed by {item.carried_by})"
    return f"{item.name} (a {item.kind})" if item.kind in ("person", "blockage") else item.name


def consequence_sentence(verdict: Verdict, cause: Verdict) -> str:
    """Describe a violation that is told after ``cause``, and say so if it follows from it."""
    text = violation_sentence(verdict)
    if not follows_from(verdict, cause):
        return text
    after = ""
    if verdict.violated_at is not None:
        after = f", {verdict.violated_at - cause_begins(cause):.1f} s after the onset"
    return f"A consequence of it{after}: {text[0].lower()}{text[1:]}"


def who_text(verdict: Verdict) -> str:
    """Name who is concerned: members, the root first, and in brackets whom they hold up."""
    account = wait_account(verdict)
    names = account.members or verdict.who
    shown = [*names[:MAX_NAMES], *(["..."] if len(names) > MAX_NAMES else [])]
    held_up = f" ({', '.join(account.victims)})" if account.victims else ""
    return ", ".join(shown) + held_up


def beside_sentences(verdicts: Sequence[Verdict]) -> tuple[str, ...]:
    """Tell what verdicts note beside their outcome, and what is no failure.

    These are robots that only new work freed, and claims of the oracle that the run refuted.
    """
    return tuple(
        text
        for verdict in verdicts
        if verdict.spec == DEADLOCK
        for text in (
            *map(_held_until_work, verdict.evidence.get("held_until_work", ())),
            *map(_contradiction, verdict.evidence.get("contradictions", ())),
        )
    )


def _held_until_work(row: Mapping[str, Any]) -> str:
    names = list(row.get("robots", ())) or [row.get("robot", "a robot")]
    until = row.get("until")
    to = f" to {float(until):.1f} s" if isinstance(until, (int, float)) else " on"
    return (
        f"{listed(names)} {'was' if len(names) == 1 else 'were'} held until new work arrives, from "
        f"{float(row.get('since', 0.0)):.1f} s{to}{_place(row.get('place'))}: no failure."
    )


def _contradiction(row: Mapping[str, Any]) -> str:
    members, robot = listed(list(row.get("members", ()))), row.get("robot", "")
    stands = "stands" if len(row.get("members", ())) == 1 else "stand"
    went_on = f": {robot} went on" if robot else ""
    return (
        f"Contradiction of the oracle: at {float(row.get('claimed_at', 0.0)):.1f} s it claimed "
        f"that {members} {stands}, at {float(row.get('refuted_at', 0.0)):.1f} s the run refuted "
        f"it{went_on}. The claim is withdrawn and counts as no failure."
    )


def _place(place: Any) -> str:
    if not isinstance(place, dict) or "near" not in place:
        return ""
    numbers = (place.get("x"), place.get("y"), place.get("distance", 0.0))
    if not all(isinstance(number, (int, float)) for number in numbers):
        return ""  # evidence of a specification of a user
    point = f"x {float(place['x']):.1f} m, y {float(place['y']):.1f} m"
    near, distance = place["near"], float(place.get("distance", 0.0))
    if not near:
        return f" at {point}"
    at = f"at {near}" if distance < AT_PLACE else f"{distance:.1f} m from {near}"
    return f" {at} ({point})"


def wait_sentence(
    wait: WaitsFor, objects: Sequence[PresentObject] = (), waits: Sequence[WaitsFor] = ()
) -> str:
    """Say why one robot does not move on.

    Args:
        wait: what it waits for.
        objects: things and people that took part, to say who pushes what.
        waits: all of the account, to name together what cuts off the robot together.
    """
    texts = {item.name: object_text(item) for item in objects}
    solids = [object_text(item) for item in objects if item.kind in ("furniture", "blockage")]
    resource = texts.get(wait.resource, wait.resource)
    if wait.blocked_by and not wait.seen:
        return f"{wait.robot} goes on once {wait.blocked_by} is gone."
    if wait.cause == "queue" and not wait.blocked_by:
        return f"{wait.robot} waits for {resource or 'a resource'}, and no robot keeps it out."
    if wait.cause == "queue" and not resource:
        return f"{wait.robot} waits for {wait.blocked_by}, as the stack reports."
    text = CAUSES.get(wait.cause, f"is blocked ({wait.cause})").format(
        other=wait.blocked_by or "another robot",
        resource=resource or "a resource",
        solid=f": {resource or listed(solids)}" if resource or solids else "",
        because=_what_cuts_off(wait, waits, texts) if wait.cause == "no-path" else "",
    )
    return f"{wait.robot} {text}."


def _what_cuts_off(wait: WaitsFor, waits: Sequence[WaitsFor], texts: Mapping[str, str]) -> str:
    """Say what cuts a robot off its goal, empty if that is not known."""
    if wait.blocked_by:
        return f"; {wait.blocked_by} cuts it off"
    if wait.resource == "unreachable":
        return "; walls cut it off for good"
    alike = (wait.robot, "no-path", "")
    solids = [w.resource for w in waits if (w.robot, w.cause, w.blocked_by) == alike]
    named = [texts.get(name, name) for name in solids or [wait.resource] if name]
    return f"; {listed(named)} {'cuts' if len(named) == 1 else 'cut'} it off" if named else ""


def account_sentences(account: WaitAccount) -> tuple[str, ...]:
    """Tell who waits for whom, the root first, and where they were if that is not one place."""
    waits = tuple(dict.fromkeys(_sentence_of(wait, account) for wait in account.waits))
    return (*waits, _places_sentence(account)) if _are_apart(account) else waits


def _are_apart(account: WaitAccount) -> bool:
    """Whether the members stand too far apart to name one place for all."""
    if len(account.places) < 2:
        return False
    points = [(row.x, row.y) for row in account.places]
    middle = (statistics.fmean(x for x, _ in points), statistics.fmean(y for _, y in points))
    return any(math.dist(point, middle) > APART for point in points)


def _places_sentence(account: WaitAccount) -> str:
    """Say where each member stood when the failure was found."""
    rows = account.places[:MAX_NAMES]
    beyond = len(account.places) - len(rows)
    more = [f"{beyond} more were elsewhere"] if beyond else []
    were = [f"{row.robot} was{_place(row._asdict())}" for row in rows]
    return f"When it was found, {listed([*were, *more])}."


def _sentence_of(wait: WaitsFor, account: WaitAccount) -> str:
    """Tell of one wait; of a victim with nothing in its way, what copies without members say."""
    if wait.cause != STALLED or wait.robot not in account.victims:
        return wait_sentence(wait, account.objects, account.waits)
    holders = listed(account.members)
    gone = f"once {holders} is gone" if len(account.members) == 1 else f"without one of {holders}"
    return f"{wait.robot} has nothing in its way, but goes on only {gone}."


def robustness_text(value: float) -> str:
    """Write a robustness with three digits and a sign, or as a word if it is infinite."""
    if math.isinf(value):
        return "unbounded" if value > 0 else "-unbounded"
    return f"{value:+.3g}"


def evidence_text(evidence: dict[str, Any]) -> str:
    """Write the evidence of a verdict as indented JSON, cut off where it is long."""
    text = json.dumps(codec.encode(evidence), indent=1, sort_keys=True)
    return text if len(text) <= MAX_EVIDENCE else text[:MAX_EVIDENCE] + "\n..."


def guess_text(found: Guess, verdict: Verdict, trace: Trace) -> str:
    """Say what decided for a layer, or that nothing did.

    Args:
        found: the guess.
        verdict: it is about.
        trace: of the run.
    """
    if not found.robots:
        return f"A guess by rules from the trace: {found.rule}."
    names = list(found.robots)
    who = listed(names) if len(names) <= MAX_NAMES else f"the {len(names)} robots"
    until = trace.duration if verdict.violated_at is None else verdict.violated_at
    return f"A guess by rules from the trace: {blocked_text(who, until, found.spent)}."


def blocked_text(who: str, until: float, spent: Mapping[str, float]) -> str:
    """Say what had held robots up.

    Args:
        who: the robots.
        until: end of the time in question [s].
        spent: seconds by cause, as ``attribution.blocked_time`` gives them.
    """
    lasting = {cause: time for cause, time in spent.items() if time >= SHOWN_FROM}
    if spent and not lasting:
        causes = listed([cause for cause in spent if cause != STALLED])
        what = f"was held up by {causes}" if causes else "stood with nothing in the way"
        return f"at {until:.1f} s, {who} {what}"
    idle = lasting.pop(STALLED, 0.0)
    ordered = sorted(lasting.items(), key=lambda item: (-item[1], item[0]))
    times = [f"{time:.1f} s ({cause})" for cause, time in ordered]
    times += [f"{idle:.1f} s (nothing in the way)"] if idle else []
    stood = f"had stood for {listed(times)}" if times else "had not been blocked"
    stood += " (times may overlap)" if len(ordered) > 1 else ""
    return f"until {until:.1f} s, {who} {stood}"


# --- what a stack did wrong beside driving badly --------------------------------------------

#: what a layer, or the stack, did, by the kind of its failure
DID = {
    "crash": "crashed",
    "hang": "hung",
    "memory": "took too much memory",
    "answer": "answered nonsense",
}
#: where answers that differ usually come from
NOISE = (
    "Usual sources: threads, clocks, random numbers without a seed, the order of sets (hash seeds)."
)
_OTHERWISE = "the same run again may go otherwise"
#: what each coupling of a stack to simulated time means
COUPLED: dict[Coupling, str] = {
    "stepped": "stepped: it answered when all of a tick's work was done",
    "awaited": f"awaited: it waited for its parts, up to a limit; {_OTHERWISE}",
    "paced": f"paced: its parts ran by the wall clock; {_OTHERWISE}",
}


def coupling_facts(coupling: Coupling | None) -> tuple[tuple[str, str], ...]:
    """Say how tightly a foreign stack was coupled; nothing of the shipped one."""
    return (("coupling", COUPLED[coupling]),) if coupling is not None else ()


def stack_failure_sentence(verdict: Verdict) -> str:
    """Say how the stack failed to answer a tick, and where in its code.

    Args:
        verdict: violated, of ``stack_runs``.
    """
    evidence = verdict.evidence
    who = str(evidence.get("layer") or "stack").replace("_", " ")
    what = DID.get(str(evidence.get("kind")), "failed")
    exception, message = evidence.get("exception", ""), evidence.get("message", "")
    is_named = evidence.get("kind") == "crash" and exception and exception not in message
    why = f"{exception}: {message}" if is_named and message else message or exception
    frames = evidence.get("frames") or []
    where = f" ({frames[-1]})" if frames else ""
    when = f" at {verdict.violated_at:.2f} s" if verdict.violated_at is not None else ""
    return f"The {who} {what}{when}{f': {why}' if why else ''}{where}."


def repeated_sentence(verdict: Verdict) -> str:
    """Say which answer differed when the stack was asked again.

    Args:
        verdict: violated, of ``repeatable``.
    """
    evidence = verdict.evidence
    of = f" of {evidence['robot']}" if evidence.get("robot") else ""
    when = f" at {verdict.violated_at:.2f} s" if verdict.violated_at is not None else ""
    tick = f" (tick {evidence['tick']})" if "tick" in evidence else ""
    return (
        f"Asked the same again{when}{tick}, the stack answered otherwise: {evidence['field']}{of} "
        f"was {evidence['first']} and then {evidence['again']}. {NOISE}"
    )
