"""A stack that crashes, hangs, hoards memory or answers nonsense violates ``stack_runs``."""

import dataclasses
import json
import shutil
from pathlib import Path

import pytest
from click.testing import CliRunner

from mrta_falsify.cli import main
from mrta_falsify.core.world import write_world
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
LIMITS = ("--tick-limit", "2", "--memory-limit", "0.5")


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


@pytest.mark.parametrize("layer", CRASHES)
def test_an_exception_or_nonsense_is_a_verdict_at_its_tick(place, layer):
    kind, exception, words = CRASHES[layer]
    result = fails(layer)
    assert result.exit_code == 1, result.output
    found = judged(place / "out")
    evidence = found["evidence"]
    assert (evidence["kind"], evidence["exception"]) == (kind, exception)
    assert words in evidence["message"]
    assert evidence["layer"] == "controller"
    assert (found["violated_at"], evidence["tick"]) == (2.0, 40)
    assert "the toolkit itself failed" not in result.output


@pytest.mark.slow
@pytest.mark.parametrize("layer", DEATHS)
def test_what_only_another_process_can_end_is_a_verdict_as_well(place, layer):
    kind, exception, words = DEATHS[layer]
    result = fails(layer)
    assert result.exit_code == 1, result.output
    found = judged(place / "out")
    evidence = found["evidence"]
    assert (evidence["kind"], evidence["exception"]) == (kind, exception)
    assert words in evidence["message"]
    assert (found["violated_at"], evidence["tick"]) == (2.0, 40)
    if layer not in ("IsKilled", "EndsProcess"):
        assert evidence["layer"] == "controller"
        assert any("users_layers.py" in frame for frame in evidence["frames"])
