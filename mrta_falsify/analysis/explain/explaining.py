"""Why a failure happens: the same world with one thing changed, judged like a trial.

Each row of a table exchanges one layer of the stack shortly before the onset, in the same copies of
the world; the first row exchanges nothing. Where that says nothing, the layers are exchanged from
the start. Of robots that wait for each other, each is removed in a continuation of its own. At last
the run is rewound, to tell when the failure was decided.

A foreign stack has no layers to exchange. It is replaced as a whole, from the first
tick on. The whole world is run without each of its things, and under other schedules.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from functools import partial
from typing import TypeAlias

from mrta_falsify.analysis.explain.absences import Absences
from mrta_falsify.analysis.explain.case import Case, Question
from mrta_falsify.analysis.explain.changes import changes_of
from mrta_falsify.analysis.explain.layers import Layers, last_rows
from mrta_falsify.analysis.explain.people import People
from mrta_falsify.analysis.explain.removals import Removals
from mrta_falsify.analysis.explain.rewinding import Rewinding
from mrta_falsify.analysis.explain.rows import RUNS, curing, failure_of, run_to_keep
from mrta_falsify.analysis.explain.schedules import Schedules
from mrta_falsify.campaigns.finding_files import write_finding
from mrta_falsify.campaigns.store import Campaign
from mrta_falsify.core.config import StackConfig
from mrta_falsify.core.errors import InputError
from mrta_falsify.core.findings import Explanation, LayerRow
from mrta_falsify.core.record import TrialRecord
from mrta_falsify.core.run_result import Vote
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.core.world import World
from mrta_falsify.lab import Experiment, Lab, OnRun, experiment_of_job
from mrta_falsify.lab.stored import job_of
from mrta_falsify.specs.attribution import WORLD, suspect
from mrta_falsify.specs.causes import cause_begins, is_outcome, leading, root_onsets
from mrta_falsify.trial import Job, Judged
from simulator_interface.simulate import Outcome

#: what is asked about a failure; the answers of one stand in what the next one is given
QUESTIONS: tuple[Question, ...] = (
    Removals(),
    Layers(),
    Schedules(),
    Absences(),
    People(),
    Rewinding(),
)

LEAD = 10.0  # s before the onset at which things are changed
MAX_RUNS = 120  # of rows, unless the caller says otherwise
#: writes a run: its name, the stack that took over, the world, and the run
Keep: TypeAlias = Callable[[str, StackConfig, World, Judged], None]
JOURNAL_NAME = "explain.journal.jsonl"  # beside the trial, until all its runs are finished


def explain(
    campaign: Campaign,
    record: TrialRecord,
    *,
    max_runs: int = MAX_RUNS,
    rewinds: int = 0,
    keep: Keep | None = None,
    workers: int = 1,
    on_done: OnRun = lambda done, total: None,
) -> Explanation:
    """Explain a stored failure and keep the explanation beside it as ``explain.json``.

    Args:
        campaign: that the failure belongs to.
        record: of the failure.
        max_runs: runs of rows, removals and changed worlds at most; the last layers in the
            pipeline give way first.
        rewinds: copies at most, beside these, that tell when the failure was decided.
        keep: writes a run of each row that removes the failure, and one of the stack as it is in
            the same way; None: none is kept.
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
    with Lab(folder / JOURNAL_NAME, what=f"explain {record.id}", workers=workers) as lab:
        found = explain_job(
            job,
            max_runs=max_runs,
            rewinds=rewinds,
            lab=lab,
            on_done=on_done,
            on_found=partial(write_finding, folder),
            keep=keep,
        )
    lab.journal.discard()
    return found


