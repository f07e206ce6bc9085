"""Rows of the table of ``explain``: what a run tells, and which layer the rows name."""

from __future__ import annotations

import dataclasses

import pytest

from mrta_falsify.analysis.explain.changes import Change
from mrta_falsify.analysis.explain.rows import (
    Failure,
    curing,
    fate_of,
    meets,
    rows_of,
    separating,
    suspicion_from,
    told,
)
from mrta_falsify.core.config import StackConfig
from mrta_falsify.core.findings import LayerRow
from mrta_falsify.core.verdict import Verdict, unjudged
from mrta_falsify.lab import RunResult, Situation, Vote
from mrta_falsify.trial import Job

STOOD = Verdict(
    spec="no_deadlock",
    robustness=-1.0,
    violated=True,
    violated_at=40.0,
    who=("robot1", "robot2"),
    evidence={"members": ["robot1", "robot2"], "kind": "deadlock", "onset": 35.0},
)
TOUCHED = Verdict(spec="no_robot_robot_contact", robustness=-1.0, violated=True, violated_at=12.0)
LATE = Verdict(
    spec="deadlines", robustness=-3.0, violated=True, violated_at=50.0, who=("task2", "task5")
)
PASSED = Verdict(spec="no_deadlock", robustness=1.0, violated=False)
FAILURE = Failure(
    verdict=STOOD,
    found=40.0,
    tasks=(3,),
    situation=Situation(robots=(0, 1), place=(0.0, 0.0), reach=2.0),
)


def result(*verdicts, met=30.0, status="judged", time=100.0):
    return RunResult(status=status, verdicts=verdicts, met=met, sim_time=time)


@pytest.mark.parametrize(
    ("ran", "fate"),
    [
        (result(STOOD), "fails"),
        (result(STOOD, met=None), "fails"),
        (result(PASSED), "passes"),
        (result(PASSED, met=None), "avoids"),
        (result(PASSED, TOUCHED), "otherwise"),
        (result(PASSED, LATE), "passes"),
        (result(unjudged("no_deadlock", "the stack tells no goals")), "unknown"),
        (result(status="error"), "otherwise"),
        (result(status="impossible"), "unknown"),
        (result(STOOD, time=9.0), "unknown"),
    ],
)
def test_what_a_run_tells_of_a_failure(ran, fate):
    assert fate_of(ran, FAILURE, since=10.0) == fate


def test_a_robot_that_was_taken_away_fails_at_nothing():
    alone = dataclasses.replace(STOOD, who=("robot1",))
    assert fate_of(result(alone), FAILURE, without="robot1") == "passes"
    assert fate_of(result(STOOD), FAILURE, without="robot1") == "fails"


def test_work_is_late_again_only_if_the_same_task_is():
    failure = dataclasses.replace(FAILURE, verdict=LATE, situation=None)
    assert fate_of(result(LATE), failure) == "fails"
    other = dataclasses.replace(LATE, who=("task7",))
    assert fate_of(result(other), failure) == "passes"


def row(layer, failed, runs=6, **more):
    change = layer or "the stack as it is"
    return LayerRow(layer=layer, change=change, at=10.0, runs=runs, failed=failed, **more)


def test_a_layer_is_named_where_its_row_and_no_other_separates():
    rows = [row("", 6), row("planner", 0), row("controller", 6), row("allocator", 5)]
    assert separating(rows) == ("planner",)
    assert suspicion_from(rows, STOOD, "controller").layer == "planner"
    reason = suspicion_from(rows, STOOD, "controller").reason
    assert "the stack as it is: fails in 6 of 6 runs" in reason
    assert "planner: fails in 0 of 6 runs (90 % bounds 0.00 and 0.32)" in reason


def test_two_layers_that_both_remove_a_failure_name_none():
    rows = [row("", 6), row("planner", 0), row("controller", 0)]
    assert separating(rows) == ()
    found = suspicion_from(rows, STOOD, "controller")
    assert found.layer == ""
    assert "exchanging planner and controller removes it" in found.reason


def test_of_several_cures_those_that_are_not_as_shipped_are_told():
    stack, other = row("", 6), row("controller", 0)
    shipped = row("priority_rule", 0, restores=True)
    found = suspicion_from((stack, shipped, other), STOOD, "")
    assert found.layer == ""
    assert found.reason.endswith("; of these, priority rule is not as shipped")
    alone = suspicion_from((stack, row("priority_rule", 0), other), STOOD, "")
    assert "shipped" not in alone.reason


