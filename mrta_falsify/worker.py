"""What a worker of a campaign runs: from a proposal to the record of its trial.

Module-level and free of closures over processes, so that a spawned worker can open it.
"""

from __future__ import annotations

import dataclasses
import functools
import os
import time
import weakref
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from mrta_falsify.campaigns.runner import point_digest
from mrta_falsify.campaigns.settings import CONFIRMING_RUNS, TrialSettings
from mrta_falsify.campaigns.signature import signature
from mrta_falsify.campaigns.store import OTHER, removed, trial_folder
from mrta_falsify.core import codec
from mrta_falsify.core.candidate import Candidate
from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.core.durable import make_folder, naming, place_error_in
from mrta_falsify.core.errors import InputError
from mrta_falsify.core.probability import failure_probability
from mrta_falsify.core.record import (
    EngineRun,
    Origin,
    OtherRun,
    PerturbedRuns,
    Repeats,
    SearchData,
    TrialRecord,
    versions,
)
from mrta_falsify.core.run_result import RunResult, Vote
from mrta_falsify.core.seeding import candidate_seed
from mrta_falsify.core.trace import write_trace
from mrta_falsify.core.world import World, write_world
from mrta_falsify.perturbed_runs import NO_COMPARISON, Comparison, judged_by_vote, trial_score
from mrta_falsify.possibility import look_at
from mrta_falsify.process.budget import credit, own_budget
from mrta_falsify.specs.attribution import suspect
from mrta_falsify.specs.causes import leading
from mrta_falsify.trial import (
    Job,
    Judged,
    campaign_specifications,
    judge,
    on_kinematic_engine,
    perturbed_job,
)
from simulator_interface.external.transcript import TRANSCRIPT_NAME, Transcript, write_transcript
from simulator_interface.guard import Guard, guarded
from simulator_interface.simulate import Outcome

if TYPE_CHECKING:
    from scenic_worlds.program import Program


def open_trials(settings: TrialSettings) -> Callable[[dict[str, Any]], dict[str, Any]]:
    """Compile a campaign's scenario; the result runs one job after the other.

    Args:
        settings: of the campaign.

    Returns:
        A function from ``{"number": n, "u": [...]}`` to a record as JSON-shaped data.

    Raises:
        InputError: the program does not compile, or is not the one the campaign began with.
    """
    trials = TrialRunner(settings, open_program(settings))
    return lambda job: codec.encode(
        trials.run(job["number"], np.asarray(job["u"], dtype=np.float64))
    )


def open_program(settings: TrialSettings) -> Program:
    """Compile a campaign's scenario.

    Raises:
        InputError: it does not compile, or is not the one the campaign began with.
    """
    from scenic_worlds import program  # noqa: PLC0415 - Scenic takes seconds to import

    compiled = program.compile_program(program.scenario_path(settings.scenario), settings.params)
    if settings.sources_digest and compiled.sources_digest != settings.sources_digest:
        raise InputError(
            f"{settings.scenario}: the program (or a file it imports) has changed since the "
            "campaign began; undo the change, or begin a new campaign"
        )
    return compiled


