"""From one failure to a rule: a box over named dimensions in which runs fail alike.

The box is learned and written as a Scenic program. That program is then sampled anew, at points
from which nothing was learned, to measure how often it fails.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from mrta_falsify.campaigns.code_digest import code_digest
from mrta_falsify.campaigns.finding_files import write_finding
from mrta_falsify.campaigns.journal import RunJournal, going_on
from mrta_falsify.campaigns.signature import signature
from mrta_falsify.campaigns.statistics import failure_probability
from mrta_falsify.campaigns.store import Campaign
from mrta_falsify.core.candidate import Candidate
from mrta_falsify.core.config import StackConfig
from mrta_falsify.core.durable import write_atomically
from mrta_falsify.core.errors import InputError
from mrta_falsify.core.findings import Family
from mrta_falsify.core.record import TrialRecord
from mrta_falsify.trial import Job, judge, quick_stack
from mrta_falsify.verbs.family.conditions import conditions_of, passing_neighbours
from mrta_falsify.verbs.family.learning import SEEDS, BoxSearch
from mrta_falsify.verbs.family.program_text import program_text
from mrta_falsify.verbs.family.samples import PointRun, SampleRuns
from mrta_falsify.verbs.stored_trials import stored_world
from mrta_falsify.worker import open_program, specifications_of
from simulator_interface.guard import guarded

if TYPE_CHECKING:
    from scenic_worlds.program import Program

JOURNAL_NAME = "family.cache.jsonl"  # beside the trial; a second call goes on from it
UNMEASURED = ".unmeasured.scenic"  # ending of a family's program before it is measured
PROGRAM_NAME = "family.scenic"  # beside the trial, unless the user gives another file


@guarded()
def find_family(
    campaign: Campaign,
    record: TrialRecord,
    *,
    max_runs: int = 300,
    fresh: int = 100,
    path: Path | None = None,
    on_run: Callable[[int], None] = lambda runs: None,
) -> Family:
    """Find the family of a stored failure and keep it beside the trial; a second call goes on.

    Args:
        campaign: that the failure belongs to.
        record: of the failure.
        max_runs: simulations at most, including fresh samples and earlier calls.
        fresh: samples on which the precision is measured; at most half of ``max_runs``.
        path: of the Scenic program; ``family.scenic`` beside the trial if None.
        on_run: called after each run with their number.

    Returns:
        The family, written as ``family.json`` and as a Scenic program.

    Raises:
        InputError: the trial did not fail, nothing of its program is random, or the program
            cannot be moved to where the family is to be written.
        Interrupted: Ctrl-C; finished runs are kept, and nothing else is written.
    """
    if not record.failed:
        raise InputError(f"trial {record.id} violates nothing; it has no failure family")
    settings = campaign.settings.trials
    program = open_program(settings)
    if not len(program.space):
        raise InputError(f"{settings.scenario}: nothing in it is random; a family needs dimensions")
    folder = campaign.folder(record)
    folder.mkdir(parents=True, exist_ok=True)
    path = path or folder / PROGRAM_NAME
    _check_can_move(program.path, path)
    code = code_digest(settings.stack, specifications_of(settings))
    journal = RunJournal(PointRun, folder / JOURNAL_NAME, code=code)
    with going_on(f"family {record.id}", journal):
        config = _reference_stack(campaign, record)
        # recomputed: another version may have written the stored one in other words
        wanted = signature(record.verdicts)
        runs = SampleRuns(settings, program, config, wanted, journal, on_run)
        fresh = max(1, min(fresh, max_runs // 2))
        case = _in_whole_ranges(program, record.candidate)
        search = BoxSearch(runs, case, budget=max_runs - fresh)
        search.learn()
        found = _learned_family(search, campaign, record, path)
        path.parent.mkdir(parents=True, exist_ok=True)
        text = program_text(found, program, record, campaign)
        found = _measured(found, text, runs, record.candidate.seed, fresh)
        # the comment of the program that is kept says what was measured
        write_atomically(path, program_text(found, program, record, campaign).encode())
        write_finding(folder, found)
    return found


def _learned_family(
    search: BoxSearch, campaign: Campaign, record: TrialRecord, path: Path
) -> Family:
    """Describe a family that is learned but not measured yet."""
    dimensions = search.runs.program.space.dimensions
    judged = [other for other in campaign.records if other.status == "ok"]
    wanted = signature(record.verdicts)
    alike = sum(signature(other.verdicts) == wanted for other in judged)
    return Family(
        signature=wanted,
        engine=search.runs.config.engine.name,
        conditions=conditions_of(search),
        free=tuple(dimensions[i].name for i in search.free),
        noise_seed=None if search.fresh_noise else record.candidate.seed,
        precision=failure_probability(0, 0),
        elsewhere=(alike, len(judged)),
        learning_runs=search.runs.count,
        no_scene=0,
        passing=passing_neighbours(search),
        program=str(path),
    )


def _in_whole_ranges(program: Program, candidate: Candidate) -> Candidate:
    """Give ``candidate`` its point in shares of whole ranges, if its program is a family itself."""
    u = np.array(candidate.u)
    for i, (low, high) in program.search.driver.source.intervals.items():
        u[i] = low + (high - low) * u[i]
    return dataclasses.replace(candidate, u=u)


def _check_can_move(source: Path, target: Path) -> None:
    """Refuse to write a program that would not find its own files any more.

    Raises:
        InputError: it uses files beside it, and the copy would lie elsewhere; or the copy would
            replace it.
    """
    from scenic_worlds.sources import source_files  # noqa: PLC0415 - Scenic takes seconds

    if source.resolve() == target.resolve():
        raise InputError(f"{target}: is the program itself; give another file by -o")
    beside = source.resolve().parent
    if target.resolve().parent == beside:
        return
    others = [f for f in source_files(source) if f.parent == beside and f != source.resolve()]
    if others or "localPath" in source.read_text(encoding="utf-8"):
        raise InputError(
            f"{source}: uses files beside it, so its family must lie there too; give "
            f"-o {source.with_name(PROGRAM_NAME)}"
        )


def _reference_stack(campaign: Campaign, record: TrialRecord) -> StackConfig:
    """Choose the stack to run the family on: the quick engine if it shows the same failure."""
    settings = campaign.settings.trials
    quick = quick_stack(settings.stack)
    world = stored_world(campaign, record)
    if record.engine == quick.engine.name:
        return quick
    if not world.scripted:
        job = Job(
            world=world,
            config=quick,
            specifications=specifications_of(settings),
            early_stop=True,
            then=settings.then,
            limits=settings.limits,
        )
        if signature(judge(job, keep_trace=False).verdicts) == signature(record.verdicts):
            return quick
    return settings.stack


def _measured(found: Family, text: str, runs: SampleRuns, seed: int, fresh: int) -> Family:
    """Measure how often the program ``text`` fails, on ``fresh`` samples of it."""
    from scenic_worlds.program import compile_program  # noqa: PLC0415 - Scenic takes seconds

    path = Path(found.program)
    unmeasured = path.with_name(f"{path.stem}{UNMEASURED}")  # beside the files that it uses
    try:
        unmeasured.write_text(text, encoding="utf-8")
        program = compile_program(unmeasured, runs.settings.params)
        numbers = {d.name: i for i, d in enumerate(program.space.dimensions)}
        box = {numbers[c.dimension]: (c.low, c.high) for c in found.conditions}
        candidates = [program.candidate(seed % SEEDS, number) for number in range(fresh)]
        samples = [runs.of(program, c, box, noise_seed=found.noise_seed) for c in candidates]
    finally:
        unmeasured.unlink(missing_ok=True)
    decided = [sample.failed for sample in samples if sample.u is not None]
    precision = failure_probability(sum(decided), len(decided))
    return dataclasses.replace(found, precision=precision, no_scene=fresh - len(decided))
