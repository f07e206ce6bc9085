"""The stack files and scenarios of all examples are read as they are."""

from __future__ import annotations

from pathlib import Path

import pytest

from mrta_falsify.commands.stacks import load_stack
from scenic_worlds.program import compile_program

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
#: but for the one whose program is compiled first, by a test of its own
STACKS = [path for path in sorted(EXAMPLES.glob("*/stack.yaml")) if "room_keys" not in path.parts]


@pytest.mark.parametrize("path", STACKS, ids=lambda path: path.parent.name)
def test_a_stack_file_is_read(path):
    assert load_stack(path) != load_stack()


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*/*.scenic")), ids=lambda path: path.stem)
def test_a_scenario_gives_a_world(path):
    program = compile_program(path)
    assert program.realise(program.candidate(0, 0)).world.robots