class TrialRunner:
    """Runs the trials of one campaign in this process."""

    def __init__(self, settings: TrialSettings, program: Program) -> None:
        self._settings = settings
        self._program = program
        self._guard = Guard(on_lost=credit)
        self._files = TrialFiles.of(settings.directory)

    def run(self, number: int, u: np.ndarray) -> TrialRecord:
        """Run proposal ``number`` at ``u`` ``(k,)``; its files are durable before it returns.

        Raises:
            PlaceError: a file cannot be written, or the campaign's directory was removed.
        """
        with guarded(self._guard):
            return self._run(number, u)

    def _run(self, number: int, u: np.ndarray) -> TrialRecord:
        settings = self._settings
        began = time.perf_counter()
        proposed = Candidate(
            number=number,
            u=u,
            seed=candidate_seed(settings.seed, number),
            params=settings.params,
        )
        record = TrialRecord(
            candidate=proposed,
            origin=Origin(proposal=point_digest(u), versions=versions()),
        )
        try:
            realised = self._program.realise(proposed, mode=settings.mode)
        except InputError as error:
            if place := place_error_in(error):
                raise place from error  # it tells of the disk, not of the scene
            spent = time.perf_counter() - began
            origin = dataclasses.replace(record.origin, scene_s=spent)
            return dataclasses.replace(record, origin=origin, error=str(error))
        spent = time.perf_counter() - began
        possible = look_at(realised.world, specifications_of(settings))
        origin = dataclasses.replace(
            record.origin,
            values=self._program.values_of(realised.candidate),
            world=realised.world.digest(),
            attempts=realised.attempts,
            scene_s=spent,
            shut=possible.shut,
            notes=possible.notes,
        )
        record = dataclasses.replace(record, candidate=realised.candidate, origin=origin)
        if possible.late or (possible.shut and not settings.with_shut_rooms):
            result = RunResult(status="impossible")
            return dataclasses.replace(record, result=result, error=possible.reason)
        return self._simulate(realised.world, record, realised.scene)

    def _simulate(self, world: World, record: TrialRecord, scene: Any) -> TrialRecord:
        settings = self._settings
        began = time.perf_counter()
        config = settings.stack
        if settings.screen:
            quick = self._judge(world, on_kinematic_engine(config), scene)
            if not quick.failed:
                return self._finish(
                    world, record, quick, on_kinematic_engine(config).engine.name, began
                )
            screening = engine_run(on_kinematic_engine(config).engine.name, quick, failed=True)
            origin = dataclasses.replace(record.origin, screening=screening)
            record = dataclasses.replace(record, origin=origin)
        judged = self._judge(world, config, scene)
        comparison = self._vote(world, config, scene, judged)
        repeated = self._repeat(world, config, scene, judged) if judged.failed else None
        other = self._keep_other(world, record, comparison)
        record = dataclasses.replace(record, other=other, repeats=repeated)
        if judged.is_primary and (comparison.jittered is None or comparison.jittered.robust):
            confirmed = self._confirm(world, config, scene, judged)
            record = dataclasses.replace(record, engines={run.engine: run for run in confirmed})
        return self._finish(world, record, judged, config.engine.name, began, comparison)

    def _confirm(
        self, world: World, config: StackConfig, scene: Any, judged: Judged
    ) -> tuple[EngineRun, ...]:
        """Run a failing world and copies of it on other engines, each with the whole time limit."""
        settings, runs = self._settings, []
        others = [name for name in settings.confirm if name != config.engine.name]
        for name in others:
            with own_budget():
                there = dataclasses.replace(config, engine=Choice(name))
                run = self._judge(world, there, scene, keep_trace=False)
                copies = settings.jittered or CONFIRMING_RUNS
                again = functools.partial(self._judge_perturbed, config=there, scene=scene)
                comparison = judged_by_vote(world, run, copies, again)
            runs.append(engine_run(name, run, failed=run.is_primary, jittered=comparison.jittered))
        return tuple(runs)

    def _vote(self, world: World, config: StackConfig, scene: Any, judged: Judged) -> Comparison:
        if not judged.is_primary:
            return NO_COMPARISON
        against = self._settings.against
        return judged_by_vote(
            world,
            judged,
            self._settings.jittered,
            functools.partial(self._judge_perturbed, config=config, scene=scene),
            None if against is None else lambda copy: self._judge_other(copy, against, scene),
        )

    def _judge_other(self, world: World, config: StackConfig, scene: Any) -> Judged:
        """Run a world under the other stack, with the whole time limit."""
        with own_budget():
            return self._judge(world, config, scene)

    def _keep_other(
        self, world: World, record: TrialRecord, comparison: Comparison
    ) -> OtherRun | None:
        if comparison.other is None or comparison.their_run is None:
            return None
        return dataclasses.replace(
            comparison.other,
            trace_file=self._write(world, comparison.their_run.outcome, record.number, OTHER),
        )

    def _repeat(
        self, world: World, config: StackConfig, scene: Any, judged: Judged
    ) -> Repeats | None:
        """Run a failing world again, nothing changed; each run has the whole time limit."""
        if config.stack is None or not self._settings.verify:
            return None
        runs = [self._run_again(world, config, scene) for _ in range(self._settings.verify)]
        return counted_repeats(judged, runs)

    def _run_again(self, world: World, config: StackConfig, scene: Any) -> Judged | None:
        try:
            with own_budget():
                return self._judge(world, config, scene, keep_trace=False)
        except InputError:  # the stack did not start this time
            return None

    def _judge(
        self, world: World, config: StackConfig, scene: Any, *, keep_trace: bool = True
    ) -> Judged:
        return judge(trial_job(self._settings, world, config, scene), keep_trace=keep_trace)

    def _judge_perturbed(self, copy: World, config: StackConfig, scene: Any) -> Judged:
        """Run a copy of a failing world; only whether it fails counts."""
        return judge(
            perturbed_job(trial_job(self._settings, copy, config, scene)), keep_trace=False
        )

    def _finish(
        self,
        world: World,
        record: TrialRecord,
        judged: Judged,
        engine: str,
        began: float,
        comparison: Comparison = NO_COMPARISON,
    ) -> TrialRecord:
        outcome = judged.outcome
        keep = judged.failed or record.number % self._settings.keep_every == 0
        trace_file = self._write(world, outcome, record.number) if keep else ""
        copies = comparison.jittered
        result = RunResult(
            status=judged.status,
            verdicts=judged.verdicts,
            margins=judged.margins,
            signature=signature(judged.verdicts),
            rank=judged.rank,
            ended=outcome.ended,
            trace=outcome.trace.digest,
            sim_time=outcome.sim_time,
            wall_s=time.perf_counter() - began,
            engine=engine,
            layer=suspect(self._settings.stack, judged.verdicts, outcome.trace)
            if judged.failed
            else "",
            trace_file=trace_file,
            coupling=outcome.coupling,
        )
        search = SearchData(
            score=trial_score(judged, comparison),
            descriptors=judged.descriptors,
            situations=judged.situations,
            blamed=blamed(judged),
            expected=copies.objectives if copies is not None else {},
            noise=copies.noise if copies is not None else {},
        )
        vote = voted(copies)
        return dataclasses.replace(record, result=result, vote=vote, search=search)

    def _write(self, world: World, outcome: Outcome, number: int, beside: str = "") -> str:
        return self._files.write(world, outcome, number, beside) if self._files else ""


