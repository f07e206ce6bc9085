"""Runs experiments: each once, several side by side, and in copies with small differences.

This is the one way in which a world is run again. What has been run is kept by the digest of its
experiment and of its code, in memory and, where a journal is given, on disc. So a command that was
stopped, by kill -9 too, goes on where it stopped when it is called again.

Runs that share their world, stack and perturbation share what comes before their first edit
(see :mod:`.running`).
"""

from __future__ import annotations

import collections
import contextlib
import dataclasses
import itertools
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, ExitStack
from pathlib import Path
from typing import Any, TypeVar

from mrta_falsify.campaigns.code_digest import known_code_digest
from mrta_falsify.campaigns.executors import Finished
from mrta_falsify.campaigns.journal import RunJournal, resumable
from mrta_falsify.campaigns.runner import REPEATS
from mrta_falsify.campaigns.settings import CampaignSettings, TrialSettings
from mrta_falsify.core import codec, registry
from mrta_falsify.core.config import Choice
from mrta_falsify.core.errors import HarnessError, InputError, PlaceError
from mrta_falsify.core.run_result import RunResult, Vote
from mrta_falsify.lab.experiment import Experiment, Fails, is_failed
from mrta_falsify.lab.recorded import draw_scene
from mrta_falsify.lab.running import (
    DrawScene,
    OnEnd,
    forks,
    has_place,
    run_group,
    run_whole,
)
from mrta_falsify.process.budget import credit
from mrta_falsify.trial import Judged
from simulator_interface.guard import Guard, guarded

A = TypeVar("A")

TARGET = "experiments"  #: what a worker process of the lab opens
NO_LIMIT = 1e9  # s
WAIT = 1.0  # s between two looks at overdue workers

OnRun = Callable[[int, int], None]
Group = dict[str, Experiment]  #: by key; alike in all before their first edit


def local_workers(count: int) -> Choice:
    """Choose the executor of some local processes."""
    return Choice("processes", {"workers": count})


