"""Continuations of a failing episode, each with one layer of the stack changed."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import NamedTuple

from mrta_falsify.campaigns.journal import RunJournal
from mrta_falsify.core import codec
from mrta_falsify.core.findings import Counterfactual
from mrta_falsify.core.protocols import Specification
from mrta_falsify.core.stack_failure import StackFailed
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.trial import Job, judges_of
from mrta_falsify.verbs.explain.changes import Change
from mrta_falsify.verbs.explain.whole_runs import AFTER, looking_for, run_changed
from simulator_interface.continuation import Running, run_to
from simulator_interface.watched_copy import CopyFailed

LOOK_STRIDE = 10  # ticks between two looks at whether the failure is back


def continued_with(
    job: Job,
    verdict: Verdict,
    at: float,
    changes: Sequence[Change],
    journal: RunJournal[Counterfactual],
) -> Iterator[Counterfactual]:
    """Run to ``at`` [s] once, and from there once for each change that is not in the journal.

    Args:
        job: that fails.
        verdict: the violated one that explains the failure.
        at: when to change something [s].
        changes: to make.
        journal: of finished continuations.
    """
    until = (verdict.violated_at or job.world.horizon) + AFTER
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
    with run_to(job.world, job.config, judges_of(job), at) as running:
        for key, change in missing.items():
            changed = partial(_counterfactual, running, verdict, change, until)
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


def _counterfactual(
    running: Running, verdict: Verdict, change: Change, until: float
) -> Counterfactual:
    """Go on with a change, and look whether the same specification is violated by ``until`` [s]."""
    ended = go_on(running, verdict, until, lambda: running.episode.swap(change.config))
    return Counterfactual(
        layer=change.layer,
        change=change.text,
        failure_gone=not ended.unjudged and not ended.violated,
        detail=f"not judged: {ended.unjudged}" if ended.unjudged else ended.detail,
        restores=change.restores,
        answered=not ended.unjudged,
    )


class Ended(NamedTuple):
    """How a continuation ended."""

    violated: tuple[Verdict, ...]  #: of the same specification
    detail: str
    unjudged: str  #: why it could not be judged; empty if it was


def go_on(running: Running, verdict: Verdict, until: float, change: Callable[[], None]) -> Ended:
    """Go on with something changed, and look whether the same specification is violated.

    Args:
        running: where the continuation begins, in a copy of the process.
        verdict: the violated one that explains the failure.
        until: how long to look [s].
        change: makes the change.
    """
    own = [s for s in running.specifications if s.verdict().spec == verdict.spec]
    failed: tuple[Verdict, ...] = ()
    try:
        change()
        detail = _watched(running, own, until)
    except StackFailed as stopped:
        # A change that makes the stack fail cures nothing.
        failed, detail = (verdict,), f"the stack failed at {stopped.failure.time:.1f} s"
    verdicts = [s.verdict() for s in own]
    unjudged = next((v.not_judged for v in verdicts if v.not_judged), "")
    return Ended((*failed, *(v for v in verdicts if v.violated)), detail, unjudged)


def _watched(running: Running, own: Sequence[Specification], until: float) -> str:
    """Go on until one of ``own`` is violated, or ``until`` [s]; say how that ended."""
    for frame in running.frames:
        for specification in own:
            specification.update(frame)
        time = frame.sensed.time
        if frame.sensed.tick % LOOK_STRIDE == 0 and any(s.verdict().violated for s in own):
            return f"violated again at {time:.1f} s"
        if running.episode.books.due and running.episode.books.closed:
            return f"all tasks done at {time:.1f} s"
        if time >= min(until, running.episode.world.horizon):
            return f"nothing violated until {time:.1f} s"
    return "the time looked at was over"
