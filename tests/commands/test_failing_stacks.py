"""A stack that crashes, hangs, hoards memory or answers nonsense violates ``stack_runs``."""

import dataclasses
import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner

from mrta_falsify.cli import main
from mrta_falsify.commands.stored_trials import open_campaign
from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.core.trace import read_trace
from mrta_falsify.core.world import write_world
from mrta_falsify.trial import Job, run_job
from tests import failing_stacks

#: how each layer fails: kind, exception, words of the message
CRASHES = {
    "Raises": ("crash", "KeyError", "left"),
    "Exits": ("crash", "SystemExit", "done with it"),
    "AnswersNan": ("answer", "command", "is not finite"),
    "AnswersForOne": ("answer", "command", "shape (1, 3), not (2, 3)"),
    "AnswersWords": ("answer", "command", "not numbers"),
}
DEATHS = {
    "EndsProcess": ("crash", "exit code 7", "the stack ended its process by exit code 7"),
    "Aborts": ("crash", "SIGABRT", "by SIGABRT"),
    "Segfaults": ("crash", "SIGSEGV", "by SIGSEGV"),
    "IsKilled": ("crash", "SIGKILL", "by SIGKILL"),
    "Loops": ("hang", "", "no answer within 2 s of CPU time"),
    "LoopsCompiled": ("hang", "", "no answer within 2 s of CPU time"),
    "Sleeps": ("hang", "", "no answer within 2 s of CPU time"),
    "HoardsAtOnce": ("memory", "", "more than 0.5 GiB of memory"),
}
CAMPAIGN = """
model scenic_worlds.model
new Robot with name 'robot1', with start_room 0, with max_speed Uniform(0.4, 0.6)
param tasks = [(0, 0, 2, 100)]
param horizon = 8
"""
LIMITS = ("--tick-limit", "2", "--memory-limit", "0.5")


@pytest.fixture(autouse=True)
def _warm(hall):
    """Load compiled functions here, so that copies of this process need not."""
    job = Job(
        world=dataclasses.replace(hall, horizon=1.0),
        config=StackConfig(engine=Choice("kinematic")),
    )
    run_job(job, keep_trace=False)


