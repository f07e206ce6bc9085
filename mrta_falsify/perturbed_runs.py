"""Failures judged by copies of their world with small differences, under one stack or two.

A world near a deadline fails under one stack and passes under another by chance. So two stacks are
told apart by the same copies of it: the stack under test fails in more than half of them, the other
one passes in more than half. Copies end once the rest cannot change that.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable, Sequence
from typing import Literal, NamedTuple, TypeAlias

import numpy as np

from mrta_falsify.campaigns.signature import signature, signature_before
from mrta_falsify.core.probability import chance_of_failure
from mrta_falsify.core.record import OtherRun, PerturbedRuns
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.core.world import World
from mrta_falsify.specs.causes import leading
from mrta_falsify.specs.objectives import SMALLEST, differing, search_score
from mrta_falsify.trial import Judged
from scenic_worlds.variation import perturbed_worlds

Run = Callable[[World], Judged]
FateOnOther: TypeAlias = Literal["passes", "fails", "not judged"]


class Comparison(NamedTuple):
    """A failure judged by copies, and by the other stack where there is one."""

    jittered: PerturbedRuns | None  #: None: no copies were run
    other: OtherRun | None
    their_run: Judged | None = None  #: of the other stack, of the world itself


class Margin(NamedTuple):
    """A margin that copies tell, and how uncertain it is."""

    mean: float
    variance: float


NO_COMPARISON = Comparison(None, None)  #: of a run that is not judged by copies


def judged_by_vote(
    world: World, judged: Judged, count: int, run: Run, run_other: Run | None = None
) -> Comparison:
    """Judge a failure by copies, and on the other stack.

    The other stack runs the world itself first. Where it does not pass, copies tell nothing and are
    not run. It runs copies only if the stack under test fails in most of them.

    Args:
        world: in which the stack under test fails.
        judged: its run.
        count: copies at most.
        run: runs a world under the stack under test.
        run_other: runs it under the other stack, if two are compared.
    """
    if run_other is None:
        copies = perturbed_worlds(world, count)
        return Comparison(_of_one_stack(judged, copies, run), None)
    theirs = run_other(world)
    other = _other_run(judged, theirs)
    if not other.passes:
        return Comparison(None, other, theirs)
    copies = perturbed_worlds(world, count)
    runs = run_perturbed(copies, run, lambda one: one.is_primary)
    their_runs: tuple[Judged, ...] = ()
    if 2 * sum(one.is_primary for one in runs) > len(runs):
        their_runs = run_perturbed(copies, run_other, lambda one: _passes(judged, one))
        other = _with_vote(other, judged, their_runs)
    # where the other stack has not run a copy, its run of the world itself stands for it
    theirs_of = itertools.chain((theirs, *their_runs), itertools.repeat(theirs))
    told = [
        {
            name: differing(margin, _their_score(judged, its))
            for name, margin in mine.margins.items()
        }
        for mine, its in zip((judged, *runs), theirs_of, strict=False)
    ]
    return Comparison(counted([one.is_primary for one in runs], told), other, theirs)


def _of_one_stack(judged: Judged, copies: Sequence[World], run: Run) -> PerturbedRuns | None:
    runs = run_perturbed(copies, run, lambda one: one.is_primary)
    return counted([one.is_primary for one in runs], [one.margins for one in (judged, *runs)])


def counted(fails: Sequence[bool], told: Sequence[dict[str, float]]) -> PerturbedRuns | None:
    """Count copies, each of which ``fails`` or not; None without copies.

    Args:
        fails: of each copy.
        told: margins of the world, then of its copies, for the search.
    """
    if not fails:
        return None
    expected = {name: expected_margin([of[name] for of in told if name in of]) for name in told[0]}
    return PerturbedRuns(
        runs=len(fails),
        failed=sum(fails),
        objectives={name: margin.mean for name, margin in expected.items()},
        noise={name: margin.variance for name, margin in expected.items() if margin.variance},
    )


def expected_margin(margins: Sequence[float]) -> Margin:
    """Say what a margin is near a world, as far as copies tell.

    Copies tell the chance of failure, as a posterior of some width. The margin is that of runs that
    fail with this chance, otherwise that of runs that pass: 0 where there are none. So all of few
    copies is told as less certain than all of many, and a knife edge as next to nothing.

    Args:
        margins: of the world itself, then of its copies. The world itself does not count for the
            chance: it was chosen because it fails.
    """
    failing = [margin for margin in margins if margin < 0.0]
    passing = [margin for margin in margins if margin >= 0.0]
    if not failing:
        return Margin(float(np.mean(passing)), 0.0)
    chance = chance_of_failure(sum(margin < 0.0 for margin in margins[1:]), len(margins) - 1)
    bad, good = float(np.mean(failing)), float(np.mean(passing)) if passing else 0.0
    return Margin(good + chance.mean * (bad - good), chance.variance * (bad - good) ** 2)


# --- the other stack ----------------------------------------------------------------------


def _other_run(judged: Judged, theirs: Judged) -> OtherRun:
    """Record what the other stack did in the world itself."""
    outcome = theirs.outcome
    return OtherRun(
        fate=fate_on_other(judged, theirs),
        score=_their_score(judged, theirs),
        verdicts=theirs.verdicts,
        signature=signature(theirs.verdicts),
        signature_before=signature_before(theirs.verdicts),
        trace_digest=outcome.trace.digest,
        ended=outcome.ended,
        sim_time=outcome.sim_time,
        wall_s=outcome.wall_s,
    )


def _with_vote(other: OtherRun, judged: Judged, runs: Sequence[Judged]) -> OtherRun:
    """Add what the other stack did in copies; one that cannot be judged is no pass."""
    passed = sum(_passes(judged, one) for one in runs)
    return dataclasses.replace(
        other,
        jittered=PerturbedRuns(runs=len(runs), failed=len(runs) - passed),
        runs=1 + len(runs),
        wall_s=other.wall_s + sum(one.outcome.wall_s for one in runs),
    )


def fate_on_other(judged: Judged, theirs: Judged) -> FateOnOther:
    """Say what becomes of a failure on the other stack, in what is looked for first.

    Args:
        judged: the failing run of the stack under test.
        theirs: the run of the other stack in the same world.
    """
    return fate_by(
        leading(judged.verdicts), theirs.verdicts, fails=theirs.is_primary, is_shut=theirs.is_shut
    )


def fate_by(
    failure: Verdict | None, theirs: Sequence[Verdict], *, fails: bool, is_shut: bool
) -> FateOnOther:
    """Say the same of a run whose trace is gone.

    Args:
        failure: of the stack under test, the violated verdict that explains it.
        theirs: verdicts of the other stack in the same world.
        fails: whether one is violated that is looked for first.
        is_shut: whether it fails only because the world shut a place.
    """
    if fails:
        return "fails"
    if is_shut:  # it could not show what it does
        return "not judged"
    wanted = failure.spec if failure is not None else ""
    unjudged = any(v.not_judged and v.spec == wanted for v in theirs)
    return "not judged" if unjudged else "passes"


def _passes(judged: Judged, theirs: Judged) -> bool:
    return fate_on_other(judged, theirs) == "passes"


def _their_score(judged: Judged, theirs: Judged) -> float:
    """Score a run of the other stack: below 0 unless it passes."""
    if fate_on_other(judged, theirs) == "not judged":
        return -SMALLEST
    return search_score(theirs.margins, theirs.secondary)


def run_perturbed(
    copies: Sequence[World], run: Run, counts: Callable[[Judged], bool]
) -> tuple[Judged, ...]:
    """Run copies until the rest cannot change whether most of them count."""
    runs: list[Judged] = []
    for copy in copies:
        if is_decided(sum(map(counts, runs)), len(runs), len(copies)):
            break
        runs.append(run(copy))
    return tuple(runs)


def is_decided(failed: int, runs: int, most: int) -> bool:
    """Whether further copies cannot change whether most of them fail.

    Args:
        failed: copies that failed.
        runs: copies that were run.
        most: copies that would be run.
    """
    left = most - runs
    return 2 * failed > most or 2 * (failed + left) <= most


def trial_score(judged: Judged, comparison: Comparison) -> float:
    """Compute what a search minimises of a trial, below 0 only for what it looks for.

    Of a failure with copies it is the chance that a copy fails, negated. Where two stacks are
    compared, it is the smaller one of that chance and of the chance that the other one passes.
    """
    score = search_score(judged.margins, judged.secondary)
    if comparison.jittered is None:
        if comparison.other is None:
            return score
        return differing(score, comparison.other.score)
    chance = comparison.jittered.chance.mean
    if comparison.other is not None and comparison.other.jittered is not None:
        chance = min(chance, 1.0 - comparison.other.jittered.chance.mean)
    return -chance
