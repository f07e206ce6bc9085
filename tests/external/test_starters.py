"""From an empty folder to an own stack on trial, as docs/door.md says."""

from __future__ import annotations

import shutil
import subprocess
import sys

import pytest
from click.testing import CliRunner

from mrta_falsify.cli import main

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="processes are kept on Linux")

FLAGS = ["-std=c++17", "-Wall", "-Wextra", "-Wpedantic", "-Werror"]


def run(*arguments: str) -> str:
    result = CliRunner().invoke(main, list(arguments), catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return result.output


@pytest.mark.slow
def test_the_starter_in_cpp_compiles_without_a_warning(tmp_path, monkeypatch):
    compiler = shutil.which("c++") or pytest.skip("there is no C++ compiler")
    monkeypatch.chdir(tmp_path)
    run("init", "first", "--stack", "cpp")
    subprocess.run([compiler, *FLAGS, "-fsyntax-only", "first/my_stack.cpp"], check=True)


@pytest.mark.long  # the tutorial `own-stack` does the same with the one in Python
@pytest.mark.parametrize("language", ["python", "cpp"])
def test_a_newcomers_stack_passes_its_first_campaign(language, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    run("init", "first", "--stack", language)
    monkeypatch.chdir(tmp_path / "first")
    if language == "cpp":
        compiler = shutil.which("c++") or pytest.skip("there is no C++ compiler")
        subprocess.run([compiler, *FLAGS, "-O2", "-o", "my_stack", "my_stack.cpp"], check=True)
    else:
        text = (tmp_path / "first/stack.yaml").read_text()
        (tmp_path / "first/stack.yaml").write_text(text.replace("python3", sys.executable))
    said = run(
        "campaign", "my_scenario.scenic", "--stack", "stack.yaml", "-o", "runs/first",
        "--budget", "2", "--workers", "1",
    )  # fmt: skip
    assert "no violation found" in said
