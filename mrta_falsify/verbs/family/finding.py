"""From one failure to a rule: a box over named dimensions in which runs fail alike.

The box is learned (:mod:`.learning`), written as a Scenic program, and that program is sampled
anew, with points that nothing was learned from, to measure how often it
fails.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from mrta_falsify.campaigns.signature import signature
from mrta_falsify.campaigns.statistics import Probability, failure_probability
from mrta_falsify.campaigns.store import Campaign, write_atomically
from mrta_falsify.core.candidate import Candidate
from mrta_falsify.core.config import StackConfig
from mrta_falsify.core.errors import InputError
from mrta_falsify.core.record import TrialRecord
from mrta_falsify.trial import Job, judge, quick_stack
from mrta_falsify.verbs.family.learning import Search
from mrta_falsify.verbs.family.rule import Family, program_text, rule_lines, sentence, summary
from mrta_falsify.verbs.family.samples import Runs
from mrta_falsify.verbs.stored_trials import stored_world
from mrta_falsify.worker import open_program, specifications_of

if TYPE_CHECKING:
    from scenic_worlds.program import Program

__all__ = ["Family", "find_family", "rule_lines", "sentence", "summary"]

CACHE = "family.cache.jsonl"  # answers so far, so that a second call goes on


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
        campaign: it belongs to.
        record: of the failure.
        max_runs: simulations at most; those of the fresh samples and of earlier calls included.
        fresh: samples on which the precision is measured; at most half of ``max_runs``.
        path: of the Scenic program; ``family.scenic`` beside the trial if None.
        on_run: called after each run with their number.

    Returns:
        The family, written as ``family.json`` and as a Scenic program.

    Raises:
        InputError: the trial did not fail, nothing of its program is random, or the program
            cannot be moved to where the family is to be written.
    """
    if not record.failed:
        raise InputError(f"trial {record.id} violates nothing; it has no failure family")
    settings = campaign.settings.trials
    program = open_program(settings)
    if not len(program.space):
        raise InputError(f"{settings.scenario}: nothing in it is random; a family needs dimensions")
    folder = campaign.folder(record)
    folder.mkdir(parents=True, exist_ok=True)
    path = path or folder / "family.scenic"
    _check_can_move(program.path, path)
    config, wanted = _reference(campaign, record)
    runs = Runs(settings, program, config, wanted, folder / CACHE, on_run)
    fresh = max(1, min(fresh, max_runs // 2))
    search = Search(runs, _in_whole_ranges(program, record.candidate), budget=max_runs - fresh)
    search.learn()
    conditions = search.conditions()
    noise_seed = None if search.fresh_noise else record.candidate.seed
    found = Family(
        signature=runs.wanted,
        engine=runs.config.engine.name,
        conditions=conditions,
        free=tuple(program.space.dimensions[i].name for i in search.free),
        noise_seed=noise_seed,
        precision=failure_probability(0, 0),
        elsewhere=_share_elsewhere(campaign, record),
        learning_runs=runs.count,
        no_scene=0,
        passing=search.neighbours(),
        program=str(path),
    )
    path.parent.mkdir(parents=True, exist_ok=True)
    write_atomically(path, program_text(found, program, record, campaign).encode())
    precision, no_scene = _measure(found, runs, record, fresh)
    found = dataclasses.replace(found, precision=precision, no_scene=no_scene)
    # once more, since the program says what was measured
    write_atomically(path, program_text(found, program, record, campaign).encode())
    text = json.dumps(summary(found), indent=1) + "\n"
    write_atomically(folder / "family.json", text.encode())
    return found


def _in_whole_ranges(program: Program, candidate: Candidate) -> Candidate:
    """``candidate`` with u as shares of whole ranges, if its program is a family itself."""
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
            f"-o {source.with_name('family.scenic')}"
        )


def _reference(campaign: Campaign, record: TrialRecord) -> tuple[StackConfig, str]:
    """Stack to run the family on, and the signature there: the quick engine if it agrees."""
    settings = campaign.settings.trials
    quick = quick_stack(settings.stack)
    world = stored_world(campaign, record)
    if record.engine == quick.engine.name:
        return quick, record.signature
    if not world.scripted:
        job = Job(
            world=world, config=quick, specifications=specifications_of(settings), early_stop=True
        )
        if signature(judge(job, keep_trace=False).verdicts) == record.signature:
            return quick, record.signature
    return settings.stack, record.signature


def _share_elsewhere(campaign: Campaign, record: TrialRecord) -> tuple[int, int]:
    judged = [other for other in campaign.records if other.status == "ok"]
    return sum(other.signature == record.signature for other in judged), len(judged)


def _measure(found: Family, runs: Runs, record: TrialRecord, fresh: int) -> tuple[Probability, int]:
    """How often the written program fails, and samples without a valid scene."""
    from scenic_worlds.program import compile_program  # noqa: PLC0415 - Scenic takes seconds

    program = compile_program(Path(found.program), runs.settings.params)
    numbers = {d.name: i for i, d in enumerate(program.space.dimensions)}
    box = {numbers[c.dimension]: (c.low, c.high) for c in found.conditions}
    seed = record.candidate.seed % 2**31
    answers = [
        runs.of(program, program.candidate(seed, number), box, noise_seed=found.noise_seed)
        for number in range(fresh)
    ]
    decided = [answer.failed for answer in answers if answer is not None]
    return failure_probability(sum(decided), len(decided)), fresh - len(decided)