def explain_job(
    job: Job,
    *,
    max_runs: int = MAX_RUNS,
    rewinds: int = 0,
    lab: Lab | None = None,
    on_done: OnRun = lambda done, total: None,
    on_found: Callable[[Explanation], None] = lambda found: None,
    keep: Keep | None = None,
) -> Explanation:
    """Explain the failure of a job (see :func:`explain`).

    Args:
        job: that fails.
        max_runs: runs of rows, removals and changed worlds at most.
        rewinds: copies at most, beside these.
        lab: that runs them; its processes end here.
        on_done: called after each run.
        on_found: called with the explanation, before any run is kept.
        keep: writes a run of a row.
    """
    with lab or Lab() as opened:
        opened.on_run = on_done
        case = _case_of(job, max_runs, rewinds, opened)
        opened.expected = 1 + RUNS * (1 + len(case.changes)) + rewinds
        opened.count()  # the trial again
        found = Explanation(
            layer="",
            guess=case.guess,
            reason="",
            changed_at=case.at,
            counterfactuals=(),
            jittered=Vote(runs=0, failed=0),
            runs=0,
        )
        waiting = [question for question in QUESTIONS if question.applies(case)]
        while waiting:
            question = waiting.pop(0)
            left = max_runs - opened.runs - sum(later.least for later in waiting)
            found = question.ask(case, found, max(left, question.least))
        found = dataclasses.replace(found, runs=opened.runs)
        on_found(found)
        if keep is not None:
            _keep_runs(case, last_rows(found.rows), keep)
    return found


def _case_of(job: Job, max_runs: int, rewinds: int, lab: Lab) -> Case:
    """Run a job, and look at what fails in it.

    Raises:
        InputError: nothing does.
    """
    own = experiment_of_job(job)
    judged = lab.judge(own)
    verdict = leading(judged.verdicts)
    if verdict is None:
        again = " this time: the stack does not answer the same again" if job.config.stack else ""
        raise InputError(f"the run violates nothing{again}; there is nothing to explain")
    trace = judged.outcome.trace
    guess = suspect(job.config, judged.verdicts, trace)
    failure = failure_of(job, *_alone(own, verdict, judged, lab))
    before = moment_of_change(failure.verdict)
    return Case(
        job=job,
        own=own,
        verdict=verdict,
        trace=trace,
        failure=failure,
        guess=guess,
        before_onset=before,
        at=before if job.config.stack is None else 0.0,
        changes=() if guess == WORLD else changes_of(job.config)[: max(1, max_runs // RUNS - 1)],
        rewinds=rewinds,
        lab=lab,
    )


def _alone(own: Experiment, verdict: Verdict, judged: Judged, lab: Lab) -> tuple[Verdict, Outcome]:
    """Judge the run by the rule of the rows: no copies vote on it, as rows vote themselves.

    Without votes, what stands may be seen to do so earlier.
    """
    alone = lab.judge(own.for_vote())
    found = (v for v in alone.verdicts if v.violated and v.spec == verdict.spec)
    same = next(found, None)
    if same is None:
        return verdict, judged.outcome
    return dataclasses.replace(same, who=verdict.who), alone.outcome


def _keep_runs(case: Case, rows: Sequence[LayerRow], keep: Keep) -> None:
    """Keep a failing run of the stack as it is, and one of each row that removes the failure."""
    job, lab = case.job, case.lab
    by_text = {change.text: change for change in case.changes}
    for row in (*rows[:1], *curing(rows)):
        change = by_text.get(row.change)
        experiment = run_to_keep(case.failure, row, change, job, lab)
        if experiment is None:
            continue
        config = job.config if change is None else change.config
        name = "as_it_is" if change is None else f"{row.layer}_{list(by_text).index(row.change)}"
        lab.watch(experiment, partial(keep, name, config))


def moment_of_change(verdict: Verdict) -> float:
    """Choose when to change something [s]: shortly before the onset, or before the violation."""
    if is_outcome(verdict):
        return 0.0  # whatever cost the time may be anywhere
    begun = cause_begins(verdict)
    for time in (verdict.evidence.get("waiting_since"), *root_onsets(verdict)):
        begun = min(begun, time) if isinstance(time, float) else begun
    return max(0.0, begun - LEAD) if begun < float("inf") else 0.0
