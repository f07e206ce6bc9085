"""Whether a failure depends on the schedule: how long the stack thinks, what it hears first."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

from mrta_falsify.campaigns.journal import RunJournal
from mrta_falsify.core import codec
from mrta_falsify.core.findings import ChangedRun
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.core.world import World
from mrta_falsify.trial import Job
from mrta_falsify.verbs.explain.whole_runs import looking_for, run_changed

LATER = (1, 2, 3, 4)  # ticks by which commands are held back
SCHEDULE = "schedule"  # group of such runs


def schedules_of(
    job: Job, verdict: Verdict, most: int, journal: RunJournal[ChangedRun]
) -> Iterator[ChangedRun]:
    """Run the world under other schedules.

    Args:
        job: that fails, of a stack in a process of its own.
        verdict: the violated one that explains the failure.
        most: runs at most.
        journal: of finished runs.
    """
    other = list(_others(looking_for(job, verdict)))
    for change, changed in other[: max(0, most)]:
        key = codec.digest([changed.world, changed.config, changed.specifications, verdict])
        known = journal.answers.get(key)
        if known is None:
            fate, detail = run_changed(changed, verdict)
            found = ChangedRun(group=SCHEDULE, change=change, fate=fate, detail=detail)
            known = journal.keep(key, found)
        yield known


def _others(job: Job) -> Iterator[tuple[str, Job]]:
    stack = job.config.stack
    assert stack is not None
    for ticks in LATER:
        later = ticks / job.config.control_rate
        delayed = dataclasses.replace(stack, delay=stack.delay + later)
        config = dataclasses.replace(job.config, stack=delayed)
        yield f"every command {later * 1e3:.0f} ms later", dataclasses.replace(job, config=config)
    world = with_ties_reversed(job.world)
    if world.digest() != job.world.digest():
        text = "tasks that come at the same time told in reverse order"
        yield text, dataclasses.replace(job, world=world)


def with_ties_reversed(world: World) -> World:
    """Reverse the order of the tasks that arrive at the same time."""
    places: dict[float, list[int]] = {}
    for number, task in enumerate(world.tasks):
        places.setdefault(task.arrival, []).append(number)
    tasks = list(world.tasks)
    for numbers in places.values():
        for number, other in zip(numbers, reversed(numbers), strict=True):
            tasks[number] = world.tasks[other]
    return dataclasses.replace(world, tasks=tuple(tasks))