@pytest.fixture
def place(tmp_path, monkeypatch, hall) -> Path:
    """A directory with a world of 6 s and the failing layers, in which commands run."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("NO_COLOR", "1")
    shutil.copy(failing_stacks.__file__, tmp_path / "users_layers.py")
    write_world(dataclasses.replace(hall, horizon=6.0), tmp_path / "hall.json")
    return tmp_path


def run(*args: str):
    return CliRunner().invoke(main, ["run", "hall.json", "--set", "engine=kinematic", *args])


def judged(folder: Path, name: str = "stack_runs") -> dict:
    verdicts = json.loads((folder / "verdicts.json").read_text())
    (found,) = [verdict for verdict in verdicts if verdict["spec"] == name]
    return found


def fails(layer: str, *more: str, choice: str = "controller"):
    return run("--set", f"{choice}=users_layers:{layer}", *LIMITS, "-o", "out", *more)


def assert_fails_at_its_tick(place, layer, expected):
    """Run a stack that fails; gives the result of the command and the evidence."""
    kind, exception, words = expected
    result = fails(layer)
    assert result.exit_code == 1, result.output
    found = judged(place / "out")
    evidence = found["evidence"]
    assert (evidence["kind"], evidence["exception"]) == (kind, exception)
    assert words in evidence["message"]
    assert (found["violated_at"], evidence["tick"]) == (2.0, 40)
    return result, evidence


@pytest.mark.parametrize("layer", CRASHES)
def test_an_exception_or_nonsense_is_a_verdict_at_its_tick(place, layer):
    result, evidence = assert_fails_at_its_tick(place, layer, CRASHES[layer])
    assert evidence["layer"] == "controller"
    assert "the toolkit itself failed" not in result.output
    assert "The controller " in result.stdout


def test_what_was_seen_until_then_is_kept(place):
    assert fails("Raises").exit_code == 1
    trace = read_trace(place / "out" / "trace.zip")
    assert len(trace) == 40
    assert trace.ended == "stack-crashed"
    frames = judged(place / "out")["evidence"]["frames"]
    assert frames[-1].startswith("users_layers.py:")
    assert frames[-1].endswith(" in fail")
    assert str(place) not in json.dumps(frames)


def test_the_layer_named_is_the_one_whose_code_raised(place):
    assert fails("RaisingAllocator", choice="allocator").exit_code == 1
    found = judged(place / "out")
    assert found["evidence"]["layer"] == "allocator"
    assert found["violated_at"] == 0.0
    assert fails("RaisingPlanner", choice="planner").exit_code == 1
    assert judged(place / "out")["evidence"]["layer"] == "planner"


@pytest.mark.parametrize(
    ("choice", "layer"), [("allocator", "UnbuildableAllocator"), ("controller", "Unbuildable")]
)
def test_a_layer_that_cannot_be_built_fails_at_the_first_tick(place, choice, layer):
    result = fails(layer, choice=choice)
    assert result.exit_code == 1, result.output
    found = judged(place / "out")
    assert (found["violated_at"], found["evidence"]["exception"]) == (0.0, "OSError")
    assert found["evidence"]["layer"] == choice
    assert len(read_trace(place / "out" / "trace.zip")) == 1


def test_a_failing_stack_fails_whatever_is_asked_for(place):
    result = fails("Raises", "--spec", "deadlines")
    assert result.exit_code == 1
    assert judged(place / "out")["violated"]


def test_a_layer_that_refuses_its_options_is_bad_input(place):
    result = fails("Refuses")
    assert result.exit_code == 2
    assert result.stderr.strip() == "error: users_layers: no such model"


@pytest.mark.parametrize(
    "broken",
    [
        ("--set", "engine=users_layers:BrokenEngine"),
        ("--spec", "users_layers:BrokenSpecification"),
    ],
)
def test_what_fails_outside_the_stack_is_no_verdict(place, broken):
    result = run(*broken)
    assert result.exit_code == 3
    assert "the toolkit itself failed: RuntimeError: the " in result.stderr
    assert "has a fault" in result.stderr


@pytest.mark.slow
@pytest.mark.parametrize("layer", DEATHS)
def test_what_only_another_process_can_end_is_a_verdict_as_well(place, layer):
    _, evidence = assert_fails_at_its_tick(place, layer, DEATHS[layer])
    if layer not in ("IsKilled", "EndsProcess"):
        assert evidence["layer"] == "controller"
        assert any("users_layers.py" in frame for frame in evidence["frames"])


@pytest.mark.slow
def test_what_grows_from_tick_to_tick_is_found_as_well(place):
    # In a process of its own: what earlier tests leave in this one and let go of meanwhile counts.
    command = (
        sys.executable, "-c", "from mrta_falsify.cli import main; main()", "run", "hall.json",
        "--set", "engine=kinematic", "--set", "controller=users_layers:Hoards", *LIMITS,
        "-o", "out",
    )  # fmt: skip
    result = subprocess.run(command, check=False, capture_output=True)
    assert result.returncode == 1, result.stderr
    found = judged(place / "out")
    assert found["evidence"]["kind"] == "memory"
    # 64 MiB a tick from tick 40, and what the shipped layers take up beside it.
    assert 46 <= found["evidence"]["tick"] <= 48


@pytest.mark.slow
def test_a_hang_in_one_of_two_runs_is_an_error(place):
    result = fails("LoopsOnce")
    assert result.exit_code == 3, result.output
    assert "in a second run it did not happen again" in result.stderr


# --- in a campaign -------------------------------------------------------------------------


def campaign(place: Path, layer: str):
    (place / "fast.scenic").write_text(CAMPAIGN)
    args = (
        "campaign", "fast.scenic", "-o", "c", "--budget", "3", "--seed", "1", "--workers", "1",
        "--sampler", "random", "--set", "engine=kinematic",
        "--set", f"controller=users_layers:{layer}", "--spec", "stack_runs",
        "--spec", "deadlines", *LIMITS, "--format", "json",
    )  # fmt: skip
    result = CliRunner().invoke(main, list(args))
    assert result.exit_code == 1, result.output
    summary = json.loads(result.stdout)
    assert (summary["errors"], summary["ran"]) == (0, 3)
    records = open_campaign(place / "c").records
    failed = [record for record in records if record.failed]
    assert 0 < len(failed) < 3  # the trials in which the robot is slow are not harmed
    return failed[0]


def call(*args: str):
    return CliRunner().invoke(main, list(args))


@pytest.mark.long
def test_a_hang_in_compiled_code_is_a_trial_s_verdict_and_is_replayed(place):
    record = campaign(place, "LoopsIfFast")
    assert record.signature == "stack_runs/hang/controller"
    assert (record.status, record.layer, record.ended) == ("ok", "controller", "stack-hung")
    again = call("replay", "c", record.id, "--format", "json")
    assert again.exit_code == 0, again.output
    assert json.loads(again.stdout)["identical"] == 1


@pytest.mark.long
def test_a_crash_is_minimised_explained_rechecked_and_reported(place):
    record = campaign(place, "RaisesIfFast")
    assert record.signature == "stack_runs/crash/controller/ZeroDivisionError"
    small = call("minimize", "c", record.id, "--max-runs", "6", "--workers", "1")
    assert small.exit_code == 0, small.output
    found = json.loads((place / "c" / "trials" / record.id / "minimize.json").read_text())
    assert found["signature"] == record.signature
    why = call("explain", "c", record.id, "--max-runs", "5", "--rewinds", "0", "--format", "json")
    assert why.exit_code == 0, why.output
    assert json.loads(why.stdout)["guess"] == "controller"
    cured = call(
        "corpus", "c", "--set", "controller=cluster_cbf", "--perturbed", "0", "--workers", "1"
    )
    assert "fixed" in cured.output
    own = call("corpus", "c", "--perturbed", "0", "--workers", "1", "--format", "json")
    assert json.loads(own.stdout)["still failing"] >= 1, own.output
    assert call("report", "c").exit_code == 0
    page = (place / "c" / "report.html").read_text()
    assert "The controller crashed at 2.00 s: ZeroDivisionError: too fast to think" in page
