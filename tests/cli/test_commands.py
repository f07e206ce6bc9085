from __future__ import annotations

import csv
import json
import re
import subprocess
import sys

import pytest
import yaml

from mrta_falsify.commands import run as running
from mrta_falsify.commands.worlds import find_world
from mrta_falsify.core import registry
from mrta_falsify.core.defects import defect, defect_names
from mrta_falsify.core.interruption import Interrupted
from mrta_falsify.core.trace import read_trace
from mrta_falsify.core.world import read_world
from mrta_falsify.specs.library import default_specifications

QUICK = ("--set", "engine=kinematic")


def masked(text: str) -> str:
    """``text`` without what changes from run to run: seconds, factors, digests."""
    text = re.sub(r"\b[0-9a-f]{16}\b", "<digest>", text)
    text = re.sub(r"in \d+\.\d s \(\d+\.\dx real time\)", "in <wall>", text)
    return re.sub(r"\d+\.\d+( s simulated)", r"<time>\1", text)


def test_version_is_one_line(cli):
    result = cli("--version")
    assert result.exit_code == 0
    assert re.fullmatch(r"mrta-falsify \d+\.\d+\.\d+\n", result.stdout)


def test_help_lists_every_command_with_what_it_does(cli):
    result = cli("--help")
    assert result.exit_code == 0
    listing = result.stdout.partition("Commands:")[2]
    commands = re.findall(r"^  ([a-z-]+) +(\S.*)$", listing, re.MULTILINE)
    assert [name for name, _ in commands] == [
        "allocate", "bench", "campaign", "certify", "check", "ci", "compare", "completion",
        "corpus", "demo", "doctor", "explain", "export", "import", "init", "issue", "list",
        "minimize", "plugins",
        "replay", "report",
        "run", "sample", "show", "stack-test", "travel-times",
    ]  # fmt: skip


def test_plugins_as_json_has_a_key_per_extension_point_and_the_defects(cli):
    result = cli("plugins", "--format", "json")
    data = json.loads(result.stdout)
    assert set(data) == {*registry.EXTENSION_POINTS, "defects"}
    assert data["defects"] == list(defect_names())
    assert "bullet" in data["engine"]


def test_plugins_as_text_explains_each_defect(cli):
    result = cli("plugins")
    for name in defect_names():
        planted = defect(name)
        assert f"{name} {planted.layer}: {planted.what}" in " ".join(result.stdout.split())


def test_run_prints_one_json_object_with_what_the_contract_names(cli, ward_file):
    result = cli("run", str(ward_file), *QUICK, "--format", "json", "--seed", "1")
    assert result.exit_code in (0, 1), result.stderr
    data = json.loads(result.stdout)
    assert {
        "world_digest", "trace_digest", "sim_time_s", "wall_s", "real_time_factor", "tasks",
        "robots_finished", "contacts", "verdicts", "ended",
    } <= set(data)  # fmt: skip
    assert set(data["tasks"]) == {"total", "completed", "late"}
    assert {"robot_robot", "robot_human", "robot_static"} <= set(data["contacts"])
    for verdict in data["verdicts"]:
        assert set(verdict) == {
            "spec", "robustness", "violated", "violated_at_s", "who", "outcome", "not_judged",
            "evidence",
        }  # fmt: skip
        assert verdict["outcome"] == ("violated" if verdict["violated"] else "holds")
    violated = any(verdict["violated"] for verdict in data["verdicts"])
    assert result.exit_code == int(violated)


