"""The frozen benchmark suite is whole."""

from __future__ import annotations

import pytest

from benchmarks.falsification.suite import HERE, read_suite
from mrta_falsify.specs.library import build_specifications
from scenic_worlds.program import compile_program

PAIRS = read_suite()


def test_there_are_at_least_ten_pairs_and_five_hard_ones():
    halves = [pair.half for pair in PAIRS.values()]
    assert len(halves) >= 10
    assert halves.count("hard") >= 5


@pytest.mark.parametrize("name", list(PAIRS))
def test_a_pair_names_layers_defects_and_specifications_that_exist(name):
    pair = PAIRS[name]
    assert pair.stack.engine.name == "kinematic"
    build_specifications(pair.specifications)


@pytest.mark.slow
@pytest.mark.parametrize("scenario", sorted({pair.scenario for pair in PAIRS.values()}))
def test_a_scenario_of_the_suite_gives_a_world_of_a_small_ward(scenario):
    program = compile_program(HERE / "scenarios" / f"{scenario}.scenic")
    world = program.realise(program.candidate(0)).world
    assert 1 <= len(world.robots) <= 5
    assert world.horizon <= 200.0


def test_every_scenario_file_is_of_some_pair():
    files = {path.stem for path in (HERE / "scenarios").glob("*.scenic")}
    assert files == {pair.scenario for pair in PAIRS.values()}
