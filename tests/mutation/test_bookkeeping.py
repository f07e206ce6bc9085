"""Trees, watched lines, reasons, tasks and reports of the mutation benchmark, without a run."""

from __future__ import annotations

import ast
import importlib.metadata
import importlib.util
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from benchmarks.defects.worlds import PLANTS
from benchmarks.mutation.killing import Hunted
from benchmarks.mutation.lines import LineWatch, always_runs
from benchmarks.mutation.mutants import Edit, Mutant
from benchmarks.mutation.process import StoppedError
from benchmarks.mutation.report import explained, report
from benchmarks.mutation.runs import Run, kind_of, reasons
from benchmarks.mutation.searching import Searched
from benchmarks.mutation.sound import SoundRuns
from benchmarks.mutation.tasks import Tasks, Worker
from benchmarks.mutation.trees import PACKAGES, digest_of, mutated_tree, remove_tree, sound_tree
from benchmarks.mutation.worlds import PORTFOLIO, stack_of
from mrta_falsify.core.config import StackConfig
from scenic_worlds.shipped import scenario_names

ROOT = Path(__file__).resolve().parents[2]
WORLD = PLANTS["same_room_twice_stalls"].world(0)
PATH = "mrta_falsify/stack/route.py"
MUTANT = Mutant(
    id="m1",
    edits=(Edit(path=PATH, line=1, before="a = 1", after="a = 2"),),
    layer="planner",
    what="a = 1 -> a = 2",
)
PASSED = Run(fate="judged", costs={"way": 40.0, "time": 50.0, "calls": 3.0})


PROJECT = """
[project]
name = "mrta-falsify"
version = "9.9"

[project.entry-points."mrta_falsify.planner"]
mine = "mrta_falsify.stack.mine:Mine"
"""


# --- trees -----------------------------------------------------------------------------------


@pytest.fixture
def source(tmp_path):
    for package in PACKAGES:
        (tmp_path / "source" / package).mkdir(parents=True)
        (tmp_path / "source" / package / "__init__.py").touch()
    (tmp_path / "source" / PATH).parent.mkdir()
    (tmp_path / "source" / PATH).write_text("a = 1\n")
    (tmp_path / "source" / "pyproject.toml").write_text(PROJECT)
    return tmp_path / "source"


def test_a_mutant_lies_in_a_tree_of_its_own(source, tmp_path):
    sound = sound_tree(tmp_path / "trees", source)
    tree = mutated_tree(tmp_path / "trees", MUTANT)
    assert (tree / PATH).read_text() == "a = 2\n"
    assert (sound / PATH).read_text() == (source / PATH).read_text() == "a = 1\n"
    assert (tree / "simulator_interface" / "__init__.py").is_file()
    remove_tree(tmp_path / "trees", MUTANT)
    assert not tree.exists()


def test_a_tree_names_its_own_components_whatever_is_installed(source, tmp_path):
    sound = sound_tree(tmp_path / "trees", source)
    (found,) = importlib.metadata.distributions(path=[str(sound)])
    assert (found.metadata["Name"], found.version) == ("mrta-falsify", "9.9")
    assert [(e.group, e.name) for e in found.entry_points] == [("mrta_falsify.planner", "mine")]


def test_the_sound_tree_stays_when_the_sources_change(source, tmp_path):
    sound = sound_tree(tmp_path / "trees", source)
    (source / PATH).write_text("a = 3\n")
    assert (sound_tree(tmp_path / "trees", source) / PATH).read_text() == "a = 1\n"
    assert sound == sound_tree(tmp_path / "trees", source)


def test_the_digest_of_a_tree_is_that_of_its_sources(source, tmp_path):
    before = digest_of(sound_tree(tmp_path / "one", source))
    assert digest_of(sound_tree(tmp_path / "two", source)) == before
    (source / PATH).write_text("a = 3\n")
    assert digest_of(sound_tree(tmp_path / "three", source)) != before


# --- the sound stack's runs ------------------------------------------------------------------


class Answering:
    """Stands for a process with the sound stack; counts its runs."""

    stopped = False
    runs = 0

    def run(self, *args, **more):
        self.runs += 1
        return PASSED


def test_runs_of_the_sound_stack_are_kept_for_the_same_sources_only(tmp_path):
    process, path, stack = Answering(), tmp_path / "sound.jsonl", StackConfig()
    for code, runs in (("a", 1), ("a", 1), ("b", 2), ("a", 2)):
        assert SoundRuns(path, ("deadlines",), code).run(process, WORLD, stack) == PASSED
        assert process.runs == runs


