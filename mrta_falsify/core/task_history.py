"""Who had which task, and what became of it in words."""

from __future__ import annotations

import re

from mrta_falsify.core.trace import Trace
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.core.world import World

MAX_SENTENCES = 6  # tasks of one verdict that get a sentence each


def tasks_of(verdict: Verdict) -> list[int]:
    """Read the numbers of the tasks that a verdict names."""
    found = [re.fullmatch(r"task(\d+)", name) for name in verdict.who]
    return [int(match[1]) for match in found if match]


def robots_of(tasks: list[int], trace: Trace) -> list[str]:
    """Name the robots that had one of ``tasks`` last, in the order of the tasks."""
    last = last_robots(trace)
    return list(dict.fromkeys(last[task] for task in tasks if task in last))


def last_robots(trace: Trace) -> dict[int, str]:
    """Name the robot that had each task last; tasks that no robot had are left out."""
    return {
        event.task: trace.robots[event.robot]
        for event in trace.events
        if event.task >= 0 <= event.robot
    }


def stories(tasks: list[int], world: World, trace: Trace) -> list[str]:
    """Tell what became of the first of ``tasks``, a sentence each, and count the others."""
    told = [story(task, world, trace) for task in tasks[:MAX_SENTENCES] if task < len(world.tasks)]
    if len(tasks) > MAX_SENTENCES:
        told.append(f"{len(tasks) - MAX_SENTENCES} further tasks.")
    return told


def story(number: int, world: World, trace: Trace) -> str:
    """Tell where a task was to go, who had it, and how far it came.

    Args:
        number: of the task in ``world``.
        world: of the run.
        trace: of the run.
    """
    task = world.tasks[number]
    start, end = (world.rooms[room].name for room in (task.start, task.end))
    text = f"task{number}, from {start} to {end}, known at {task.arrival:.1f} s and due at "
    text += f"{task.deadline:.1f} s"
    events = [event for event in trace.events if event.task == number and event.robot >= 0]
    given = [event for event in events if event.kind == "assigned"]
    steps = []
    if given:
        plan = f", {given[-1].detail}" if given[-1].detail else ""
        name = trace.robots[given[-1].robot]
        steps.append(f"was given to {name} (last at {given[-1].time:.1f} s{plan})")
    for kind, word in (("picked-up", "picked up"), ("dropped-off", "delivered")):
        done = next((event for event in events if event.kind == kind), None)
        if done is None:
            steps.append(f"had not been {word} when the run ended at {trace.duration:.1f} s")
            break
        steps.append(f"was {word} by {trace.robots[done.robot]} at {done.time:.1f} s")
    return f"{text}: it {', '.join(steps)}."
