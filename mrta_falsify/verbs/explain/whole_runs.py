"""Runs of the whole world with something changed: is the failure still there?"""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

from mrta_falsify.campaigns.rules import RULES, signed
from mrta_falsify.core.errors import InputError
from mrta_falsify.core.findings import Fate
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.specs.library import specification_choice
from mrta_falsify.trial import Job, Judged, judge
from simulator_interface import starts

STACK_RUNS = "stack_runs"  # judged in every run


class RunFate(NamedTuple):
    """What became of a failure in a changed run."""

    fate: Fate
    detail: str  #: how the run ended


def looking_for(job: Job, verdict: Verdict) -> Job:
    """Reduce a job to what tells whether a failure is there: its specification.

    Other violations must not end a changed run before it has had time to fail.

    Args:
        job: that fails.
        verdict: the violated one that explains the failure.
    """
    own = tuple(
        name
        for name in job.specifications
        if verdict.spec in (name, specification_choice(name).name)
    )
    if own or verdict.spec == STACK_RUNS:
        names = own or (STACK_RUNS,)
        return dataclasses.replace(job, specifications=names, early_stop=True)
    return dataclasses.replace(job, early_stop=False)


def run_changed(job: Job, verdict: Verdict) -> RunFate:
    """Run a changed job, and look whether it fails as before.

    Args:
        job: changed, of :func:`looking_for`.
        verdict: the violated one that explains the failure.
    """
    try:
        starts.check_starts(job.world)
        judged = judge(job, keep_trace=False)
    except InputError as error:
        return RunFate("unknown", f"it cannot be run: {error}")
    return fate_in(judged, verdict, job.rules)


def fate_in(judged: Judged, verdict: Verdict, rules: int = RULES) -> RunFate:
    """Tell what became of a failure in a run of which nothing else was judged.

    A run that could not be judged, or that the stack broke off, tells nothing.

    Args:
        judged: the run.
        verdict: the violated one that explains the failure.
        rules: in whose form the two are compared.
    """
    own = [found for found in judged.verdicts if found.spec == verdict.spec]
    for found in own:
        if not found.violated:
            continue
        at, way = f"at {found.violated_at or 0.0:.1f} s", signed([found], rules)
        if way == signed([verdict], rules):
            return RunFate("stays", f"violated again {at}")
        return RunFate("otherwise", f"violated {at} in another way: {way}")
    missing = _missing(judged, own)
    if missing:
        return RunFate("unknown", missing)
    ended = judged.outcome.ended
    what = "all tasks done at" if ended == "all-tasks-done" else "nothing of the kind until"
    return RunFate("gone", f"{what} {judged.outcome.sim_time:.1f} s")


def _missing(judged: Judged, own: list[Verdict]) -> str:
    """Say why a run without the failure tells nothing of it; empty if it does."""
    for found in judged.verdicts:
        if found.spec == STACK_RUNS and found.violated:
            return f"the stack failed at {found.violated_at or 0.0:.1f} s"
    reasons = [found.not_judged for found in own if found.not_judged]
    if reasons:
        return f"not judged: {reasons[0]}"
    return "" if own else "not judged: the run ended before"
