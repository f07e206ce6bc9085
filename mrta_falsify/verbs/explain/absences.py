"""What a failure needs: runs of the whole world without each robot, person, thing and task.

A few things of a kind are left out one by one. Many are left out together, then by halves, for as
long as the failure is not there without them.
"""

from __future__ import annotations

import dataclasses
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

from mrta_falsify.campaigns.journal import RunJournal
from mrta_falsify.core import codec
from mrta_falsify.core.findings import ChangedRun
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.core.world import World
from mrta_falsify.trial import Job
from mrta_falsify.verbs.explain.run_count import RunCount
from mrta_falsify.verbs.explain.whole_runs import looking_for, run_changed
from mrta_falsify.verbs.minimize.edits import ways_to_remove, without
from mrta_falsify.verbs.minimize.reruns import Smaller

#: groups of things, what a reader asks about first
ORDER = ("robots", "humans", "furniture", "events", "tasks")
SINGLY = 6  # things of a group that are left out one by one; halving more takes fewer runs
WORDS = {"humans": "people", "furniture": "pieces of furniture"}


class Chunk(NamedTuple):
    """Some things of a group."""

    group: str
    gone: range  #: indices in the group


def absences_of(
    job: Job,
    verdict: Verdict,
    had: Mapping[str, Sequence[int]],
    most: int,
    count: RunCount,
    journal: RunJournal[ChangedRun],
) -> Iterator[ChangedRun]:
    """Run the world without its things, the coarse questions of all groups first.

    Args:
        job: that fails.
        verdict: the violated one that explains the failure.
        had: tasks by the robot that had them last; a robot is left out with its tasks.
        most: runs at most.
        count: of all runs.
        journal: of finished runs.

    Yields:
        What each run gave, and what there were no runs for.
    """
    looking = looking_for(job, verdict)
    until = count.done + most
    waiting = deque(_first_chunks(job.world))
    while waiting:
        chunk = waiting.popleft()
        smaller = _smaller(looking.world, chunk, had)
        if smaller is None and len(chunk.gone) > 1:
            waiting.extend(_halves(chunk))
            continue
        told = _asked(job.world, chunk, smaller)
        if smaller is not None and count.done < until:
            changed = dataclasses.replace(looking, world=smaller.world)
            told = _run(changed, verdict, told, journal)
            count.add()
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


def _run(
    job: Job, verdict: Verdict, asked: ChangedRun, journal: RunJournal[ChangedRun]
) -> ChangedRun:
    key = codec.digest([job.world, job.config, job.specifications, verdict])
    known = journal.answers.get(key)
    if known is not None:
        return known
    fate, detail = run_changed(job, verdict)
    return journal.keep(key, dataclasses.replace(asked, fate=fate, detail=detail))
