from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest

from benchmarks.defects import worlds
from mrta_falsify.campaigns.attribution import suspected_layer
from mrta_falsify.core.config import Choice, StackConfig, read_config
from mrta_falsify.core.errors import InputError
from mrta_falsify.core.findings import Counterfactual, Removal
from mrta_falsify.specs.causes import leading
from mrta_falsify.trial import Job, judge, quick_stack
from mrta_falsify.verbs.explain import removal_text
from mrta_falsify.verbs.explain.changes import changes_of, suspicion_from
from mrta_falsify.verbs.explain.explaining import explain_job
from mrta_falsify.verbs.explain.removals import removals_of
from scenic_worlds.program import compile_program


def _job(defect, *specifications):
    return Job(
        world=getattr(worlds, defect)(0),
        config=quick_stack(StackConfig(defects=(defect,))),
        specifications=specifications,
        early_stop=True,
    )


@pytest.mark.parametrize(
    "max_runs", [pytest.param(3, marks=pytest.mark.slow), pytest.param(8, marks=pytest.mark.long)]
)
def test_the_layer_whose_replacement_cures_the_failure_is_named(max_runs):
    told = []
    found = explain_job(
        _job("room_freed_while_parked", "exclusive_use"),
        max_runs=max_runs,
        on_done=lambda done, total: told.append((done, total)),
    )
    assert found.layer == "queue_policy"
    gone = {finding.layer for finding in found.counterfactuals if finding.failure_gone}
    assert gone == {"queue_policy"}
    assert found.runs <= max_runs + 6
    assert [done for done, _ in told] == list(range(1, found.runs + 1))
    assert all(done <= total for done, total in told)


@pytest.mark.slow
def test_what_costs_a_deadline_is_looked_for_from_the_start():
    found = explain_job(_job("planner_failure_blocks_all", "deadlines"), max_runs=6)
    assert found.layer == "planner"
    assert found.changed_at == 0.0


def test_a_run_that_holds_has_nothing_to_explain():
    world = worlds.room_freed_while_parked(0)
    job = Job(world=world, config=quick_stack(StackConfig()), specifications=("exclusive_use",))
    with pytest.raises(InputError, match="violates nothing"):
        explain_job(job)


def test_a_layer_under_test_is_replaced_by_the_reference_and_the_reference_by_others():
    config = StackConfig(priority_rule=Choice("distance_to_goal"), engine=Choice("kinematic"))
    changes = changes_of(config)
    rules = [c.config.priority_rule.name for c in changes if c.layer == "priority_rule"]
    planners = [c.config.planner.name for c in changes if c.layer == "planner"]
    assert rules == ["fixed"]
    assert planners == ["ompl"]
    assert all(c.config.engine.name == "kinematic" for c in changes)


@pytest.mark.parametrize(
    ("cured", "guess", "expected"),
    [
        ([], "planner", "planner"),
        (["controller"], "planner", "controller"),
        (["controller", "queue_policy"], "controller", "controller"),
        # changes in two places remove it, so either may only have kept the run out of it
        (["controller", "queue_policy"], "planner", "planner"),
        (["controller", "queue_policy"], "", "queue_policy"),
    ],
)
def test_one_layer_is_named_from_what_cured_the_failure(cured, guess, expected):
    findings = [
        Counterfactual(layer=layer, change=layer, failure_gone=layer in cured)
        for layer in ("queue_policy", "planner", "controller")
    ]
    assert suspicion_from(findings, guess).layer == expected


def test_the_shipped_layer_in_place_of_another_says_more_than_one_that_does_all_otherwise():
    findings = [
        Counterfactual(layer="waypoint_generator", change="another one", failure_gone=True),
        Counterfactual(
            layer="controller", change="the shipped one", failure_gone=True, restores=True
        ),
    ]
    assert suspicion_from(findings, "waypoint_generator").layer == "controller"
    stays = [findings[0], dataclasses.replace(findings[1], failure_gone=False)]
    assert suspicion_from(stays, "controller").layer == "waypoint_generator"


