"""The smallest world that still fails in the same way.

Hierarchical delta debugging on the World (Zeller and Hildebrandt's ddmin by groups, with guesses
from the run itself first, see :mod:`mrta_falsify.verbs.minimize.search`); then values are moved to
nominal. It goes on until nothing changes any more, so that what is left is 1-minimal: no single
robot, task, person, piece of furniture or event can go. Every accepted step is a run that failed
with the same signature, so the result is verified by construction.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from mrta_falsify.campaigns.signature import leading, signature
from mrta_falsify.campaigns.store import Campaign, write_atomically
from mrta_falsify.core import codec
from mrta_falsify.core.errors import InputError
from mrta_falsify.core.record import TrialRecord
from mrta_falsify.core.trace import Trace, write_trace
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.core.world import World, write_world
from mrta_falsify.trial import Job, Judged, judge
from mrta_falsify.verbs.minimize.reruns import OutOfRunsError, Runs, Smaller
from mrta_falsify.verbs.minimize.search import (
    GROUPS,
    MARGIN,
    NOMINAL,
    Course,
    concerned,
    course_of,
    later_starts,
    named,
    without,
)
from mrta_falsify.verbs.stored_trials import job_of

CACHE = "minimize.cache.jsonl"  # answers so far, so that a second call goes on


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Minimised:
    """The result."""

    world: World
    judged: Judged  #: its run
    signature: str
    removed: tuple[str, ...]  #: in words
    runs: int  #: simulated for it, those of earlier attempts included
    one_minimal: bool  #: False if the runs did not suffice
    counts: dict[str, tuple[int, int]]  #: by group: before, after


def minimise(
    campaign: Campaign,
    record: TrialRecord,
    *,
    max_runs: int = 100,
    workers: int = 1,
    on_run: Callable[[int, str], None] = lambda runs, text: None,
) -> Minimised:
    """Minimise a stored failure and keep the result beside it; a second call goes on.

    Args:
        campaign: it belongs to.
        record: of the failure.
        max_runs: simulations at most, those of earlier calls included.
        workers: simulations at a time; the result is the same with any number of them, only the
            runs that it takes are not.
        on_run: called after each with the number so far and a line about it.

    Returns:
        The result, written as ``world.min.json``, ``world.min.scenic``, ``trace.min.zip`` and
        ``minimize.json``, with the stack that it fails on as ``stack.yaml``.

    Raises:
        InputError: the trial did not fail, or its world is missing.
    """
    if not record.failed:
        raise InputError(f"trial {record.id} violates nothing; there is nothing to minimise")
    job = job_of(campaign, record)
    folder = campaign.folder(record)
    folder.mkdir(parents=True, exist_ok=True)
    found = minimise_job(
        job, max_runs=max_runs, workers=workers, cache=folder / CACHE, on_run=on_run
    )
    write_world(found.world, folder / "world.min.json")
    write_trace(found.judged.outcome.trace, folder / "trace.min.zip")
    stack = yaml.safe_dump(codec.encode(job.config), sort_keys=False)
    write_atomically(folder / "stack.yaml", stack.encode())
    data = {**summary(found), "program": write_as_program(found, job, folder)}
    write_atomically(folder / "minimize.json", (json.dumps(data) + "\n").encode())
    return found


def write_as_program(found: Minimised, job: Job, folder: Path) -> str:
    """Write a minimised world as ``world.min.scenic`` and run what the program gives.

    Args:
        found: the result.
        job: that was minimised; its stack and specifications are used.
        folder: for the program, and its layout ``world.min.layout.json`` if no shipped one.

    Returns:
        ``identical`` if the program's run has the same trace, ``same failure`` if it has the
        same signature, else why there is no program; then none is left in ``folder``.
    """
    from scenic_worlds.program import compile_program  # noqa: PLC0415 - Scenic takes seconds
    from scenic_worlds.writing import write_program  # noqa: PLC0415

    path = folder / "world.min.scenic"
    why = f"The smallest world that fails with {found.signature}."
    files: tuple[Path, ...] = (path, path.with_suffix(".layout.json"))
    try:
        write_program(found.world, path, comment=why)
        judged = judge(dataclasses.replace(job, world=compile_program(path).sample(0)))
        if judged.outcome.trace.digest == found.judged.outcome.trace.digest:
            return "identical"
        if signature(judged.verdicts) == found.signature:
            return "same failure"
        reason = f"the program's world gives {signature(judged.verdicts) or 'no failure'}"
    except InputError as error:
        reason = str(error)
    for file in files:
        file.unlink(missing_ok=True)
    return reason


def summary(found: Minimised) -> dict[str, Any]:
    """The result as JSON-shaped data."""
    return {
        "signature": found.signature,
        "removed": list(found.removed),
        "runs": found.runs,
        "one_minimal": found.one_minimal,
        "counts": {name: list(pair) for name, pair in found.counts.items()},
        "share_removed": share_removed(found),
        "world_digest": found.world.digest(),
        "trace_digest": found.judged.outcome.trace.digest,
        "verdicts": [codec.encode(v) for v in found.judged.verdicts if v.violated],
    }


def share_removed(found: Minimised) -> float:
    """Share of robots, people, furniture, tasks and events that could go."""
    before = sum(pair[0] for pair in found.counts.values())
    after = sum(pair[1] for pair in found.counts.values())
    return 1.0 - after / before if before else 0.0


def minimise_job(
    job: Job,
    *,
    max_runs: int = 100,
    workers: int = 1,
    cache: Path | None = None,
    on_run: Callable[[int, str], None] = lambda runs, text: None,
) -> Minimised:
    """Minimise the failure of a job (see :func:`minimise`)."""
    first = judge(job)
    verdict = leading(first.verdicts)
    if verdict is None:
        raise InputError("the run violates nothing; there is nothing to minimise")
    trace = first.outcome.trace
    complete = True
    runs = Runs(job, signature(first.verdicts), max_runs, cache, on_run, workers)
    search = _Search(job.world, course_of(verdict, trace, job.world), runs)
    with runs:
        try:
            search.begin(verdict, trace)
            search.go_on()
        except OutOfRunsError:
            complete = False
    judged = judge(dataclasses.replace(job, world=search.world))
    return Minimised(
        world=search.world,
        judged=judged,
        signature=runs.wanted,
        removed=_removed(job.world, search.world),
        runs=runs.count,
        one_minimal=complete,
        counts={g: (len(getattr(job.world, g)), len(getattr(search.world, g))) for g in GROUPS},
    )


class _Search:
    """Holds the smallest failing world so far, and the course of its run."""

    def __init__(self, world: World, course: Course, runs: Runs) -> None:
        self.world = world
        self._course = course
        self._runs = runs

    def _take(self, worlds: Iterable[Smaller]) -> Smaller | None:
        """Go on with the first of some smaller worlds that fails; None if none does."""
        found = self._runs.first_failing(worlds)
        if found is None:
            return None
        smaller, self._course = found
        self.world = smaller.world
        return smaller

    def begin(self, verdict: Verdict, trace: Trace) -> None:
        """What the run points to and nothing else; failing that, only what comes before it."""
        self._take(self._guesses(verdict, trace))

    def _guesses(self, verdict: Verdict, trace: Trace) -> Iterator[Smaller]:
        for wide, what in ((False, "what the failure does not name"), (True, "what is far away")):
            guess = concerned(self.world, verdict, trace, wide=wide)
            if guess is not None:
                yield Smaller(guess, what)
        if verdict.violated_at is None or verdict.spec == "all_tasks_done":
            return
        found = verdict.violated_at
        tasks = tuple(task for task in self.world.tasks if task.arrival <= found)
        horizon = min(self.world.horizon, found + MARGIN)
        shorter = dataclasses.replace(self.world, tasks=tasks, horizon=horizon)
        yield Smaller(shorter, "what comes after the violation")

    def go_on(self) -> None:
        """Make the world smaller until nothing goes: then each single thing is needed."""
        for group in GROUPS:
            self._shrink(group, len(getattr(self.world, group)))
        self._move_to_nominal()  # now, since all single things are tried again after a change
        while True:
            before = self.world
            self._begin_later()
            for group in GROUPS:
                self._shrink(group, 1)
            if self.world is before:
                return

    def _shrink(self, group: str, size: int) -> None:
        """ddmin: chunks of at most ``size`` things down to single ones."""
        while size >= 1:
            place = 0
            while taken := self._take(self._removals(group, size, place)):
                place = taken.place
            if size == 1:
                return
            size = max(1, min(size, len(getattr(self.world, group))) // 2)

    def _removals(self, group: str, size: int, place: int) -> Iterator[Smaller]:
        """Worlds without one chunk of a group, from the one at ``place`` on."""
        items = getattr(self.world, group)
        for start in range(place, len(items), size):
            gone = range(len(items))[start : start + size]
            what = named(group, [items[i] for i in gone])
            had: list[int] = []
            if group == "robots":
                # what a robot had to do would go to the others, and change their ways
                had = [task for i in gone for task in self._course.had.get(items[i].name, ())]
            ways = [(had, f"{what} and what it had to do")] if had else []
            if not had or len(gone) == 1:
                ways.append(([], what))
            for tasks, text in ways:
                smaller = without(self.world, group, gone, tasks)
                if smaller is not None:
                    yield Smaller(smaller, text, start)

    def _begin_later(self) -> None:
        while self._take(self._later()):
            pass

    def _later(self) -> Iterator[Smaller]:
        return (Smaller(world, what) for what, world in later_starts(self.world, self._course))

    def _move_to_nominal(self) -> None:
        """Noise, delays, odd speeds and times, as far as the failure does not need them."""
        calm = self.world
        for _, change in NOMINAL:
            calm = change(calm)
        if calm.digest() == self.world.digest() or self._take([Smaller(calm, "anything odd")]):
            return
        place = 0
        while taken := self._take(self._calmer(place)):
            place = taken.place + 1

    def _calmer(self, place: int) -> Iterator[Smaller]:
        """Worlds with one thing as usual, from that at ``place`` in ``NOMINAL`` on."""
        for number, (what, change) in list(enumerate(NOMINAL))[place:]:
            calm = change(self.world)
            if calm.digest() != self.world.digest():
                yield Smaller(calm, what, number)


def _removed(before: World, after: World) -> tuple[str, ...]:
    """What is gone, in words."""
    texts = []
    for group in GROUPS:
        one, other = len(getattr(before, group)), len(getattr(after, group))
        if one > other:
            texts.append(f"{one - other} of {one} {group}")
    if after.horizon < before.horizon:
        texts.append(f"everything after {after.horizon:.0f} s")
    for what, change in NOMINAL:
        had = change(before).digest() != before.digest()
        if had and change(after).digest() == after.digest():
            texts.append(what)
    return tuple(texts)
