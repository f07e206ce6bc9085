"""Runs of smaller worlds, side by side, with answers that outlive the process."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import AbstractContextManager, ExitStack
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from mrta_falsify.campaigns.journal import RunJournal
from mrta_falsify.campaigns.processes import spawned
from mrta_falsify.campaigns.rules import signed
from mrta_falsify.copies import fate_on_other
from mrta_falsify.core import codec
from mrta_falsify.core.codec import later
from mrta_falsify.core.config import StackConfig
from mrta_falsify.core.errors import HarnessError, InputError
from mrta_falsify.core.world import World
from mrta_falsify.specs.causes import leading
from mrta_falsify.trial import Job, judge
from mrta_falsify.verbs.minimize.course import Course, course_of
from simulator_interface import starts
from simulator_interface.guard import Guard, guarded


class OutOfRunsError(Exception):
    """An answer is not known yet, and the runs are used up."""


class Smaller(NamedTuple):
    """A world that may still fail."""

    world: World
    what: str  #: that it is without
    place: int = 0  #: of what is left out, in its group


@dataclass(frozen=True, slots=True, kw_only=True)
class SmallerRun:
    """What the run of a smaller world gave."""

    ran: bool  #: False if the world is not valid
    course: Course | None  #: of the run, if it fails in the wanted way
    other_ran: bool = later(False)  #: whether the other stack was asked, too

    @property
    def runs(self) -> int:
        """Simulations it took."""
        return self.ran + self.other_ran


@dataclass(slots=True)
class Reruns(AbstractContextManager["Reruns"]):
    """Runs worlds and says which is the first that still fails in the wanted way.

    With several workers the next few worlds run side by side. The first in their order that
    fails counts, so the answer is the same as with one worker. All answers are kept, including
    those that were not needed. An answer of an earlier call is taken when this call would run its
    world, and counts as that run, so a second call takes the steps of the first again.
    """

    job: Job
    wanted: str  #: signature, in the form of the job's rules
    max_runs: int
    journal: RunJournal[SmallerRun]
    on_run: Callable[[int, str], None]
    workers: int = 1
    other: StackConfig | None = None  #: must pass where the other one fails; None: any may fail
    count: int = field(init=False, default=0)  #: simulated, including earlier calls
    _known: dict[str, SmallerRun] = field(init=False, default_factory=dict)  #: so far
    _pool: ProcessPoolExecutor | None = field(init=False, default=None)
    _opened: ExitStack = field(init=False, default_factory=ExitStack)

    def __enter__(self) -> Reruns:
        if self.workers > 1:
            self._pool = self._opened.enter_context(spawned(self.workers))
        return self

    def __exit__(self, *error: Any) -> None:
        self._opened.__exit__(*error)

    def first_failing(self, worlds: Iterable[Smaller]) -> tuple[Smaller, Course] | None:
        """Find the first of ``worlds`` that fails with the wanted signature.

        Args:
            worlds: in the order in which they are wanted; taken as they are needed.

        Returns:
            The world and the course of its run; None if none fails.

        Raises:
            OutOfRunsError: an answer that is needed is not known, and the runs are used up.
            HarnessError: a process died.
        """
        rest, known = iter(worlds), self._known
        while batch := list(self._next_batch(rest)):
            self._run({key: smaller for key, smaller in batch if key not in known})
            for key, smaller in batch:
                if key not in known:
                    raise OutOfRunsError
                course = known[key].course
                if course is not None:
                    return smaller, course
        return None

    def _next_batch(self, rest: Iterator[Smaller]) -> Iterator[tuple[str, Smaller]]:
        """Take worlds up to one that is known to fail, at most one unknown for each worker."""
        unknown = set()
        for smaller in rest:
            asked = [smaller.world, self.job.config, self.job.specifications, self.wanted]
            key = codec.digest(asked if self.other is None else [*asked, self.other])
            yield key, smaller
            answer = self._known.get(key)
            if answer is None:
                unknown.add(key)
            elif answer.course is not None:
                return
            if len(unknown) == self.workers:
                return

    def _run(self, asked: dict[str, Smaller]) -> None:
        cost = 1 if self.other is None else 2  # simulations, at most
        left = max(0, self.max_runs - self.count) // cost
        chosen = dict(itertools.islice(asked.items(), left))
        for key in chosen:
            if key in self.journal.answers:
                self._take(key, self.journal.answers[key])
        missing = {key: smaller for key, smaller in chosen.items() if key not in self._known}
        jobs = {key: dataclasses.replace(self.job, world=s.world) for key, s in missing.items()}
        if self._pool is None or len(jobs) < 2:
            for key, job in jobs.items():
                self._keep(key, chosen[key], run_smaller(job, self.wanted, self.other))
            return
        futures: dict[str, Future[SmallerRun]] = {
            key: self._pool.submit(run_in_pool, job, self.wanted, self.other)
            for key, job in jobs.items()
        }
        try:
            for key, future in futures.items():
                self._keep(key, chosen[key], future.result())
        except BrokenProcessPool:
            raise HarnessError("a process that ran smaller worlds has died; call again") from None

    def _take(self, key: str, answer: SmallerRun) -> None:
        self._known[key] = answer
        self.count += answer.runs

    def _keep(self, key: str, smaller: Smaller, answer: SmallerRun) -> None:
        self._take(key, self.journal.keep(key, answer))
        outcome = "fails" if answer.course is not None else "passes"
        self.on_run(self.count, f"{outcome} without {smaller.what}")


_guard = Guard()  # of a process of the pool


def run_in_pool(job: Job, wanted: str, other: StackConfig | None = None) -> SmallerRun:
    """Run a smaller world as :func:`run_smaller`, in a process that does nothing else."""
    with guarded(_guard):
        return run_smaller(job, wanted, other)


def run_smaller(job: Job, wanted: str, other: StackConfig | None = None) -> SmallerRun:
    """Run a smaller world and look whether it fails with the signature ``wanted``.

    Args:
        job: the smaller world.
        wanted: signature.
        other: a stack that must pass it, if there is one.
    """
    try:
        starts.check_starts(job.world)
        judged = judge(job)
    except InputError:
        return SmallerRun(ran=False, course=None)
    verdict = leading(judged.verdicts)
    if verdict is None or signed(judged.verdicts, job.rules) != wanted:
        return SmallerRun(ran=True, course=None)
    course = course_of(verdict, judged.outcome.trace, job.world)
    if other is None:
        return SmallerRun(ran=True, course=course)
    theirs = judge(dataclasses.replace(job, config=other), keep_trace=False)
    passes = fate_on_other(judged, theirs) == "passes"
    return SmallerRun(ran=True, course=course if passes else None, other_ran=True)
