"""Ctrl-C, SIGTERM and kill -9 at random moments: commands stop, store nothing false, and go on.

Each command runs in a process of its own on a small campaign, is interrupted again and again, and
is then left to finish. What it prints and stores at last must be what a call in peace does.
"""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from mrta_falsify.core.seeding import stream
from tests.quick_program import PROGRAM

SIGNALS, SHARES = (signal.SIGINT, signal.SIGTERM, signal.SIGKILL), (0.6, 0.2, 0.2)
LIMIT = 2.0  # s from the signal to the end of the process
EARLIEST = 0.5  # s: the interpreter has begun to load our modules by then
VOLATILE = {"wall_s", "real_time_factor", "seconds_to_failure", "seconds_per_failure"}
STACK = ("--set", "engine=kinematic", "--spec", "deadlines")
JSON = ("--format", "json")


PROJECT = """
scenarios:
  small.scenic: {budget: 4, seed: 4, sampler: random, specs: [deadlines], jittered: 0, verify: 0}
stacks: {ours: {stack: default, settings: [engine=kinematic]}}
corpus: [c]
jittered: 1
keep: kept
"""


def _write_project(folder: Path) -> None:
    (folder / "mrta-falsify.yaml").write_text(PROJECT)


@dataclass(frozen=True)
class Case:
    """A command, what it leaves behind, and how it goes on."""

    args: tuple[str, ...]
    results: tuple[str, ...] = ()  #: files that only a whole run writes
    again: tuple[str, ...] = ()  #: the call that goes on; empty: the same
    prepare: Callable[[Path], None] = lambda folder: None  #: what else it needs
    over: str = ""  #: file whose being there makes the next call another one


MOMENTS, SEED = 5, 2  # of a command
CASES = {
    "run": Case(("run", "c/trials/{id}/world.json", *STACK, "-o", "out"), ("out/verdicts.json",)),
    "campaign": Case(
        ("campaign", "small.scenic", "-o", "new", "--budget", "6", "--seed", "4", "--workers", "2",
         "--sampler", "random", *STACK),
        again=("campaign", "--resume", "new", "--workers", "2"),
    ),
    "compare": Case(
        ("compare", "small.scenic", "-o", "new", "--budget", "2", "--repeats", "1", "--workers",
         "2", "--samplers", "random,auto", "--all-failures", *STACK),
        ("new/comparison.png",),
        ("compare", "small.scenic", "-o", "new", "--budget", "2", "--repeats", "1", "--workers",
         "2", "--samplers", "random,auto", "--all-failures", *STACK, "--resume"),
    ),
    "replay": Case(("replay", "c", "{id}", "--verify", "3"), ("c/trials/{id}/verify.json",)),
    "explain": Case(
        ("explain", "c", "{id}", "--max-runs", "6", "--rewinds", "8"),
        ("c/trials/{id}/explain.json",),
    ),
    "minimize": Case(
        ("minimize", "c", "{id}", "--max-runs", "5", "--workers", "2"),
        ("c/trials/{id}/minimize.json", "c/trials/{id}/world.min.json"),
    ),
    "corpus": Case(("corpus", "c", "--workers", "2", "--perturbed", "1")),
    "ci": Case(
        ("ci", "--trust", "--workers", "2"),
        ("kept/report.html",),
        prepare=_write_project,
        over="kept/last.json",
    ),
}  # fmt: skip


@dataclass(frozen=True)
class Ended:
    """A call that has ended."""

    code: int
    stdout: str
    stderr: str
    stopped_in: float | None  #: s from the signal to the end; None: it ended before


def _call(folder: Path, args: tuple[str, ...], *, after: float | None = None, by: int = 0) -> Ended:
    """Run a command in ``folder``; interrupt it ``after`` s by a signal, as a terminal does."""
    process = subprocess.Popen(
        [sys.executable, "-m", "mrta_falsify.cli", *args, *JSON],
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        env={**os.environ, "NO_COLOR": "1"},
    )
    signalled = None
    try:
        if after is not None:
            try:
                process.wait(after)
            except subprocess.TimeoutExpired:
                signalled = time.monotonic()
                os.killpg(process.pid, by)
        stdout, stderr = process.communicate()
    finally:
        process.kill()
    took = None if signalled is None else time.monotonic() - signalled
    return Ended(process.returncode, stdout, stderr, took)


