"""Why a failure happens: the same episode with one thing changed shortly before it.

The episode is run to a few seconds before the onset, then forked: each continuation replaces one
layer of the stack. If no change helps there, they begin at the first tick. What differs after
the change is its doing, since all before it is shared. Of robots that wait for each other, each
is removed in a continuation of its own. Jittered copies tell failures that any change would cure.
At last the run is rewound, to tell when the failure was decided.

A stack in a process of its own has no layers to exchange. It is replaced as a whole, from the first
tick on. The whole world is run without each of its things, and under other schedules.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from mrta_falsify.campaigns.attribution import WORLD, points_directly, suspect
from mrta_falsify.campaigns.code_digest import code_digest
from mrta_falsify.campaigns.finding_files import write_finding
from mrta_falsify.campaigns.journal import RunJournal, going_on
from mrta_falsify.campaigns.store import Campaign
from mrta_falsify.core.errors import InputError
from mrta_falsify.core.findings import ChangedRun, Counterfactual, Explanation, Removal
from mrta_falsify.core.record import TrialRecord
from mrta_falsify.core.trace import Trace
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.specs.causes import cause_begins, is_outcome, leading, root_onsets
from mrta_falsify.trial import Job, judge
from mrta_falsify.verbs.explain.absences import absences_of
from mrta_falsify.verbs.explain.changed_runs import continued_with
from mrta_falsify.verbs.explain.changes import changes_of, suspicion_from
from mrta_falsify.verbs.explain.continuing import failure_of
from mrta_falsify.verbs.explain.removals import removals_of
from mrta_falsify.verbs.explain.rewinding import RewoundCopy, branches_of, rewind
from mrta_falsify.verbs.explain.run_count import RunCount
from mrta_falsify.verbs.explain.schedules import schedules_of
from mrta_falsify.verbs.explain.small_differences import FEW, CopyRun, copies_of
from mrta_falsify.verbs.minimize.course import course_of
from mrta_falsify.verbs.stored_trials import job_of
from simulator_interface.guard import guarded

LEAD = 10.0  # s before the onset at which things are changed
COPIES_KEPT = 8  # runs that absences leave for copies: without any, a knife edge is not seen
JOURNAL_NAME = "explain.journal.jsonl"  # beside the trial, until all its runs are finished


class Journals:
    """The finished runs of an explanation, by kind, in one file.

    Args:
        path: of the file; None keeps nothing.
        code: digest of the code that is run.
    """

    def __init__(self, path: Path | None = None, code: str = "") -> None:
        self.changes = RunJournal(Counterfactual, path, code=code)
        self.removals = RunJournal(Removal, path, code=code)
        self.copies = RunJournal(CopyRun, path, code=code)
        self.whole = RunJournal(ChangedRun, path, code=code)
        self.rewound = RunJournal(RewoundCopy, path, code=code)

    @property
    def all(self) -> tuple[RunJournal[Any], ...]:
        """The journals of all kinds."""
        return (self.changes, self.removals, self.copies, self.whole, self.rewound)


def explain(
    campaign: Campaign,
    record: TrialRecord,
    *,
    max_runs: int = 40,
    rewinds: int = 0,
    on_done: Callable[[int, int], None] = lambda done, total: None,
) -> Explanation:
    """Explain a stored failure and keep the explanation beside it as ``explain.json``.

    Args:
        campaign: that the failure belongs to.
        record: of the failure.
        max_runs: episodes and continuations at most; jittered copies give way first.
        rewinds: copies at most, beside these, that tell when the failure was decided.
        on_done: called after each run with how many are done, and how many there will be.

    Raises:
        InputError: the trial did not fail, or its world is missing.
        Interrupted: Ctrl-C; finished runs are kept for the next call, and nothing else is written.
    """
    if not record.failed:
        raise InputError(f"trial {record.id} violates nothing; there is nothing to explain")
    job, folder = job_of(campaign, record), campaign.folder(record)
    code = code_digest(job.config, job.specifications)
    journals = Journals(folder / JOURNAL_NAME, code)
    with going_on(f"explain {record.id}", *journals.all):
        found = explain_job(
            job, max_runs=max_runs, rewinds=rewinds, journals=journals, on_done=on_done
        )
        write_finding(folder, found)
    journals.changes.discard()
    return found


@guarded()
def explain_job(
    job: Job,
    *,
    max_runs: int = 40,
    rewinds: int = 0,
    journals: Journals | None = None,
    on_done: Callable[[int, int], None] = lambda done, total: None,
) -> Explanation:
    """Explain the failure of a job (see :func:`explain`)."""
    journals = journals or Journals()
    judged = judge(job)
    verdict = leading(judged.verdicts)
    if verdict is None:
        again = " this time: the stack does not answer the same again" if job.config.stack else ""
        raise InputError(f"the run violates nothing{again}; there is nothing to explain")
    trace = judged.outcome.trace
    failure = failure_of(job, verdict, trace)
    guess = suspect(job.config, judged.verdicts, trace)
    at = moment_of_change(verdict) if job.config.stack is None else 0.0
    changes = () if guess == WORLD else changes_of(job.config)[: max(1, max_runs - 1)]
    expected = min(max_runs, 1 + len(changes) + FEW)
    count = RunCount(max_runs, expected + rewinds, on_done)
    count.add()
    found = tuple(count.each(continued_with(job, failure, at, changes, journals.changes)))
    if at > 0.0 and not any(one.failure_gone for one in found):
        # What was lost long before the onset is not mended by mending the layer that lost it.
        at = 0.0
        found = tuple(count.each(continued_with(job, failure, at, changes, journals.changes)))
    removals = tuple(count.each(removals_of(job, verdict, trace, count.left, journals.removals)))
    if removals:
        count.add()  # the run up to the onset
    absences, schedules = _changed_runs(job, verdict, trace, count, journals.whole)
    jittered = copies_of(job, failure, count, journals.copies)
    layer, reason = suspicion_from(
        found, guess, direct=points_directly(verdict, guess), knife_edge=jittered.is_knife_edge
    )
    branches = branches_of(job, verdict, changes, found, at)
    inevitability = rewind(job, failure, branches, count.allowing(rewinds), journals.rewound)
    return Explanation(
        layer=layer,
        guess=guess,
        reason=reason,
        changed_at=at,
        counterfactuals=found,
        removals=removals,
        absences=absences,
        schedules=schedules,
        jittered=jittered,
        runs=count.done,
        inevitability=inevitability,
    )


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
    most = count.left - COPIES_KEPT
    return tuple(absences_of(job, verdict, had, most, count, journal)), schedules


def moment_of_change(verdict: Verdict) -> float:
    """Choose when to change something [s]: shortly before the onset, or before the violation."""
    if is_outcome(verdict):
        return 0.0  # whatever cost the time may be anywhere
    begun = cause_begins(verdict)
    for time in (verdict.evidence.get("waiting_since"), *root_onsets(verdict)):
        begun = min(begun, time) if isinstance(time, float) else begun
    return max(0.0, begun - LEAD) if begun < float("inf") else 0.0