class TrialFiles:
    """Keeps worlds and traces in a campaign's directory, which is held open.

    A directory that was removed is not made anew, nor is another one of its name taken for it.

    Args:
        path: of the directory.
        handle: of the open directory; closed with this object.
    """

    def __init__(self, path: Path, handle: int) -> None:
        self._path = path
        self._handle = handle
        weakref.finalize(self, os.close, handle)

    @classmethod
    def of(cls, directory: str) -> TrialFiles | None:
        """Open a directory; None if it is not on this machine, or none is named: nothing is kept.

        Raises:
            PlaceError: it cannot be used.
        """
        if not directory:
            return None
        with naming(directory):
            try:
                return cls(Path(directory), os.open(directory, os.O_RDONLY | os.O_CLOEXEC))
            except FileNotFoundError:
                return None

    def write(self, world: World, outcome: Outcome, number: int, beside: str = "") -> str:
        """Write the files of trial ``number``; they are durable on return.

        Args:
            world: that was run.
            outcome: of its run.
            number: of the trial.
            beside: folder in that of the trial; empty: that itself.

        Returns:
            The trace, relative to the directory.

        Raises:
            PlaceError: a file cannot be written, or the directory was removed.
        """
        try:
            is_there = os.path.samestat(os.stat(self._path), os.fstat(self._handle))
        except OSError:
            is_there = False
        if not is_there:
            raise removed(self._path)
        folder = make_folder(trial_folder(self._path, number) / beside)
        write_world(world, folder / "world.json")
        write_trace(outcome.trace, folder / "trace.zip")
        if outcome.transcript is not None:
            write_transcript(outcome.transcript, folder / TRANSCRIPT_NAME)
        return str((folder / "trace.zip").relative_to(self._path))


