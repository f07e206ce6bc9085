"""Whether a failure depends on the schedule: how long the stack thinks, what it hears first."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

from mrta_falsify.analysis.explain.case import Case
from mrta_falsify.analysis.explain.whole_runs import looking_for, run_changed
from mrta_falsify.core.findings import ChangedRun, Explanation
from mrta_falsify.core.world import World
from mrta_falsify.lab import Experiment

LATER = (1, 2, 3, 4)  # ticks by which commands are held back
SCHEDULE = "schedule"  # group of such runs


class Schedules:
    """The world under other schedules, of a foreign stack."""

    least = 2

    def applies(self, case: Case) -> bool:
        """See :class:`.case.Question`."""
        return case.job.config.stack is not None

    def ask(self, case: Case, found: Explanation, runs: int) -> Explanation:
        """See :class:`.case.Question`."""
        told = []
        for change, changed in list(_others(looking_for(case.own, case.verdict)))[:runs]:
            fate, detail = run_changed(case.lab, changed, case.verdict)
            told.append(ChangedRun(group=SCHEDULE, change=change, fate=fate, detail=detail))
        return dataclasses.replace(found, schedules=tuple(told))


def _others(own: Experiment) -> Iterator[tuple[str, Experiment]]:
    stack = own.stack.stack
    assert stack is not None
    for ticks in LATER:
        later = ticks / own.stack.control_rate
        delayed = dataclasses.replace(stack, delay=stack.delay + later)
        config = dataclasses.replace(own.stack, stack=delayed)
        yield f"every command {later * 1e3:.0f} ms later", dataclasses.replace(own, stack=config)
    world = with_ties_reversed(own.world)
    if world.digest() != own.world.digest():
        text = "tasks that come at the same time told in reverse order"
        yield text, dataclasses.replace(own, world=world)


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
