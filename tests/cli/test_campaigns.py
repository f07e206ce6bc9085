"""The road of a user through a campaign, on a small scenario and the kinematic engine."""

from __future__ import annotations

import dataclasses
import json
from xml.etree import ElementTree

import pytest

from mrta_falsify.lab import running
from mrta_falsify.trial import judge
from tests.quick_program import PROGRAM

#: deadlines too tight to keep are sampled now and then, so that there is something to find
QUICK = ("--set", "engine=kinematic", "--spec", "deadlines", "--sampler", "random")


@pytest.fixture(scope="module")
def campaign(tmp_path_factory):
    from click.testing import CliRunner

    from mrta_falsify.cli import main

    folder = tmp_path_factory.mktemp("campaign")
    (folder / "small.scenic").write_text(PROGRAM)

    def call(*args):
        return CliRunner().invoke(main, [str(arg) for arg in args])

    begun = call(
        "campaign", folder / "small.scenic", "-o", folder / "c", "--budget", 3, "--seed", 4,
        "--perturbed", 0, "--executor", "serial", *QUICK, "--format", "json",
    )  # fmt: skip
    resumed = call(
        "campaign", "--resume", folder / "c", "--budget", 6, "--executor", "serial",
        "--format", "json",
    )  # fmt: skip
    return folder / "c", call, begun, resumed


def _first_failure(call, directory):
    rows = json.loads(call("list", directory, "--format", "json", "--failed").stdout)
    if not rows:
        pytest.fail("the small campaign found no missed deadline; choose another seed")
    return rows[0]["id"]


@pytest.mark.slow
def test_a_campaign_finds_counts_and_goes_on(campaign):
    _, _, begun, resumed = campaign
    assert begun.exit_code in (0, 1), begun.stderr
    assert resumed.exit_code == 1, resumed.stderr
    one, whole = json.loads(begun.stdout), json.loads(resumed.stdout)
    assert (one["ran"], whole["ran"]) == (3, 6)
    assert whole["failed"] == sum(mode["count"] for mode in whole["modes"])
    assert "why_not" in whole["probability"]  # repaired scenes
    assert whole["errors"] == 0


@pytest.mark.slow
def test_list_show_and_replay_agree(campaign):
    directory, call, *_ = campaign
    rows = json.loads(call("list", directory, "--format", "json").stdout)
    assert [row["id"] for row in rows] == [f"{i:04d}" for i in range(6)]
    name = _first_failure(call, directory)
    shown = json.loads(call("show", directory, name, "--format", "json").stdout)
    assert shown["failed"]
    replayed = call("replay", directory, name, "--verify", "2", "--format", "json")
    assert replayed.exit_code == 0, replayed.stderr
    assert json.loads(replayed.stdout)["identical"] == 2
    csv = call("list", directory, "--format", "csv").stdout.splitlines()
    assert len(csv) == 7


@pytest.mark.slow
def test_a_replay_that_differs_names_the_first_tick(campaign, monkeypatch):
    directory, call, *_ = campaign
    name = _first_failure(call, directory)

    def judge_elsewhere(*args, **options):  # as on a machine with another floating point
        judged = judge(*args, **options)
        pose = judged.outcome.trace.columns["pose"].copy()
        pose[30:, 1, 0] += 1e-9
        columns = {**judged.outcome.trace.columns, "pose": pose}
        trace = dataclasses.replace(judged.outcome.trace, columns=columns, digest="0" * 64)
        return dataclasses.replace(judged, outcome=dataclasses.replace(judged.outcome, trace=trace))

    monkeypatch.setattr(running, "judge", judge_elsewhere)
    result = call("replay", directory, name)
    page = call("report", directory)
    (directory / "trials" / name / "verify.json").unlink()
    assert result.exit_code == 1, result.stderr
    assert "0 of 1 identical" in result.stdout
    assert "1 of 1 have the same violations at the same times" in result.stdout
    assert "first differs at tick 30 (1.50 s): pose of robot2 by 1e-09" in result.stdout
    assert page.exit_code == 0
    assert "first differs at tick 30" in (directory / "report.html").read_text()


