"""Which layer a failure seems to belong to, by rules on what was seen of it.

A first guess that costs no run; ``explain`` checks it by re-runs with one layer changed. The
rules look at the violated specification and at what blocked the robots that lost most time. They
know no names of defects and trust nothing that the stack says of itself.
"""

from __future__ import annotations

from collections.abc import Sequence

from mrta_falsify.campaigns.signature import leading
from mrta_falsify.core.trace import Trace
from mrta_falsify.core.verdict import Verdict

#: layer that decides about what blocks a robot, by cause
LAYER_OF_CAUSE = {
    "queue": "queue_policy",
    "barrier": "controller",
    "cluster": "priority_rule",
    "human": "controller",
    "wall": "costmap",
    "no-path": "planner",
    "stalled": "waypoint_generator",
}
#: layer that should have prevented the violation, by specification
LAYER_OF_CONTACT = {
    "no_robot_robot_contact": "controller",
    "no_robot_human_contact": "controller",
    "human_clearance": "controller",
    "no_robot_static_contact": "costmap",
    "exclusive_use": "queue_policy",
}
#: layer that gives a part of the stack's answer
LAYER_OF_ANSWER = {
    "command": "controller",
    "intent.path": "planner",
    "intent.goal": "planner",
    "intent.waypoint": "waypoint_generator",
    "intent.tasks_left": "allocator",
    "intent.queue": "queue_policy",
}
LITTLE_BLOCKING = 10.0  # s in all, too little to explain a missed deadline


def suspected_layer(verdicts: Sequence[Verdict], trace: Trace) -> str:
    """Name the layer to look at first, empty if nothing is violated.

    Args:
        verdicts: of the run.
        trace: of the run, with its edges.
    """
    verdict = leading(verdicts)
    if verdict is None:
        return ""
    if verdict.spec == "stack_runs":
        return str(verdict.evidence.get("layer", ""))  # whose code failed
    if verdict.spec == "repeatable":
        return LAYER_OF_ANSWER.get(str(verdict.evidence["field"]), "")
    if verdict.spec in LAYER_OF_CONTACT:
        return LAYER_OF_CONTACT[verdict.spec]
    until = verdict.violated_at if verdict.violated_at is not None else float("inf")
    members = [name for name in verdict.who if name in trace.robots]
    spent = blocked_time(trace, until, members or trace.robots)
    if verdict.spec == "no_deadlock":
        causes = {edge["cause"] for edge in verdict.evidence.get("cycle", [])}
        spent = {cause: time for cause, time in spent.items() if cause in causes} or spent
        # A lost exclusion or a forgotten waiter shows in the queue before anywhere else.
        if "queue" in causes:
            return "queue_policy"
    elif sum(spent.values()) < LITTLE_BLOCKING:
        return "allocator"  # no robot was held up, so the plan was too tight
    longest = max(sorted(spent), key=lambda cause: spent[cause], default="")
    return LAYER_OF_CAUSE.get(longest, "")


def blocked_time(trace: Trace, until: float, robots: Sequence[str]) -> dict[str, float]:
    """Add up how long ``robots`` were blocked before ``until`` [s], in seconds by cause."""
    chosen = {trace.robots.index(name) for name in robots}
    spent: dict[str, float] = {}
    for span in trace.edges:
        if span.edge.robot in chosen and span.edge.cause != "task":
            end = min((span.last + 1) * trace.dt, until)
            time = max(0.0, end - span.first * trace.dt)
            spent[span.edge.cause] = spent.get(span.edge.cause, 0.0) + time
    return spent


def members_of(verdict: Verdict | None) -> list[str]:
    """Name the members of the deadlock, none if the failure is another one."""
    if verdict is None or verdict.spec != "no_deadlock":
        return []
    return sorted({edge["robot"] for edge in verdict.evidence.get("cycle", [])})


def waited_for(verdict: Verdict | None, trace: Trace) -> set[str]:
    """Name the members of the deadlock and all that they wait for, directly or through others.

    The verdict names the robots whose wait is certain. It may miss a robot in the chain that the
    stack still moves a little now and then.
    """
    found = set(members_of(verdict))
    if verdict is None or verdict.violated_at is None:
        return found
    tick = round(verdict.violated_at / trace.dt)
    waits = [
        (trace.robots[edge.robot], trace.robots[edge.other])
        for edge in trace.edges_at(tick)
        if edge.other >= 0 and edge.cause not in ("human", "task")
    ]
    while True:
        more = {other for robot, other in waits if robot in found} - found
        if not more:
            return found
        found |= more
