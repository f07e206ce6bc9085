"""Which bodies at rest close a way, against trying each of them."""

from __future__ import annotations

import numpy as np
import pytest
from frames import Robot, Script, corridor

from mrta_falsify.core.geometry import rectangle
from mrta_falsify.specs.deadlock.occupancy import SolidGrid

GAP = 0.44  # m, of two robots
START, GOAL = np.array([-4.0, 0.0]), np.array([4.0, 0.0])


def two_ways(width: float, block: float = 0.0) -> SolidGrid:
    """A corridor, the only way, with a block in it: a way on either side, if there is room."""
    around = [rectangle(0.4, 20.0, (0.0, side * (width / 2 + 10.1))) for side in (1, -1)]
    walls = [*corridor(width), *around, rectangle(1.0, 0.4, (0.0, block))]
    return SolidGrid(Script([Robot((0.0, 3.0))], walls=walls).world())


def closing(space: SolidGrid, bodies: np.ndarray) -> list[int] | None:
    return space.bodies_closing(START, GOAL, 0.0, others=bodies, gap=GAP)


@pytest.mark.parametrize("seed", range(40))
def test_those_that_close_a_way_alone_are_found_as_by_trying_each(seed):
    random = np.random.default_rng(seed)
    space = two_ways(random.uniform(1.2, 2.4), random.uniform(-0.5, 0.5))
    bodies = random.uniform((-1.5, -0.9), (1.5, 0.9), (int(random.integers(2, 9)), 2))
    found = closing(space, bodies)
    if found is None:
        assert all(closing(space, bodies[k : k + 1]) is None for k in range(len(bodies)))
        return
    alone = [k for k in range(len(bodies)) if closing(space, bodies[k : k + 1]) is not None]
    assert found == (alone or list(range(len(bodies))))


@pytest.mark.parametrize("seed", range(40))
def test_a_way_is_open_among_bodies_if_none_of_the_others_closes_it(seed):
    random = np.random.default_rng(seed)
    space = two_ways(random.uniform(1.2, 2.4), random.uniform(-0.5, 0.5))
    bodies = random.uniform((-5.0, -0.9), (5.0, 0.9), (int(random.integers(2, 12)), 2))
    own = int(random.integers(len(bodies)))
    for place in (bodies[own].copy(), START, START + random.uniform(-0.3, 0.3, 2)):
        bodies[own] = place
        found = space.is_open_among(START, GOAL, 0.0, bodies=bodies, own=own, gap=GAP)
        assert found == (closing(space, np.delete(bodies, own, axis=0)) is None)


def test_two_that_close_a_way_only_together_are_both_named():
    space = two_ways(2.4)
    beside = np.array([[0.0, 0.7], [0.0, -0.7], [2.0, 3.0]])
    assert closing(space, beside[:1]) is None
    assert closing(space, beside) == [0, 1, 2]


def test_solids_that_leave_a_way_close_nothing():
    assert two_ways(2.4).closing(START, GOAL, 0.0) is None
    assert two_ways(0.6).closing(START, GOAL, 0.0) == ()
