"""Smaller worlds that may still fail, in the order in which they are worth a run.

The first guess comes from the run itself: only what the verdict names, and what stood near the
robots it names, is kept. What is left is taken apart by delta debugging, each group from large
chunks down to single things; a robot goes together with the tasks it had, so that the others
keep theirs. What happened before the fleet was last at rest is cut off, and what one robot
delivered before the task that matters is replaced by its start where it would have been.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mrta_falsify.core.arrays import Array, frozen_array
from mrta_falsify.core.errors import InputError
from mrta_falsify.core.task_history import last_robots, robots_of, tasks_of
from mrta_falsify.core.trace import Trace
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.core.world import Blockage, CommsOutage, Task, World

#: groups of things, in the order in which they are tried
GROUPS = ("humans", "furniture", "events", "robots", "tasks")
MARGIN = 15.0  # s of horizon behind the violation
NEAR = 1.0  # m from the way of a robot concerned: things kept by the first guess
WIDE = 3.0  # m, the same by the second guess, which keeps all robots
RESTS = 2  # moments of rest that are tried, the latest first


@dataclass(frozen=True, slots=True, kw_only=True)
class Start:
    """Where a robot was when something was delivered."""

    time: float  #: [s]
    pose: tuple[float, ...]  #: x [m], y [m], yaw [rad], map frame


@dataclass(frozen=True, slots=True, kw_only=True)
class Course:
    """What a failing run says about where it can be shortened."""

    found: float | None  #: time of the violation [s]
    had: dict[str, tuple[int, ...]]  #: tasks by the robot that had them last
    delivered: dict[str, tuple[Start, ...]]  #: by robot, one for each of its deliveries
    rests: tuple[tuple[Start, ...], ...]  #: poses of all robots when nothing was left to do


def course_of(verdict: Verdict, trace: Trace, world: World) -> Course:
    """The course of a run that fails.

    Args:
        verdict: the violated one that explains it.
        trace: of the run, with its columns.
        world: of the run.
    """
    had: dict[str, list[int]] = {name: [] for name in trace.robots}
    for task, robot in sorted(last_robots(trace).items()):
        had[robot].append(task)
    delivered: dict[str, list[Start]] = {name: [] for name in trace.robots}
    done: dict[int, float] = {}
    for event in trace.events:
        if event.kind == "dropped-off" and event.robot >= 0:
            done[event.task] = event.time
            delivered[trace.robots[event.robot]].append(_start(trace, event.robot, event.time))
    return Course(
        found=verdict.violated_at,
        had={name: tuple(tasks) for name, tasks in had.items()},
        delivered={name: tuple(starts) for name, starts in delivered.items()},
        rests=tuple(_rests(trace, world, done)),
    )


def _start(trace: Trace, robot: int, time: float) -> Start:
    tick = min(int(np.searchsorted(trace.columns["time"], time)), len(trace) - 1)
    pose = trace.columns["pose"][tick, robot]
    return Start(time=float(trace.columns["time"][tick]), pose=tuple(map(float, pose)))


def _rests(trace: Trace, world: World, done: dict[int, float]) -> Iterator[tuple[Start, ...]]:
    """Poses just before a task arrives at a fleet that has delivered all earlier ones."""
    arrivals = sorted({task.arrival for task in world.tasks}, reverse=True)
    for arrival in arrivals:
        earlier = [i for i, task in enumerate(world.tasks) if task.arrival < arrival]
        if earlier and all(done.get(i, np.inf) <= arrival <= trace.duration for i in earlier):
            yield tuple(_start(trace, i, arrival) for i in range(len(trace.robots)))


# --- guesses ---------------------------------------------------------------------------


def concerned(world: World, verdict: Verdict, trace: Trace, *, wide: bool = False) -> World | None:
    """``world`` with only what the violation seems to need.

    Args:
        world: that fails.
        verdict: the violated one that explains it.
        trace: of its run.
        wide: keep all robots and tasks, and things farther away.

    Returns:
        The smaller world, None if it is no valid one.
    """
    until = _behind(verdict)
    course = course_of(verdict, trace, world)
    names = set(trace.robots) if wide else _robots_named(verdict, trace)
    tracks = trace.columns["pose"][:, [i for i, n in enumerate(trace.robots) if n in names], :2]
    moments = trace.columns["time"] <= until
    way = tracks[moments][::5].reshape(-1, 2)
    reach = WIDE if wide else NEAR
    due = [i for i, task in enumerate(world.tasks) if task.arrival <= until]
    had = {task for name in names for task in course.had.get(name, ())}
    people = set(verdict.who) | {e["blocked_by"] for e in verdict.evidence.get("cycle", [])}
    met = _met(trace, moments, tracks, reach)
    try:
        chosen = dataclasses.replace(
            world,
            robots=tuple(robot for robot in world.robots if robot.name in names),
            tasks=tuple(world.tasks[i] for i in due if wide or i in had),
            humans=tuple(h for h in world.humans if h.name in people or h.name in met),
            furniture=tuple(f for f in world.furniture if _distance(f.polygon, way) < reach),
            events=tuple(
                event
                for event in _events_of(world, names)
                if event.start <= until
                and (not isinstance(event, Blockage) or _distance(event.polygon, way) < reach)
            ),
            horizon=min(world.horizon, until + MARGIN),
        )
    except InputError:
        return None
    return chosen if chosen.robots and chosen.tasks else None


def _behind(verdict: Verdict) -> float:
    if verdict.violated_at is None or verdict.spec == "all_tasks_done":
        return float("inf")
    return verdict.violated_at


def _robots_named(verdict: Verdict, trace: Trace) -> set[str]:
    """Robots of the cycle and whom they wait for, else those of the verdict and of its tasks."""
    cycle = verdict.evidence.get("cycle", [])
    named = {edge[key] for edge in cycle for key in ("robot", "blocked_by")}
    named = (named or set(verdict.who)) & set(trace.robots)
    named |= set(robots_of(tasks_of(verdict), trace))
    return named or set(trace.robots)


def _met(trace: Trace, moments: NDArray[np.bool_], tracks: Array, reach: float) -> set[str]:
    """People who were ever within ``reach`` [m] of ``tracks`` ``(K, n, 2)`` [m]."""
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


# --- changes ---------------------------------------------------------------------------


def without(world: World, group: str, gone: Sequence[int], had: Sequence[int] = ()) -> World | None:
    """``world`` without some things of a group, and without the tasks that robots had.

    Args:
        world: to make smaller.
        group: one of ``GROUPS``.
        gone: indices in it.
        had: indices of tasks that go along.

    Returns:
        The world, None if it is no valid one: someone pushes what would be gone, say, or
        nobody or nothing to do would be left.
    """
    changes: dict[str, Any] = {group: _others(getattr(world, group), gone)}
    if group == "robots":
        changes["tasks"] = _others(world.tasks, had)
        changes["events"] = _events_of(world, {robot.name for robot in changes["robots"]})
    try:
        smaller = dataclasses.replace(world, **changes)
    except InputError:
        return None
    return smaller if smaller.robots and smaller.tasks else None


def _others(items: Sequence[Any], gone: Sequence[int]) -> tuple[Any, ...]:
    left_out = set(gone)
    return tuple(item for i, item in enumerate(items) if i not in left_out)


def _events_of(world: World, names: set[str]) -> tuple[Any, ...]:
    """Events, outages without robots that are gone."""
    return tuple(
        dataclasses.replace(event, robots=tuple(n for n in event.robots if n in names))
        if isinstance(event, CommsOutage) and event.robots
        else event
        for event in world.events
        if not isinstance(event, CommsOutage) or not event.robots or names & set(event.robots)
    )


def later_starts(world: World, course: Course) -> Iterator[tuple[str, World]]:
    """Worlds that begin later, in words and as they are; the shortest first."""
    if _stays_the_same(world):
        for rest in course.rests[:RESTS]:
            yield from _begun_at(world, rest)
    for robot in world.robots:
        for start in reversed(course.delivered.get(robot.name, ())):
            yield from _begun_by(world, course, robot.name, start)


def _stays_the_same(world: World) -> bool:
    """Whether people are where they are at any time, so that time may be cut off before."""
    return all(not human.directives and len(human.route) <= 1 for human in world.humans)


def _begun_at(world: World, rest: Sequence[Start]) -> Iterator[tuple[str, World]]:
    time = rest[0].time
    shift = min(task.arrival for task in world.tasks if task.arrival >= time - 1.0)
    tasks = [_earlier(task, shift) for task in world.tasks if task.arrival >= shift]
    robots = [
        dataclasses.replace(
            robot, pose=frozen_array(start.pose), joins_at=max(0.0, robot.joins_at - shift)
        )
        for robot, start in zip(world.robots, rest, strict=True)
    ]
    people = [
        dataclasses.replace(
            human,
            appears_at=max(0.0, human.appears_at - shift),
            leaves_at=max(0.0, human.leaves_at - shift),
        )
        for human in world.humans
    ]
    events = [
        dataclasses.replace(event, start=max(0.0, event.start - shift), end=event.end - shift)
        for event in world.events
        if event.end > shift
    ]
    yield (
        f"the first {shift:.0f} s",
        dataclasses.replace(
            world,
            robots=tuple(robots),
            humans=tuple(people),
            tasks=tuple(tasks),
            events=tuple(events),
            horizon=max(world.horizon - shift, MARGIN),
        ),
    )


def _earlier(task: Task, shift: float) -> Task:
    return dataclasses.replace(
        task, arrival=task.arrival - shift, deadline=max(task.deadline - shift, 0.0)
    )


def _begun_by(world: World, course: Course, name: str, start: Start) -> Iterator[tuple[str, World]]:
    """One robot begins where it had delivered something, with what it had not done by then."""
    count = sum(other.time <= start.time for other in course.delivered[name])
    mine = course.had.get(name, ())
    if count >= len(mine):
        return
    # those known first were delivered first; a wrong guess costs a run
    order = sorted(mine, key=lambda i: (world.tasks[i].arrival, i))
    gone, kept = order[:count], set(order[count:])
    tasks = [
        dataclasses.replace(task, arrival=max(task.arrival, start.time)) if i in kept else task
        for i, task in enumerate(world.tasks)
        if i not in gone
    ]
    robots = [
        dataclasses.replace(robot, pose=frozen_array(start.pose)) if robot.name == name else robot
        for robot in world.robots
    ]
    try:
        changed = dataclasses.replace(world, robots=tuple(robots), tasks=tuple(tasks))
    except InputError:  # a deadline before its arrival
        return
    yield f"what {name} delivered before {start.time:.0f} s", changed


# --- values ----------------------------------------------------------------------------


def _calm_robots(world: World) -> World:
    quiet: dict[str, Any] = {
        "position_noise": 0.0,
        "heading_noise": 0.0,
        "wheel_slip": 0.0,
        "command_latency": 0.0,
        "joins_at": 0.0,
    }
    return dataclasses.replace(
        world, robots=tuple(dataclasses.replace(robot, **quiet) for robot in world.robots)
    )


def _calm_people(world: World) -> World:
    humans = tuple(
        dataclasses.replace(human, speed=1.0) if human.speed else human for human in world.humans
    )
    return dataclasses.replace(world, humans=humans)


def _no_service(world: World) -> World:
    return dataclasses.replace(
        world,
        tasks=tuple(
            dataclasses.replace(task, pickup_time=0.0, dropoff_time=0.0) for task in world.tasks
        ),
    )


def _all_at_once(world: World) -> World:
    return dataclasses.replace(
        world, tasks=tuple(dataclasses.replace(task, arrival=0.0) for task in world.tasks)
    )


#: what it is called, and the change
NOMINAL: tuple[tuple[str, Callable[[World], World]], ...] = (
    ("noise and delays of robots", _calm_robots),
    ("noise of obstacle distances", lambda world: dataclasses.replace(world, ray_noise=0.0)),
    ("service times", _no_service),
    ("different paces of people", _calm_people),
    ("different arrivals of tasks", _all_at_once),
)


def named(group: str, items: Sequence[Any]) -> str:
    """Some things of a group, in words."""
    if group == "tasks":
        return f"{len(items)} tasks" if len(items) > 1 else "a task"
    if len(items) == 1:
        return str(items[0].name)
    return f"{len(items)} {group}"
