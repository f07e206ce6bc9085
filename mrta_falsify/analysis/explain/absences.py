"""What a failure needs: runs of the whole world without each robot, person, thing and task.

A few things of a kind are left out one by one. Many are left out together, then by halves, for as
long as the failure is not there without them.
"""

from __future__ import annotations

import dataclasses
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

from mrta_falsify.analysis.explain.case import Case
from mrta_falsify.analysis.explain.whole_runs import looking_for, run_changed
from mrta_falsify.analysis.minimize.edits import ways_to_remove, without
from mrta_falsify.analysis.minimize.reruns import Smaller
from mrta_falsify.core.findings import ChangedRun, Explanation
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.core.world import World
from mrta_falsify.lab import Experiment, Lab, course_of

#: groups of things, what a reader asks about first
ORDER = ("robots", "humans", "furniture", "events", "tasks")
SINGLY = 6  # things of a group that are left out one by one; halving more takes fewer runs
WORDS = {"humans": "people", "furniture": "pieces of furniture"}


class Chunk(NamedTuple):
    """Some things of a group."""

    group: str
    gone: range  #: indices in the group


class Absences:
    """The whole world without each robot, person, thing and task.

    Only of a stack whose layers cannot be exchanged: of the shipped one, the rows say more.
    """

    least = 2

    def applies(self, case: Case) -> bool:
        """See :class:`.case.Question`."""
        return case.job.config.stack is not None

    def ask(self, case: Case, found: Explanation, runs: int) -> Explanation:
        """See :class:`.case.Question`."""
        had = course_of(case.verdict, case.trace, case.job.world).had
        told = absences_of(case.own, case.verdict, had, runs, case.lab)
        return dataclasses.replace(found, absences=(*found.absences, *told))


def absences_of(
    own: Experiment,
    verdict: Verdict,
    had: Mapping[str, Sequence[int]],
    most: int,
    lab: Lab,
) -> Iterator[ChangedRun]:
    """Run the world without its things, the coarse questions of all groups first.

    Args:
        own: that fails.
        verdict: the violated one that explains the failure.
        had: tasks by the robot that had them last; a robot is left out with its tasks.
        most: runs at most.
        lab: that runs them.

    Yields:
        What each run gave, and what there were no runs for.
    """
    looking, left = looking_for(own, verdict), most
    waiting = deque(_first_chunks(own.world))
    while waiting:
        chunk = waiting.popleft()
        smaller = _smaller(looking.world, chunk, had)
        if smaller is None and len(chunk.gone) > 1:
            waiting.extend(_halves(chunk))
            continue
        told = _asked(own.world, chunk, smaller)
        if smaller is not None and left > 0:
            left -= 1
            changed = dataclasses.replace(looking, world=smaller.world)
            fate, detail = run_changed(lab, changed, verdict)
            told = dataclasses.replace(told, fate=fate, detail=detail)
        yield told
        if told.fate not in ("stays", "untried"):
            waiting.extend(_halves(chunk))


def _first_chunks(world: World) -> Iterator[Chunk]:
    for group in ORDER:
        things = range(len(getattr(world, group)))
        if len(things) <= SINGLY:
            yield from (Chunk(group, things[i : i + 1]) for i in things)
        else:
            yield Chunk(group, things)


def _halves(chunk: Chunk) -> tuple[Chunk, ...]:
    middle = len(chunk.gone) // 2
    parts = (chunk.gone[:middle], chunk.gone[middle:])
    return tuple(Chunk(chunk.group, part) for part in parts) if middle else ()


def _smaller(world: World, chunk: Chunk, had: Mapping[str, Sequence[int]]) -> Smaller | None:
    """Leave a chunk out, with the tasks of its robots where that leaves any."""
    for tasks, _ in ways_to_remove(world, chunk.group, chunk.gone, had):
        smaller = without(world, chunk.group, chunk.gone, tasks)
        if smaller is not None:
            owner = "it" if len(chunk.gone) == 1 else "they"
            return Smaller(smaller, f" and what {owner} had to do" if tasks else "")
    return None


def _asked(world: World, chunk: Chunk, smaller: Smaller | None) -> ChangedRun:
    """Put what is to be run as if there were no runs left for it."""
    names = tuple(_name(world, chunk.group, i) for i in chunk.gone)
    many = f"{len(names)} {WORDS.get(chunk.group, chunk.group)} at once ({names[0]} to {names[-1]})"
    return ChangedRun(
        group=chunk.group,
        things=names,
        change=(names[0] if len(names) == 1 else many) + (smaller.what if smaller else ""),
        fate="untried" if smaller else "unknown",
        detail="" if smaller else "no valid world is left without it",
    )


def _name(world: World, group: str, number: int) -> str:
    return f"task{number}" if group == "tasks" else str(getattr(world, group)[number].name)