@pytest.mark.parametrize("source", PORTFOLIO, ids=lambda source: source.name)
def test_sources_of_worlds_have_a_program_and_known_settings(source):
    assert Path(source.place).is_file() or source.scenario in scenario_names()
    assert stack_of(source.settings).engine.name == "kinematic"


# --- CPU time --------------------------------------------------------------------------------

SPENDING = """
import os, sys, time
from benchmarks.mutation.server import CpuLimit

def spend(seconds):
    end = time.process_time() + seconds
    while time.process_time() < end:
        pass

def in_a_fork(seconds):
    child = os.fork()
    if child == 0:
        spend(seconds)
        os._exit(0)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])

def compile_for(seconds):
    limit.on_start(None)
    spend(seconds)
    limit.on_end(None)

limit = CpuLimit()
limit.set(0.3)
"""


@pytest.mark.parametrize(
    ("what", "code"),
    [
        ("spend(0.2)", 0),
        ("spend(0.5)", -signal.SIGPROF),
        ("for _ in range(4): in_a_fork(0.2)\nspend(0.1)", -signal.SIGPROF),
        ("assert in_a_fork(0.5) == -27\nspend(0.5)", -signal.SIGPROF),
        ("compile_for(0.5)\nspend(0.1)\nassert limit.compile_s > 0.4", 0),
    ],
)
def test_a_request_has_so_much_cpu_time_with_all_its_forks(what, code):
    program = [sys.executable, "-c", f"{SPENDING}\n{what}\nos._exit(0)"]
    assert subprocess.run(program, cwd=ROOT, check=False).returncode == code


def test_what_a_fork_compiles_is_no_time_of_the_stack():
    forked = "child = os.fork()\nif child == 0:\n    compile_for(0.4)\n    os._exit(0)\n"
    after = "os.waitpid(child, 0)\nspend(0.1)\nassert limit.compile_s > 0.3\nin_a_fork(0.05)"
    program = [sys.executable, "-c", f"{SPENDING}\n{forked}{after}\nos._exit(0)"]
    assert subprocess.run(program, cwd=ROOT, check=False).returncode == 0


# --- lines that run --------------------------------------------------------------------------

WATCHED = """
import functools
LIMIT = 3


def sign(x):
    '''Text.'''
    if x > 0:
        return (
            1
        )
    elif x < 0:
        return -1
    return 0


class Thing:
    size = 1

    @property
    def double(self):
        return 2 * self.size


@functools.lru_cache
def loop(n):
    for _ in range(n):
        pass
    else:
        n = 0
    return n
"""


@pytest.fixture
def watched(tmp_path, monkeypatch):
    (tmp_path / "watched_stack.py").write_text(WATCHED)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr(sys, "meta_path", list(sys.meta_path))
    watch = LineWatch(tmp_path, ("watched_stack.py",))
    watch.install()
    module = importlib.import_module("watched_stack")
    yield watch, module
    del sys.modules["watched_stack"]


@pytest.mark.parametrize(
    ("call", "lines"),
    [
        (lambda module: module.sign(1), (8, 9, 10, 11)),
        (lambda module: module.sign(-1), (8, 12, 13)),
        (lambda module: module.sign(0), (8, 12, 14)),
        (lambda module: module.Thing().double, (22,)),
        (lambda module: module.loop(2), (27, 28, 30, 31)),
        (lambda module: module.loop(0), (27, 30, 31)),
    ],
)
def test_the_lines_that_run_are_known(watched, call, lines):
    watch, module = watched
    watch.clear()
    call(module)
    assert watch.lines() == {"watched_stack.py": lines}


def test_a_watched_module_does_what_it_does_otherwise(watched):
    _, module = watched
    assert [module.sign(x) for x in (2, -2, 0)] == [1, -1, 0]
    assert module.sign.__doc__ == "Text."


@pytest.mark.parametrize(
    ("line", "wanted"), [(3, True), (6, True), (8, False), (18, True), (27, False)]
)
def test_lines_outside_functions_count_as_run_everywhere(line, wanted):
    assert always_runs([line], ast.parse(WATCHED)) is wanted


def test_lines_of_compiled_functions_count_as_run_everywhere():
    for mark in ("@njit", "@njit(cache=True)", "@inner()", "@numba.njit"):
        tree = ast.parse(f"{mark}\ndef f(x):\n    return x + 1\n")
        assert always_runs([3], tree)


