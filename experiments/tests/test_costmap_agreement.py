"""What a program generates is in the costmap where the Bullet world has it."""

from __future__ import annotations

import dataclasses
import importlib.util
import sys
from pathlib import Path

import pytest

from mrta_falsify.commands.programs import draw_candidates, open_scenario
from simulator_interface.costmap_layers import build_costmap

EXPERIMENT = Path(__file__).parents[1] / "scenic" / "costmap_agreement.py"

PROGRAM = """\
param layout = localPath('floor.yaml')
model scenic_worlds.model
new Robot with name 'robot1', with start_room 'lab'
for i in range(4):
    new Chair in free_floor, facing Range(0, 360) deg
new Bookshelf on along_wall('store')
new Blockage in corridors, with width 0.6, with length Range(0.5, 1.5), with during (50, 60)
param tasks = [(0, 'lab', 'store', 200)]
"""
FLOOR = """\
walls:
  - line: [[0, 0], [14, 0], [14, 8], [0, 8], [0, 0]]
  - line: [[5, 0], [5, 5.5]]
  - line: [[9, 8], [9, 2.5]]
furniture:
  - {name: table, kind: table, box: [6.5, 0.2, 8.0, 1.0], height: 0.7}
rooms:
  - {name: lab, point: [2, 3]}
  - {name: store, point: [12, 5]}
"""


@pytest.fixture(scope="module")
def agreement():
    """The benchmark's module."""
    spec = importlib.util.spec_from_file_location("costmap_agreement", EXPERIMENT)
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    yield module
    del sys.modules[spec.name]


@pytest.fixture(scope="module")
def program(tmp_path_factory):
    folder = tmp_path_factory.mktemp("programs")
    (folder / "floor.yaml").write_text(FLOOR)
    path = folder / "cluttered.scenic"
    path.write_text(PROGRAM)
    return open_scenario(str(path))


@pytest.fixture(scope="module")
def worlds(program):
    return [drawn.world for drawn in draw_candidates(program, count=3, seed=1)]


def test_every_generated_object_is_lethal_cell_by_cell_and_free_cells_hold_no_body(
    agreement, program, worlds
):
    total = agreement.Agreement()
    for world in worlds:
        agreement.compare(world, agreement.fixed_furniture(program), total)
    assert total.worlds == 3
    assert total.objects == 3 * 6
    assert total.disagreements == 0
    assert total.object_cells > 18 * 60
    assert min(total.free_cells, total.inner_cells, total.face_cells) > 1000


def test_a_costmap_that_is_blind_to_furniture_is_found_out(
    agreement, program, worlds, monkeypatch, capsys
):
    def blind(world):
        return build_costmap(dataclasses.replace(world, furniture=()))

    monkeypatch.setattr(agreement, "build_costmap", blind)
    total = agreement.Agreement()
    agreement.compare(worlds[0], agreement.fixed_furniture(program), total)
    assert total.object_cells_not_lethal > 200
    assert total.face_cells_not_lethal > 100
    assert "chair_1" in capsys.readouterr().err


def test_furniture_of_the_layout_is_told_from_the_generated(agreement, program, worlds):
    fixed = agreement.fixed_furniture(program)
    names = [item.name for item in agreement.generated(worlds[0], fixed)]
    assert fixed == 1
    assert names[:4] == ["chair_1", "chair_2", "chair_3", "chair_4"]
    assert names[4:] == ["bookshelf_1", "blockage_1"]
