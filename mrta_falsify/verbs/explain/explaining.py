"""Why a failure happens: the same world with one thing changed, judged like a trial.

Each row of a table exchanges one layer of the stack shortly before the onset, in the same copies of
the world; the first row exchanges nothing. Where that says nothing, the layers are exchanged from
the start. Of robots that wait for each other, each is removed in a continuation of its own. At last
the run is rewound, to tell when the failure was decided.

A stack in a process of its own has no layers to exchange. It is replaced as a whole, from the first
tick on. The whole world is run without each of its things, and under other schedules.
"""

from __future__ import annotations

import dataclasses
import shlex
import shutil
from collections.abc import Callable, Sequence
from functools import partial
from typing import TypeAlias

from mrta_falsify.campaigns.code_digest import code_digest
from mrta_falsify.campaigns.finding_files import write_finding
from mrta_falsify.campaigns.journal import RunJournal, resumable
from mrta_falsify.campaigns.store import Campaign
from mrta_falsify.core.config import StackConfig
from mrta_falsify.core.errors import InputError
from mrta_falsify.core.findings import ChangedRun, Explanation, LayerRow, Removal, VoteCount
from mrta_falsify.core.record import TrialRecord
from mrta_falsify.core.trace import Trace
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.core.world import World
from mrta_falsify.lab import Lab, course_of
from mrta_falsify.specs.attribution import WORLD, suspect
from mrta_falsify.specs.causes import cause_begins, is_outcome, leading, root_onsets
from mrta_falsify.trial import Job, Judged, judge, perturbed_job
from mrta_falsify.verbs.explain.absences import absences_of
from mrta_falsify.verbs.explain.changes import Change, changes_of
from mrta_falsify.verbs.explain.removals import removals_of
from mrta_falsify.verbs.explain.rewinding import branches_of, rewind
from mrta_falsify.verbs.explain.rows import (
    RUNS,
    Failure,
    curing,
    failure_of,
    is_knife_edge,
    rows_of,
    run_to_keep,
    suspicion_from,
)
from mrta_falsify.verbs.explain.run_count import RunCount
from mrta_falsify.verbs.explain.schedules import schedules_of
from mrta_falsify.verbs.run import write_run
from mrta_falsify.verbs.stored_trials import job_of
from simulator_interface.guard import guarded
from simulator_interface.simulate import Outcome

LEAD = 10.0  # s before the onset at which things are changed
MAX_RUNS = 120  # of rows, unless the caller says otherwise
#: writes a run: its name, the stack that took over, the world, and the run
Keep: TypeAlias = Callable[[str, StackConfig, World, Judged], None]
KEPT = "explain"  # folder of runs beside the trial
JOURNAL_NAME = "explain.journal.jsonl"  # beside the trial, until all its runs are finished


def explain(
    campaign: Campaign,
    record: TrialRecord,
    *,
    max_runs: int = MAX_RUNS,
    rewinds: int = 0,
    keep: bool = False,
    workers: int = 1,
    on_done: Callable[[int, int], None] = lambda done, total: None,
) -> Explanation:
    """Explain a stored failure and keep the explanation beside it as ``explain.json``.

    Args:
        campaign: that the failure belongs to.
        record: of the failure.
        max_runs: runs of rows, removals and changed worlds at most; the last layers in the
            pipeline give way first.
        rewinds: copies at most, beside these, that tell when the failure was decided.
        keep: write a run of each row that removes the failure, and one of the stack as it is in
            the same way, into ``explain`` beside the trial: world, trace, picture and page.
        workers: processes that run rows.
        on_done: called after each run with how many are done, and how many there will be.

    Raises:
        InputError: the trial did not fail, or its world is missing.
        PlaceError: a file cannot be written; finished runs are kept for the next call.
        Interrupted: Ctrl-C; finished runs are kept for the next call, and nothing else is written.
    """
    if not record.failed:
        raise InputError(f"trial {record.id} violates nothing; there is nothing to explain")
    job, folder = job_of(campaign, record), campaign.make_folder(record)
    code, path = code_digest(job.config, job.specifications), folder / JOURNAL_NAME
    lab = Lab(path, code=code, workers=workers)
    removals = RunJournal(Removal, path, code=code)
    whole = RunJournal(ChangedRun, path, code=code)
    with resumable(f"explain {record.id}", lab.journal, removals, whole):
        found = explain_job(
            job,
            max_runs=max_runs,
            rewinds=rewinds,
            lab=lab,
            removals=removals,
            whole=whole,
            on_done=on_done,
            on_found=partial(write_finding, folder),
            keep=_keeping(campaign, record) if keep else None,
        )
    lab.journal.discard()
    return found


