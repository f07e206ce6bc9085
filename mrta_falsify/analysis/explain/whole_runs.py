"""Runs of the whole world with something changed: is the failure still there?"""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

from mrta_falsify.campaigns.rules import RULES, signed
from mrta_falsify.core.findings import Fate
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.lab import Experiment, Lab, RunResult, certain
from mrta_falsify.specs.library import specification_choice

STACK_RUNS = "stack_runs"  # judged in every run


class RunFate(NamedTuple):
    """What became of a failure in a changed run."""

    fate: Fate
    detail: str  #: how the run ended


def looking_for(own: Experiment, verdict: Verdict) -> Experiment:
    """Reduce a run to what tells whether a failure is there: its specification.

    Other violations must not end a changed run before it has had time to fail.

    Args:
        own: that fails.
        verdict: the violated one that explains the failure.
    """
    named = tuple(
        name for name in own.specs if verdict.spec in (name, specification_choice(name).name)
    )
    if named or verdict.spec == STACK_RUNS:
        return dataclasses.replace(own, specs=named or (STACK_RUNS,), early_stop=True)
    return dataclasses.replace(own, early_stop=False)


def run_changed(lab: Lab, changed: Experiment, verdict: Verdict) -> RunFate:
    """Run a changed world or stack, and look whether it fails as before.

    Args:
        lab: that runs it.
        changed: of :func:`looking_for`.
        verdict: the violated one that explains the failure.
    """
    return fate_in(certain_or_impossible(lab.run(changed)), verdict, changed.rules or RULES)


def certain_or_impossible(result: RunResult) -> RunResult:
    """Give the result of a run, unless the toolkit failed.

    Raises:
        HarnessError: it did.
    """
    return result if result.status == "impossible" else certain(result)


def fate_in(result: RunResult, verdict: Verdict, rules: int = RULES) -> RunFate:
    """Tell what became of a failure in a run of which nothing else was judged.

    A run that could not be judged, or that the stack broke off, tells nothing.

    Args:
        result: of the run.
        verdict: the violated one that explains the failure.
        rules: in whose form the two are compared.
    """
    if result.status == "impossible":
        return RunFate("unknown", f"it cannot be run: {result.detail}")
    own = [found for found in result.verdicts if found.spec == verdict.spec]
    for found in own:
        if not found.violated:
            continue
        at, way = f"at {found.violated_at or 0.0:.1f} s", signed([found], rules)
        if way == signed([verdict], rules):
            return RunFate("stays", f"violated again {at}")
        return RunFate("otherwise", f"violated {at} in another way: {way}")
    missing = _missing(result, own)
    if missing:
        return RunFate("unknown", missing)
    is_done = result.ended == "all-tasks-done"
    what = "all tasks done at" if is_done else "nothing of the kind until"
    return RunFate("gone", f"{what} {result.sim_time:.1f} s")


def _missing(result: RunResult, own: list[Verdict]) -> str:
    """Say why a run without the failure tells nothing of it; empty if it does."""
    for found in result.verdicts:
        if found.spec == STACK_RUNS and found.violated:
            return f"the stack failed at {found.violated_at or 0.0:.1f} s"
    reasons = [found.not_judged for found in own if found.not_judged]
    if reasons:
        return f"not judged: {reasons[0]}"
    return "" if own else "not judged: the run ended before"
