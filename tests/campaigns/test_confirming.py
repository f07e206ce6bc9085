"""Failures on other engines: what is run, what is stored, what is told."""

import dataclasses
import json

import pytest
from click.testing import CliRunner

from mrta_falsify.cli import main
from mrta_falsify.commands.campaign import campaign
from mrta_falsify.commands.stored_trials import list_trials, open_campaign
from mrta_falsify.core import codec
from mrta_falsify.core.errors import InputError
from mrta_falsify.core.record import EngineRun, TrialRecord
from mrta_falsify.core.run_result import Vote
from tests.quick_program import PROGRAM


def call(*words):
    return CliRunner().invoke(main, [str(word) for word in words])


def run_on(engine: str, failed: bool, copies: tuple[int, int]) -> EngineRun:
    return EngineRun(engine=engine, failed=failed, vote=Vote(runs=copies[1], failed=copies[0]))


@pytest.mark.parametrize(
    ("failed", "copies", "fails"),
    [(True, (2, 4), True), (True, (1, 3), False), (False, (3, 4), True), (False, (0, 4), False)],
)
def test_a_world_fails_on_an_engine_where_most_of_its_runs_do(failed, copies, fails):
    assert run_on("mujoco", failed, copies).total.robust is fails


@pytest.mark.long
def test_a_record_says_where_a_failure_fails_and_where_not(records):
    record = dataclasses.replace(
        records[0],
        engines={
            "mujoco": run_on("mujoco", True, (3, 3)),
            "kinematic": run_on("kinematic", False, (1, 4)),
        },
    )
    assert record.confirmation == "fails on mujoco 4 of 4; not on kinematic 1 of 5"
    assert codec.decode(TrialRecord, codec.encode(record)).engines == record.engines
    assert "engines" not in codec.encode(dataclasses.replace(record, engines={}))


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    """A campaign in which some trials miss a deadline on the kinematic engine."""
    folder = tmp_path_factory.mktemp("confirming") / "small"
    program = folder.parent / "small.scenic"
    program.write_text(PROGRAM)
    campaign(
        program,
        folder,
        budget=4,
        seed=4,
        sampler="random",
        executor="serial",
        specs=["deadlines"],
        settings=["engine=kinematic"],
        confirm=("kinematic", "mujoco"),
    )
    return folder


@pytest.fixture(scope="module")
def records(small):
    return open_campaign(small).records


@pytest.mark.long
def test_failures_are_run_on_the_engines_asked_for_and_no_other_trial_is(records):
    failed = [record for record in records if record.is_primary]
    assert failed
    for record in records:
        engines = list(record.engines)
        assert engines == (["mujoco"] if record.is_primary else [])  # not where it was found
    run = failed[0].engines["mujoco"]
    assert 1 < run.total.runs <= 5
    assert run.failed == bool(run.violated)
    assert run.trace_digest not in ("", failed[0].trace_digest)


@pytest.mark.long
def test_list_show_and_report_tell_on_which_engines_a_failure_fails(small, records, monkeypatch):
    monkeypatch.setenv("COLUMNS", "200")
    monkeypatch.setenv("NO_COLOR", "1")
    failed = next(record for record in records if record.is_primary)
    rows = {row.id: row for row in list_trials(small)}
    assert rows[failed.id].other_engines == failed.confirmation
    assert "other engines" in call("list", small).output
    assert failed.confirmation in call("show", small, failed.id).output
    stored = json.loads(call("show", small, failed.id, "--format", "json").output)
    assert stored["confirmed"][0]["engine"] == "mujoco"
    assert call("report", small).exit_code == 0
    page = (small / "report.html").read_text()
    assert f"other engines: {failed.confirmation}" in page
    assert "fail on mujoco, too" in page


def test_an_engine_that_is_not_known_is_refused_before_a_trial_runs(tmp_path):
    with pytest.raises(InputError, match="did you mean 'mujoco'"):
        campaign("bed_in_the_doorway", tmp_path / "new", budget=1, confirm=["mujco"])
    assert not (tmp_path / "new").exists()