@pytest.mark.slow
def test_report_in_all_formats(campaign):
    directory, call, *_ = campaign
    name = _first_failure(call, directory)
    result = call(
        "report", directory, "--junit", directory / "out/j.xml", "--markdown", directory / "r.md"
    )
    assert result.exit_code == 0, result.stderr
    page = (directory / "report.html").read_text()
    assert f"Trial {name}" in page
    assert "A deadline was missed" in page
    suite = ElementTree.parse(directory / "out/j.xml").getroot()
    assert suite.get("tests") == "6"
    assert int(suite.get("failures")) == len(suite.findall("testcase/failure"))
    assert "mrta-falsify replay" in (directory / "r.md").read_text()


@pytest.mark.slow
def test_a_scenario_that_was_edited_is_not_gone_on_with(campaign):
    directory, call, *_ = campaign
    program = directory.parent / "small.scenic"
    text = program.read_text()
    program.write_text(text.replace("horizon = 35", "horizon = 36"))
    try:
        result = call("campaign", "--resume", directory, "--budget", 7)
    finally:
        program.write_text(text)
    assert result.exit_code == 2
    assert "has changed since the campaign began" in " ".join(result.stderr.split())


@pytest.mark.slow
def test_a_dry_run_stores_nothing_and_says_what_it_costs(campaign):
    directory, call, *_ = campaign
    before = sorted(directory.parent.rglob("*"))
    result = call(
        "campaign", directory.parent / "small.scenic", "--budget", 50, "--dry-run", *QUICK,
        "--format", "json",
    )  # fmt: skip
    assert result.exit_code == 0, result.stderr
    data = json.loads(result.stdout)
    assert data["budget"] == 50
    assert data["trial_s"] > 0
    assert sorted(directory.parent.rglob("*")) == before


@pytest.mark.long
def test_workers_that_would_be_idle_are_told_of(campaign):
    directory, call, *_ = campaign
    folder = directory.parent
    common = ("campaign", folder / "small.scenic", "--workers", 64, "--budget", 64, *QUICK)
    few, many = (
        json.loads(call(*common, "--window", n, "--dry-run", "--format", "json").stdout)
        for n in (2, 64)
    )
    seconds = [3600.0 * told["hours"] / (64 * told["trial_s"]) for told in (few, many)]
    assert seconds == [pytest.approx(1 / 2), pytest.approx(1 / 64)]
    result = call(
        "campaign", folder / "small.scenic", "-o", folder / "w", "--workers", 2, "--window", 1,
        "--budget", 1, *QUICK,
    )  # fmt: skip
    assert result.exit_code in (0, 1), result.stderr
    assert "2 workers, but no more trials than --window (1) run at a time" in " ".join(
        result.stderr.split()
    )


@pytest.mark.slow
@pytest.mark.usefixtures("in_process")
def test_copies_say_which_failures_are_robust(campaign):
    directory, call, *_ = campaign
    folder = directory.parent
    result = call(
        "campaign", folder / "small.scenic", "-o", folder / "j", "--budget", 4,
        "--executor", "serial", "--seed", 4, "--perturbed", 3, *QUICK, "--format", "json",
    )  # fmt: skip
    assert result.exit_code == 1, result.stderr
    data = json.loads(result.stdout)
    rows = json.loads(call("list", folder / "j", "--format", "json").stdout)
    assert not any(row["jittered"] for row in rows if not row["failed"])
    failures = [row for row in rows if row["failed"]]
    # Copies end once no further one can change whether most of them fail.
    assert {row["jittered"] for row in failures} <= {2, 3}
    robust = {row["id"]: 2 * row["jittered_failures"] > row["jittered"] for row in failures}
    assert data["robust"] == sum(robust.values())
    for row in failures:
        # The mean of the chance of failure, Beta(1 + f, 1 + n - f).
        chance = (row["jittered_failures"] + 1) / (row["jittered"] + 2)
        assert row["score"] == pytest.approx(-chance)
    # The same copies, run by another command, which runs all of them.
    again = json.loads(call("corpus", folder / "j", "--perturbed", 3, "--format", "json").stdout)
    assert {row["id"]: row["jittered_failures"] > 1 for row in again["failures"]} == robust