@pytest.fixture(scope="module")
def stored(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """A folder with a program and a campaign on it, and the id of a failure."""
    folder = tmp_path_factory.mktemp("stored")
    (folder / "small.scenic").write_text(PROGRAM)
    begun = _call(
        folder,
        ("campaign", "small.scenic", "-o", "c", "--budget", "6", "--seed", "4", "--workers", "1",
         "--sampler", "random", *STACK),
    )  # fmt: skip
    assert begun.code == 1, begun.stderr
    return folder, json.loads(begun.stdout)["modes"][0]["ids"][0]


def _steady(data: Any) -> Any:
    """Leave out of printed data what no two calls share."""
    if isinstance(data, dict):
        return {key: _steady(value) for key, value in data.items() if key not in VOLATILE}
    if isinstance(data, list):
        return [_steady(value) for value in data]
    return data


def _results(folder: Path, files: list[str]) -> dict[str, Any]:
    """Read those of ``files`` that are there, JSON as data; of others only that they are there."""
    found = {name: folder / name for name in files if (folder / name).exists()}
    return {
        name: json.loads(path.read_text()) if path.suffix == ".json" else ""
        for name, path in found.items()
    }


def _check_interrupted(ended: Ended) -> None:
    assert "Traceback" not in ended.stderr, ended.stderr
    assert ended.code == 130, ended.stderr
    assert "interrupted" in ended.stderr
    if ended.stdout:
        said = json.loads(ended.stdout)
        assert said.get("interrupted") is True or said.get("ended") == "interrupted"
        assert "verdicts" not in said


@pytest.mark.long
@pytest.mark.parametrize("command", CASES)
def test_a_command_that_was_interrupted_comes_to_the_same_result(
    stored, tmp_path, command, record_property
):
    origin, id = stored
    case = CASES[command]
    if case.prepare is not Case.prepare:
        origin = Path(shutil.copytree(origin, tmp_path / "origin"))
        case.prepare(origin)

    def named(text: str) -> str:
        return text.format(id=id)

    args, again = ([*map(named, call)] for call in (case.args, case.again or case.args))

    def begin() -> Path:
        # at the same path, since what is stored and printed names it
        folder = tmp_path / "work"
        shutil.rmtree(folder, ignore_errors=True)
        shutil.copytree(origin, folder)
        return folder

    began = time.monotonic()
    peace = _call(begin(), tuple(args))
    whole = time.monotonic() - began
    files = [*map(named, case.results)]
    whole_results = _results(tmp_path / "work", files)
    assert len(whole_results) == len(files)
    assert peace.code in (0, 1), peace.stderr
    random = stream(SEED, f"interrupt/{command}")
    folder, took = begin(), []
    for _ in range(MOMENTS):
        call = again if any((folder / "new").glob("c*.json")) else args
        by = SIGNALS[int(random.choice(len(SIGNALS), p=SHARES))]
        after = float(random.uniform(EARLIEST, whole))
        ended = _call(folder, tuple(call), after=after, by=by)
        if ended.stopped_in is None or ended.code == peace.code:
            assert ended.code == peace.code, ended.stderr
            assert _steady(json.loads(ended.stdout)) == _steady(json.loads(peace.stdout))
            folder = begin()
            continue
        for file, data in _results(folder, files).items():
            assert data == whole_results[file]  # the signal came after the end of the work
        if by != signal.SIGKILL:
            took.append(ended.stopped_in)
            _check_interrupted(ended)
        if case.over and (folder / case.over).exists():
            folder = begin()
    call = again if any((folder / "new").glob("c*.json")) else args
    last = _call(folder, tuple(call))
    assert last.code == peace.code, last.stderr
    assert _steady(json.loads(last.stdout)) == _steady(json.loads(peace.stdout))
    assert _results(folder, files) == whole_results
    record_property("stopped_in", [round(seconds, 2) for seconds in took])
    assert max(took, default=0.0) <= LIMIT, took
