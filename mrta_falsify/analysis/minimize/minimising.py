"""The smallest world that still fails in the same way.

Every accepted step is a run that fails by the same mechanism (see
:func:`mrta_falsify.campaigns.signature.mechanism`), so the result is verified by construction. Of a
failure that another stack does not share, that stack passed every accepted step, too. The search
ends when no single robot, task, person, piece of furniture, event or stretch of time can go, and no
pair of these things. Runs with small differences then say how often the result fails.
"""

from __future__ import annotations

import contextlib
import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import yaml

from mrta_falsify.analysis.minimize.edits import GROUPS, things_of
from mrta_falsify.analysis.minimize.first_guess import concerned
from mrta_falsify.analysis.minimize.nominal import NOMINAL
from mrta_falsify.analysis.minimize.reruns import PERTURBED, OutOfRunsError, Reruns
from mrta_falsify.analysis.minimize.search import SmallestSearch
from mrta_falsify.campaigns.finding_files import FILE_NAMES, write_finding
from mrta_falsify.campaigns.rules import signed
from mrta_falsify.campaigns.settings import COMPARISON_RUNS
from mrta_falsify.campaigns.signature import mechanism
from mrta_falsify.campaigns.store import Campaign
from mrta_falsify.core import codec
from mrta_falsify.core.config import StackConfig
from mrta_falsify.core.durable import staged, write_atomically
from mrta_falsify.core.errors import InputError
from mrta_falsify.core.findings import Minimisation
from mrta_falsify.core.record import PerturbedRuns, TrialRecord
from mrta_falsify.core.trace import write_trace
from mrta_falsify.core.world import World, write_world
from mrta_falsify.lab import Lab, course_of, experiment_of_job, result_of
from mrta_falsify.lab.stored import job_of, kept_trace, kept_world, other_stack_of
from mrta_falsify.perturbed_runs import Comparison, compared_by_vote
from mrta_falsify.specs.causes import leading
from mrta_falsify.trial import Job, Judged

MAX_RUNS = 200  # simulations, unless the caller says otherwise
JOURNAL_NAME = "minimize.cache.jsonl"  # beside the trial; a second call goes on from it
WORLD, TRACE, STACK = "world.min.json", "trace.min.zip", "stack.yaml"  # files of the result
OTHER_TRACE, OTHER_STACK = "trace.min.other.zip", "stack.other.yaml"  # if two are compared
PROGRAM, LAYOUT = "world.min.scenic", "world.min.layout.json"  # the latter if none is shipped


FILES = (WORLD, TRACE, STACK, OTHER_TRACE, OTHER_STACK, PROGRAM, LAYOUT)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Smallest:
    """The smallest world with its run."""

    world: World
    judged: Judged  #: its run
    theirs: Judged | None  #: the other stack's run, if two are compared
    finding: Minimisation


def minimize(
    campaign: Campaign,
    record: TrialRecord,
    *,
    max_runs: int = MAX_RUNS,
    workers: int = 1,
    on_run: Callable[[int, str], None] = lambda runs, text: None,
) -> Minimisation:
    """Minimise a stored failure and keep the result beside it; a second call goes on.

    Args:
        campaign: that the failure belongs to.
        record: of the failure.
        max_runs: simulations at most, including those of earlier calls, beside ten of the result.
        workers: simulations at a time. They change how many runs it takes, not the result.
        on_run: called after each run with the number so far and a line about it.

    Returns:
        The result, written as ``minimize.json``. Beside it are ``world.min.json``,
        ``world.min.scenic``, ``trace.min.zip`` and the stack that fails, ``stack.yaml``.

    Raises:
        InputError: the trial did not fail, or its world is missing.
        PlaceError: a file cannot be written; finished runs are kept, and an earlier result.
        Interrupted: Ctrl-C; finished runs are kept, and nothing else is written.
    """
    if not record.failed:
        raise InputError(f"trial {record.id} violates nothing; there is nothing to minimise")
    job = job_of(campaign, record)
    folder = campaign.make_folder(record)
    other = other_stack_of(campaign, record)
    with Lab(folder / JOURNAL_NAME, what=f"minimize {record.id}", workers=workers) as lab:
        found = minimize_job(job, other=other, max_runs=max_runs, lab=lab, on_run=on_run)
        return _write(found, job, other, folder)


def expected_runs(campaign: Campaign, record: TrialRecord) -> int:
    """Estimate how many runs it takes to minimise a stored failure; 0: that is not known.

    The first guess is right as a rule. Then each thing that it keeps is tried once or twice, and so
    are all pairs.
    """
    verdict = leading(record.verdicts)
    if verdict is None or not record.trace_file:
        return 0
    with contextlib.suppress(InputError):
        trace = kept_trace(campaign, record)
        guess = concerned(kept_world(campaign, record), verdict, trace)
        if guess is not None:
            count = len(things_of(guess))
            runs = 1 + 2 * count + math.comb(count, 2)
            return runs * (2 if campaign.settings.trials.against else 1) + PERTURBED
    return 0