class Lab(AbstractContextManager["Lab"]):
    """Runs experiments, each of them once.

    Its processes start with the first experiments that go side by side, and end with the block
    that it is opened in.

    Args:
        journal: file of finished runs, for the next call; None keeps them in memory only. So does
            a foreign stack whose files are not known.
        what: has no result if it is interrupted, in words; empty: somebody else says so.
        workers: processes.
        time_limit: what a run may work and sleep [s], after which it is killed; None: no limit. A
            limit needs processes of their own, with one worker too.
        on_run: called after each run, one from the journal too, with how many are done, and will
            be as far as is known.
        draw: gives the Scenic scene of a scripted world.
    """

    def __init__(
        self,
        journal: Path | None = None,
        *,
        what: str = "",
        workers: int = 1,
        time_limit: float | None = None,
        on_run: OnRun = lambda done, expected: None,
        draw: DrawScene = draw_scene,
    ) -> None:
        self.journal = RunJournal(RunResult, journal)
        self._file = journal
        self._journals: list[RunJournal[Any]] = [self.journal]
        self.workers = workers
        self.on_run = on_run
        self.runs = 0  #: done, known ones included
        self.expected = 0  #: in all; who asks for them knows
        self._what = what
        self._time_limit = time_limit
        self._draw = draw
        self._known: dict[str, RunResult] = {}  # that may come out otherwise in another call
        self._codes: dict[tuple[str, ...], str | None] = {}
        self._blocks: list[ExitStack] = []
        self._executor: Any = None
        self._numbers = itertools.count()  # of jobs
        self._guard = Guard()

    def __enter__(self) -> Lab:
        """Open a block; the outermost one ends processes, and says what is kept."""
        block = ExitStack()
        if not self._blocks:
            if self._what:
                block.enter_context(resumable(self._what, self._journals))
            block.callback(self._close)
        self._blocks.append(block)
        return self

    def __exit__(self, *error: Any) -> None:
        self._blocks.pop().__exit__(*error)

    def _close(self) -> None:
        executor, self._executor = self._executor, None
        if executor is not None:
            executor.close()
        self._guard.close()

    # --- runs -------------------------------------------------------------------------------

    def run(self, experiment: Experiment) -> RunResult:
        """Run one experiment, unless it is known."""
        return next(self.map((experiment,)))

    def judge(self, experiment: Experiment, *, keep_trace: bool = True) -> Judged:
        """Run one experiment here from its start, known or not, and give the run itself.

        Args:
            experiment: to run.
            keep_trace: False: the trace has only its digest.

        Raises:
            InputError: the world cannot be run.
            HarnessError: the toolkit failed.
        """
        with guarded(self._guard):
            return run_whole(experiment, keep_trace=keep_trace, draw=self._draw)

    def watch(self, experiment: Experiment, on_end: OnEnd) -> RunResult:
        """Run one experiment here, known or not, and look at the run itself where it was run.

        Args:
            experiment: to run.
            on_end: called in the process that ran it, with its trace.

        Raises:
            HarnessError: the toolkit failed, or ``on_end`` did.
        """
        with guarded(self._guard):
            (result,) = run_group((experiment,), on_end, self._draw)
        return result

    def map(self, experiments: Iterable[Experiment]) -> Iterator[RunResult]:
        """Run experiments; their results come in the order of the experiments.

        A run that is lost with its process is run again, twice at most.

        Raises:
            InputError: a stack cannot be built.
            HarnessError: a run was lost each time, or the toolkit failed.
            PlaceError: the journal cannot be written.
            KeyboardInterrupt: Ctrl-C; finished runs are in the journal.
        """
        wanted = [(self.key(experiment), experiment) for experiment in experiments]
        missing = {key: one for key, one in wanted if self._answer(key) is None}
        for _ in {key for key, _ in wanted if key not in missing}:
            self.count()
        ran = self._ran(_shared(missing))
        for key, _ in wanted:
            while self._answer(key) is None:
                done, result = next(ran)
                self._keep(done, missing[done], result)
                self.count()
            yield self.known(key)

    def copies(
        self,
        experiment: Experiment,
        at_most: int,
        fails: Fails = is_failed,
        *,
        each: Callable[[], AbstractContextManager[None]] = contextlib.nullcontext,
    ) -> Iterator[RunResult]:
        """Run copies with small differences until the rest cannot change how they vote.

        Args:
            experiment: whose world is varied; its own run does not vote.
            at_most: copies; those that have no place for their robots are left out.
            fails: whether a run counts as failed; None: it tells nothing.
            each: entered around each run.
        """
        copies = [experiment.with_perturbation(number) for number in range(1, at_most + 1)]
        copies = [copy for copy in copies if has_place(copy)]
        vote = Vote(runs=0, failed=0)
        for copy in copies:
            if vote.is_settled(len(copies)):
                return
            with each():
                result = self.run(copy)
            vote = vote.add(failed=fails(result))
            yield result

    def vote(self, experiment: Experiment, at_most: int, fails: Fails = is_failed) -> Vote:
        """Count :meth:`copies` of an experiment that fail."""
        return Vote.of(map(fails, self.copies(experiment, at_most, fails)))

    def count(self) -> None:
        """Count a run, also one that goes on from a run of somebody else."""
        self.runs += 1
        self.expected = max(self.expected, self.runs)
        self.on_run(self.runs, self.expected)

    # --- what is known ------------------------------------------------------------------------

    def key(self, experiment: Experiment) -> str:
        """Digest of an experiment and of the code that it runs."""
        return codec.digest([experiment.digest(), self._code_of(experiment) or ""])

    def known(self, key: str) -> RunResult:
        """Give the result of a run by its key."""
        result = self._answer(key)
        assert result is not None, "it has not been run"
        return result

    def result_of(self, experiment: Experiment) -> RunResult | None:
        """Give the result of an experiment if it has been run."""
        return self._answer(self.key(experiment))

    def journal_of(self, kind: type[A], *, experiment: Experiment) -> RunJournal[A]:
        """Open a journal of other answers in the same file, for one state of the code.

        Args:
            kind: of the answers.
            experiment: whose code they come from; where that is not known, none is kept.
        """
        code = self._code_of(experiment)
        found = RunJournal(kind, None if code is None else self._file, code=code or "")
        self._journals.append(found)
        return found

    def _answer(self, key: str) -> RunResult | None:
        return self._known.get(key) or self.journal.answers.get(key)

    def _code_of(self, experiment: Experiment) -> str | None:
        """Digest of the code that an experiment runs; None: it is not known."""
        if not self.journal.is_kept:
            return ""
        own = experiment.stack
        if experiment.transcript is not None:  # its stack is not asked
            own = dataclasses.replace(own, stack=None)
        stacks = [own, *(edit.stack for edit in experiment.edits if edit.stack)]
        names = (*(stack.digest() for stack in stacks), *experiment.specs)
        if names not in self._codes:
            self._codes[names] = known_code_digest(stacks, experiment.specs)
        return self._codes[names]

    def _keep(self, key: str, experiment: Experiment, result: RunResult) -> None:
        """Keep a result; on disc only if it may not come out otherwise when it is run again.

        A stack that cannot be started may start the next time, and another call may have another
        time limit.
        """
        is_certain = result.status in ("judged", "not_judged")
        if not is_certain or self._code_of(experiment) is None:
            self._known[key] = result
        else:
            self.journal.keep(key, result)

    # --- where it runs ------------------------------------------------------------------------

    def _ran(self, groups: Sequence[Group]) -> Iterator[tuple[str, RunResult]]:
        """Run groups, and yield the result of each experiment as its group ends."""
        has_pool = self._time_limit is not None or (self.workers > 1 and len(groups) > 1)
        here: list[Group] = []
        apart: list[Group] = []
        for group in groups:
            # answers that a stack gave stay in this process
            is_told = any(one.transcript is not None for one in group.values())
            (apart if has_pool and not is_told else here).append(group)
        for group in here:
            with guarded(self._guard):
                rows = run_group(tuple(group.values()), draw=self._draw)
            yield from zip(group, rows, strict=True)
        if apart:
            yield from self._ran_apart(apart)

    def _ran_apart(self, groups: Sequence[Group]) -> Iterator[tuple[str, RunResult]]:
        executor = self._opened_executor()
        lost = collections.Counter[int]()
        left = {next(self._numbers): group for group in groups}
        jobs = {n: {"group": codec.encode(list(group.values()))} for n, group in left.items()}
        for number, job in jobs.items():
            executor.submit({"number": number, **job})
        while left:
            for finished in executor.collect(WAIT):
                number = finished.number
                if number not in left:
                    continue  # nobody waits for it any more
                if finished.fate in ("crashed", "timeout") and lost[number] < REPEATS:
                    lost[number] += 1
                    executor.submit({"number": number, **jobs[number]})
                    continue
                yield from zip(left[number], _rows_of(finished, left.pop(number)), strict=True)

    def _opened_executor(self) -> Any:
        if self._executor is None:
            executor = registry.build("executor", local_workers(self.workers), where="lab")
            executor.open(
                CampaignSettings(
                    trials=TrialSettings(scenario=""),
                    target=TARGET,
                    time_limit=self._time_limit or NO_LIMIT,
                )
            )
            self._executor = executor
        return self._executor


