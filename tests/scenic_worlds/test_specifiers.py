"""Position and orientation come together as Scenic draws them, for every specifier of both."""

from __future__ import annotations

import math

import numpy as np
import pytest

from scenic_worlds.program import compile_program
from tests.scenic_worlds.specifiers import (
    EnergyTest,
    drawn_apart,
    our_draws,
    scenics_draws,
    shifted,
    write,
)

pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore")]  # compiles Scenic programs

COUNT = 200
LEVEL = 0.002  # of a test; 999 permutations can tell 0.001
#: where Scenic's pruning draws apart, reaches out of the container, or weighs by what is visible
PRUNED = (
    "on line",
    *(
        pytest.param(name, marks=pytest.mark.long)
        for name in (
            "on region, back edge",
            "on region, facing",
            "beyond",
            "in region, visible",
            "mutated on line",
        )
    ),
)


@pytest.mark.parametrize("name", PRUNED)
def test_draws_are_of_scenics_joint_distribution(name, tmp_path):
    """Power: the test finds a shift of half a standard deviation, and orientations drawn apart."""
    path = write(name, tmp_path)
    theirs = scenics_draws(path, COUNT).rows
    for mode in ("exact", "repair"):
        ours = our_draws(path, COUNT, mode).rows
        test = EnergyTest(ours, theirs)
        assert test.p_value > LEVEL, mode
        assert test.p_of(shifted(ours, 0.5), theirs) <= LEVEL
        if name != "beyond":  # faces the same way wherever it stands
            apart = drawn_apart(ours, 1.0, np.random.default_rng(1))
            assert test.p_of(apart, theirs) <= LEVEL


@pytest.mark.parametrize("mode", ["exact", "repair"])
def test_a_thing_on_a_bent_line_faces_along_the_segment_that_it_stands_on(mode, tmp_path):
    rows = our_draws(write("on line", tmp_path), 60, mode).rows
    x, y, facing = rows[:, 0], rows[:, 1], np.arctan2(rows[:, 5], rows[:, 3])
    north = np.hypot(x - 4, facing) < 1e-6
    east = np.hypot(y + 6, facing + math.pi / 2) < 1e-6
    assert (north | east).all()
    assert north.any()
    assert east.any()


@pytest.mark.parametrize("name", ["on line", "on region, back edge", "on along_wall", "beyond"])
def test_one_choice_is_one_unit_of_the_search(name, tmp_path):
    program = compile_program(write(name, tmp_path))
    driver = program.search.driver
    (thing,) = [item for item, called in driver.names.items() if called == "a"]
    count = bin(driver.units_of(thing)).count("1")
    assert count == (2 if name == "beyond" else 1)  # the point, and how far beyond


@pytest.mark.parametrize("name", ["on line", "on region, facing", "beyond", "mutated", "beside"])
def test_a_step_along_one_dimension_moves_position_and_orientation_together(name, tmp_path):
    program = compile_program(write(name, tmp_path))
    driver = program.search.driver
    (thing,) = [item for item, called in driver.names.items() if called == "a"]
    numbers = np.random.default_rng(3)
    u = numbers.random(len(program.space))
    kept = driver.begin()
    kept.move(u, driver.all_units)
    for place in range(len(u)):
        u[place] = numbers.random()
        (unit,) = [i for i, one in enumerate(driver.units) if one.start <= place < one.stop]
        kept.move(u, 1 << unit)
        fresh = driver.begin()
        fresh.move(u, driver.all_units)
        moved, made = kept.values[thing], fresh.values[thing]
        np.testing.assert_array_equal(moved.position.coordinates, made.position.coordinates)
        np.testing.assert_array_equal(moved.orientation.q, made.orientation.q)


def test_what_only_pruning_can_draw_is_still_drawn(tmp_path):
    for name in ("two at one point", "visible from", "visible", "in tiles, relative heading"):
        assert our_draws(write(name, tmp_path), 2, "repair").rows.shape[0] == 2
