"""Runs experiments: each once, several side by side, and in copies with small differences.

Runs that share their world, stack and perturbation share what comes before their first edit: the
run goes forward once, and is forked where each of them begins (see :mod:`mrta_falsify.process`).
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, ExitStack
from pathlib import Path
from typing import Any

import numpy as np

from mrta_falsify.campaigns.journal import RunJournal
from mrta_falsify.campaigns.rules import RULES, signed
from mrta_falsify.core import codec
from mrta_falsify.core.errors import HarnessError, InputError
from mrta_falsify.core.fleet import Frame
from mrta_falsify.core.run_result import Rank, RunResult, Vote
from mrta_falsify.core.trace import Trace
from mrta_falsify.core.world import World
from mrta_falsify.lab.course import course_of
from mrta_falsify.lab.experiment import Edit, Experiment, Situation
from mrta_falsify.process.ending import Ending
from mrta_falsify.process.pool import MAX_DEATHS, Pool
from mrta_falsify.process.supervisor import run_supervised
from mrta_falsify.specs.causes import leading, primary
from mrta_falsify.trial import Job, Judged, TrialWatch, judge, judges_of, summed_up
from scenic_worlds.variation import perturb_world
from simulator_interface import starts
from simulator_interface.guard import Guard, guarded
from simulator_interface.simulate import EpisodeRun

Answers = Callable[[RunResult], bool | None]  #: whether a run fails; None: it tells nothing
LATE = 0.5  # s after its deadline at which a task counts as late
OnEnd = Callable[[World, Judged], None]  #: called with a run's world and result where it was run


class Lab(AbstractContextManager["Lab"]):
    """Runs experiments, each of them once.

    Its processes start with the first experiments that go side by side, and end with the block
    that it is opened in.

    Args:
        journal: file of finished runs, for the next call; None keeps them in memory only.
        code: digest of the code that is run; rows of other code are not read.
        workers: processes.
        on_run: called after each run.
    """

    def __init__(
        self,
        journal: Path | None = None,
        *,
        code: str = "",
        workers: int = 1,
        on_run: Callable[[], None] = lambda: None,
    ) -> None:
        self.journal = RunJournal(RunResult, journal, code=code)
        self.workers = workers
        self._opened = ExitStack()
        self._pool: Pool | None = None
        self.on_run = on_run  #: called for answers from the journal, too

    def __exit__(self, *error: Any) -> None:
        self._pool = None
        self._opened.__exit__(*error)

    def run(self, experiment: Experiment) -> RunResult:
        """Run one experiment."""
        return next(self.map((experiment,)))

    def watch(self, experiment: Experiment, on_end: OnEnd) -> RunResult:
        """Run one experiment, known or not, and look at the run itself where it was run.

        Args:
            experiment: to run.
            on_end: called in the process that ran it, with its trace.

        Raises:
            HarnessError: the toolkit failed, or ``on_end`` did.
        """
        (result,) = run_group((experiment,), on_end)
        return result

    def map(self, experiments: Iterable[Experiment]) -> Iterator[RunResult]:
        """Run experiments; their results come in the order of the experiments.

        Raises:
            HarnessError: processes died three times in a row, or the toolkit failed.
            PlaceError: the journal cannot be written.
            KeyboardInterrupt: Ctrl-C; finished runs are in the journal.
        """
        wanted = list(experiments)
        keys = [experiment.digest() for experiment in wanted]
        missing = {
            key: experiment
            for key, experiment in zip(keys, wanted, strict=True)
            if key not in self.journal.answers
        }
        for _ in {key for key in keys if key not in missing}:
            self.on_run()
        for key, result in self._ran(_shared(missing)):
            self._keep(key, result)
            self.on_run()
        for key in keys:
            yield self.journal.answers[key]

    def vote(
        self,
        experiment: Experiment,
        at_most: int,
        fails: Answers = lambda result: result.failed if result.status == "judged" else None,
    ) -> Vote:
        """Run copies of an experiment with small differences until the rest cannot change it.

        Args:
            experiment: whose world is varied; its own run does not vote.
            at_most: copies.
            fails: whether a run counts as failed; None: it tells nothing.
        """
        vote = Vote(runs=0, failed=0)
        for number in range(1, at_most + 1):
            copy = dataclasses.replace(experiment, perturbation=number)
            vote = vote.add(failed=fails(self.run(copy)))
            if 2 * vote.failed > at_most or 2 * (vote.runs - vote.failed) >= at_most:
                break
        return vote

    def _ran(self, groups: Sequence[dict[str, Experiment]]) -> Iterator[tuple[str, RunResult]]:
        if self.workers < 2 or len(groups) < 2:
            for group in groups:
                yield from zip(group, run_group(tuple(group.values())), strict=True)
            return
        if self._pool is None:
            self._pool = self._opened.enter_context(Pool(_runs_groups, workers=self.workers))
        found = self._pool.map([tuple(group.values()) for group in groups])
        try:
            for group, rows in zip(groups, found, strict=True):
                yield from zip(group, rows, strict=True)
        except Ending:
            text = f"processes of the lab have died {MAX_DEATHS} times in a row; call again"
            raise HarnessError(text) from None

    def _keep(self, key: str, result: RunResult) -> None:
        """Keep a result; on disc only if it may not come out otherwise when it is run again."""
        if result.status == "error":
            self.journal.answers[key] = result
        else:
            self.journal.keep(key, result)


def _shared(missing: dict[str, Experiment]) -> list[dict[str, Experiment]]:
    """Put together what shares the run before its first edit, by the time of that."""
    groups: dict[tuple[str, ...], dict[str, Experiment]] = {}
    for key, experiment in sorted(missing.items(), key=lambda item: item[1].begins_at):
        alone = key if not _forks(experiment) else ""
        bare = dataclasses.replace(experiment, edits=())
        groups.setdefault((bare.digest(), alone), {})[key] = experiment
    return list(groups.values())


def _forks(experiment: Experiment) -> bool:
    """Whether the run goes on in a fork from its first edit on; else it is edited from the start.

    A stack in a process of its own cannot be exchanged in mid-run, nor judged apart from its past.
    """
    if experiment.stack.stack is None:
        return bool(experiment.edits)
    return any(edit.nudge or edit.without for edit in experiment.edits)


# --- one group, in a process of its own -----------------------------------------------------------

_guard = Guard()  # of a process of the pool


def _ignore(world: World, judged: Judged) -> None:
    del world, judged


def _runs_groups() -> Callable[[tuple[Experiment, ...]], list[RunResult]]:
    return _in_pool


def _in_pool(group: tuple[Experiment, ...]) -> list[RunResult]:
    with guarded(_guard):
        return run_group(group)


def run_group(group: Sequence[Experiment], on_end: OnEnd = _ignore) -> list[RunResult]:
    """Run experiments that share all before their first edit, sorted by the time of that.

    Args:
        group: of them, alike in world, stack and perturbation.
        on_end: called with the world and the result of each, where it was run.

    Returns:
        A result for each; a world that cannot begin, and a stack that ends its process, are
        results as well.
    """
    first = group[0]
    try:
        world = first.world
        if first.perturbation:
            world = perturb_world(world, first.perturbation - 1)
        starts.check_starts(world)
    except InputError as error:
        return [RunResult(status="impossible", detail=str(error)) for _ in group]
    if not _forks(first):
        return [_whole(one, world, on_end) for one in group]
    try:
        rows = run_supervised(functools.partial(_forked_rows, group, world, on_end))
    except Ending as failed:
        return [RunResult(status="error", detail=str(failed)) for _ in group]
    return [codec.decode(RunResult, row, where="run") for row in rows]


def experiment_of_job(job: Job) -> Experiment:
    """Describe the run of a job; a stack outside is asked anew."""
    return Experiment(
        world=job.world,
        stack=job.config,
        specs=job.specifications,
        then=job.then,
        early_stop=job.early_stop,
        limits=job.limits,
        rules=job.rules,
    )


def _job_of(experiment: Experiment, world: World) -> Job:
    return Job(
        world=world,
        config=experiment.stack,
        specifications=experiment.specs,
        early_stop=experiment.early_stop,
        then=experiment.then,
        limits=experiment.limits,
        transcript=experiment.transcript,
        rules=experiment.rules or RULES,
    )


def _whole(experiment: Experiment, world: World, on_end: OnEnd) -> RunResult:
    """Run a stack in a process of its own; what is edited is so from the first tick on."""
    stack = experiment.stack
    for edit in experiment.edits:
        stack = edit.stack or stack
    job = dataclasses.replace(_job_of(experiment, world), config=stack)
    try:
        judged = judge(job)
    except InputError as error:
        return RunResult(status="impossible", detail=str(error))
    except HarnessError as error:
        return RunResult(status="error", detail=str(error))
    on_end(world, judged)
    return result_of(experiment, judged)


def _forked_rows(group: Sequence[Experiment], world: World, on_end: OnEnd) -> list[Any]:
    """Run a world once, and go on in a fork where each experiment begins; results as data."""
    job = _job_of(group[0], world)
    judges = judges_of(job)
    watch = TrialWatch(job, judges)
    forked: list[Experiment] = []  # that goes on; none before the fork

    def stop(frame: Frame) -> str:
        delivered = run.episode.books.delivered
        is_decided = any(_is_decided(one, world, delivered, frame.sensed.time) for one in forked)
        return "decided" if is_decided else watch.stop(frame)

    run = EpisodeRun(world, job.config, specifications=judges, stop=stop)
    try:
        run.advance()
        return [_forked(run, watch, one, forked, on_end) for one in group]
    finally:
        run.close()


def _is_decided(one: Experiment, world: World, delivered: Collection[int], time: float) -> bool:
    """Whether what became of the tasks of an experiment is known at a time [s]."""
    open_ = [task for task in one.until_delivered if task not in delivered]
    if one.ends_late and any(time > world.tasks[task].deadline + LATE for task in open_):
        return True
    return bool(one.until_delivered) and not open_


def _forked(
    run: EpisodeRun,
    watch: TrialWatch,
    one: Experiment,
    forked: list[Experiment],
    on_end: OnEnd,
) -> Any:
    _advance(run, one.begins_at)

    def branch() -> Any:
        run.episode.become_copy()
        forked.append(one)
        for edit in one.edits:
            _advance(run, edit.at)
            if not run.ended:
                _make(run, edit)
        _advance(run, np.inf)
        judged = summed_up(run.outcome(), watch)
        on_end(run.episode.world, judged)
        return codec.encode(result_of(one, judged))

    try:
        return run_supervised(branch)
    except Ending as failed:
        return codec.encode(RunResult(status="error", detail=str(failed)))


def _advance(run: EpisodeRun, until: float) -> None:
    """Advance a run to a time [s], or to its end if that comes before."""
    while not run.ended and (run.frame is None or run.frame.sensed.time < until):
        run.advance()


def _make(run: EpisodeRun, edit: Edit) -> None:
    """Change a run as an edit says."""
    if edit.nudge:
        run.episode.nudge(edit.nudge)
    if edit.stack is not None:
        run.episode.swap(edit.stack)
    for robot in edit.without:
        run.episode.remove(robot)


def result_of(experiment: Experiment, judged: Judged) -> RunResult:
    """Sum up a judged run."""
    outcome = judged.outcome
    violated = any(verdict.violated for verdict in judged.verdicts)
    rank: Rank = "none"
    if violated:
        rank = "primary" if primary(judged.verdicts, experiment.then) else "secondary"
    verdict, course = leading(judged.verdicts), None
    if experiment.with_course and verdict is not None:
        course = course_of(verdict, outcome.trace, experiment.world)
    reasons = [v.not_judged for v in judged.verdicts if v.not_judged]
    return RunResult(
        status="not_judged" if reasons and not violated else "judged",
        verdicts=judged.verdicts,
        margins=judged.margins,
        signature=signed(judged.verdicts, experiment.rules or RULES) if violated else "",
        rank=rank,
        ended=outcome.ended,
        detail=reasons[0] if reasons else "",
        trace=outcome.trace.digest,
        sim_time=outcome.sim_time,
        wall_s=outcome.wall_s,
        met=_met(experiment.situation, outcome.trace),
        course=course,
    )


def _met(situation: Situation | None, trace: Trace) -> float | None:
    """When a situation came about first [s]; None: it never did."""
    if situation is None or "pose" not in trace.columns:
        return None
    places = trace.columns["pose"][:, list(situation.robots), :2]
    near = (np.hypot(*np.moveaxis(places - situation.place, -1, 0)) <= situation.reach).all(axis=1)
    return float(near.argmax() * trace.dt) if near.any() else None
