"""Runs one experiment, or several that share all before their first edit, where it is called.

The run goes forward once, and is forked where each of the experiments begins
(see :mod:`mrta_falsify.process`).
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Collection, Sequence
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from mrta_falsify.campaigns.rules import RULES, signed
from mrta_falsify.core import codec
from mrta_falsify.core.difference import Difference, first_difference
from mrta_falsify.core.errors import HarnessError, InputError
from mrta_falsify.core.fleet import Frame
from mrta_falsify.core.run_result import RunResult
from mrta_falsify.core.trace import Trace, read_trace
from mrta_falsify.core.world import World
from mrta_falsify.lab.course import course_of
from mrta_falsify.lab.experiment import (
    Edit,
    Experiment,
    KeptTrace,
    SceneSource,
    Situation,
)
from mrta_falsify.lab.recorded import draw_scene
from mrta_falsify.process.budget import Budget
from mrta_falsify.process.ending import Ending
from mrta_falsify.process.supervisor import run_supervised
from mrta_falsify.specs.causes import leading
from mrta_falsify.trial import Job, Judged, TrialWatch, judge, judges_of, summed_up
from scenic_worlds.variation import perturb_world
from simulator_interface import starts
from simulator_interface.simulate import EpisodeRun
from simulator_interface.warm_up import warm_up

OnEnd: TypeAlias = Callable[[World, Judged], None]  #: called with a run's world and result
DrawScene: TypeAlias = Callable[[SceneSource], Any]  #: gives the Scenic scene of a scripted world
LATE = 0.5  # s after its deadline at which a task counts as late


def ignore_run(world: World, judged: Judged) -> None:
    """Do not look at a run."""
    del world, judged


def world_of(experiment: Experiment) -> World:
    """Give the world that is run: with small differences, if the experiment says so.

    Raises:
        WorldError: a robot's start has no free place within 2 cm.
    """
    if not experiment.perturbation:
        return experiment.world
    return perturb_world(experiment.world, experiment.perturbation - 1)


def has_place(experiment: Experiment) -> bool:
    """Whether the world with small differences has a place for its robots."""
    try:
        world_of(experiment)
    except InputError:
        return False
    return True


def forks(experiment: Experiment) -> bool:
    """Whether the run goes on in a fork from its first edit on, as others like it do.

    A foreign stack cannot be exchanged in mid-run, nor judged apart from its past.
    """
    if experiment.stack.stack is None:
        return bool(experiment.edits)
    return any(edit.nudge or edit.without for edit in experiment.edits)


def _is_edited(experiment: Experiment) -> bool:
    """Whether a run of its own is edited on the way."""
    edits = experiment.edits
    return not forks(experiment) and any(edit.without_people for edit in edits)


def run_whole(
    experiment: Experiment, *, keep_trace: bool = True, draw: DrawScene = draw_scene
) -> Judged:
    """Run an experiment from its start, what is edited from the first tick on.

    Args:
        experiment: whose edits exchange the stack, if there are any.
        keep_trace: False: the trace has only its digest.
        draw: gives the scene of a scripted world.

    Raises:
        InputError: the world cannot be run, or the stack cannot be started in it.
        HarnessError: the toolkit failed, or the stack failed in one of two runs only.
    """
    world, stack = world_of(experiment), experiment.stack
    for edit in experiment.edits:
        stack = edit.stack or stack
    job = dataclasses.replace(job_of_experiment(experiment, world), config=stack)
    if experiment.scene is not None and world.scripted:
        job = dataclasses.replace(job, scene=draw(experiment.scene))
    return judge(job, keep_trace=keep_trace)


def run_group(
    group: Sequence[Experiment], on_end: OnEnd = ignore_run, draw: DrawScene = draw_scene
) -> list[RunResult]:
    """Run experiments that share all before their first edit, sorted by the time of that.

    Args:
        group: of them, alike in world, stack and perturbation.
        on_end: called with the world and the result of each, where it was run.
        draw: gives the scene of a scripted world.

    Returns:
        A result for each; a world that cannot begin, and a stack that ends its process, are
        results as well.

    Raises:
        HarnessError: the toolkit failed in a run that is not edited.
    """
    first = group[0]
    try:
        world = world_of(first)
        starts.check_starts(world)
    except InputError as error:
        return [RunResult(status="impossible", detail=str(error)) for _ in group]
    if not forks(first) and not _is_edited(first):
        return [_whole(one, world, on_end, draw) for one in group]
    if first.stack.stack is None:
        warm_up()
    try:
        rows = run_supervised(
            functools.partial(_forked_rows, group, world, on_end),
            budget=Budget.of_stack(first.limits),
        )
    except Ending as failed:
        return [RunResult(status="error", detail=str(failed)) for _ in group]
    return [codec.decode(RunResult, row, where="run") for row in rows]


def experiment_of_job(job: Job) -> Experiment:
    """Describe the run of a job; a foreign stack is asked anew."""
    return Experiment(
        world=job.world,
        stack=job.config,
        specs=job.specifications,
        then=job.then,
        early_stop=job.early_stop,
        limits=job.limits,
        rules=job.rules,
    )


def job_of_experiment(experiment: Experiment, world: World) -> Job:
    """Make the job of an experiment's run before it is edited."""
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


