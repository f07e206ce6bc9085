"""Which violation came first, and which ones follow from it.

A run may violate many specifications for one reason. These rules choose the one to tell first:

1. The violation whose cause began first leads. A deadlock begins at its onset, not when it is
   found; lost progress begins when progress ended; anything else when it is violated.
2. What says only that work was late or left undone never leads if something else is violated:
   whatever cost the time came before.
3. A robot of a deadlock gets no nearer, drives in vain and starves. Such a violation follows
   from the deadlock if it comes after the onset, even if the last progress was before it.
4. A person who is touched was passed too closely just before. That is one event: the contact.
5. At the same instant the order is ``TIES``: what ended the run, what was said wrongly or done
   beyond the limits, what touched, what stands still.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from mrta_falsify.core.verdict import Verdict
from mrta_falsify.core.wait_account import first_deadlock, wait_account

DEADLOCK = "no_deadlock"
#: order of violations that begin at the same instant; a specification of the user's own comes first
TIES = (
    "stack_runs",
    "repeatable",
    "honest_events",
    "kinematic_limits",
    "exclusive_use",
    "no_robot_robot_contact",
    "no_robot_static_contact",
    "no_robot_human_contact",
    DEADLOCK,
    "no_livelock",
    "no_starvation",
    "progress",
    "human_clearance",
    "deadlines",
    "all_tasks_done",
)
#: say that work was late, undone or dear, not what went wrong
OUTCOMES = frozenset(("deadlines", "all_tasks_done"))
COSTLY = "costly"  #: how the names of specifications begin that compare with a reference stack
#: what a robot that cannot move violates sooner or later
STANDSTILL = frozenset(("no_livelock", "no_starvation", "progress"))


def leading(verdicts: Sequence[Verdict]) -> Verdict | None:
    """Choose the violated verdict that explains the run, None if nothing is violated."""
    return next((verdict for verdict in by_cause(verdicts) if verdict.violated), None)


def by_cause(verdicts: Sequence[Verdict]) -> tuple[Verdict, ...]:
    """Sort verdicts: the leading one, the other violated ones by time, then those that hold."""
    rank = {name: i for i, name in enumerate(TIES)}

    def key(verdict: Verdict) -> tuple[bool, bool, bool, float, int, str]:
        place = rank.get(verdict.spec, -1)
        if not verdict.violated:
            return (True, False, bool(verdict.not_judged), 0.0, place, verdict.spec)
        is_effect = any(_is_led_by(verdict, other) for other in verdicts if other is not verdict)
        return (False, is_outcome(verdict), is_effect, cause_begins(verdict), place, verdict.spec)

    return tuple(sorted(verdicts, key=key))


def cause_begins(verdict: Verdict) -> float:
    """Tell when the cause of a violation began [s]; inf if that is not known."""
    found = float("inf") if verdict.violated_at is None else verdict.violated_at
    if verdict.spec == DEADLOCK:
        begun = first_deadlock(verdict.evidence).get("onset")
    else:
        begun = verdict.evidence.get("since")
    # the evidence is of the worst moment, which may come after the first violation
    return min(float(begun), found) if isinstance(begun, (int, float)) else found


def root_onsets(verdict: Verdict) -> tuple[float, ...]:
    """List when each member of a deadlock stopped [s], as far as that is known."""
    onsets = first_deadlock(verdict.evidence).get("onsets", {})
    return tuple(float(time) for time in onsets.values())


def first_claim(evidence: Mapping[str, Any]) -> str:
    """Name the kind of the first claim that motion contradicts; empty if there is none."""
    claims = evidence.get("claims", ())
    return str(claims[0].get("kind", "")) if claims else ""


def is_outcome(verdict: Verdict) -> bool:
    """Whether it says only that work was late, undone or dear."""
    return verdict.spec in OUTCOMES or verdict.spec.startswith(COSTLY)


def follows_from(verdict: Verdict, cause: Verdict) -> bool:
    """Whether a violation is a consequence of the deadlock ``cause``.

    It is if it came after the onset and concerns one of the deadlock's robots, or names no robot.
    """
    if verdict is cause or cause.spec != DEADLOCK or not cause.violated or not verdict.violated:
        return False
    if verdict.violated_at is not None and verdict.violated_at < cause_begins(cause):
        return False
    concerned = {name for name in _concerned(verdict) if name}
    return not concerned or bool(concerned & set(wait_account(cause).robots))


def _is_led_by(verdict: Verdict, other: Verdict) -> bool:
    """Whether ``other`` comes first whatever their times are (rules 3 and 4)."""
    if verdict.spec in STANDSTILL:
        return follows_from(verdict, other)
    return (
        verdict.spec == "human_clearance"
        and other.spec == "no_robot_human_contact"
        and other.violated
        and bool(set(verdict.who) & set(other.who))
    )


def _concerned(verdict: Verdict) -> tuple[str, ...]:
    """Name the robots that a violation concerns, as far as it names any."""
    if is_outcome(verdict):
        late = verdict.evidence.get("late", ())
        return tuple(row.get("robot", "") for row in late if isinstance(row, dict))
    return tuple(name for name in verdict.who if not name.startswith("task"))
