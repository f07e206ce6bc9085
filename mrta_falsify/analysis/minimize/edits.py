"""Smaller worlds: without things of a group, and without what belongs to them."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from mrta_falsify.core.errors import InputError
from mrta_falsify.core.world import CommsOutage, Event, World

#: groups of things, in the order in which they are tried
GROUPS = ("humans", "furniture", "events", "robots", "tasks")
HORIZON_MARGIN = 15.0  # s of horizon kept after the violation


class Thing(NamedTuple):
    """Something of a world that may go."""

    group: str  #: one of ``GROUPS``
    number: int  #: in its group


def things_of(world: World) -> list[Thing]:
    """List all things of a world."""
    return [Thing(group, i) for group in GROUPS for i in range(len(getattr(world, group)))]


def without(world: World, group: str, gone: Sequence[int], had: Sequence[int] = ()) -> World | None:
    """Leave some things of a group out of a world, and tasks that go with them.

    Args:
        world: to make smaller.
        group: one of ``GROUPS``.
        gone: indices in the group.
        had: indices of tasks that go along.

    Returns:
        The smaller world. None if it is not valid: a person would push furniture that is gone,
        or no robot or no task would be left.
    """
    return without_things(world, [Thing(group, i) for i in gone], had)


def without_things(
    world: World, things: Collection[Thing], had: Collection[int] = ()
) -> World | None:
    """Leave some things of any groups out of a world.

    Args:
        world: to make smaller.
        things: that go.
        had: indices of tasks that go along.

    Returns:
        As :func:`without`.
    """
    gone: dict[str, set[int]] = {"tasks": set(had)}
    for thing in things:
        gone.setdefault(thing.group, set()).add(thing.number)
    changes: dict[str, Any] = {}
    if "robots" in gone:
        names = {robot.name for robot in _others(world.robots, gone["robots"])}
        orphans = (i for i, task in enumerate(world.tasks) if task.robot not in {"", *names})
        gone["tasks"].update(orphans)
    for group, numbers in gone.items():
        changes[group] = _others(getattr(world, group), numbers)
    if "robots" in gone:
        changes["events"] = events_without(changes.get("events", world.events), names)
    try:
        smaller = dataclasses.replace(world, **changes)
    except InputError:
        return None
    return smaller if smaller.robots and smaller.tasks else None


def tasks_along(
    things: Sequence[Thing], world: World, had: Mapping[str, Sequence[int]]
) -> list[int]:
    """List the tasks of the robots among some things."""
    names = [world.robots[thing.number].name for thing in things if thing.group == "robots"]
    return [task for name in names for task in had.get(name, ())]


def ways_to_remove(
    world: World, group: str, gone: Sequence[int], had: Mapping[str, Sequence[int]]
) -> Iterator[tuple[list[int], str]]:
    """Yield the tasks that go along with some things of a group, and what goes in words.

    Args:
        world: that has them.
        group: one of ``GROUPS``.
        gone: indices in the group.
        had: tasks by the robot that had them last.
    """
    items = [getattr(world, group)[i] for i in gone]
    what = named(group, items)
    # tasks that stay would go to the other robots, and change their routes
    along = tasks_along([Thing(group, i) for i in gone], world, had)
    if along:
        yield along, f"{what} and what {'it' if len(items) == 1 else 'they'} had to do"
    if not along or len(gone) == 1:
        yield [], what


def _others(items: Sequence[Any], gone: Collection[int]) -> tuple[Any, ...]:
    left_out = set(gone)
    return tuple(item for i, item in enumerate(items) if i not in left_out)


def events_without(events: Sequence[Event], names: set[str]) -> tuple[Event, ...]:
    """Restrict outages to the robots ``names``; an outage of none of them is left out."""
    kept: list[Event] = []
    for event in events:
        if not isinstance(event, CommsOutage) or not event.robots:
            kept.append(event)
            continue
        robots = tuple(name for name in event.robots if name in names)
        if robots:
            kept.append(dataclasses.replace(event, robots=robots))
    return tuple(kept)


def named(group: str, items: Sequence[Any]) -> str:
    """Name some things of a group."""
    if group == "tasks":
        return f"{len(items)} tasks" if len(items) > 1 else "a task"
    if len(items) == 1:
        return str(items[0].name)
    return f"{len(items)} {group}"
