"""Failures judged by copies of their world with small differences, under one stack or two.

A world near a deadline fails under one stack and passes under another by chance. So two stacks are
told apart by the same copies of it: the stack under test fails in more than half of them, the other
one passes in more than half. Copies end once the rest cannot change that.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable, Collection, Sequence
from contextlib import AbstractContextManager, nullcontext
from typing import Literal, NamedTuple, TypeAlias

import numpy as np

from mrta_falsify.campaigns.signature import signature, signature_before
from mrta_falsify.core.probability import chance_of_failure
from mrta_falsify.core.record import OtherRun, PerturbedRuns
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.lab import Experiment, Lab, RunResult, Vote, certain
from mrta_falsify.specs.causes import group_of, leading, secondary
from mrta_falsify.specs.objectives import SMALLEST, differing, search_score
from mrta_falsify.trial import Judged

FateOnOther: TypeAlias = Literal["passes", "fails", "not judged"]


class Comparison(NamedTuple):
    """A failure judged by copies, and by the other stack where there is one."""

    jittered: PerturbedRuns | None  #: None: no copies were run
    other: OtherRun | None


class Margin(NamedTuple):
    """A margin that copies tell, and how uncertain it is."""

    mean: float
    variance: float


NO_COMPARISON = Comparison(None, None)  #: of a run that is not judged by copies


def judged_by_vote(lab: Lab, experiment: Experiment, own: RunResult, count: int) -> Comparison:
    """Judge a failure by copies.

    Args:
        lab: that runs them.
        experiment: that fails.
        own: its result.
        count: copies at most.
    """
    runs = tuple(lab.copies(experiment.for_vote(), count, fails))
    told = [one.margins for one in (own, *runs)]
    return Comparison(counted([one.failed for one in runs], told), None)


def compared_by_vote(
    lab: Lab,
    experiment: Experiment,
    own: RunResult,
    other: Experiment,
    theirs: RunResult,
    count: int,
    each: Callable[[], AbstractContextManager[None]] = nullcontext,
) -> Comparison:
    """Judge a failure by copies, and on the other stack.

    Where the other stack does not pass in the world itself, copies tell nothing and are not run. It
    runs copies only if the stack under test fails in most of them.

    Args:
        lab: that runs copies.
        experiment: in which the stack under test fails.
        own: its result.
        other: the same with the other stack.
        theirs: its result.
        count: copies at most.
        each: entered around each run of the other stack.
    """
    failure = leading(own.verdicts)
    run = other_run(failure, theirs, other.then)
    if not run.passes:
        return Comparison(None, run)

    def does_pass(result: RunResult) -> bool:
        return fate_on_other(failure, certain(result)) == "passes"

    runs = tuple(lab.copies(experiment.for_vote(), count, fails))
    their_runs: tuple[RunResult, ...] = ()
    if Vote.of(one.failed for one in runs).robust:
        their_runs = tuple(lab.copies(other, count, does_pass, each=each))
        passed = sum(map(does_pass, their_runs))
        run = dataclasses.replace(
            run,
            jittered=PerturbedRuns(runs=len(their_runs), failed=len(their_runs) - passed),
            runs=1 + len(their_runs),
            wall_s=run.wall_s + sum(one.wall_s for one in their_runs),
        )
    # where the other stack has not run a copy, its run of the world itself stands for it
    theirs_of = itertools.chain((theirs, *their_runs), itertools.repeat(theirs))
    told = [
        {
            name: differing(margin, _their_score(failure, its, other.then))
            for name, margin in mine.margins.items()
        }
        for mine, its in zip((own, *runs), theirs_of, strict=False)
    ]
    return Comparison(counted([one.failed for one in runs], told), run)


def fails(result: RunResult) -> bool:
    """Whether a perturbed run violates a primary specification; one not judged does not.

    Raises:
        InputError: it cannot be run.
        HarnessError: the toolkit failed.
    """
    return certain(result).failed


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


def other_run(failure: Verdict | None, theirs: RunResult, then: Collection[str]) -> OtherRun:
    """Record what the other stack did in the world itself.

    Args:
        failure: of the stack under test.
        theirs: of the other stack.
        then: secondary specifications.
    """
    return OtherRun(
        fate=fate_on_other(failure, theirs),
        score=_their_score(failure, theirs, then),
        verdicts=theirs.verdicts,
        signature=signature(theirs.verdicts),
        signature_before=signature_before(theirs.verdicts),
        trace_digest=theirs.trace,
        ended=theirs.ended,
        sim_time=theirs.sim_time,
        wall_s=theirs.wall_s,
    )


def fate_on_other(failure: Verdict | None, theirs: RunResult) -> FateOnOther:
    """Say what becomes of a failure on the other stack, by primary specifications.

    Args:
        failure: of the stack under test, the violated verdict that explains it.
        theirs: the run of the other stack in the same world.
    """
    if theirs.failed:
        return "fails"
    if group_of(theirs) == "shut":  # it could not show what it does
        return "not judged"
    wanted = failure.spec if failure is not None else ""
    unjudged = any(v.not_judged and v.spec == wanted for v in theirs.verdicts)
    return "not judged" if unjudged else "passes"


def _their_score(failure: Verdict | None, theirs: RunResult, then: Collection[str]) -> float:
    """Score a run of the other stack: below 0 unless it passes."""
    if fate_on_other(failure, theirs) == "not judged":
        return -SMALLEST
    return search_score(theirs.margins, secondary(theirs.verdicts, then))


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
    chance = comparison.jittered.posterior.mean
    if comparison.other is not None and comparison.other.jittered is not None:
        chance = min(chance, 1.0 - comparison.other.jittered.posterior.mean)
    return -chance