def _whole(experiment: Experiment, world: World, on_end: OnEnd, draw: DrawScene) -> RunResult:
    """Run from the start; of an edited run the toolkit's failure is a result, too."""
    keep = on_end is not ignore_run or _reads_trace(experiment)
    try:
        judged = run_whole(experiment, keep_trace=keep, draw=draw)
    except InputError as error:
        return RunResult(status="impossible", detail=str(error))
    except HarnessError as error:
        if not experiment.edits:
            raise
        return RunResult(status="error", detail=str(error))
    on_end(world, judged)
    return result_of(experiment, judged, world)


def _reads_trace(experiment: Experiment) -> bool:
    """Whether the result tells what only the trace says."""
    return bool(
        experiment.with_course
        or experiment.situation
        or experiment.compared_with
        or experiment.picture
    )


def _forked_rows(group: Sequence[Experiment], world: World, on_end: OnEnd) -> list[Any]:
    """Run a world once, and go on in a fork where each experiment begins; results as data."""
    job = job_of_experiment(group[0], world)
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
        if forks(one):
            run.episode.become_copy()
        forked.append(one)
        for edit in one.edits:
            _advance(run, edit.at)
            if not run.ended:
                _make(run, edit)
        _advance(run, np.inf)
        judged = summed_up(run.outcome(), watch)
        on_end(run.episode.world, judged)
        return codec.encode(result_of(one, judged, run.episode.world))

    if not forks(one):
        return branch()
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
    for person in edit.without_people:
        run.episode.remove_person(person)


def result_of(experiment: Experiment, judged: Judged, world: World | None = None) -> RunResult:
    """Sum up a judged run.

    Args:
        experiment: that was run.
        judged: its run.
        world: that was run; None: that of the experiment.
    """
    outcome, trace = judged.outcome, judged.outcome.trace
    verdict, course = leading(judged.verdicts), None
    if experiment.with_course and verdict is not None:
        course = course_of(verdict, trace, experiment.world)
    reasons = [v.not_judged for v in judged.verdicts if v.not_judged]
    return RunResult(
        status=judged.status,
        verdicts=judged.verdicts,
        margins=judged.margins,
        signature=signed(judged.verdicts, experiment.rules or RULES) if judged.failed else "",
        rank=judged.rank,
        ended=outcome.ended,
        detail=reasons[0] if reasons else "",
        trace=trace.digest,
        sim_time=outcome.sim_time,
        wall_s=outcome.wall_s,
        met=_met(experiment.situation, trace),
        course=course,
        difference=_difference(experiment.compared_with, trace),
        picture=_draw(experiment.picture, world or experiment.world, judged),
    )


def _difference(kept: KeptTrace | None, trace: Trace) -> Difference | None:
    if kept is None or kept.digest == trace.digest:
        return None
    return first_difference(read_trace(Path(kept.file)), trace)


def _draw(picture: str, world: World, judged: Judged) -> str:
    """Draw a run that fails, where a picture is asked for."""
    if not picture or not judged.failed:
        return ""
    from reports.contents import RunView  # noqa: PLC0415
    from reports.run_picture import write_picture  # noqa: PLC0415 - matplotlib loads slowly

    view = RunView(world=world, trace=judged.outcome.trace, verdicts=judged.verdicts)
    write_picture(view, Path(picture))
    return picture


def _met(situation: Situation | None, trace: Trace) -> float | None:
    """When a situation came about first [s]; None: it never did."""
    if situation is None or "pose" not in trace.columns:
        return None
    places = trace.columns["pose"][:, list(situation.robots), :2]
    near = (np.hypot(*np.moveaxis(places - situation.place, -1, 0)) <= situation.reach).all(axis=1)
    return float(near.argmax() * trace.dt) if near.any() else None
