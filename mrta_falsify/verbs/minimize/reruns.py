"""Runs of smaller worlds, side by side, with answers that outlive the process."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from pathlib import Path

from mrta_falsify.campaigns.journal import append_row, read_rows
from mrta_falsify.campaigns.processes import spawned
from mrta_falsify.campaigns.signature import leading, signature
from mrta_falsify.core import codec
from mrta_falsify.core.errors import HarnessError, InputError
from mrta_falsify.core.world import World
from mrta_falsify.trial import Job, judge
from mrta_falsify.verbs.minimize.search import Course, course_of
from simulator_interface import starts


class OutOfRunsError(Exception):
    """An answer is not known yet, and the runs are used up."""


@dataclass(frozen=True, slots=True, eq=False)
class Smaller:
    """A world that may still fail."""

    world: World
    what: str  #: that it is without
    place: int = 0  #: of what is left out, in its group


@dataclass(slots=True)
class Runs(AbstractContextManager["Runs"]):
    """Runs worlds and says which still fails in the wanted way.

    With several workers the next few worlds run side by side, and the first in their order that
    fails counts, so that the answer is the same as with one. Answers are remembered, those that
    were not needed as well, and kept in ``cache``, a line each.
    """

    job: Job
    wanted: str  #: signature
    max_runs: int
    cache: Path | None
    on_run: Callable[[int, str], None]
    workers: int = 1
    count: int = 0  #: simulated, earlier attempts included
    _known: dict[str, Course | None] = field(default_factory=dict)
    _pool: ProcessPoolExecutor | None = None

    def __post_init__(self) -> None:
        if self.workers > 1:
            self._pool = spawned(self.workers)
        if self.cache is None:
            return
        for row in read_rows(self.cache):
            try:
                key, ran, course = str(row["run"]), bool(row["ran"]), row["course"]
                self._known[key] = course and codec.decode(Course, course, where=str(self.cache))
            except (InputError, KeyError, TypeError):
                continue  # a damaged line costs one run
            self.count += ran

    def __exit__(self, *_: object) -> None:
        if self._pool is not None:
            self._pool.shutdown(cancel_futures=True)

    def first_failing(self, worlds: Iterable[Smaller]) -> tuple[Smaller, Course] | None:
        """The first of ``worlds`` that fails with the wanted signature, and the course of its run.

        Args:
            worlds: in the order in which they are wanted; taken as they are needed.

        Returns:
            None if none does.

        Raises:
            OutOfRunsError: an answer that is needed is not known, and the runs are used up.
            HarnessError: a process died.
        """
        rest = iter(worlds)
        while batch := list(self._next_unknown(rest)):
            self._run({key: smaller for key, smaller in batch if key not in self._known})
            for key, smaller in batch:
                if key not in self._known:
                    raise OutOfRunsError
                course = self._known[key]
                if course is not None:
                    return smaller, course
        return None

    def _next_unknown(self, rest: Iterator[Smaller]) -> Iterator[tuple[str, Smaller]]:
        """Worlds up to the next that is known to fail, with at most one unknown per worker."""
        unknown = set()
        for smaller in rest:
            key = codec.digest(
                [smaller.world, self.job.config, self.job.specifications, self.wanted]
            )
            yield key, smaller
            if key not in self._known:
                unknown.add(key)
            elif self._known[key] is not None:
                return
            if len(unknown) == self.workers:
                return

    def _run(self, asked: dict[str, Smaller]) -> None:
        chosen = dict(itertools.islice(asked.items(), max(0, self.max_runs - self.count)))
        jobs = {key: dataclasses.replace(self.job, world=s.world) for key, s in chosen.items()}
        if self._pool is None or len(jobs) < 2:
            for key, job in jobs.items():
                self._keep(key, chosen[key], *_course(job, self.wanted))
            return
        futures: dict[str, Future[tuple[bool, Course | None]]] = {
            key: self._pool.submit(_course, job, self.wanted) for key, job in jobs.items()
        }
        try:
            for key, future in futures.items():
                self._keep(key, chosen[key], *future.result())
        except BrokenProcessPool:
            raise HarnessError("a process that ran smaller worlds has died; call again") from None

    def _keep(self, key: str, smaller: Smaller, ran: bool, course: Course | None) -> None:
        self.count += ran
        self._known[key] = course
        if self.cache is not None:
            kept = codec.encode(course) if course else None
            append_row(self.cache, {"run": key, "ran": ran, "course": kept})
        self.on_run(self.count, f"{'fails' if course else 'passes'} without {smaller.what}")


def _course(job: Job, wanted: str) -> tuple[bool, Course | None]:
    """Whether the job could run, and the course of its run if it fails with ``wanted``."""
    try:
        starts.check_starts(job.world)
        judged = judge(job)
    except InputError:
        return False, None  # no valid world
    verdict = leading(judged.verdicts)
    if verdict is None or signature(judged.verdicts) != wanted:
        return True, None
    return True, course_of(verdict, judged.outcome.trace, job.world)