def test_init_writes_a_start_and_never_overwrites(cli, tmp_path):
    assert cli("init", "start").exit_code == 0
    assert (tmp_path / "start" / "my_scenario.scenic").is_file()
    again = cli("init", "start")
    assert again.exit_code == 2
    assert "nothing was written" in again.stderr


@pytest.mark.parametrize(
    ("args", "expected"),
    [
        (("campaign",), "give a SCENARIO"),
        (("campaign", "hospital_day"), "-o DIR is missing"),
        (
            ("campaign", "hospital_day", "-o", "x", "--budget", "0"),
            "0 is not allowed; it must be at least 1",
        ),
        (("campaign", "--resume", "nowhere"), "is not a campaign directory"),
        (("campaign", "--resume", "x", "--seed", "3"), "--seed cannot be changed by --resume"),
        (
            ("campaign", "hospital_day", "-o", "x", "--sampler", "splitting", "--perturbed", "2"),
            "a probability counts every failure",
        ),
        (("campaign", "--resume", "x", "--perturbed", "3"), "--perturbed cannot be changed"),
        (("campaign", "--resume", "x", "--dry-run"), "--dry-run is about a new campaign"),
        (("campaign", "hospital_dey", "-o", "x"), "did you mean 'hospital_day'"),
        (("list", "nowhere"), "is not a campaign directory"),
        (("compare", "hospital_day", "--resume", "-o", "."), "is not a comparison"),
        (("compare", "hospital_day", "--samplers", "randm", "-o", "x"), "did you mean 'random'"),
    ],
)
def test_wrong_usage_is_one_sentence_and_exit_code_2(cli, args, expected):
    result = cli(*args)
    assert result.exit_code == 2
    assert expected in " ".join(result.stderr.split())
    assert "Traceback" not in result.stderr


@pytest.mark.slow
def test_a_campaign_of_which_nothing_can_be_judged_is_refused_before_a_trial(campaign):
    directory, call, *_ = campaign
    folder = directory.parent
    hidden = ("--set", "withheld=[deliveries]")
    refused = call(
        "campaign", folder / "small.scenic", "-o", folder / "h", "--budget", 3, *QUICK, *hidden
    )
    assert refused.exit_code == 2
    assert "none of the specifications can be judged; deadlines: the stack" in refused.stderr
    assert not (folder / "h").exists()


@pytest.mark.slow
def test_a_campaign_says_what_it_could_not_judge_and_never_that_it_holds(campaign):
    directory, call, *_ = campaign
    folder = directory.parent
    asked = ("--spec", "no_robot_robot_contact", "--set", "withheld=[deliveries]")
    begun = call(
        "campaign", folder / "small.scenic", "-o", folder / "n", "--budget", 2, "--seed", 4,
        "--executor", "serial", *QUICK, *asked, "--format", "json",
    )  # fmt: skip
    assert begun.exit_code == 0, begun.stderr
    data = json.loads(begun.stdout)
    assert data["not_judged"] == {"deadlines": 2}
    rows = json.loads(call("list", folder / "n", "--format", "json").stdout)
    assert [row["not_judged"] for row in rows] == [["deadlines"], ["deadlines"]]
    shown = call("show", folder / "n", "0000").stdout
    assert "deadlines                not judged: the stack does not tell its deliveries" in shown
    call("report", folder / "n", "--junit", folder / "n.xml", "--markdown", folder / "n.md")
    suite = ElementTree.parse(folder / "n.xml").getroot()
    assert suite.get("skipped") == "2"
    assert "deadlines was not judged in 2 trials" in (folder / "n.md").read_text()