def _write(found: Smallest, job: Job, other: StackConfig | None, folder: Path) -> Minimisation:
    """Write the result beside the trial, in place of an earlier one."""
    mark = FILE_NAMES[Minimisation]
    with staged(folder, mark=mark, others=FILES) as stage:
        write_world(found.world, stage / WORLD)
        write_trace(found.judged.outcome.trace, stage / TRACE)
        _write_stack(job.config, stage / STACK)
        if other is not None and found.theirs is not None:
            write_trace(found.theirs.outcome.trace, stage / OTHER_TRACE)
            _write_stack(other, stage / OTHER_STACK)
        program = write_as_program(found, job, stage)
        finding = dataclasses.replace(found.finding, program=program)
        write_finding(stage, finding)
    return finding


def _write_stack(config: StackConfig, path: Path) -> None:
    write_atomically(path, yaml.safe_dump(codec.encode(config), sort_keys=False).encode())


def write_as_program(found: Smallest, job: Job, folder: Path) -> str:
    """Write a minimised world as ``world.min.scenic`` and run what the program gives.

    Args:
        found: the result.
        job: that was minimised; its stack and specifications are used.
        folder: for the program, and for its layout ``world.min.layout.json`` if none is shipped.

    Returns:
        ``identical`` if the program's run has the same trace, ``same failure`` if it fails by the
        same mechanism. Otherwise why there is no program; none is left in ``folder`` then.
    """
    from scenic_worlds.program import compile_program  # noqa: PLC0415 - Scenic takes seconds
    from scenic_worlds.writing import write_program  # noqa: PLC0415

    path = folder / PROGRAM
    wanted = mechanism(found.judged.verdicts)
    name = signed(found.judged.verdicts, job.rules)
    try:
        write_program(found.world, path, comment=f"The smallest world that fails with {name}.")
        world = compile_program(path).sample(0)
        judged = Lab().judge(dataclasses.replace(experiment_of_job(job), world=world))
        if judged.outcome.trace.digest == found.finding.trace_digest:
            return "identical"
        now = mechanism(judged.verdicts)
        if now == wanted:
            return "same failure"
        reason = f"the program's world gives {now or 'no failure'}"
    except InputError as error:
        reason = str(error)
    for name in (PROGRAM, LAYOUT):
        (folder / name).unlink(missing_ok=True)
    return reason


def minimize_job(
    job: Job,
    *,
    other: StackConfig | None = None,
    max_runs: int = MAX_RUNS,
    lab: Lab | None = None,
    on_run: Callable[[int, str], None] = lambda runs, text: None,
) -> Smallest:
    """Minimise the failure of a job (see :func:`minimize`).

    Args:
        job: that fails.
        other: a stack that must go on passing, if there is one.
        max_runs: simulations at most.
        lab: that runs them, and keeps finished runs.
        on_run: called after each run.
    """
    own = experiment_of_job(job)
    with lab or Lab() as opened:
        first = opened.judge(own)
        verdict, trace = leading(first.verdicts), first.outcome.trace
        if verdict is None:
            raise InputError("the run violates nothing; there is nothing to minimise")
        reruns = Reruns(opened, job, verdict, mechanism(first.verdicts), max_runs, on_run, other)
        search = SmallestSearch(job.world, course_of(verdict, trace, job.world), reruns)
        with contextlib.suppress(OutOfRunsError):
            search.begin(verdict, trace)
            search.finish()
        world = search.world
        smallest, theirs = dataclasses.replace(own, world=world), None
        judged = opened.judge(smallest)
        if other is None:
            fails = reruns.perturbed(world)
            said = Comparison(PerturbedRuns(runs=len(fails), failed=sum(fails)), None)
        else:
            on_other = dataclasses.replace(smallest, stack=other)
            theirs = opened.judge(on_other)
            said = compared_by_vote(
                opened,
                smallest,
                result_of(smallest, judged),
                on_other,
                result_of(on_other, theirs),
                COMPARISON_RUNS,
            )
    pairs, tried = search.count_pairs()
    finding = Minimisation(
        signature=signed(first.verdicts, job.rules),
        removed=_removed(job.world, world),
        runs=reruns.count,
        one_minimal=search.one_minimal,
        counts={g: (len(getattr(job.world, g)), len(getattr(world, g))) for g in GROUPS},
        world_digest=world.digest(),
        trace_digest=judged.outcome.trace.digest,
        verdicts=tuple(verdict for verdict in judged.verdicts if verdict.violated),
        jittered=said.jittered,
        other=said.other,
        pairs=pairs,
        pairs_tried=tried,
        pairs_unsure=len(search.unsure),
    )
    return Smallest(world=world, judged=judged, theirs=theirs, finding=finding)


def _removed(before: World, after: World) -> tuple[str, ...]:
    """Say what is gone."""
    texts = []
    for group in GROUPS:
        one, other = len(getattr(before, group)), len(getattr(after, group))
        if one > other:
            texts.append(f"{one - other} of {one} {group}")
    if after.horizon < before.horizon:
        texts.append(f"everything after {after.horizon:.0f} s")
    for change in NOMINAL:
        was_odd = change.apply(before).digest() != before.digest()
        if was_odd and change.apply(after).digest() == after.digest():
            texts.append(change.what)
    return tuple(texts)
