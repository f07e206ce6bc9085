"""Plug-ins, stacks, projects, floors, tasks and worlds of commit 73399d2 run unchanged."""

from __future__ import annotations

import re
import sys
import types
from pathlib import Path

import pytest

import mrta_falsify as mf
from mrta_falsify.commands.ci.project import read_project
from mrta_falsify.commands.worlds import find_world
from scenic_worlds.program import compile_program
from simulator_interface.formats.floor_yaml import read_floor

FILES = Path(__file__).parent / "files"
PAGES = sorted(FILES.glob("extend-*.md"))
STACKS = sorted(FILES.rglob("stack.yaml"))
PROGRAMS = sorted(FILES.rglob("*.scenic"))
OLD_NAME = "ignore:.* is called .* now:DeprecationWarning"


@pytest.mark.filterwarnings(OLD_NAME)
@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_a_plug_in_runs_unchanged(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    module = types.ModuleType("documented")
    monkeypatch.setitem(sys.modules, "documented", module)  # dataclasses look their module up
    for block in re.findall(r"```python\n(.*?)```", page.read_text(), re.DOTALL):
        exec(compile(block, str(page), "exec"), module.__dict__)


@pytest.mark.parametrize("path", STACKS, ids=lambda path: path.parent.name)
def test_a_stack_is_read(path):
    assert mf.read_config(path).digest()


@pytest.mark.slow
@pytest.mark.parametrize("path", PROGRAMS, ids=lambda path: f"{path.parent.name}/{path.stem}")
def test_a_program_gives_worlds(path):
    program = compile_program(path)
    assert program.realise(program.candidate(0, 0), "repair").world.robots


def test_a_project_is_read(tmp_path):
    for name in ("project.yaml", "starter/first_ward.scenic", "starter/stack.yaml"):
        (tmp_path / Path(name).name).write_text((FILES / name).read_text())
    project = read_project(tmp_path / "project.yaml")
    assert project.file.scenarios["first_ward.scenic"].jittered == 1
    assert project.stack("careful").planner.options == {"resolution": 0.1}


def test_a_floor_is_read():
    floor = read_floor(FILES / "floor.yaml")
    assert [room.name for room in floor.rooms] == ["lab", "store"]


def test_tasks_are_read():
    world = find_world("aws_hospital_day", tasks=FILES / "testcase.json")
    assert [task.deadline for task in world.tasks] == [200.0, 200.0, 250.0]
