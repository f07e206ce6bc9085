"""What a worker of a campaign runs: from a proposal to the record of its trial.

Module-level and free of closures over processes, so that a spawned worker can open it.
"""

from __future__ import annotations

import dataclasses
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
from mrta_falsify.core.config import Choice
from mrta_falsify.core.durable import make_folder, naming, place_error_in
from mrta_falsify.core.errors import InputError
from mrta_falsify.core.probability import failure_probability
from mrta_falsify.core.record import (
    EngineRun,
    Origin,
    PerturbedRuns,
    Repeats,
    SearchData,
    TrialRecord,
    versions,
)
from mrta_falsify.core.run_result import RunResult
from mrta_falsify.core.seeding import candidate_seed
from mrta_falsify.core.trace import write_trace
from mrta_falsify.core.world import World, write_world
from mrta_falsify.lab import (
    Experiment,
    Lab,
    certain,
    experiment_of_trial,
    open_program,
    result_of,
    specifications_of,
)
from mrta_falsify.perturbed_runs import (
    NO_COMPARISON,
    Comparison,
    compared_by_vote,
    judged_by_vote,
    trial_score,
)
from mrta_falsify.possibility import look_at
from mrta_falsify.process.budget import credit, own_budget
from mrta_falsify.specs.attribution import suspect
from mrta_falsify.specs.causes import leading
from mrta_falsify.trial import Judged, on_kinematic_engine
from simulator_interface.external.transcript import TRANSCRIPT_NAME, write_transcript
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
        lab = Lab(draw=lambda source: scene)
        own = experiment_of_trial(settings, world, settings.stack, record.candidate)
        if settings.screen:
            config = on_kinematic_engine(settings.stack)
            there = dataclasses.replace(own, stack=config)
            quick = lab.judge(there)
            result = _result(there, quick)
            if not quick.failed:
                return self._finish(world, record, quick, result, began)
            screening = engine_run(there, result, failed=True)
            origin = dataclasses.replace(record.origin, screening=screening)
            record = dataclasses.replace(record, origin=origin)
        judged = lab.judge(own)
        result = _result(own, judged)
        comparison = self._vote(lab, own, result, record.number)
        repeats = self._repeat(lab, own, result)
        record = dataclasses.replace(record, other=comparison.other, repeats=repeats)
        if judged.is_primary and (comparison.jittered is None or comparison.jittered.robust):
            record = dataclasses.replace(record, engines=self._confirm(lab, own))
        return self._finish(world, record, judged, result, began, comparison)

    def _confirm(self, lab: Lab, own: Experiment) -> dict[str, EngineRun]:
        """Run a failing world and copies of it on other engines, each with the whole time limit."""
        settings, runs = self._settings, {}
        for name in settings.confirm:
            if name == own.stack.engine.name:
                continue
            there = dataclasses.replace(
                own, stack=dataclasses.replace(own.stack, engine=Choice(name))
            )
            with own_budget():
                run = certain(lab.run(there))
                votes = judged_by_vote(lab, there, run, settings.jittered or CONFIRMING_RUNS)
            runs[name] = engine_run(there, run, failed=run.failed, jittered=votes.jittered)
        return runs

    def _vote(self, lab: Lab, own: Experiment, result: RunResult, number: int) -> Comparison:
        """Let copies of a failing world vote; the other stack has the whole time limit for each."""
        against = self._settings.against
        if not result.failed:
            return NO_COMPARISON
        if against is None:
            return judged_by_vote(lab, own, result, self._settings.jittered)
        other, files = dataclasses.replace(own, stack=against), ""

        def keep(world: World, judged: Judged) -> None:
            nonlocal files
            files = self._write(world, judged.outcome, number, OTHER)

        with own_budget():
            theirs = certain(lab.watch(other, keep))
        votes = compared_by_vote(
            lab, own, result, other, theirs, self._settings.jittered, own_budget
        )
        assert votes.other is not None
        return votes._replace(other=dataclasses.replace(votes.other, trace_file=files))

    def _repeat(self, lab: Lab, own: Experiment, result: RunResult) -> Repeats | None:
        """Run a failing world again, nothing changed; each run has the whole time limit."""
        if own.stack.stack is None or not self._settings.verify or not result.violated:
            return None
        runs = []
        for number in range(1, 1 + self._settings.verify):
            with own_budget():
                runs.append(lab.run(dataclasses.replace(own, repeat=number)))
        return counted_repeats(result, runs)

    def _finish(
        self,
        world: World,
        record: TrialRecord,
        judged: Judged,
        result: RunResult,
        began: float,
        comparison: Comparison = NO_COMPARISON,
    ) -> TrialRecord:
        outcome = judged.outcome
        keep = judged.failed or record.number % self._settings.keep_every == 0
        trace_file = self._write(world, outcome, record.number) if keep else ""
        copies = comparison.jittered or PerturbedRuns(runs=0, failed=0)
        layer = ""
        if judged.failed:
            layer = suspect(self._settings.stack, judged.verdicts, outcome.trace)
        result = dataclasses.replace(
            result,
            wall_s=time.perf_counter() - began,
            layer=layer,
            trace_file=trace_file,
            coupling=outcome.coupling,
        )
        search = SearchData(
            score=trial_score(judged, comparison),
            descriptors=judged.descriptors,
            situations=judged.situations,
            blamed=blamed(judged),
            expected=copies.objectives,
            noise=copies.noise,
        )
        vote = PerturbedRuns.vote(comparison.jittered)
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


def _result(experiment: Experiment, judged: Judged) -> RunResult:
    """Sum up a run as records do: with its engine; why nothing was judged is in its verdicts."""
    engine = experiment.stack.engine.name
    return dataclasses.replace(result_of(experiment, judged), engine=engine, detail="")


def engine_run(
    experiment: Experiment, run: RunResult, *, failed: bool, jittered: PerturbedRuns | None = None
) -> EngineRun:
    """Sum up what a run on another engine gave."""
    return EngineRun(
        engine=experiment.stack.engine.name,
        failed=failed,
        violated=run.violated,
        trace_digest=run.trace,
        sim_time=run.sim_time,
        wall_s=run.wall_s,
        vote=PerturbedRuns.vote(jittered),
    )


def blamed(judged: Judged) -> tuple[str, ...]:
    """Name the objects that a search should change first, sorted.

    Of a failure the ones that its leading verdict names, and always those that took part when the
    run was nearest to a deadlock.
    """
    verdict = leading(judged.verdicts)
    return tuple(sorted({*judged.involved, *(verdict.who if verdict else ())}))


def counted_repeats(result: RunResult, runs: Sequence[RunResult]) -> Repeats:
    """Count how often a failure came again.

    Args:
        result: of the run that failed.
        runs: of the same world.
    """
    wanted, verdict = signature(result.verdicts), leading(result.verdicts)
    assert verdict is not None, "only failures are run again"
    decided = [run for run in runs if _decides(run, verdict.spec)]
    same = sum(signature(run.verdicts) == wanted for run in decided)
    return Repeats(
        same=failure_probability(same, len(decided), undecided=len(runs) - len(decided)),
        otherwise=sum(bool(run.violated) for run in decided) - same,
        identical=sum(bool(run.trace) and run.trace == result.trace for run in runs),
    )


def _decides(run: RunResult, spec: str) -> bool:
    """Whether a run tells if a specification fails in it; not if the stack did not start."""
    if run.status == "impossible":
        return False
    return bool(run.violated) or not any(v.spec == spec and v.not_judged for v in run.verdicts)
