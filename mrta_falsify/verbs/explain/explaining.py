"""Why a failure happens: the same episode with one thing changed shortly before it.

The episode is run to a few seconds before the onset, then forked: each continuation replaces one
layer of the stack. If no change helps there, they begin at the first tick. What differs after
the change is its doing, since all before it is shared. Of robots that wait for each other, each
is removed in a continuation of its own. Jittered copies tell failures that any change would cure.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import TypeVar

from mrta_falsify.campaigns.attribution import suspected_layer
from mrta_falsify.campaigns.finding_files import write_finding
from mrta_falsify.campaigns.signature import leading
from mrta_falsify.campaigns.store import Campaign
from mrta_falsify.core.errors import InputError
from mrta_falsify.core.findings import CopyCount, Explanation
from mrta_falsify.core.record import TrialRecord
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.trial import Job, judge
from mrta_falsify.verbs.explain.changed_runs import continued_with
from mrta_falsify.verbs.explain.changes import changes_of, suspicion_from
from mrta_falsify.verbs.explain.removals import removals_of
from mrta_falsify.verbs.stored_trials import job_of
from scenic_worlds.variation import jittered_worlds
from simulator_interface.guard import guarded

LEAD = 10.0  # s before the onset at which things are changed
JITTERED = 20  # copies with small differences, as far as the runs suffice

T = TypeVar("T")


def explain(
    campaign: Campaign,
    record: TrialRecord,
    *,
    max_runs: int = 40,
    on_done: Callable[[int, int], None] = lambda done, total: None,
) -> Explanation:
    """Explain a stored failure and keep the explanation beside it as ``explain.json``.

    Args:
        campaign: that the failure belongs to.
        record: of the failure.
        max_runs: episodes and continuations at most; jittered copies give way first.
        on_done: called after each run with how many are done, and how many there will be.

    Raises:
        InputError: the trial did not fail, or its world is missing.
    """
    if not record.failed:
        raise InputError(f"trial {record.id} violates nothing; there is nothing to explain")
    found = explain_job(job_of(campaign, record), max_runs=max_runs, on_done=on_done)
    write_finding(campaign.folder(record), found)
    return found


@guarded()
def explain_job(
    job: Job,
    *,
    max_runs: int = 40,
    on_done: Callable[[int, int], None] = lambda done, total: None,
) -> Explanation:
    """Explain the failure of a job (see :func:`explain`)."""
    judged = judge(job)
    verdict = leading(judged.verdicts)
    if verdict is None:
        raise InputError("the run violates nothing; there is nothing to explain")
    trace = judged.outcome.trace
    guess = suspected_layer(judged.verdicts, trace)
    at = moment_of_change(verdict)
    changes = changes_of(job.config)[: max(1, max_runs - 1)]
    count = _Count(max_runs, min(max_runs, 1 + len(changes) + JITTERED), on_done)
    count.add()
    found = tuple(count.each(continued_with(job, verdict, at, changes)))
    if at > 0.0 and not any(one.failure_gone for one in found):
        # What was lost long before the onset is not mended by mending the layer that lost it.
        at = 0.0
        found = tuple(count.each(continued_with(job, verdict, at, changes)))
    removals = tuple(count.each(removals_of(job, verdict, trace, count.left)))
    if removals:
        count.add()  # the run up to the onset
    jittered = _jittered(job, count)
    layer, reason = suspicion_from(found, guess)
    return Explanation(
        layer=layer,
        guess=guess,
        reason=reason,
        changed_at=at,
        counterfactuals=found,
        removals=removals,
        jittered=jittered,
        runs=count.done,
    )


def moment_of_change(verdict: Verdict) -> float:
    """Choose when to change something [s]: shortly before the onset, or before the violation."""
    for key in ("onset", "since", "waiting_since"):
        begun = verdict.evidence.get(key)
        if isinstance(begun, float):
            return max(0.0, begun - LEAD)
    if verdict.spec in ("deadlines", "all_tasks_done"):
        return 0.0  # whatever cost the time may be anywhere
    return max(0.0, (verdict.violated_at or 0.0) - LEAD)


def _jittered(job: Job, count: _Count) -> CopyCount:
    worlds = jittered_worlds(job.world, max(0, min(JITTERED, count.left)))
    jobs = (dataclasses.replace(job, world=world) for world in worlds)
    failed = [run.failed for run in count.each(judge(one, keep_trace=False) for one in jobs)]
    return CopyCount(runs=len(failed), failed=sum(failed))


@dataclass(slots=True)
class _Count:
    """Counts runs and tells the caller."""

    most: int
    expected: int  #: in all
    on_done: Callable[[int, int], None]
    done: int = 0

    @property
    def left(self) -> int:
        """Runs that are allowed still."""
        return self.most - self.done

    def add(self) -> None:
        """Count one run."""
        self.done += 1
        self.expected = max(self.expected, self.done)
        self.on_done(self.done, self.expected)

    def each(self, runs: Iterable[T]) -> Iterator[T]:
        """Count each of ``runs`` as it ends."""
        for run in runs:
            self.add()
            yield run
