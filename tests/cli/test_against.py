"""The road of a user who looks for what a stack fails at and another one does not."""

from __future__ import annotations

import json
import shutil

import pytest

import mrta_falsify as mf
from mrta_falsify.campaigns.store import read_campaign
from mrta_falsify.commands.stacks import load_other_stack
from tests.quick_program import PROGRAM

#: a stack that plans nothing once a deadline cannot be met, against the default one
BROKEN = ("--set", "engine=kinematic", "--set", "defects=[no_plan_when_infeasible]")
SEARCH = ("--sampler", "random", "--seed", 4, "--spec", "all_tasks_done", "--executor", "serial")


@pytest.fixture(scope="module")
def call():
    from click.testing import CliRunner

    from mrta_falsify.cli import main

    return lambda *args: CliRunner().invoke(main, [str(arg) for arg in args])


@pytest.fixture(scope="module")
def campaign(call, tmp_path_factory):
    """A campaign in two pieces, until its first difference: directory and both results."""
    folder = tmp_path_factory.mktemp("against")
    (folder / "small.scenic").write_text(PROGRAM)
    begun = call(
        "campaign", folder / "small.scenic", "-o", folder / "c", "--budget", 4, *BROKEN, *SEARCH,
        "--against", "default", "--format", "json",
    )  # fmt: skip
    resumed = call(
        "campaign",
        "--resume",
        folder / "c",
        "--budget",
        20,
        "--stop-after",
        1,
        "--executor",
        "serial",
    )
    return folder / "c", begun, resumed


@pytest.fixture(scope="module")
def found(campaign):
    """The failure that the other stack does not share."""
    (record,) = (record for record in read_campaign(campaign[0]).records if record.is_robust)
    return record


@pytest.mark.long
def test_what_both_fail_at_is_counted_and_is_no_find(campaign, found):
    directory, begun, resumed = campaign
    assert begun.exit_code == 0, begun.stderr
    first = json.loads(begun.stdout)
    assert first["against"]["found"] == 0
    assert first["against"]["on_both"] == first["failed"] > 0
    assert first["modes"] == []
    assert first["first_failure_at"] is None
    assert resumed.exit_code == 1, resumed.stderr
    assert "1 world on which only this stack fails" in resumed.stdout
    assert "ended: stop-after" in resumed.stdout
    assert found.vote.robust
    assert found.other.passes_most
    stored = read_campaign(directory).settings.trials
    assert stored.against.defects == ()
    assert stored.against.engine.name == stored.stack.engine.name == "kinematic"
    assert stored.jittered == 4


@pytest.mark.long
@pytest.mark.usefixtures("in_process")
def test_list_show_and_replay_know_both_stacks(campaign, found, call):
    directory, *_ = campaign
    rows = json.loads(call("list", directory, "--failed", "--format", "json").stdout)
    fates = {row["id"]: row["other"] for row in rows}
    assert fates.pop(found.id) == "passes"
    assert set(fates.values()) == {"fails"}
    shown = call("show", directory, found.id).stdout
    assert "the other stack passes" in shown
    assert (
        "of the perturbed runs this stack fails 3 of 3 (too few runs for a 95% interval)" in shown
    )
    assert "perturbed runs confirm it" in shown
    here, there = (
        json.loads(call("replay", directory, found.id, *more, "--format", "json").stdout)
        for more in ((), ("--against",))
    )
    assert (here["identical"], here["failed"]) == (1, [True])
    assert (there["identical"], there["failed"]) == (1, [False])
    assert there["trace_digest"] == found.other.trace_digest != here["trace_digest"]
    passing = next(row["id"] for row in json.loads(call("list", directory, "--format", "json")
                   .stdout) if not row["failed"])  # fmt: skip
    refused = call("replay", directory, passing, "--against")
    assert refused.exit_code == 2
    assert "the other stack was not run" in refused.stderr


@pytest.mark.long
@pytest.mark.usefixtures("in_process")
def test_the_smallest_world_still_tells_the_stacks_apart(campaign, found, call, tmp_path):
    directory = shutil.copytree(campaign[0], tmp_path / "c")
    result = call("minimize", directory, found.id, "--max-runs", 40, "--workers", 1,
                  "--format", "json")  # fmt: skip
    assert result.exit_code == 0, result.stderr
    data = json.loads(result.stdout)
    assert data["one_minimal"]
    assert data["runs"] <= 40
    assert data["other"]["fate"] == "passes"
    assert data["jittered"]["failed"] == data["jittered"]["runs"] == 3
    folder = directory / "trials" / found.id
    smallest = mf.read_world(folder / "world.min.json")
    assert len(smallest.robots) == 1
    for name, fails in (("stack.yaml", True), ("stack.other.yaml", False)):
        outcome = mf.run(smallest, folder / name, specs=["all_tasks_done"])
        assert any(verdict.violated for verdict in outcome.verdicts) == fails

    assert call("report", directory, "--markdown", directory / "r.md").exit_code == 0
    page = (directory / "report.html").read_text()
    assert page.count('<div class="side">') == 4  # the failure and its smallest world
    assert page.count('aria-label="Replay of trial') == 4
    assert "1 world on which only this stack fails" in page
    assert "defects: no_plan_when_infeasible against none" in page
    assert f"replay {directory} {found.id} --against" in page
    assert "<summary>The other stack</summary>" in page
    assert "Against the other stack: the other stack passes" in (directory / "r.md").read_text()


@pytest.mark.long
@pytest.mark.usefixtures("in_process")
def test_a_smallest_world_may_not_cost_more_runs_than_allowed(campaign, found, tmp_path):
    directory = shutil.copytree(campaign[0], tmp_path / "c")
    small = mf.minimize(directory, found.id, 5, workers=1)
    assert small.runs <= 5
    assert not small.one_minimal
    assert small.other.passes


def test_a_stack_is_not_compared_with_itself(call, tmp_path):
    (tmp_path / "small.scenic").write_text(PROGRAM)
    result = call("campaign", tmp_path / "small.scenic", "-o", tmp_path / "c", "--against",
                  "default", "--set", "engine=kinematic")  # fmt: skip
    assert result.exit_code == 2
    assert "--against names the stack under test itself" in result.stderr
    assert not (tmp_path / "c").exists()


def test_engine_and_people_are_those_of_the_stack_under_test(tmp_path):
    (tmp_path / "other.yaml").write_text("engine: bullet\nallocator: nearest\n")
    tested = mf.load_stack(None, ["engine=kinematic", "human_model.room=0.3"])
    other = load_other_stack(tmp_path / "other.yaml", tested)
    assert other.engine == tested.engine
    assert other.human_model == tested.human_model
    assert other.allocator.name == "nearest"


@pytest.mark.slow
def test_a_search_for_a_probability_compares_no_stacks(call, tmp_path):
    (tmp_path / "small.scenic").write_text(PROGRAM)
    result = call("campaign", tmp_path / "small.scenic", "-o", tmp_path / "c", *BROKEN,
                  "--against", "default", "--sampler", "splitting", "--mode", "exact")  # fmt: skip
    assert result.exit_code == 2
    assert "splitting estimates the probability of any failure" in result.stderr


def test_the_other_stack_belongs_to_a_campaign(call, tmp_path):
    result = call("campaign", "--resume", tmp_path, "--against", "default")
    assert result.exit_code == 2
    assert "--against cannot be changed by --resume" in result.stderr
