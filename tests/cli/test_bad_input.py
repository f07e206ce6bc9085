"""Bad input ends with exit code 2 and one sentence: file, field, value, what is allowed."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from mrta_falsify.campaigns.rules import RULES
from mrta_falsify.campaigns.settings import CampaignSettings, TrialSettings
from mrta_falsify.campaigns.store import Store
from mrta_falsify.core import parsing
from mrta_falsify.core.arrays import frozen_array
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.testing.records import trial_record

TASKS = {
    "tasks_stream": [{"arrival": 0, "tasks": [{"start": 0, "end": 1, "deadline": 90}]}],
    "agents": [],
}


def assert_refused(result, *parts: str) -> None:
    assert result.exit_code == 2, result.output + result.stderr
    assert result.stdout == ""
    (line,) = result.stderr.splitlines()
    assert line.startswith("error: ")
    assert "Traceback" not in result.stderr
    for part in parts:
        assert part in line


def _set(*path, value):
    def edit(data):
        for key in path[:-1]:
            data = data[key]
        data[path[-1]] = value

    return edit


def _rename(*path, new):
    def edit(data):
        for key in path[:-1]:
            data = data[key]
        data[new] = data.pop(path[-1])

    return edit


@pytest.mark.parametrize(
    ("edit", "parts"),
    [
        (
            _rename("robots", 0, "max_speed", new="max_sped"),
            ["robots[0].max_sped is not a known field", "did you mean 'max_speed'?"],
        ),
        (
            _set("robots", 1, "pose", value=[1.6, 2.1, 0.0]),
            ["robots[1].pose of robot2 is 0.14 m from robots[0]", "at least 0.44 m apart"],
        ),
        (
            _set("robots", 0, "pose", value=[0.05, 4.0, 0.0]),
            ["robots[0].pose of robot1 is (0.05, 4) m", "0.22 m clear of walls[2] (west)"],
        ),
        (
            _set("robots", 0, "pose", value=[6.0, 4.0, 0.0]),
            ["robots[0].pose", "clear of furniture[0] (table)"],
        ),
        (
            _set("robots", 0, "pose", value=[99.0, 4.0, 0.0]),
            ["robots[0].pose", "must lie within bounds, x -0.5 to 12.5 m"],
        ),
        (_set("tasks", 1, "end", value=7), ["tasks[1].end is room 7", "rooms are 0 to 1"]),
        (
            _set("tasks", 1, "deadline", value=3.0),
            ["tasks[1].deadline is 3.0 s", "before its arrival at 5.0 s"],
        ),
        (
            _set("robots", 0, "pose", value=[float("nan"), 1.0, 0.0]),
            ["robots[0].pose is [nan, 1.0, 0.0]", "it must be finite"],
        ),
        (
            _set("robots", 0, "max_speed", value=-1),
            ["robots[0].max_speed is -1.0 m/s", "it must be > 0"],
        ),
        (_set("horizon", value="long"), ["horizon is 'long'", "it must be a number"]),
        (_set("rooms", 0, "point", value=[1.0]), ["rooms[0].point has shape (1,)", "(2,)"]),
    ],
)
def test_a_wrong_world_is_refused(cli, edited, edit, parts):
    path = edited(edit)
    assert_refused(cli("run", str(path)), f"{path}: ", *parts)


@pytest.mark.parametrize(
    ("content", "part"),
    [
        (b'{"name": "hall", "bounds": [0, 0', "is not valid JSON"),
        (b"\x00\xff\xfe", "is not UTF-8 text"),
        (b"{}", "is not a world file (no field `bounds`)"),
        (b"[" * 200_000, "is not valid JSON"),
        (b'{"horizon": ' + b"9" * 6000 + b"}", "a number in it has too many digits"),
    ],
)
def test_a_damaged_world_file_is_refused(cli, tmp_path, content, part):
    path = tmp_path / "world.json"
    path.write_bytes(content)
    assert_refused(cli("run", str(path)), f"{path}: ", part)


def test_a_huge_world_file_is_refused(cli, tmp_path):
    path = tmp_path / "world.json"
    with path.open("wb") as file:
        file.truncate(parsing.MAX_FILE_BYTES + 1)
    assert_refused(cli("run", str(path)), f"{path}: the file has 256 MB; at most 256 MB")


def test_a_world_that_does_not_exist_lists_the_shipped_ones(cli):
    assert_refused(
        cli("run", "aws_hospital_dya"),
        "unknown world 'aws_hospital_dya'; did you mean 'aws_hospital_day'?",
        "Known: aws_hospital_day",
    )
    assert_refused(cli("run", "absent.json"), "absent.json: cannot be read: No such file")
    assert_refused(cli("run", "absent.scenic"), "absent.scenic: cannot be read: no such file")
    assert_refused(cli("run", "."), ".: cannot be read: Is a directory")


@pytest.mark.parametrize(
    ("setting", "parts"),
    [
        ("planer=astar", ["unknown layer 'planer'; did you mean 'planner'?"]),
        ("human_model=social_force", ["unknown human_model 'social_force'. Known: by_sight"]),
        ("planner=astr", ["--set planner=astr: ", "unknown planner 'astr'; did you mean 'astar'?"]),
        ("costmap.resolution=-0.05", ["costmap: resolution is -0.05 m; it must be > 0"]),
        ("costmap.resolutoin=0.1", ["costmap: resolutoin is not a known field", "'resolution'"]),
        ("costmap.resolution=fine", ["costmap: resolution is 'fine'; it must be a number"]),
        ("control_rate=0", ["control_rate is 0 Hz; it must be >= 5"]),
        ("defects=[lazy]", ["unknown defect 'lazy'", "Known: cluster_rows_wrong_robot"]),
        ("planner=no_such_module:Planner", ["cannot be loaded: No module named"]),
        ("planner=os:path", ["'os:path' cannot be used as planner"]),
        ("planner", ["it must read layer=NAME or layer.option=VALUE"]),
    ],
)
def test_a_wrong_setting_is_refused(cli, setting, parts):
    assert_refused(cli("run", "aws_hospital_day", "--set", setting), f"--set {setting}", *parts)


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ("planner: astr\n", ["planner: unknown planner 'astr'"]),
        ("human_model: social_force\n", ["human_model: unknown human_model 'social_force'"]),
        ("plannr: astar\n", ["plannr is not a known field; did you mean 'planner'?"]),
        ("costmap: {resolution: .nan}\n", ["costmap: resolution is nan m; it must be finite"]),
        ("costmap: [1\n", ["is not valid YAML"]),
        ("defects: [nothing]\n", ["unknown defect 'nothing'"]),
        ("- planner\n", ["it must map layers to names"]),
    ],
)
def test_a_wrong_stack_file_is_refused(cli, tmp_path, text, parts):
    path = tmp_path / "stack.yaml"
    path.write_text(text)
    result = cli("run", "aws_hospital_day", "--stack", str(path))
    assert_refused(result, f"{path}: ", *parts)


@pytest.mark.parametrize(
    ("change", "part"),
    [
        ({"end": 6}, "tasks_stream[0].tasks[0].end is room 6; rooms are 0 to 5"),
        ({"start": "ward"}, "tasks_stream[0].tasks[0].start is 'ward'; it must be a whole number"),
        ({"deadlin": 9}, "tasks_stream[0].tasks[0].deadlin is not a known field"),
        ({"deadline": -1}, "tasks_stream[0].tasks[0].deadline is -1.0 s; it must be >= 0"),
    ],
)
def test_a_wrong_task_file_is_refused(cli, tmp_path, change, part):
    data = json.loads(json.dumps(TASKS))
    data["tasks_stream"][0]["tasks"][0].update(change)
    path = tmp_path / "tasks.json"
    path.write_text(json.dumps(data))
    assert_refused(cli("run", "aws_hospital_day", "--tasks", str(path)), f"{path}: {part}")


def test_two_agents_in_one_room_are_refused(cli, tmp_path):
    path = tmp_path / "tasks.json"
    path.write_text(json.dumps({**TASKS, "agents": [0, 0]}))
    result = cli("run", "aws_hospital_day", "--tasks", str(path))
    assert_refused(result, f"{path}: robots[1].pose of robot2 is 0.00 m from robots[0]")


def test_a_robot_file_that_puts_a_robot_into_a_wall_is_refused(cli, tmp_path):
    path = tmp_path / "robots.yaml"
    path.write_text("agents: {robot1: {start: [6.5, 0.0]}}")
    result = cli("run", "aws_hospital_day", "--robots", str(path))
    assert_refused(result, f"{path}: robots[0].pose of robot1 is (6.5, 0) m", "clear of walls[")


@pytest.mark.parametrize(
    ("args", "part"),
    [
        (["run"], "Missing argument 'WORLD'"),
        (["run", "aws_hospital_day", "--sed", "3"], "No such option"),
        (["run", "aws_hospital_day", "--seed", "-1"], "-1 is not allowed; it must be at least 0"),
        (
            ["run", "aws_hospital_day", "--seed", "x"],
            "'x' is not a whole number; it must be at least 0",
        ),
        (["run", "aws_hospital_day", "--format", "xml"], "'xml' is not one of 'text', 'json'"),
        (["run", "aws_hospital_day", "--gif"], "--gif and --mp4 need -o DIR"),
        (["rnu"], "unknown command 'rnu'; did you mean 'run'?"),
        (["bench", "--robots", "2,x"], "--robots is '2,x'; it must be numbers from 1 to 1000"),
        (["export", "aws_hospital_day", "--format", "nav3", "-o", "m"], "'nav3' is not"),
        (["travel-times", "aws_hospital_day", "-o", "t.txt"], "must end in .csv or .json"),
        (["bench", "--seconds", "nan"], "nan is not a finite number"),
        (["campaign"], "give a SCENARIO with -o DIR, or --resume DIR"),
        (["campaign", "hot_room"], "-o DIR is missing"),
        (
            ["campaign", "hot_room", "-o", "c", "--budget", "0"],
            "0 is not allowed; it must be at least 1",
        ),
        (["campaign", "hot_room", "-o", "c", "--time-limit", "inf"], "inf is not a finite number"),
        (["campaign", "--resume", "c", "-o", "d"], "--resume DIR takes neither"),
        (["campaign", "--resume", "c", "--seed", "1"], "--seed cannot be changed by --resume"),
        (["compare", "hot_room", "-o", "c", "--samplers", "auto,auto"], "may be named once"),
        (["replay", "c", "0", "--verify", "0"], "0 is not allowed; it must be from 1 to 1000"),
        (["minimize", "c"], "Missing argument 'ID'"),
        (["check"], "give a SCENARIO or several, or --all"),
    ],
)
def test_wrong_usage_is_refused_in_one_line_that_names_the_help(cli, args, part):
    assert_refused(cli(*args), part, "--help)")


def test_an_unknown_specification_is_refused_before_anything_runs(cli):
    result = cli("run", "aws_hospital_day", "--spec", "no_deadlok")
    assert_refused(result, "unknown specification 'no_deadlok'; did you mean 'no_deadlock'?")


def test_a_formula_that_cannot_be_read_is_refused(cli):
    result = cli("run", "aws_hospital_day", "--spec", "stl:always(")
    assert_refused(result, "stl formula 'always('", "column 8")


def test_an_output_directory_that_is_a_file_is_refused(cli, tmp_path):
    (tmp_path / "out").write_text("")
    result = cli("run", "aws_hospital_day", "-o", "out")
    assert_refused(result, "out: cannot be used as a directory")


# --- campaigns ---------------------------------------------------------------------------------


@pytest.fixture
def campaign(tmp_path: Path) -> Path:
    """A campaign with a trial that passed and one that failed, whose files were not kept."""
    directory = tmp_path / "campaign"
    late = Verdict(
        spec="deadlines", robustness=-3.0, violated=True, violated_at=90.0, who=("task1",)
    )
    with Store.create(
        directory, CampaignSettings(trials=TrialSettings(scenario="bookshelf"), rules=RULES)
    ) as store:
        for number, verdicts in enumerate(((), (late,))):
            store.add(
                trial_record(
                    number,
                    frozen_array(np.zeros(0)),
                    verdicts=verdicts,
                    signature="deadlines" if verdicts else "",
                    trace_file=f"trials/{number:04d}/trace.zip" if verdicts else "",
                )
            )
    return directory


READERS = (
    ["list"],
    ["show", "1"],
    ["replay", "1"],
    ["explain", "1"],
    ["minimize", "1"],
    ["corpus"],
    ["report"],
    ["export", "1", "--format", "sdf", "-o", "world.sdf"],
)


def _with(directory: Path | str, command: list[str]) -> list[str]:
    return [command[0], str(directory), *command[1:]]


@pytest.mark.parametrize("command", READERS, ids=lambda command: command[0])
def test_a_directory_that_is_no_campaign_is_refused(cli, tmp_path, command):
    (tmp_path / "file").write_text("")
    for name in ("absent", "file", "."):
        result = cli(*_with(name, command))
        assert_refused(result, f"{name}: is not a campaign directory (it has no campaign.json)")


@pytest.mark.parametrize("command", READERS, ids=lambda command: command[0])
def test_a_damaged_record_is_refused_and_nothing_is_changed(cli, campaign, command):
    log = campaign / "records.jsonl"
    log.write_text(log.read_text().replace('"robustness":-3.0', '"robustness":3.0'))
    before = log.read_bytes()
    assert_refused(cli(*_with(campaign, command)), f"{log}:2: this record is damaged")
    assert_refused(cli("campaign", "--resume", str(campaign)), f"{log}:2: this record is damaged")
    assert log.read_bytes() == before


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ('{"version": 9}', "has format version 9; this reads 1"),
        ("{", "is not valid JSON"),
        ("[]", "has format version None"),
    ],
)
def test_settings_of_a_campaign_that_cannot_be_read_are_refused(cli, campaign, text, part):
    (campaign / "campaign.json").write_text(text)
    assert_refused(cli("list", str(campaign)), f"{campaign / 'campaign.json'}: {part}")
    assert_refused(cli("campaign", "--resume", str(campaign)), part)


@pytest.mark.parametrize("name", ["2", "first", "1e0", "", "9" * 5000])
@pytest.mark.parametrize("command", ["show", "replay", "explain", "minimize"])
def test_a_trial_that_does_not_exist_is_refused(cli, campaign, command, name):
    assert_refused(cli(command, str(campaign), name), "has no trial", "trials 0000 to 0001")


@pytest.mark.parametrize("command", ["explain", "minimize"])
def test_a_trial_that_passed_cannot_be_explained_or_minimised(cli, campaign, command):
    assert_refused(cli(command, str(campaign), "0"), "trial 0000 violates nothing")


def test_a_campaign_in_use_cannot_be_resumed(cli, campaign):
    with Store.resume(campaign):
        result = cli("campaign", "--resume", str(campaign))
    assert_refused(result, f"{campaign}: is in use by process ")


def test_the_report_of_a_failure_without_files_says_so(cli, campaign):
    result = cli("report", str(campaign))
    assert result.exit_code == 0, result.stderr
    text = (campaign / "report.html").read_text()
    assert "1 of 2 trials violate" in text or "1 of 2 trials violates" in text
    assert "Trial 0001 is not shown in full" in text


@pytest.mark.parametrize("option", ["-o", "--junit", "--markdown"])
def test_a_report_that_cannot_be_written_is_refused(cli, campaign, tmp_path, option):
    (tmp_path / "taken").mkdir()
    result = cli("report", str(campaign), option, "taken")
    assert result.exit_code == 2
    assert result.stderr == "error: taken: cannot be written: Is a directory; name another place\n"


def test_a_comparison_is_not_written_into_a_file(cli, tmp_path):
    (tmp_path / "file").write_text("")
    result = cli("compare", "hot_room", "-o", "file")
    assert_refused(result, "file: cannot be used as a directory")


@pytest.mark.parametrize("command", ["check", "sample", "campaign", "compare"])
def test_a_scenario_that_does_not_exist_is_refused(cli, command):
    for name, part in (
        ("hot_rom", "unknown scenario 'hot_rom'; did you mean 'hot_room'?"),
        ("absent.scenic", "absent.scenic: cannot be read: no such file"),
    ):
        output = ["-o", "out"] if command != "check" else []
        result = cli(command, name, *output)
        assert result.exit_code == 2
        assert result.stderr.splitlines()[-1].startswith(f"error: {part}")
