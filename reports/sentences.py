"""Verdicts in plain words: what happened, when, to whom, and why."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from typing import Any

from mrta_falsify.core import codec
from mrta_falsify.core.verdict import Verdict
from reports.stack_sentences import repeated_sentence, stack_failure_sentence

AT_PLACE = 0.5  # m; nearer than this, something happened at a place
MOST_EVIDENCE = 4000  # characters of the evidence of one verdict
#: what a blocked-by cause means, said of the robot that is blocked; {other} and {resource}
CAUSES = {
    "queue": "waits for {resource}: {other} holds it or is ahead in the queue",
    "barrier": "cannot drive on because {other} stands in its path",
    "cluster": "has a free path but waits for {other}, which is near and moves first",
    "human": "stands still because {other}, a person, is in the way",
    "wall": "is held back by a solid{resource_in_brackets}",
    "no-path": "has a goal but no path to it{because}",
    "stalled": "has a goal and a free path but does not drive",
    "task": "waits for a task",
}

MEANINGS = {
    "no_robot_robot_contact": "two robots touched",
    "no_robot_static_contact": "a robot touched a wall or furniture",
    "no_robot_human_contact": "a moving robot touched a person",
    "human_clearance": "a moving robot came closer than 0.1 m to a person",
    "all_tasks_done": "not all tasks were delivered",
    "deadlines": "a deadline was missed",
    "no_deadlock": "robots wait for each other and nothing can resolve it",
    "exclusive_use": "two robots held a resource that only one may hold",
    "no_livelock": "a robot kept driving without getting closer to its goal",
    "no_starvation": "a robot went on waiting while later ones were served",
    "progress": "a robot with work made no progress",
}


def listed(names: Sequence[str]) -> str:
    """List names as ``a``, ``a and b`` or ``a, b and c``."""
    if len(names) < 2:
        return "".join(names)
    return f"{', '.join(names[:-1])} and {names[-1]}"


def violation_sentence(verdict: Verdict) -> str:
    """Describe a violated verdict in one sentence, with time, robots and place."""
    when = f" at {verdict.violated_at:.1f} s" if verdict.violated_at is not None else ""
    who = listed(verdict.who)
    where = _place(verdict.evidence.get("place"))
    if verdict.spec == "no_deadlock":
        alone = len(verdict.who) == 1
        what = "is stuck for good" if alone else "are deadlocked"
        stood = "it has stood" if alone else "they have stood"
        onset = verdict.evidence.get("onset")
        since = f"; {stood} since {onset:.1f} s" if isinstance(onset, float) else ""
        return f"{who} {what}{where} (found{when}){since}."
    if verdict.spec == "stack_runs":
        return stack_failure_sentence(verdict)
    if verdict.spec == "repeatable":
        return repeated_sentence(verdict)
    if verdict.spec.startswith("stl"):
        return f"The formula is false{when} (robustness {verdict.robustness:+.3g})."
    meaning = MEANINGS.get(verdict.spec, f"{verdict.spec} is violated")
    concerned = f": {who}" if who else ""
    return f"{meaning[0].upper()}{meaning[1:]}{when}{concerned}{where}."


def _place(place: Any) -> str:
    if not isinstance(place, dict) or "near" not in place:
        return ""
    point = f"x {float(place['x']):.1f} m, y {float(place['y']):.1f} m"
    near, distance = place["near"], float(place.get("distance", 0.0))
    if not near:
        return f" at {point}"
    at = f"at {near}" if distance < AT_PLACE else f"{distance:.1f} m from {near}"
    return f" {at} ({point})"


def edge_sentence(edge: dict[str, str]) -> str:
    """Say why one robot of a wait-for cycle does not move on."""
    resource, other = edge.get("resource", ""), edge.get("blocked_by", "")
    because = ""
    if other:
        because = f"; {other} cuts it off"
    elif resource == "unreachable":
        because = "; walls and furniture cut it off for good"
    elif resource:
        because = f"; {resource} cuts it off"
    text = CAUSES.get(edge["cause"], f"is blocked ({edge['cause']})").format(
        other=other or "another robot",
        resource=resource or "a resource",
        resource_in_brackets=f" ({resource})" if resource else "",
        because=because,
    )
    return f"{edge['robot']} {text}."


def robustness_text(value: float) -> str:
    """Write a robustness with three digits and a sign, or as a word if it is infinite."""
    if math.isinf(value):
        return "unbounded" if value > 0 else "-unbounded"
    return f"{value:+.3g}"


def evidence_text(evidence: dict[str, Any]) -> str:
    """Write the evidence of a verdict as indented JSON, cut off where it is long."""
    text = json.dumps(codec.encode(evidence), indent=1, sort_keys=True)
    return text if len(text) <= MOST_EVIDENCE else text[:MOST_EVIDENCE] + "\n..."
