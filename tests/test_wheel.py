"""The built wheel works in an empty folder, without the source tree."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import venv
import zipfile
from pathlib import Path

import pytest

from scenic_worlds.shipped import scenario_names

ROOT = Path(__file__).parent.parent
PACKAGES = ("mrta_falsify", "scenic_worlds", "simulator_interface", "samplers", "reports")
LARGEST = 15e6  # bytes of a wheel
#: of a measurement; what is read at run time is made from them
NOT_SHIPPED = {"README.md", "aws_hospital.samples.csv"}


def _source_files() -> set[str]:
    """List what the packages hold, but for what Python and numba keep there."""
    found = set()
    for package in PACKAGES:
        for path in (ROOT / package).rglob("*"):
            if path.is_file() and "__pycache__" not in path.parts:
                found.add(path.relative_to(ROOT).as_posix())
    return found


@pytest.fixture(scope="module")
def wheel(tmp_path_factory) -> Path:
    """Builds the wheel from a copy of the sources."""
    folder = tmp_path_factory.mktemp("wheel")
    source, built = folder / "source", folder / "built"
    for package in PACKAGES:
        skipped = shutil.ignore_patterns("__pycache__")
        shutil.copytree(ROOT / package, source / package, ignore=skipped)
    for name in ("pyproject.toml", "README.md", "LICENSE", "NOTICE"):
        shutil.copy(ROOT / name, source)
    words = ["wheel", "--no-deps", "--no-build-isolation", "--no-index", "-w", built, source]
    _run(sys.executable, "-m", "pip", "--quiet", *words)
    (path,) = built.glob("*.whl")
    return path


@pytest.fixture(scope="module")
def command(wheel, tmp_path_factory) -> Path:
    """Installs the wheel into an environment that has only this one's dependencies."""
    folder = tmp_path_factory.mktemp("installed") / "env"
    venv.create(folder, with_pip=False)
    python = folder / "bin" / "python"
    words = ["install", "--no-deps", "--no-index", wheel]
    _run(sys.executable, "-m", "pip", "--quiet", "--python", python, *words)
    (site,) = folder.glob("lib/python*/site-packages")
    # Plain lines add folders, without the links to the source tree that they may hold.
    others = [place for place in sys.path if place.endswith("site-packages")]
    (site / "dependencies.pth").write_text("\n".join(others) + "\n")
    return folder / "bin" / "mrta-falsify"


def _run(*words: object, cwd: Path | None = None, codes: tuple[int, ...] = (0,)) -> str:
    hidden = {"PYTHONPATH", "NUMBA_CACHE_DIR"}  # nothing of this process's
    env = {name: value for name, value in os.environ.items() if name not in hidden}
    done = subprocess.run(
        [str(word) for word in words], capture_output=True, text=True, cwd=cwd, env=env, check=False
    )
    assert done.returncode in codes, done.stderr
    return done.stdout


@pytest.mark.long
def test_the_wheel_is_small_and_holds_every_file_of_the_packages(wheel):
    inside = set(zipfile.ZipFile(wheel).namelist())
    missing = {name for name in _source_files() - inside if Path(name).name not in NOT_SHIPPED}
    assert missing == set()
    assert wheel.stat().st_size < LARGEST


@pytest.mark.long
def test_the_installed_command_knows_its_version_and_writes_files_to_begin_with(command, tmp_path):
    assert _run(command, "--version", cwd=tmp_path).startswith("mrta-falsify ")
    _run(command, "init", "first", "--stack", "cpp", cwd=tmp_path)
    assert (tmp_path / "first" / "mrta_stack.hpp").is_file()


@pytest.mark.long  # compiles all kernels anew
@pytest.mark.timeout(1800)
def test_the_installed_command_runs_days_checks_programs_and_finds_its_machine_in_order(
    command, tmp_path
):
    assert json.loads(_run(command, "doctor", "--format", "json", cwd=tmp_path))["ok"]
    _run(command, "init", "first", "--stack", "cpp", cwd=tmp_path)
    mine = ["check", "first/my_scenario.scenic", "--count", "1", "--format", "json"]
    assert json.loads(_run(command, *mine, cwd=tmp_path))["scenes"] == 1
    checked = _run(command, "check", "--all", "--count", "1", "--format", "json", cwd=tmp_path)
    assert len(json.loads(checked)["programs"]) == len(scenario_names())
    words = ["run", "zoo/doorway", "-o", "out", "--format", "json"]
    ran = json.loads(_run(command, *words, cwd=tmp_path, codes=(0, 1)))
    assert ran["sim_time_s"] > 0.0
    assert (tmp_path / "out" / "report.html").stat().st_size > 50_000
    _run(command, "corpus", "zoo", cwd=tmp_path)
