"""`stack-test`: which checks a stack passes, and what is said of those it fails."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import mrta_falsify as mf
from mrta_falsify.core.errors import ConfigError

ROOT = Path(__file__).resolve().parents[2]
BAD = Path(__file__).with_name("bad_stack.py")

pytestmark = [
    pytest.mark.slow,  # ten starts and eight runs each
    pytest.mark.skipif(sys.platform != "linux", reason="processes are kept on Linux"),
]


def outcomes(report) -> dict[str, str]:
    return {check.name: check.outcome for check in report.checks}


def text(report, name: str) -> str:
    return next(check.text for check in report.checks if check.name == name)


@pytest.fixture
def bad_stack(monkeypatch):
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    return lambda how, at: f"{sys.executable} {BAD} {how} {at}"


@pytest.mark.parametrize("language", ["python", pytest.param("cpp", marks=pytest.mark.long)])
def test_the_stacks_to_begin_with_pass_and_their_ticks_are_timed(language, tmp_path):
    mf.init(tmp_path / "first", stack=language)
    if language == "cpp":
        compiler = shutil.which("c++") or pytest.skip("there is no C++ compiler")
        program = tmp_path / "first/my_stack"
        subprocess.run([compiler, "-std=c++17", "-O2", "-o", program, f"{program}.cpp"], check=True)
        command = str(program)
    else:
        command = f"{sys.executable} {tmp_path}/first/my_stack.py"
    report = mf.stack_test(command, robots=(6,))
    assert report.passed, report.checks
    assert set(outcomes(report).values()) == {"ok"}
    (tick,) = report.ticks
    assert tick.robots == 6
    assert 0.0 < tick.p50_us <= tick.p95_us
    assert tick.message_bytes > 6 * 3 * 8


def test_a_stack_that_draws_noise_is_told_where_it_differs(bad_stack):
    report = mf.stack_test(bad_stack("noise", 30))
    assert not report.passed
    assert report.ticks == ()
    failed = {name for name, outcome in outcomes(report).items() if outcome == "failed"}
    assert failed == {
        "gives the same answers again",
        "goes on as a copy by fork",
        "goes on as a copy by replay",
    }
    said = text(report, "gives the same answers again")
    assert "its answers differ from tick 30 on" in said
    assert "command of" in said


def test_a_stack_that_fails_in_mid_run_is_told_how(bad_stack):
    report = mf.stack_test(bad_stack("nan", 30))
    said = text(report, "answers each tick as the protocol says")
    assert said.startswith("answer at tick 30: twist of")


def test_a_stack_that_does_not_start_is_bad_input(bad_stack):
    with pytest.raises(ConfigError, match="no world like this"):
        mf.stack_test(bad_stack("refuses", 0))