def _found(**gone):
    """Counterfactuals by layer: for each of its alternatives, whether the failure was gone."""
    return [
        Counterfactual(layer=layer, change=f"{layer} {i}", failure_gone=was_gone)
        for layer, outcomes in gone.items()
        for i, was_gone in enumerate(outcomes)
    ]


def test_a_layer_of_which_every_other_implementation_cures_says_more_than_one_of_many():
    found = _found(planner=[True], allocator=[True, False, False, False])
    assert suspicion_from(found, "allocator").layer == "planner"
    assert suspicion_from(_found(allocator=[True, False], planner=[False]), "").layer == "allocator"


def test_a_violation_that_names_its_layer_is_not_talked_away_by_a_chance_cure():
    found = _found(queue_policy=[False], allocator=[True])
    assert suspicion_from(found, "queue_policy", direct=True).layer == "queue_policy"
    assert suspicion_from(found, "queue_policy").layer == "allocator"


def test_a_part_that_cannot_be_exchanged_is_named_by_the_trace():
    assert suspicion_from(_found(planner=[True]), "dispatcher").layer == "dispatcher"


def test_another_planner_on_the_same_costmap_tells_the_two_apart():
    cured = _found(queue_policy=[True], planner=[True])
    assert suspicion_from(cured, "costmap").layer == "planner"
    not_cured = _found(queue_policy=[True], planner=[False])
    assert suspicion_from(not_cured, "costmap").layer == "costmap"


def test_on_a_knife_edge_any_change_cures_so_the_trace_decides():
    found = _found(priority_rule=[True], controller=[False])
    assert suspicion_from(found, "controller", knife_edge=True).layer == "controller"
    assert suspicion_from(found, "controller").layer == "priority_rule"
    assert suspicion_from(found, "", knife_edge=True).layer == "priority_rule"


def test_a_restored_layer_counts_on_a_knife_edge_too():
    shipped = Counterfactual(layer="planner", change="shipped", failure_gone=True, restores=True)
    assert suspicion_from([shipped], "controller", direct=True, knife_edge=True).layer == "planner"


def test_the_trace_alone_gives_a_first_guess(stalled):
    _, judged = stalled
    assert suspected_layer(judged.verdicts, judged.outcome.trace) == "waypoint_generator"
    assert suspected_layer((), judged.outcome.trace) == ""


@pytest.fixture(scope="module")
def stuck():
    """The world of the gallery in which three robots are stuck at a door."""
    folder = Path(__file__).parent.parent.parent / "docs" / "gallery" / "stuck_at_the_door"
    return Job(
        world=compile_program(folder / "world.min.scenic").sample(0),
        config=read_config(folder / "stack.yaml"),
        specifications=("no_deadlock",),
        early_stop=True,
    )


def _removals(job):
    judged = judge(job)
    return tuple(removals_of(job, leading(judged.verdicts), judged.outcome.trace, 3))


@pytest.mark.parametrize(
    "removed",
    [
        pytest.param(_removals, marks=pytest.mark.long, id="alone"),
        pytest.param(
            lambda job: explain_job(job, max_runs=14).removals, marks=pytest.mark.long, id="explain"
        ),
    ],
)
def test_the_robot_without_which_all_others_go_on_is_found(stuck, removed):
    removals = {removal.robot: removal for removal in removed(stuck)}
    assert removals["robot2"].go_on == ("robot1", "robot3")
    assert removals["robot2"].stay == ()
    assert removals["robot1"].stay == ("robot2", "robot3")
    assert "robot1 and robot3 go on" in removal_text(removals["robot2"])


def test_a_removal_says_who_goes_on_and_who_stays():
    removal = Removal(robot="a", time=12.0, go_on=("b",), stay=("c", "d"))
    assert removal_text(removal) == "without a from 12.0 s on, b goes on, c and d stay"
