"""The first guess at the smallest world: only what the violation names and what stood near it."""

from __future__ import annotations

import dataclasses

import numpy as np

from mrta_falsify.analysis.minimize.edits import HORIZON_MARGIN, events_without
from mrta_falsify.core.arrays import Array, BoolArray
from mrta_falsify.core.errors import InputError
from mrta_falsify.core.task_history import robots_of, tasks_of
from mrta_falsify.core.trace import Trace
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.core.wait_account import wait_account
from mrta_falsify.core.world import Blockage, World
from mrta_falsify.lab import course_of

KEPT_WITHIN = 1.0  # m from the route of a robot concerned: things that the first guess keeps
KEPT_WITHIN_WIDE = 3.0  # m, the same for the second guess, which keeps all robots
WAY_STRIDE = 5  # ticks between two points of a route that distances are taken from


def concerned(world: World, verdict: Verdict, trace: Trace, *, wide: bool = False) -> World | None:
    """Reduce ``world`` to what the violation seems to need.

    Args:
        world: that fails.
        verdict: the violated one that explains the failure.
        trace: of its run.
        wide: keep all robots and tasks, and things farther away.

    Returns:
        The smaller world, None if it is not valid.
    """
    until = end_of_interest(verdict)
    names = set(trace.robots) if wide else _robots_named(verdict, trace)
    tracks = trace.columns["pose"][:, [i for i, n in enumerate(trace.robots) if n in names], :2]
    moments = trace.columns["time"] <= until
    way = tracks[moments][::WAY_STRIDE].reshape(-1, 2)
    reach = KEPT_WITHIN_WIDE if wide else KEPT_WITHIN
    course = course_of(verdict, trace, world)
    had = {task for name in names for task in course.had.get(name, ())}
    due = [i for i, task in enumerate(world.tasks) if task.arrival <= until]
    people = _people_named(verdict) | _people_met(trace, moments, tracks, reach)
    events = [event for event in events_without(world.events, names) if event.start <= until]
    try:
        chosen = dataclasses.replace(
            world,
            robots=tuple(robot for robot in world.robots if robot.name in names),
            tasks=tuple(world.tasks[i] for i in due if wide or i in had),
            humans=tuple(human for human in world.humans if human.name in people),
            furniture=tuple(f for f in world.furniture if _distance(f.polygon, way) < reach),
            events=tuple(
                event
                for event in events
                if not isinstance(event, Blockage) or _distance(event.polygon, way) < reach
            ),
            horizon=min(world.horizon, until + HORIZON_MARGIN),
        )
    except InputError:
        return None
    return chosen if chosen.robots and chosen.tasks else None


def end_of_interest(verdict: Verdict) -> float:
    """Time of the violation [s], infinite if the whole run counts."""
    if verdict.violated_at is None or verdict.spec == "all_tasks_done":
        return float("inf")
    return verdict.violated_at


def _robots_named(verdict: Verdict, trace: Trace) -> set[str]:
    """Name the robots that take part in a deadlock, else those of the verdict's tasks."""
    named = {*wait_account(verdict).robots, *verdict.who} & set(trace.robots)
    named |= set(robots_of(tasks_of(verdict), trace))
    return named or set(trace.robots)


def _people_named(verdict: Verdict) -> set[str]:
    """Name the people whom a robot waits for, and those who push what it waits for."""
    return {*verdict.who, *wait_account(verdict).nodes}


def _people_met(trace: Trace, moments: BoolArray, tracks: Array, reach: float) -> set[str]:
    """Name the people who came within ``reach`` [m] of ``tracks`` ``(K, n, 2)`` [m]."""
    people = trace.columns["human_position"][moments]
    if not people.size:
        return set()
    gaps = np.linalg.norm(people[:, :, None] - tracks[moments][:, None], axis=-1)
    near = np.any(gaps < reach, axis=(0, 2))  # people who are away are at NaN
    return {name for name, is_near in zip(trace.humans, near, strict=True) if is_near}


def _distance(polygon: Array, points: Array) -> float:
    """Smallest distance [m] from any of ``points`` ``(n, 2)`` to a solid."""
    from shapely import MultiPoint, Polygon  # noqa: PLC0415 - loads slowly

    return float(Polygon(polygon).distance(MultiPoint(points)))
