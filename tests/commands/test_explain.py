from __future__ import annotations

from pathlib import Path

import pytest

from mrta_falsify.analysis.explain import removal_text
from mrta_falsify.analysis.explain.changes import changes_of
from mrta_falsify.analysis.explain.explaining import explain_job
from mrta_falsify.analysis.explain.removals import removals_of
from mrta_falsify.core.config import Choice, StackConfig, read_config
from mrta_falsify.core.errors import InputError
from mrta_falsify.core.findings import Removal
from mrta_falsify.lab import Lab
from mrta_falsify.specs.attribution import guess
from mrta_falsify.specs.causes import leading
from mrta_falsify.testing import planted as worlds
from mrta_falsify.trial import Job, judge, on_kinematic_engine
from scenic_worlds.program import compile_program


def _job(defect, *specifications):
    return Job(
        world=getattr(worlds, defect)(0),
        config=on_kinematic_engine(StackConfig(defects=(defect,))),
        specifications=specifications,
        early_stop=True,
    )


@pytest.mark.long
def test_the_layer_whose_exchange_removes_the_failure_is_named(tmp_path):
    told = []
    job = _job("room_freed_while_parked", "exclusive_use")

    def keep(name, config, world, judged):
        (tmp_path / name).write_text(str([v.spec for v in judged.verdicts if v.violated]))

    found = explain_job(job, on_done=lambda done, total: told.append((done, total)), keep=keep)
    assert found.layer == "queue_policy"
    stack, *rows = found.rows
    assert stack.layer == ""
    assert stack.failed > stack.runs / 2
    by_layer = {row.layer: row for row in rows}
    assert by_layer["queue_policy"].failed == 0
    assert by_layer["planner"].failed > 0
    assert len({row.runs + row.otherwise + row.avoided + row.unknown for row in found.rows}) == 1
    assert [done for done, _ in told] == list(range(1, found.runs + 1))
    assert all(done <= total for done, total in told)
    # the runs that are kept show what the rows say
    kept = {path.name.rstrip("_0123456789"): path.read_text() for path in tmp_path.iterdir()}
    assert kept == {"as_it_is": "['exclusive_use']", "queue_policy": "[]"}


@pytest.mark.long
def test_what_costs_a_deadline_is_looked_for_from_the_start():
    found = explain_job(_job("planner_failure_blocks_all", "deadlines"), max_runs=4)
    assert found.changed_at == 0.0
    assert {row.at for row in found.rows} == {0.0}


def test_a_run_that_holds_has_nothing_to_explain():
    world = worlds.room_freed_while_parked(0)
    job = Job(
        world=world, config=on_kinematic_engine(StackConfig()), specifications=("exclusive_use",)
    )
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


def test_the_trace_alone_gives_a_first_guess(stalled):
    _, judged = stalled
    assert guess(judged.verdicts, judged.outcome.trace).layer == "waypoint_generator"
    assert guess((), judged.outcome.trace).layer == ""


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
    return tuple(removals_of(job, leading(judged.verdicts), judged.outcome.trace, 3, Lab()))


@pytest.mark.parametrize(
    "removed",
    [
        pytest.param(_removals, marks=pytest.mark.long, id="alone"),
        pytest.param(
            lambda job: explain_job(job, max_runs=21).removals, marks=pytest.mark.long, id="explain"
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