def test_two_rows_of_one_layer_do_not_stand_in_each_others_way():
    rows = [row("", 6), row("allocator", 0), row("allocator", 1), row("planner", 6)]
    assert separating(rows) == ("allocator",)


def test_a_row_that_never_comes_to_the_situation_proves_nothing():
    avoids = row("controller", 0, runs=0, avoided=6)
    assert not meets(avoids)
    assert separating([row("", 6), avoids]) == ()
    assert curing([row("", 6), avoids]) == ()
    # nor does it keep another layer from being named
    assert separating([row("", 6), row("planner", 0), avoids]) == ("planner",)
    assert told(avoids) == "controller: avoids the situation in 6"


def test_a_row_that_makes_it_rarer_is_not_named_beside_one_that_avoids_it_and_never_fails():
    rows = [
        row("", 12, runs=12),
        row("planner", 3, runs=8, avoided=4),
        row("controller", 0, runs=2, avoided=10),
    ]
    assert separating(rows) == ()
    found = suspicion_from(rows, STOOD, "controller")
    assert found.layer == ""
    assert "exchanging planner makes it rarer" in found.reason


def test_runs_that_fail_in_another_way_are_no_cure():
    assert separating([row("", 6), row("planner", 0, runs=0, otherwise=6)]) == ()
    assert separating([row("", 4), row("planner", 0, runs=4, otherwise=2)]) == ()


class _Lab:
    """A lab in which a layer's exchange removes a failure that half of the copies repeat."""

    def __init__(self) -> None:
        self.asked = 0

    def run(self, experiment):
        return result(STOOD)

    def map(self, experiments):
        for experiment in experiments:
            self.asked += 1
            is_cured = experiment.edits[0].stack is not None
            yield result(PASSED if is_cured or experiment.perturbation % 2 else STOOD)


@pytest.mark.parametrize(("most", "runs"), [(100, 12), (20, 6)])
def test_rows_go_on_while_more_runs_may_tell_a_layer(hall, most, runs):
    job = Job(world=hall, config=StackConfig())
    change = Change(layer="planner", text="planner", config=StackConfig())
    lab = _Lab()
    rows = rows_of(job, FAILURE, 10.0, [change], most, lab)
    assert [(row.runs, row.failed) for row in rows] == [(runs, runs // 2), (runs, 0)]
    assert lab.asked == 2 * runs
    assert separating(rows) == (("planner",) if runs > 6 else ())


def test_at_a_knife_edge_no_layer_is_exchanged(hall):
    class AtAnEdge(_Lab):
        def map(self, experiments):
            for experiment in experiments:
                self.asked += 1
                yield result(STOOD if experiment.perturbation == 1 else PASSED)

    lab = AtAnEdge()
    change = Change(layer="planner", text="planner", config=StackConfig())
    rows = rows_of(Job(world=hall, config=StackConfig()), FAILURE, 10.0, [change], 100, lab)
    assert [(row.layer, row.runs, row.failed) for row in rows] == [("", 6, 1)]
    assert lab.asked == 6


def test_a_knife_edge_names_no_layer():
    found = suspicion_from([row("", 1), row("planner", 0)], STOOD, "planner")
    assert found.layer == ""
    assert "knife edge" in found.reason
    assert "1 of 6" in found.reason


def test_a_rule_by_which_the_stack_as_it_is_passes_decides_nothing():
    found = suspicion_from([row("", 0, runs=1)], STOOD, "planner")
    assert found.layer == ""
    assert "does not fail" in found.reason


def test_a_shut_place_is_of_no_layer_and_a_stack_outside_is_one():
    assert suspicion_from([], STOOD, "world").layer == "world"
    found = suspicion_from([row("", 6), row("stack", 0)], STOOD, "stack")
    assert found.layer == "stack"
    assert "0 of 6" in found.reason


def test_bounds_of_a_vote_hold_each_with_90_percent():
    low, high = Vote(runs=6, failed=0).bounds
    assert low == 0.0
    assert high == pytest.approx(1.0 - 0.1 ** (1 / 6))
    assert Vote(runs=6, failed=6).bounds == (pytest.approx(0.1 ** (1 / 6)), 1.0)
    # runs without an answer may have failed, or not
    low, high = Vote(runs=4, failed=2, undecided=2).bounds
    assert low == pytest.approx(Vote(runs=6, failed=2).bounds[0])
    assert high == pytest.approx(Vote(runs=6, failed=4).bounds[1])
