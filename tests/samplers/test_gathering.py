"""Coincidences: kin coordinates gather about common values, and what is alike is learnt."""

import numpy as np
import pytest

from mrta_falsify.core.feedback import LOADS, Cube, Feedback
from samplers.asking import Mutator
from samplers.gathering import Gathering
from samplers.surrogate import SurrogateSampler

ROBOTS, ROOMS = 6, 5
#: an arrival, a room and a side of each robot, and one width
TASKS = Cube(
    dimensions=3 * ROBOTS + 1,
    levels=(0,) * ROBOTS + (ROOMS,) * ROBOTS + (0,) * (ROBOTS + 1),
    kin=(0,) * ROBOTS + (1,) * ROBOTS + (2,) * ROBOTS + (3,),
)


def draws(count: int, cube: Cube = TASKS) -> np.ndarray:
    gathering, random = Gathering(cube), np.random.default_rng(1)
    return np.array(
        [gathering.gathered(random.random(cube.dimensions), random) for _ in range(count)]
    )


def most_in_one_room(points: np.ndarray) -> np.ndarray:
    rooms = (points[:, ROBOTS : 2 * ROBOTS] * ROOMS).astype(int)
    return (rooms[:, :, None] == rooms[:, None, :]).sum(axis=2).max(axis=1)


def test_several_want_one_place_far_more_often_than_by_chance():
    uniform = np.random.default_rng(0).random((2000, TASKS.dimensions))
    by_chance = (most_in_one_room(uniform) >= 5).mean()
    assert by_chance < 0.02
    assert (most_in_one_room(draws(2000)) >= 5).mean() > 10.0 * by_chance


def test_robots_that_leave_out_their_own_room_still_meet_in_one():
    """Each picks a room other than its own, so that equal levels are other rooms."""
    others = tuple(tuple(r for r in range(ROBOTS) if r != i) for i in range(ROBOTS))
    cube = Cube(dimensions=ROBOTS, levels=(ROBOTS - 1,) * ROBOTS, kin=(0,) * ROBOTS, labels=others)
    levels = (draws(1000, cube) * (ROBOTS - 1)).astype(int)
    rooms = np.take_along_axis(np.array(others)[None], levels[:, :, None], axis=2)[:, :, 0]
    most = (rooms[:, :, None] == rooms[:, None, :]).sum(axis=2).max(axis=1)
    assert most.max() == ROBOTS - 1  # nobody goes to its own
    assert (most == ROBOTS - 1).mean() > 0.1


def test_coordinates_without_kin_are_drawn_evenly():
    width = draws(2000)[:, -1]
    counts = np.histogram(width, bins=10, range=(0.0, 1.0))[0]
    assert counts.min() > 140
    np.testing.assert_array_less(counts, 270)


def test_every_value_of_a_family_comes_up():
    arrivals = draws(2000)[:, 0]
    assert np.histogram(arrivals, bins=10, range=(0.0, 1.0))[0].min() > 140


def test_without_families_draws_are_uniform():
    cube = Cube(dimensions=4)
    points = draws(2000, cube)
    np.testing.assert_allclose(points.mean(axis=0), 0.5, atol=0.03)
    np.testing.assert_allclose(np.corrcoef(points.T), np.eye(4), atol=0.07)


def test_an_object_drawn_anew_may_take_after_its_kin():
    mutator = Mutator(TASKS, redraw=1.0, alike=1.0)
    random = np.random.default_rng(3)
    parent = np.concatenate(
        [np.full(ROBOTS, 0.25), np.full(ROBOTS, 0.7), random.random(ROBOTS + 1)]
    )
    for _ in range(200):
        child = mutator.child(parent, 0.1, random)
        np.testing.assert_allclose(child[:ROBOTS], 0.25, atol=0.15)
        np.testing.assert_allclose(child[ROBOTS : 2 * ROBOTS], 0.7)


@pytest.mark.parametrize("seed", range(3))
def test_a_load_is_driven_up_where_no_margin_tells(seed):
    """Five robots in one room fail; margins are flat, only the longest queue is told."""
    sampler = SurrogateSampler(SurrogateSampler.Options(cube=TASKS, seed=seed))
    found = []
    for number in range(60):
        u = np.array(sampler.ask().u)
        most = int(most_in_one_room(u[None])[0])
        failed = most >= 5
        found.append(failed)
        sampler.tell(
            Feedback(
                number=number,
                u=u,
                score=-0.5 if failed else 0.5,
                objectives={"all_tasks_done": -0.5 if failed else 0.5},
                descriptors=dict.fromkeys(LOADS, 0.0) | {"queue": most / ROBOTS},
                failed=failed,
                signature="all_tasks_done" if failed else "",
            )
        )
    assert sum(found) >= 3, "by chance it is one in two searches"