def _shared(missing: Group) -> list[Group]:
    """Put together what shares the run before its first edit, by the time of that."""
    groups: dict[tuple[str, ...], Group] = {}
    for key, experiment in sorted(missing.items(), key=lambda item: item[1].begins_at):
        alone = "" if forks(experiment) else key
        bare = dataclasses.replace(experiment, edits=())
        groups.setdefault((bare.digest(), alone), {})[key] = experiment
    return list(groups.values())


def _rows_of(finished: Finished, group: Group) -> list[RunResult]:
    """Read what became of a group in a worker process.

    Raises:
        InputError: a stack cannot be built.
        PlaceError: a file cannot be written.
        HarnessError: it crashed.
    """
    if finished.fate == "timeout":
        return [RunResult(status="timeout", detail=finished.error) for _ in group]
    if finished.fate == "unwritable":
        raise PlaceError(finished.error)
    if finished.fate == "refused":
        raise InputError(finished.error)
    if finished.record is None:
        reason = (finished.error.strip().splitlines() or ["no reason given"])[-1]
        world = next(iter(group.values())).world.name
        error = HarnessError(f"a run of {world} crashed: {reason}")
        error.add_note(finished.error)
        raise error
    return [codec.decode(RunResult, row, where="run") for row in finished.record["results"]]


def open_experiments(settings: TrialSettings) -> Callable[[dict[str, Any]], dict[str, Any]]:
    """Open the lab in a worker process; the result runs one group after the other.

    Returns:
        A function from ``{"number": n, "group": [...]}``, encoded experiments, to
        ``{"results": [...]}``, encoded results.
    """
    del settings
    guard = Guard(on_lost=credit)

    def answer(job: dict[str, Any]) -> dict[str, Any]:
        group = [codec.decode(Experiment, one, where="experiment") for one in job["group"]]
        with guarded(guard):
            results = run_group(group)
        return {"results": codec.encode(results)}

    return answer
