"""Continuations of a failing episode, each with one layer of the stack changed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial

from mrta_falsify.campaigns.journal import RunJournal
from mrta_falsify.core import codec
from mrta_falsify.core.findings import Counterfactual
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.trial import Job, judges_of
from mrta_falsify.verbs.explain.changes import Change
from simulator_interface.continuation import Running, run_to

AFTER = 45.0  # s after the violation that a changed episode must survive
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
    for key in list(missing):
        if key not in journal.answers:
            break
        del missing[key]
        yield journal.answers[key]
    if not missing:
        return
    with run_to(job.world, job.config, judges_of(job), at) as running:
        for key, change in missing.items():
            changed = partial(_counterfactual, running, verdict, change, until)
            yield journal.keep(key, running.in_a_copy(changed, Counterfactual))


def _counterfactual(
    running: Running, verdict: Verdict, change: Change, until: float
) -> Counterfactual:
    """Go on with a change, and look whether the same specification is violated by ``until`` [s]."""
    running.episode.swap(change.config)
    own = [s for s in running.specifications if s.verdict().spec == verdict.spec]
    ended = "the time looked at was over"
    for frame in running.frames:
        for specification in own:
            specification.update(frame)
        time = frame.sensed.time
        if frame.sensed.tick % LOOK_STRIDE == 0 and any(s.verdict().violated for s in own):
            ended = f"violated again at {time:.1f} s"
            break
        if running.episode.books.due and running.episode.books.closed:
            ended = f"all tasks done at {time:.1f} s"
            break
        if time >= min(until, running.episode.world.horizon):
            ended = f"nothing violated until {time:.1f} s"
            break
    verdicts = [s.verdict() for s in own]
    unjudged = next((v.not_judged for v in verdicts if v.not_judged), "")
    return Counterfactual(
        layer=change.layer,
        change=change.text,
        failure_gone=not unjudged and not any(v.violated for v in verdicts),
        detail=f"not judged: {unjudged}" if unjudged else ended,
        restores=change.restores,
    )