def engine_run(
    engine: str, judged: Judged, *, failed: bool, jittered: PerturbedRuns | None = None
) -> EngineRun:
    """Sum up what a run on another engine gave."""
    return EngineRun(
        engine=engine,
        failed=failed,
        violated=tuple(v.spec for v in judged.verdicts if v.violated),
        trace_digest=judged.outcome.trace.digest,
        sim_time=judged.outcome.sim_time,
        wall_s=judged.outcome.wall_s,
        vote=voted(jittered),
    )


def voted(copies: PerturbedRuns | None) -> Vote | None:
    """Count perturbed runs as a vote; None: none were run."""
    return None if copies is None else Vote(runs=copies.runs, failed=copies.failed)


def blamed(judged: Judged) -> tuple[str, ...]:
    """Name the objects that a search should change first, sorted.

    Of a failure the ones that its leading verdict names, and always those that took part when the
    run was nearest to a deadlock.
    """
    verdict = leading(judged.verdicts)
    return tuple(sorted({*judged.involved, *(verdict.who if verdict else ())}))


def counted_repeats(judged: Judged, runs: Sequence[Judged | None]) -> Repeats:
    """Count how often a failure came again.

    Args:
        judged: the run that failed.
        runs: of the same world; None: the stack did not start.
    """
    wanted, verdict = signature(judged.verdicts), leading(judged.verdicts)
    assert verdict is not None, "only failures are run again"
    decided = [run for run in runs if run is not None and _decides(run, verdict.spec)]
    same = sum(signature(run.verdicts) == wanted for run in decided)
    return Repeats(
        same=failure_probability(same, len(decided), undecided=len(runs) - len(decided)),
        otherwise=sum(run.failed for run in decided) - same,
        identical=sum(
            run is not None and run.outcome.trace.digest == judged.outcome.trace.digest
            for run in runs
        ),
    )


def _decides(run: Judged, spec: str) -> bool:
    """Whether a run tells if a specification fails in it."""
    return run.failed or not any(v.spec == spec and v.not_judged for v in run.verdicts)


def trial_job(settings: TrialSettings, world: World, config: StackConfig, scene: Any = None) -> Job:
    """Make the job of a world under a campaign's specifications and limits.

    Args:
        settings: of the campaign.
        world: that is run.
        config: of the stack under test.
        scene: which the world was sampled from, if its program goes on in the run.
    """
    return Job(
        world=world,
        config=config,
        scene=scene,
        specifications=specifications_of(settings),
        early_stop=settings.early_stop,
        then=settings.then,
        limits=settings.limits,
    )


def rerun(
    settings: TrialSettings, record: TrialRecord, world: World, transcript: Transcript | None = None
) -> Judged:
    """Run a recorded trial again, on the engine its verdicts come from.

    Args:
        settings: of its campaign.
        record: of the trial.
        world: its world.
        transcript: what a stack in a process of its own said then; None: it is asked again.
    """
    scene = None
    if world.scripted:
        scene = open_program(settings).realise(record.candidate, mode=settings.mode).scene
    job = trial_job(settings, world, stack_of(settings, record), scene)
    return judge(dataclasses.replace(job, transcript=transcript))


def stack_of(settings: TrialSettings, record: TrialRecord) -> StackConfig:
    """Put the campaign's stack on the engine that a record's verdicts come from."""
    if record.engine in ("", settings.stack.engine.name):
        return settings.stack
    return on_kinematic_engine(settings.stack)


def specifications_of(settings: TrialSettings) -> tuple[str, ...]:
    """List what the trials of a campaign are judged by."""
    return settings.specifications or campaign_specifications(settings.stack)
