"""Continuations of a failing episode, each with one layer of the stack changed."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from functools import partial

from mrta_falsify.campaigns.journal import RunJournal
from mrta_falsify.core import codec
from mrta_falsify.core.findings import Counterfactual
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.trial import Job
from mrta_falsify.verbs.explain.changes import Change
from mrta_falsify.verbs.explain.continuing import Failure, go_on, run_until
from mrta_falsify.verbs.explain.whole_runs import looking_for, run_changed
from simulator_interface.continuation import Running
from simulator_interface.watched_copy import CopyFailed


def continued_with(
    job: Job,
    failure: Failure,
    at: float,
    changes: Sequence[Change],
    journal: RunJournal[Counterfactual],
) -> Iterator[Counterfactual]:
    """Run to ``at`` [s] once, and from there once for each change that is not in the journal.

    Args:
        job: that fails.
        failure: its.
        at: when to change something [s].
        changes: to make.
        journal: of finished continuations.
    """
    verdict = failure.verdict
    asked = [job.world, job.config, job.specifications, verdict, at]
    missing = {codec.digest([asked, change]): change for change in changes}
    yield from journal.known_first(missing)
    if not missing:
        return
    fails_at_once = verdict.spec == "stack_runs" and verdict.violated_at == 0.0
    if fails_at_once or job.config.stack is not None:  # no other stack can go on in mid-run
        for key, change in missing.items():
            yield journal.keep(key, _from_the_start(job, verdict, change))
        return
    with run_until(job, failure, at) as running:
        for key, change in missing.items():
            changed = partial(_counterfactual, running, failure, change)
            try:
                found = running.in_a_copy(changed, Counterfactual)
            except CopyFailed as failed:
                found = _cures_nothing(change, failed.message)
            yield journal.keep(key, found)


def _from_the_start(job: Job, verdict: Verdict, change: Change) -> Counterfactual:
    """Run the whole episode with a change, and look whether the same happens."""
    changed = dataclasses.replace(looking_for(job, verdict), config=change.config)
    fate, detail = run_changed(changed, verdict)
    return Counterfactual(
        layer=change.layer,
        change=change.text,
        failure_gone=fate == "gone",
        detail=detail,
        restores=change.restores,
        answered=fate != "unknown",
    )


def _cures_nothing(change: Change, detail: str) -> Counterfactual:
    return Counterfactual(
        layer=change.layer,
        change=change.text,
        failure_gone=False,
        detail=detail,
        restores=change.restores,
    )


def _counterfactual(running: Running, failure: Failure, change: Change) -> Counterfactual:
    """Go on with a change, and look whether the same specification is violated."""
    ended = go_on(running, failure, lambda: running.episode.swap(change.config))
    return Counterfactual(
        layer=change.layer,
        change=change.text,
        failure_gone=not ended.unjudged and not ended.failed,
        detail=f"not judged: {ended.unjudged}" if ended.unjudged else ended.detail,
        restores=change.restores,
        answered=not ended.unjudged,
    )