def _keeping(campaign: Campaign, record: TrialRecord) -> Keep:
    """Make room for the runs that are kept, and say how they are written."""
    folder = campaign.folder(record) / KEPT
    shutil.rmtree(folder, ignore_errors=True)
    again = shlex.join(["mrta-falsify", "explain", str(campaign.directory), record.id, "--keep"])

    def write(name: str, config: StackConfig, world: World, judged: Judged) -> None:
        write_run(judged.outcome, world, folder / name, config=config, again=again)

    return write


@guarded()
def explain_job(
    job: Job,
    *,
    max_runs: int = MAX_RUNS,
    rewinds: int = 0,
    lab: Lab | None = None,
    removals: RunJournal[Removal] | None = None,
    whole: RunJournal[ChangedRun] | None = None,
    on_done: Callable[[int, int], None] = lambda done, total: None,
    on_found: Callable[[Explanation], None] = lambda found: None,
    keep: Keep | None = None,
) -> Explanation:
    """Explain the failure of a job (see :func:`explain`).

    Args:
        job: that fails.
        max_runs: runs of rows, removals and changed worlds at most.
        rewinds: copies at most, beside these.
        lab: that runs them; its processes end here.
        removals: of finished removals.
        whole: of finished runs of changed worlds.
        on_done: called after each run.
        on_found: called with the explanation, before any run is kept.
        keep: writes a run of a row.
    """
    with lab or Lab() as opened:
        found, keep_runs = _explained(job, max_runs, rewinds, opened, removals, whole, on_done)
        on_found(found)
        if keep is not None:
            keep_runs(keep)
    return found


