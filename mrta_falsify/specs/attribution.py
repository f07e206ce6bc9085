"""Which layer a failure seems to belong to, by rules on what was seen of it.

A first guess that costs no run; ``explain`` checks it by re-runs with one layer changed. The
rules look at the violation that explains the others, at what held up the root of robots that stand,
and at what blocked the robots that lost most time. A place that the world shut is of no layer.
They know no names of defects. Of what the stack says of itself they use its paths, and whether it
gave a task away at all.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.claims import leading_claim
from mrta_falsify.core.config import DISPATCHER, StackConfig
from mrta_falsify.core.spec_profile import profile_of
from mrta_falsify.core.task_history import robots_of, tasks_of
from mrta_falsify.core.trace import Trace
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.core.wait_account import (
    WaitsFor,
    is_kept,
    tick_of,
    wait_account,
)
from mrta_falsify.specs.causes import DEADLOCK, first_claim, is_outcome, is_shut, leading
from mrta_falsify.specs.deadlock.place_kind import WAITING_SPOT, place_kind

QUEUES = "queue_policy"
WORLD = "world"  #: which shut a place during the run; no layer of the stack did
WHOLE = "stack"  #: of which no layer is known: it runs in a process of its own
#: layer that decides about what blocks a robot, by cause
LAYER_OF_CAUSE = {
    "queue": QUEUES,
    "barrier": "controller",
    "cluster": "priority_rule",
    "human": "controller",
    "wall": "costmap",
    "no-path": "planner",
    "stalled": "waypoint_generator",  # where only time lost is known; see also _of_standing
}
#: what holds a robot up, by cause
HOLDER_OF_CAUSE = {
    "queue": "a queue",
    "barrier": "another robot in its path",
    "cluster": "a robot near by that moves",
    "human": "a person",
    "wall": "a solid",
    "no-path": "having no path",
    "stalled": "nothing that is known",
}
#: layer that gives a part of the stack's answer, for one that is not repeatable
LAYER_OF_ANSWER = {
    "command": "controller",
    "intent.path": "planner",
    "intent.goal": "planner",
    "intent.waypoint": "waypoint_generator",
    "intent.tasks_left": "allocator",
    "intent.queue": "queue_policy",
}
#: claims that the queues make, where ``honest_events`` refuses one; the others are the dispatcher's
CLAIMS_OF_QUEUES = frozenset(("released", "granted", "waits-for"))
LITTLE_BLOCKING = 10.0  # s in all, too little to explain a missed deadline
TOO_NEAR = 0.2  # m between a path and a solid: less than the radius 0.22 m of the shipped robots
WAY_LEFT = 0.5  # m of path ahead; a robot with less has nowhere to drive
PATH_STEP = 0.05  # m between points looked at on a path
PATH_AHEAD = 1.5  # m of path that are looked at
STAYED = 1.0  # m from where it started; a robot as near as that may have been there from the start


class Guess(NamedTuple):
    """A layer, and what of the run decided for it."""

    layer: str  #: empty: nothing is violated, or nothing points to one
    rule: str = ""  #: what was seen, as a clause; empty: the time lost decided
    robots: tuple[str, ...] = ()  #: whose time lost decided
    spent: Mapping[str, float] = MappingProxyType({})  #: their time lost [s], by cause


def suspect(config: StackConfig, verdicts: Sequence[Verdict], trace: Trace) -> str:
    """Name the layer of a stack to look at first; see :func:`guess`."""
    return guess(verdicts, trace, whole=config.stack is not None).layer


def guess(verdicts: Sequence[Verdict], trace: Trace, *, whole: bool = False) -> Guess:
    """Guess the layer to look at first.

    Args:
        verdicts: of the run.
        trace: of the run, with its edges.
        whole: the stack's layers are not known, so that none is named but ``WHOLE``.

    Returns:
        The layer, and what decided for it.
    """
    found = _of_verdicts(verdicts, trace)
    has_failed = leading(verdicts) is not None
    return found._replace(layer=WHOLE) if whole and has_failed and found.layer != WORLD else found


def _of_verdicts(verdicts: Sequence[Verdict], trace: Trace) -> Guess:
    verdict = leading(verdicts)
    if verdict is None:
        return Guess("", "nothing is violated")
    if is_shut(verdict):
        return Guess(WORLD, "the world shut a place during the run; no layer of the stack did")
    if verdict.spec == DEADLOCK:
        return _of_standing(verdict, trace)
    if first_claim(verdict.evidence) in CLAIMS_OF_QUEUES:
        return Guess(QUEUES, "it claims what the queues decide")
    if verdict.spec == "exclusive_use":
        return _of_overfull(verdict, trace)
    if layer := profile_of(verdict.spec).layer:
        return Guess(layer, f"{verdict.spec} is its to keep")
    if verdict.spec == "no_robot_static_contact":
        return _of_solid(verdict, next(iter(verdict.who), ""), trace)
    if verdict.spec == "stack_runs":
        return Guess(str(verdict.evidence.get("layer", "")), "its code failed")
    if verdict.spec == "repeatable":
        part = str(verdict.evidence.get("field", ""))
        return Guess(LAYER_OF_ANSWER.get(part, ""), f"{part} differs between equal runs")
    return _of_lost_time(verdict, trace)


# --- robots that stand ---------------------------------------------------------------------


def _of_standing(verdict: Verdict, trace: Trace) -> Guess:
    """Guess by what holds up the root.

    Robots that queue for a robot that is held up by something else wait rightly. A queue is to
    blame if all wait in it, or if one who waits in it stands in the way of another.
    """
    account = wait_account(verdict, trace)
    waits = [wait for robot in account.holding for wait in account.of(robot)]
    reasons = [wait for wait in waits if not (wait.cause == "queue" and wait.blocked_by)]
    queued = {wait.robot for wait in waits if wait.cause == "queue"}
    if not reasons:
        return Guess(QUEUES, "all of them wait in queues")
    for wait in reasons:
        if wait.blocked_by in queued and _is_body(wait):
            told = f"{wait.blocked_by}, which waits in a queue, stands in the way of {wait.robot}"
            return Guess(QUEUES, told)
    root = next((w.robot for w in reasons if w.robot == account.root), reasons[0].robot)
    causes = {wait.cause for wait in reasons if wait.robot == root}
    robots = (root,) if root in trace.robots else ()
    spent = blocked_time(trace, _until(verdict), robots)
    cause = max(sorted(causes), key=lambda name: spent.get(name, 0.0))
    if cause == "stalled" and root == account.root and _is_at_waiting_spot(verdict):
        # the room is free, and whoever should grant it did not
        return Guess(QUEUES, f"{root} stands at a waiting spot with nothing in the way")
    if cause in ("stalled", "wall", "cluster") and _has_no_way_left(trace, root, verdict):
        # whatever stands near by, it was not told where to go on to
        return Guess("waypoint_generator", f"{root} has no path ahead of it")
    if cause == "wall":
        return _of_solid(verdict, root, trace)
    if cause == "stalled":
        return Guess("controller", f"{root} has a path and stands with nothing in the way")
    layer = LAYER_OF_CAUSE.get(cause, "")
    if len(causes) > 1 and robots:
        return Guess(layer, robots=robots, spent=spent)
    return Guess(layer, f"{root} is held up by {HOLDER_OF_CAUSE.get(cause, cause)}")


def _is_body(wait: WaitsFor) -> bool:
    return wait.cause in ("barrier", "no-path")


def _is_at_waiting_spot(verdict: Verdict) -> bool:
    place = leading_claim(verdict.evidence).get("place")
    return isinstance(place, Mapping) and place_kind(place) == WAITING_SPOT


def _has_no_way_left(trace: Trace, robot: str, verdict: Verdict) -> bool:
    """Whether a robot stands at the end of its path, or has none."""
    ahead = _path_ahead(trace, robot, tick_of(verdict, trace))
    return len(ahead) * PATH_STEP <= WAY_LEFT


def _of_solid(verdict: Verdict, robot: str, trace: Trace) -> Guess:
    """Guess what brought a robot to a solid.

    A path that leaves it no room comes from a costmap that does not know the solid, or how wide
    the robot is. Otherwise the controller left the path, or does not get away from where it is.
    """
    if robot not in trace.robots or not is_kept(trace):
        return Guess(LAYER_OF_CAUSE["wall"], "a solid is in the way")
    tick = tick_of(verdict, trace)
    ahead = _path_ahead(trace, robot, tick)
    points = np.asarray(trace.columns["obstacle_points"][tick, trace.robots.index(robot)])
    points = points[np.isfinite(points).all(axis=1)]
    if not len(ahead) or not len(points):
        return Guess("controller", f"{robot} is at a solid that no path leads it to")
    gap = np.hypot(*np.moveaxis(ahead[:, None] - points[None], -1, 0)).min()
    layer = LAYER_OF_CAUSE["wall"] if gap < TOO_NEAR else "controller"
    return Guess(layer, f"the path of {robot} comes to {gap:.2f} m of where its rays hit the solid")


def _path_ahead(trace: Trace, robot: str, tick: int) -> Array:
    """Points ``(K, 2)`` [m], 5 cm apart, of what a robot has still to drive of its path."""
    if robot not in trace.robots or not is_kept(trace):
        return np.empty((0, 2))
    number = trace.robots.index(robot)
    path = trace.path_at(number, tick)
    if len(path) < 2:
        return np.empty((0, 2))
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(path, axis=0).T))])
    steps = np.arange(0.0, along[-1], PATH_STEP)
    dense = np.stack([np.interp(steps, along, path[:, axis]) for axis in (0, 1)], axis=-1)
    if not len(dense):
        return dense
    nearest = int(np.hypot(*(dense - trace.columns["pose"][tick, number, :2]).T).argmin())
    return dense[nearest : nearest + round(PATH_AHEAD / PATH_STEP)]


def _of_overfull(verdict: Verdict, trace: Trace) -> Guess:
    """Guess what let one robot too many into a resource.

    The queues did, unless a robot is inside that was never let in and has its goal elsewhere. Its
    path leads through the resource then.
    """
    resource, near = verdict.evidence.get("resource"), verdict.evidence.get("nearest", ())
    told = [event for event in trace.events if event.resource == resource]
    let_in = {trace.robots[event.robot] for event in told if event.kind in ("granted", "released")}
    if not any(event.kind == "granted" for event in told) or not is_kept(trace):
        return Guess(QUEUES, "one robot too many is inside")
    tick = tick_of(verdict, trace)
    pose = trace.columns["pose"][:, :, :2]
    for robot in (trace.robots.index(name) for name in near if name not in let_in):
        goal = trace.columns["goal"][tick, robot]
        came = np.hypot(*(pose[tick, robot] - pose[0, robot])) > STAYED
        if came and np.hypot(*(goal - pose[tick, robot])) > PATH_AHEAD:
            name = trace.robots[robot]
            return Guess("planner", f"{name} was never let in and has its goal elsewhere")
    return Guess(QUEUES, "one robot too many was let in")


# --- lost time ---------------------------------------------------------------------


def _of_lost_time(verdict: Verdict, trace: Trace) -> Guess:
    """Guess by what cost the time.

    A task that no robot was given was not allocated, or never offered to the allocator. If the
    robots concerned were held up, what held them up longest decides. A robot that drove in vain
    with little in its way was not controlled well. Work that was late although little held its
    robots up points nowhere: the plan may have been tight, the robot slow, or the deadline short.
    """
    tasks = tasks_of(verdict)
    given = {event.task for event in trace.events if event.kind == "assigned"}
    forgotten = [task for task in tasks if task not in given]
    if forgotten:
        if _was_considered(forgotten, trace):
            return Guess("allocator", "it was asked about the task and gave it to no robot")
        return Guess(DISPATCHER, "the task was given to no robot, and the allocator not asked")
    layer = "" if is_outcome(verdict) or tasks else "controller"
    robots = _robots_concerned(verdict, trace)
    if not robots:
        return Guess(layer, "no robot had the task")
    spent = blocked_time(trace, _until(verdict), robots)
    if sum(spent.values()) >= LITTLE_BLOCKING:
        layer = LAYER_OF_CAUSE.get(max(sorted(spent), key=lambda cause: spent[cause]), "")
    return Guess(layer, robots=tuple(robots), spent=spent)


def _was_considered(tasks: Sequence[int], trace: Trace) -> bool:
    """Whether the allocator was asked about one of ``tasks``: it left it out, or was refused."""
    notes = [event.detail for event in trace.events if event.kind == "allocated"]
    named = {int(number) for note in notes for number in re.findall(r"\d+", note)}
    refused = any(event.kind == "allocation-refused" for event in trace.events)
    return refused or bool(named & set(tasks))


def _robots_concerned(verdict: Verdict, trace: Trace) -> list[str]:
    """Name the robots whose waits count: those named, else those with the late tasks."""
    named = [name for name in verdict.who if name in trace.robots]
    return named or robots_of(tasks_of(verdict), trace)


def _until(verdict: Verdict) -> float:
    return float("inf") if verdict.violated_at is None else verdict.violated_at


def blocked_time(trace: Trace, until: float, robots: Sequence[str]) -> dict[str, float]:
    """Add up how long ``robots`` were blocked before ``until`` [s], in seconds by cause.

    A robot that several hold at once for one cause is blocked once.
    """
    chosen = {trace.robots.index(name) for name in robots}
    spans: dict[tuple[int, str], list[tuple[float, float]]] = {}
    for span in trace.edges:
        if span.edge.robot in chosen and span.edge.cause != "task":
            begin, end = span.first * trace.dt, min((span.last + 1) * trace.dt, until)
            spans.setdefault((span.edge.robot, span.edge.cause), []).append((begin, end))
    spent: dict[str, float] = {}
    for (_, cause), times in spans.items():
        covered = -np.inf
        for begin, end in sorted(times):
            spent[cause] = spent.get(cause, 0.0) + max(0.0, end - max(begin, covered))
            covered = max(covered, end)
    return spent
