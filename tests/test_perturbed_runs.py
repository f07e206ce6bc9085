"""When a failure counts: by copies, and where another stack does not share it."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrta_falsify.campaigns.runner import feedback_of
from mrta_falsify.campaigns.statistics import chance_in_vote
from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.core.feedback import Cube
from mrta_falsify.core.probability import failure_probability
from mrta_falsify.core.record import OtherRun, PerturbedRuns, TrialRecord
from mrta_falsify.core.verdict import Verdict, unjudged
from mrta_falsify.core.world import World
from mrta_falsify.lab import Experiment, Lab, RunResult
from mrta_falsify.lab.running import world_of
from mrta_falsify.perturbed_runs import (
    Comparison,
    compared_by_vote,
    expected_margin,
    judged_by_vote,
    trial_score,
)
from mrta_falsify.specs.objectives import differing
from mrta_falsify.testing.records import trial_record

COPIES = 4


def run(margin: float | None) -> RunResult:
    """A run whose only specification has this margin; None: it was not judged."""
    if margin is None:
        verdict, margins = unjudged("no_deadlock", "its goals are not told"), {}
    else:
        violated = margin < 0.0
        verdict = Verdict(
            spec="no_deadlock",
            robustness=margin,
            violated=violated,
            violated_at=9.0 if violated else None,
        )
        margins = {"no_deadlock": margin}
    return RunResult(
        status="judged" if margin is not None else "not_judged",
        verdicts=(verdict,),
        margins=margins,
        rank="primary" if verdict.violated else "none",
        trace="d",
        ended="horizon",
        sim_time=60.0,
        wall_s=1.0,
    )


OTHER = StackConfig(allocator=Choice("nearest"))


class ScriptedLab(Lab):
    """Gives these margins one after the other, for the stack under test and for the other one."""

    def __init__(self, mine: Sequence[float], theirs: Sequence[float | None] = ()) -> None:
        super().__init__()
        self.margins: dict[str, list[float | None]] = {"here": [*mine], "there": [*theirs]}
        self.asked: dict[str, list[str]] = {"here": [], "there": []}

    def run(self, experiment: Experiment) -> RunResult:
        where = "there" if experiment.stack == OTHER else "here"
        self.asked[where].append(world_of(experiment).digest())
        return run(self.margins[where].pop(0))


def record_of(said: Comparison, result: RunResult) -> TrialRecord:
    judged: Any = SimpleNamespace(
        verdicts=result.verdicts, margins=result.margins, secondary=frozenset()
    )
    copies = said.jittered
    return trial_record(
        0,
        np.zeros(1),
        verdicts=judged.verdicts,
        margins=judged.margins,
        score=trial_score(judged, said),
        expected=copies.objectives if copies else {},
        signature="no_deadlock",
        vote=PerturbedRuns.vote(copies),
        other=said.other,
    )


def compared(hall, mine: tuple[float, ...], theirs: tuple[float | None, ...]):
    """The record of a world that fails by 0.5, and how many runs each stack was asked for."""
    lab = ScriptedLab(mine, theirs)
    said = ask(lab, hall)
    spent = (len(lab.asked["here"]), len(lab.asked["there"]))
    return record_of(said, run(-0.5)), spent


def ask(lab: ScriptedLab, hall: World) -> Comparison:
    """Compare two stacks in a world in which the first one fails by 0.5."""
    own = Experiment(world=hall, stack=StackConfig())
    other = dataclasses.replace(own, stack=OTHER)
    return compared_by_vote(lab, own, run(-0.5), other, lab.run(other), COPIES)


@pytest.mark.parametrize(
    ("mine", "theirs", "counts", "runs"),
    [
        # the other one passes the world and most copies
        ((-1, -1, -1), (1, 1, 1, 1), True, (3, 4)),
        ((-1, 1, -1, -1), (1, -1, 1, 1, 1), True, (4, 5)),
        # a knife edge of this stack: the other one is not asked about copies
        ((1, 1), (1,), False, (2, 1)),
        ((-1, 1, -1, 1), (1,), False, (4, 1)),
        # a knife edge of the other one
        ((-1, -1, -1), (1, -1, -1), False, (3, 3)),
        ((-1, -1, -1), (1, 1, -1, 1, -1), False, (3, 5)),
        # the other one fails, too: copies tell nothing
        ((), (-0.25,), False, (0, 1)),
        ((), (None,), False, (0, 1)),
        # what cannot be judged is no pass
        ((-1, -1, -1), (1, None, None), False, (3, 3)),
    ],
)
def test_a_failure_counts_if_most_copies_fail_here_and_pass_there(hall, mine, theirs, counts, runs):
    record, spent = compared(hall, mine, theirs)
    assert record.is_robust == counts
    assert spent == runs
    assert record.other is not None
    assert record.other.runs == runs[1] == record.other.wall_s


def test_both_stacks_are_asked_about_the_same_copies(hall):
    lab = ScriptedLab([-1.0] * COPIES, [1.0] * (1 + COPIES))
    ask(lab, hall)
    there = lab.asked["there"]
    assert there[: 1 + len(lab.asked["here"])] == [hall.digest(), *lab.asked["here"]]
    assert len(set(there)) == len(there)


def test_a_failure_of_both_stacks_is_told_as_a_world_that_passes(hall):
    record, _ = compared(hall, (), (-0.25,))
    told = feedback_of(record, Cube(dimensions=1))
    assert record.failed
    assert (record.rank, record.result.rank) == ("none", "primary")
    assert not record.is_primary
    assert not told.failed
    assert told.signature == ""
    assert told.score == pytest.approx(0.25)
    assert told.objectives == {"no_deadlock": pytest.approx(0.25)}


def test_the_score_is_the_smaller_share(hall):
    all_here, _ = compared(hall, (-1, -1, -1), (1, 1, 1, 1))
    once_there, _ = compared(hall, (-1, -1, -1), (1, -1, 1, 1, 1))
    assert all_here.score == pytest.approx(-4 / 5)  # of Beta(4, 1); the other one passes 4 of 4
    assert once_there.score == pytest.approx(-2 / 3)  # of Beta(4, 2)
    knife_edge, _ = compared(hall, (-1, 1, 1), (1,))
    assert all_here.score < once_there.score < knife_edge.score < 0.0


def test_a_knife_edge_of_either_stack_is_a_kind_of_its_own(hall):
    cube = Cube(dimensions=1)
    kinds = {
        feedback_of(compared(hall, mine, theirs)[0], cube).signature
        for mine, theirs in (
            ((-1, -1, -1), (1, 1, 1, 1)),
            ((-1, 1, 1), (1,)),
            ((-1, -1, -1), (1, -1, -1)),
        )
    }
    assert kinds == {
        "no_deadlock",
        "1 of 3 copies: no_deadlock",
        "2 of 2 copies on the other stack: no_deadlock",
    }


def test_without_another_stack_nothing_is_asked_of_one(hall):
    own, failing = Experiment(world=hall, stack=StackConfig()), run(-0.5)
    said = judged_by_vote(ScriptedLab([-1, -1, -1]), own, failing, COPIES)
    assert said.other is None
    assert record_of(said, failing).is_robust
    assert record_of(said, failing).score == pytest.approx(-4 / 5)


def test_few_copies_tell_a_margin_less_surely_than_many():
    few, many = expected_margin([-0.5] * 4), expected_margin([-0.5] * 21)
    assert few.mean == pytest.approx(-0.5 * 4 / 5)
    assert few.mean > many.mean > -0.5
    assert few.variance > 4.0 * many.variance > 0.0


def test_a_knife_edge_is_told_as_worlds_beside_it_and_as_unsure(hall):
    own = Experiment(world=hall, stack=StackConfig())
    said = judged_by_vote(ScriptedLab([0.4, 0.4]), own, run(-0.8), COPIES)
    told = feedback_of(record_of(said, run(-0.8)), Cube(dimensions=1))
    assert told.objectives == {"no_deadlock": pytest.approx(0.4 - 1.2 / 4)}
    assert said.jittered.noise == {"no_deadlock": pytest.approx(1.2**2 * 3 / 80)}


def test_a_margin_that_no_run_violates_is_the_mean_and_certain():
    assert expected_margin([0.25, 0.75]) == (0.5, 0.0)


@given(st.lists(st.floats(-1, 1), min_size=2, max_size=8))
def test_an_expected_margin_lies_between_those_of_runs_and_a_bare_pass(margins):
    told = expected_margin(margins)
    assert min(margins) - 1e-12 <= told.mean <= max(*margins, 0.0) + 1e-12
    assert told.variance >= 0.0


@given(margin=st.floats(-1, 1), other=st.floats(-1, 1))
def test_the_margin_of_a_difference_is_below_zero_only_for_one(margin, other):
    combined = differing(margin, other)
    assert (combined < 0.0) == (margin < 0.0 <= other)
    assert -1.0 <= combined <= 1.0


@given(
    fates=st.lists(st.booleans(), min_size=COPIES, max_size=COPIES),
    runs=st.integers(0, COPIES),
)
def test_copies_that_were_not_run_widen_the_interval_both_ways(fates, runs):
    cut = chance_in_vote(PerturbedRuns(runs=runs, failed=sum(fates[:runs])), COPIES)
    whole = failure_probability(sum(fates), COPIES)
    assert cut.low <= whole.low
    assert whole.high <= cut.high


def test_another_stack_is_told_in_words():
    assert str(OtherRun(fate="passes", score=0.3)) == "the other stack passes"
    failing = OtherRun(fate="fails", score=-0.3, signature="no_deadlock/1:stalled")
    assert str(failing) == "the other stack fails, too: no_deadlock/1:stalled"
    assert str(OtherRun(fate="not judged", score=-1e-9)) == "the other stack cannot be judged"
