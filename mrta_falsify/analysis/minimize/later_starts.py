"""Worlds that begin later: when the fleet was at rest, or where a robot had delivered."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence

from mrta_falsify.analysis.minimize.edits import HORIZON_MARGIN
from mrta_falsify.core.arrays import frozen_array
from mrta_falsify.core.errors import InputError
from mrta_falsify.core.world import Event, HumanSpec, Task, World
from mrta_falsify.lab import Course, TimedPose

RESTS_TRIED = 2  # moments of rest at which a world may begin, the latest first
ARRIVAL_SLACK = 1.0  # s: a task that arrives this much before a rest still follows it


def later_starts(world: World, course: Course) -> Iterator[tuple[str, World]]:
    """Yield worlds that begin later, each with what it leaves out in words; the shortest first."""
    if _people_stay(world):
        for rest in course.rests[:RESTS_TRIED]:
            yield _begun_at(world, rest)
    for robot in world.robots:
        for place in reversed(course.delivered.get(robot.name, ())):
            begun = _begun_by(world, course, robot.name, place)
            if begun is not None:
                yield f"what {robot.name} delivered before {place.time:.0f} s", begun


def _people_stay(world: World) -> bool:
    """Whether people are where they are at any time, so that earlier time can be cut off."""
    return all(not human.directives and len(human.route) <= 1 for human in world.humans)


def _begun_at(world: World, rest: Sequence[TimedPose]) -> tuple[str, World]:
    """Begin when the fleet was at rest."""
    time = rest[0].time
    shift = min(task.arrival for task in world.tasks if task.arrival >= time - ARRIVAL_SLACK)
    robots = tuple(
        dataclasses.replace(
            robot, pose=frozen_array(place.pose), joins_at=max(0.0, robot.joins_at - shift)
        )
        for robot, place in zip(world.robots, rest, strict=True)
    )
    changed = dataclasses.replace(
        world,
        robots=robots,
        humans=tuple(_person_earlier(human, shift) for human in world.humans),
        tasks=tuple(_task_earlier(task, shift) for task in world.tasks if task.arrival >= shift),
        events=tuple(_event_earlier(event, shift) for event in world.events if event.end > shift),
        horizon=max(world.horizon - shift, HORIZON_MARGIN),
    )
    return f"the first {shift:.0f} s", changed


def _task_earlier(task: Task, shift: float) -> Task:
    return dataclasses.replace(
        task, arrival=task.arrival - shift, deadline=max(task.deadline - shift, 0.0)
    )


def _person_earlier(human: HumanSpec, shift: float) -> HumanSpec:
    return dataclasses.replace(
        human,
        appears_at=max(0.0, human.appears_at - shift),
        leaves_at=max(0.0, human.leaves_at - shift),
    )


def _event_earlier(event: Event, shift: float) -> Event:
    return dataclasses.replace(event, start=max(0.0, event.start - shift), end=event.end - shift)


def _begun_by(world: World, course: Course, name: str, place: TimedPose) -> World | None:
    """Begin with one robot where it had delivered something, without what it had done by then."""
    count = sum(other.time <= place.time for other in course.delivered[name])
    mine = course.had.get(name, ())
    if count >= len(mine):
        return None
    # those known first were delivered first; a wrong guess costs a run
    order = sorted(mine, key=lambda i: (world.tasks[i].arrival, i))
    gone, kept = order[:count], set(order[count:])
    tasks = [
        dataclasses.replace(task, arrival=max(task.arrival, place.time)) if i in kept else task
        for i, task in enumerate(world.tasks)
        if i not in gone
    ]
    robots = [
        dataclasses.replace(robot, pose=frozen_array(place.pose)) if robot.name == name else robot
        for robot in world.robots
    ]
    try:
        return dataclasses.replace(world, robots=tuple(robots), tasks=tuple(tasks))
    except InputError:  # a deadline before its arrival
        return None