# --- reasons ---------------------------------------------------------------------------------


def test_a_run_is_a_failure_if_something_is_violated_or_it_ended_early():
    assert reasons(PASSED) == ()
    assert reasons(Run(fate="judged", violated=("deadlines",))) == ("deadlines",)
    assert reasons(Run(fate="crash")) == ("crash",)
    assert kind_of(("hang",)) == "hang"
    assert kind_of(("all_tasks_done", "stack_runs")) == "crash"
    assert kind_of(("deadlines",)) == "behaviour"


@pytest.mark.parametrize(
    ("name", "cost", "wanted"),
    [
        ("way", 60.5, ("costly_way",)),
        ("way", 59.5, ()),
        ("time", 75.5, ("costly_time",)),
        ("calls", 10.0, ()),  # three calls count as five
        ("calls", 11.0, ("costly_calls",)),
    ],
)
def test_a_run_that_costs_much_more_than_the_sound_one_is_a_failure(name, cost, wanted):
    costly = Run(fate="judged", costs={**PASSED.costs, name: cost})
    assert reasons(costly, PASSED) == wanted
    assert reasons(costly, Run(fate="judged", violated=("deadlines",), costs=PASSED.costs)) == ()


# --- tasks -----------------------------------------------------------------------------------


class Standin:
    """Stands for a process."""

    stopped = False


def test_all_tasks_are_worked_off_by_several_workers():
    kept = {}
    tasks = Tasks(lambda task, worker: task * 2, lambda t, r: str(kept.setdefault(t, r)), "n")
    tasks.run(range(20), [Worker(Standin()) for _ in range(3)])
    assert kept == {n: 2 * n for n in range(20)}


def test_what_a_task_raises_ends_all_of_them():
    def work(task, worker):
        if task == 3:
            raise ValueError("three")
        return task

    workers = [Worker(Standin()) for _ in range(2)]
    with pytest.raises(ValueError, match="three"):
        Tasks(work, lambda t, r: "", "n").run(range(9), workers)
    assert all(worker.sound.stopped for worker in workers)


def test_ctrl_c_ends_the_tasks_in_progress():
    def work(task, worker):
        if task == 0:
            return task
        while not worker.sound.stopped:
            time.sleep(0.01)
        raise StoppedError

    def keep(task, result):
        raise KeyboardInterrupt

    workers = [Worker(Standin()) for _ in range(2)]
    with pytest.raises(KeyboardInterrupt):
        Tasks(work, keep, "n").run(range(9), workers)


# --- reports ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("row", "words"),
    [
        (Hunted(mutant="m1", status="unreached"), "run in none of the worlds"),
        (
            Hunted(mutant="m1", status="survived", reached=9, worlds=8),
            "reached in 9 worlds, and all 8 traces are the sound ones",
        ),
        (
            Hunted(mutant="m1", status="survived", worlds=8, differing=3, knife_edges=("a",)),
            "3 of 8 traces differ, and nothing is violated; fails in 1",
        ),
        (Hunted(mutant="m1", status="stale", error="was changed"), "was changed"),
    ],
)
def test_a_survivor_is_explained_in_a_line(row, words):
    assert words in explained(row)
    assert words in report([MUTANT], {"m1": row}, [])


def test_the_report_counts_kills_and_layers_by_sampler():
    killed = Hunted(
        mutant="m1",
        status="killable",
        kind="behaviour",
        case="hall-3",
        why=("deadlines",),
        copies="3 of 3 copies, the sound stack 0 of 3",
    )
    found = {"mutant": "m1", "layer": "planner", "kind": "behaviour", "why": ("deadlines",)}
    rows = [
        Searched(sampler="auto", trials=7, found_at=7, named="planner", guess="costmap", **found),
        Searched(sampler="random", trials=60, mutant="m1", layer="planner"),
    ]
    text = report([MUTANT], {"m1": killed}, rows)
    assert "1 mutants, 1 of them run: 1 killable (1 by behaviour), 0 survived" in text
    certain, none = "1 of 1 [5%, 100%]", "0 of 1 [0%, 95%]"
    assert f"| `auto` | {certain} | 1 | 7 | {certain} | {none} | 0 of 0 |" in text
    assert f"| `random` | {none} | 0 | - | 0 of 0 | 0 of 0 | 0 of 0 |" in text
    assert "7: deadlines; planner, right | no, 60 trials |" in text