@pytest.mark.slow
def test_stdout_of_a_real_process_holds_the_json_object_and_nothing_else(ward_file):
    done = subprocess.run(
        [sys.executable, "-m", "mrta_falsify.cli", "run", str(ward_file), "--format", "json"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode in (0, 1), done.stderr
    assert done.stdout.count("\n") == 1
    assert json.loads(done.stdout)["tasks"]["total"] == 2


def test_run_writes_its_files_and_they_reproduce_it(cli, ward_file, tmp_path):
    first = cli("run", str(ward_file), *QUICK, "--seed", "2", "-o", "out", "--format", "json")
    assert first.exit_code in (0, 1), first.stderr
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert names == {
        "world.json", "stack.yaml", "trace.zip", "verdicts.json", "picture.png", "report.html",
    }  # fmt: skip
    data = json.loads(first.stdout)
    assert read_world(tmp_path / "out" / "world.json").digest() == data["world_digest"]
    assert read_trace(tmp_path / "out" / "trace.zip").digest == data["trace_digest"]
    verdicts = json.loads((tmp_path / "out" / "verdicts.json").read_text())
    assert [v["spec"] for v in verdicts] == [v["spec"] for v in data["verdicts"]]
    assert yaml.safe_load((tmp_path / "out" / "stack.yaml").read_text())["engine"] == {
        "name": "kinematic",
        "options": {},
    }
    again = cli(
        "run", "out/world.json", "--stack", "out/stack.yaml", "--format", "json"
    )  # fmt: skip
    assert json.loads(again.stdout)["trace_digest"] == data["trace_digest"]


def test_run_as_text_shows_tasks_contacts_and_every_verdict(cli, ward_file):
    result = cli("run", str(ward_file), *QUICK)
    lines = masked(result.stdout).splitlines()
    assert re.fullmatch(r"tasks      \d of 2 done, \d late or missing", lines[0])
    assert re.fullmatch(r"robots     \d of 2 finished their work", lines[1])
    assert re.fullmatch(r"time       <time> s simulated in <wall>, ended: [a-z-]+", lines[3])
    assert lines[4] == "digests    world <digest>  trace <digest>"
    assert lines[6].split() == ["specification", "verdict", "robustness", "at", "who"]
    assert len(lines) == 7 + len(default_specifications())


def test_run_says_what_was_not_judged_and_why(cli, ward_file):
    hidden = ("--set", "withheld=[deliveries]")
    data = json.loads(cli("run", str(ward_file), *QUICK, *hidden, "--format", "json").stdout)
    outcomes = {verdict["spec"]: verdict["outcome"] for verdict in data["verdicts"]}
    assert outcomes["all_tasks_done"] == outcomes["deadlines"] == "not_judged"
    assert outcomes["no_robot_robot_contact"] == "holds"
    assert data["tasks"]["told"] is False
    text = cli("run", str(ward_file), *QUICK, *hidden)
    assert "what became of them the stack does not tell" in text.stdout
    assert re.search(r"deadlines +not judged +the stack does not tell", text.stdout)


def test_a_run_of_which_nothing_can_be_judged_is_no_success(cli, ward_file):
    result = cli(
        "run", str(ward_file), *QUICK, "--set", "withheld=[deliveries]", "--spec", "deadlines"
    )
    assert result.exit_code == 2
    assert "none of the specifications can be judged; deadlines: the stack" in result.stderr


def test_different_seeds_give_different_traces(cli, ward_file):
    digests = set()
    for seed in ("0", "1"):
        result = cli("run", str(ward_file), *QUICK, "--seed", seed, "--format", "json")
        digests.add(json.loads(result.stdout)["trace_digest"])
    assert len(digests) == 2


def test_run_judges_only_the_specifications_asked_for(cli, ward_file):
    result = cli(
        "run", str(ward_file), *QUICK, "--spec", "all_tasks_done", "--spec", "no_deadlock",
        "--format", "json",
    )  # fmt: skip
    data = json.loads(result.stdout)
    assert [verdict["spec"] for verdict in data["verdicts"]] == ["all_tasks_done", "no_deadlock"]


def test_tasks_robots_and_people_come_from_mrta_sims_files(cli, ward_file, tmp_path):
    (tmp_path / "tasks.json").write_text(
        json.dumps(
            {
                "tasks_stream": [{"arrival": 0, "tasks": [{"start": 1, "end": 0, "deadline": 99}]}],
                "agents": [1],
            }
        )
    )
    (tmp_path / "humans.yaml").write_text("actor1: [[0.8, 0.8]]\nactor2: [[0.8, 1.6]]\n")
    world = find_world(
        str(ward_file), tasks=tmp_path / "tasks.json", humans=tmp_path / "humans.yaml"
    )
    assert [(task.start, task.end) for task in world.tasks] == [(1, 0)]
    assert len(world.robots) == 1
    assert [human.name for human in world.humans] == ["actor1", "actor2"]


def test_an_interrupted_run_exits_with_130(cli, ward_file, monkeypatch):
    def interrupt(*args, **kwargs):
        raise KeyboardInterrupt

    monkeypatch.setattr(running, "run", interrupt)
    result = cli("run", str(ward_file), *QUICK)
    assert result.exit_code == 130
    assert result.stderr.strip() == "interrupted"


def test_an_interrupted_command_says_what_is_kept_and_what_is_missing(cli, ward_file, monkeypatch):
    def interrupt(*args, **kwargs):
        raise Interrupted(kept="nothing", missing="small_ward has no verdict")

    monkeypatch.setattr(running, "run", interrupt)
    result = cli("run", str(ward_file), *QUICK, "--format", "json")
    assert result.exit_code == 130
    assert result.stderr.strip() == "interrupted: small_ward has no verdict; kept: nothing"
    assert json.loads(result.stdout)["missing"] == "small_ward has no verdict"


def test_a_failure_of_the_toolkit_exits_with_3_and_saves_the_traceback(
    cli, ward_file, monkeypatch, tmp_path
):
    def fail(*args, **kwargs):
        raise ZeroDivisionError("by zero")

    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr("tempfile.tempdir", None)
    monkeypatch.setattr(running, "run", fail)
    result = cli("run", str(ward_file), *QUICK)
    assert result.exit_code == 3
    (line,) = result.stderr.splitlines()
    assert "ZeroDivisionError: by zero" in line
    path = re.search(r"Traceback: (\S+)$", line)[1]
    with open(path) as file:
        assert "ZeroDivisionError: by zero" in file.read()


def test_export_writes_a_nav2_map(cli, ward_file, tmp_path):
    result = cli("export", str(ward_file), "--format", "nav2", "-o", "maps")
    assert result.exit_code == 0, result.stderr
    assert result.stdout.split() == ["maps/map.yaml", "maps/map.pgm"]
    described = yaml.safe_load((tmp_path / "maps" / "map.yaml").read_text())
    assert described["resolution"] == 0.05
    assert (tmp_path / "maps" / "map.pgm").read_bytes().startswith(b"P5")


def test_travel_times_are_measured_both_ways_and_resumed(cli, ward_file, tmp_path):
    args = ("travel-times", str(ward_file), *QUICK, "--iterations", "2", "-o", "times.json")
    assert cli(*args).exit_code == 0
    data = json.loads((tmp_path / "times.json").read_text())
    assert set(data) == {"units", "rooms", "statistic", "travel_time"}
    assert data["units"] == "s"
    assert data["statistic"] == "max"
    times = data["travel_time"]
    assert times[0][0] == times[1][1] == 0.0
    assert times[0][1] > 1.0
    assert times[1][0] > 1.0
    samples = tmp_path / "times.samples.csv"
    lines = samples.read_text().splitlines(keepends=True)
    rows = list(csv.reader(lines[1:]))
    assert [row[:2] for row in rows] == [["0", "1"], ["1", "0"]]
    assert all(len(row) == 4 for row in rows)
    # An interruption in the middle of the last line: measured again, with the same result.
    samples.write_text("".join(lines[:2]) + lines[2][:6])
    assert cli(*args).exit_code == 0
    assert samples.read_text() == "".join(lines)
    other = cli(*args[:2], *QUICK, "--iterations", "3", "-o", "times.json")
    assert other.exit_code == 2
    assert "holds another measurement" in other.stderr


@pytest.mark.long
def test_the_demo_ends_with_the_path_of_its_page(cli, tmp_path):
    result = cli("demo")
    assert result.exit_code == 0, result.stderr
    page = result.stdout.splitlines()[-1]
    assert page == str(tmp_path / "demo-run" / "report.html")
    assert (tmp_path / "demo-run" / "day" / "picture.png").stat().st_size > 50_000
    assert "seed 0" in result.stdout


@pytest.mark.long
def test_doctor_finds_this_machine_in_order(cli):
    result = cli("doctor", "--format", "json")
    data = json.loads(result.stdout)
    assert data["ok"], data
    assert {"python", "default engine", "determinism"} <= {
        check["name"] for check in data["checks"]
    }


@pytest.mark.long
def test_bench_has_the_fields_of_the_contract(cli):
    result = cli("bench", "--robots", "6", "--seconds", "15", "--format", "json")
    assert result.exit_code == 0, result.stderr
    data = json.loads(result.stdout)
    assert set(data["engines"]) == {"kinematic"}
    for fleets in (data["real_time_factor"], *data["engines"].values()):
        assert set(fleets) == {"6"}
        assert set(fleets["6"]) >= {"mean", "min", "busy_min", "calls", "stages_ms"}
        assert 0.0 < fleets["6"]["cpu_factor"]["min"] <= fleets["6"]["cpu_factor"]["mean"]
    assert set(data["cbf_qp_ms"]) == {"1", "2", "3", "6"}
    assert set(data["cbf_qp_ms"]["1"]) == {"p50", "p99"}
    assert set(data["plan_ms"]) == {"cold_p95", "warm_p95"}
    for key in ("costmap_ms", "first_tick_ms", "qp_init_ms"):
        assert data[key] > 0.0
    assert data["engine_real_time_factor"]["6"] > 1.0
    assert data["machine"]["cores"] >= 1


def test_a_command_that_is_gone_says_what_to_do_instead(cli):
    result = cli("serve", "runs/x")
    assert result.exit_code == 2
    assert "report DIR --watch" in result.stderr