def _explained(
    job: Job,
    max_runs: int,
    rewinds: int,
    lab: Lab,
    removals: RunJournal[Removal] | None,
    whole: RunJournal[ChangedRun] | None,
    on_done: Callable[[int, int], None],
) -> tuple[Explanation, Callable[[Keep], None]]:
    """Explain the failure of a job; the second result runs again what shows it best."""
    judged = judge(job)
    verdict = leading(judged.verdicts)
    if verdict is None:
        again = " this time: the stack does not answer the same again" if job.config.stack else ""
        raise InputError(f"the run violates nothing{again}; there is nothing to explain")
    trace = judged.outcome.trace
    guess = suspect(job.config, judged.verdicts, trace)
    failure = failure_of(job, *_alone(job, verdict, judged))
    at = moment_of_change(failure.verdict) if job.config.stack is None else 0.0
    changes = () if guess == WORLD else changes_of(job.config)[: max(1, max_runs // RUNS - 1)]
    count = RunCount(max_runs, 1 + RUNS * (1 + len(changes)) + rewinds, on_done)
    count.add()  # the trial again
    lab.on_run = count.add
    gone = tuple(count.each(removals_of(job, verdict, trace, count.left, removals)))
    rows, untried = _rows(job, failure, at, changes, lab, count, guess)
    reported = tuple(row for row in rows if row.at == rows[-1].at)
    absences, schedules = _changed_runs(
        job, verdict, trace, count, whole or RunJournal(ChangedRun, None)
    )
    layer, reason = suspicion_from(reported, verdict, guess, untried)
    cured = {row.change for row in curing(reported)} if reported else set()
    branches = branches_of(job, failure, changes, cured, reported[0].at if reported else 0.0)
    inevitability = rewind(job, failure, branches, rewinds, lab)
    found = Explanation(
        layer=layer,
        guess=guess,
        reason=reason,
        changed_at=reported[0].at if reported else at,
        counterfactuals=(),
        rows=rows,
        removals=gone,
        absences=absences,
        schedules=schedules,
        jittered=_copies(reported),
        runs=count.done,
        inevitability=inevitability,
    )
    return found, partial(_keep_runs, job, failure, reported, changes, lab)


def _alone(job: Job, verdict: Verdict, judged: Judged) -> tuple[Verdict, Outcome]:
    """Judge the run by the rule of the rows: no copies vote on it, as rows vote themselves.

    Without votes, what stands may be seen to do so earlier.
    """
    own = judge(perturbed_job(job))
    found = (v for v in own.verdicts if v.violated and v.spec == verdict.spec)
    same = next(found, None)
    if same is None:
        return verdict, judged.outcome
    return dataclasses.replace(same, who=verdict.who), own.outcome


def _rows(
    job: Job,
    failure: Failure,
    at: float,
    changes: Sequence[Change],
    lab: Lab,
    count: RunCount,
    guess: str,
) -> tuple[tuple[LayerRow, ...], tuple[str, ...]]:
    """Exchange layers shortly before the onset, and from the start where that says nothing.

    Returns:
        The rows, and the layers that no run was left for from the start; the guessed layer has
        its runs first.
    """
    if not changes:
        return (), ()
    whole = RUNS * (1 + len(changes)) if at > 0.0 else 0
    rows = rows_of(job, failure, at, changes, count.left, lab, reserve=whole)
    if not at or curing(rows) or is_knife_edge(rows[0]) or len(rows) == 1:
        return rows, ()
    # What was lost long before the onset is not mended by mending the layer that lost it.
    ranked = sorted(changes, key=lambda change: change.layer != guess)
    room = max(0, count.left // RUNS - 1)
    if room:
        rows += rows_of(job, failure, 0.0, ranked[:room], count.left, lab)
    return rows, tuple(dict.fromkeys(change.layer for change in ranked[room:]))


def _keep_runs(
    job: Job,
    failure: Failure,
    rows: Sequence[LayerRow],
    changes: Sequence[Change],
    lab: Lab,
    keep: Keep,
) -> None:
    """Keep a failing run of the stack as it is, and one of each row that removes the failure."""
    by_text = {change.text: change for change in changes}
    for row in (*rows[:1], *curing(rows)):
        change = by_text.get(row.change)
        experiment = run_to_keep(failure, row, change, job, lab)
        if experiment is None:
            continue
        config = job.config if change is None else change.config
        name = "as_it_is" if change is None else f"{row.layer}_{list(by_text).index(row.change)}"
        lab.watch(experiment, partial(keep, name, config))


def _copies(rows: Sequence[LayerRow]) -> VoteCount:
    """Count the copies of the stack as it is."""
    if not rows or rows[0].copies < 2:
        return VoteCount(runs=0, failed=0)
    stack = rows[0]
    return VoteCount(runs=stack.runs + stack.otherwise + stack.avoided, failed=stack.failed)


def _changed_runs(
    job: Job,
    verdict: Verdict,
    trace: Trace,
    count: RunCount,
    journal: RunJournal[ChangedRun],
) -> tuple[tuple[ChangedRun, ...], tuple[ChangedRun, ...]]:
    """Run the whole world without its things, and under other schedules.

    Only of a stack whose layers cannot be exchanged: of the shipped one, they say more.
    """
    if job.config.stack is None:
        return (), ()
    schedules = tuple(count.each(schedules_of(job, verdict, count.left, journal)))
    had = course_of(verdict, trace, job.world).had
    return tuple(absences_of(job, verdict, had, count.left, count, journal)), schedules


def moment_of_change(verdict: Verdict) -> float:
    """Choose when to change something [s]: shortly before the onset, or before the violation."""
    if is_outcome(verdict):
        return 0.0  # whatever cost the time may be anywhere
    begun = cause_begins(verdict)
    for time in (verdict.evidence.get("waiting_since"), *root_onsets(verdict)):
        begun = min(begun, time) if isinstance(time, float) else begun
    return max(0.0, begun - LEAD) if begun < float("inf") else 0.0
