"""What happened, in one canonical line: failures with the same signature are one mode.

A signature names the violated specification that explains the others, the canonical wait-for
cycle over what blocks whom (causes, never names of robots), and the place. Parameters of the
scenario play no part: two very different worlds in which two loaded robots meet in the same
corridor fail in the same mode.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from mrta_falsify.core.verdict import Verdict

#: the first one that is violated explains the run; the others are its consequences
PRECEDENCE = (
    "stack_runs",
    "repeatable",
    "no_robot_robot_contact",
    "no_robot_static_contact",
    "no_robot_human_contact",
    "no_deadlock",
    "exclusive_use",
    "no_livelock",
    "no_starvation",
    "progress",
    "human_clearance",
    "deadlines",
    "all_tasks_done",
)
PLACE_RADIUS = 3.0  # m from a named place that still count as there


def signature(verdicts: Sequence[Verdict]) -> str:
    """Write the signature of a run, empty if nothing is violated.

    Args:
        verdicts: of one run.

    Returns:
        For example ``no_deadlock/2:barrier>barrier/queue of ward_3``.
    """
    verdict = leading(verdicts)
    if verdict is None:
        return ""
    parts = [verdict.spec]
    if verdict.spec == "stack_runs":
        keys = ("kind", "layer", "exception")
        parts += [str(verdict.evidence[key]) for key in keys if verdict.evidence.get(key)]
    if verdict.spec == "repeatable":
        parts.append(str(verdict.evidence["field"]))
    if verdict.spec == "no_deadlock":
        parts.append(canonical_cycle(verdict.evidence.get("cycle", [])))
    place = _place(verdict.evidence.get("place"))
    if place:
        parts.append(place)
    return "/".join(parts)


def leading(verdicts: Sequence[Verdict]) -> Verdict | None:
    """Choose the violated verdict that explains the run, None if all hold."""
    violated = [verdict for verdict in verdicts if verdict.violated]
    known = {name: i for i, name in enumerate(PRECEDENCE)}
    return min(
        violated, key=lambda verdict: (known.get(verdict.spec, -1), verdict.spec), default=None
    )


def canonical_cycle(edges: Sequence[dict[str, str]]) -> str:
    """Write a wait-for cycle without names.

    Args:
        edges: rows ``robot``, ``cause``, ``blocked_by``, ``resource`` as in the evidence of
            ``no_deadlock``.

    Returns:
        Number of members, then their labels. If each member waits for one other member, they are
        in the order of the cycle, in its smallest rotation; otherwise they are sorted.
    """
    labels: dict[str, list[str]] = {}
    waits: dict[str, set[str]] = {}
    for edge in edges:
        labels.setdefault(edge["robot"], []).append(edge["cause"])
        if edge["blocked_by"]:
            waits.setdefault(edge["robot"], set()).add(edge["blocked_by"])
    names = {robot: "+".join(sorted(set(causes))) for robot, causes in labels.items()}
    ring = _ring(waits, set(names))
    if ring:
        words = [names[robot] for robot in ring]
        turns = [words[i:] + words[:i] for i in range(len(words))]
        return f"{len(words)}:" + ">".join(min(turns))
    return f"{len(names)}:" + ",".join(sorted(names.values()))


def _ring(waits: dict[str, set[str]], members: set[str]) -> list[str]:
    """Order the members if each waits for exactly one other and all are on one ring."""
    if not members or any(len(waits.get(robot, set()) & members) != 1 for robot in members):
        return []
    ring = [min(members)]
    while True:
        (following,) = waits[ring[-1]] & members
        if following == ring[0]:
            return ring if len(ring) == len(members) else []
        if following in ring:
            return []
        ring.append(following)


def _place(place: Any) -> str:
    if not isinstance(place, dict) or not place.get("near"):
        return ""
    beyond = float(place.get("distance", 0.0)) > PLACE_RADIUS
    return f"beyond {place['near']}" if beyond else str(place["near"])
