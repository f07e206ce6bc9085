"""What is refused of sampled worlds, also when most of a world has been seen before."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from mrta_falsify.core.errors import WorldError
from mrta_falsify.core.world import Furniture, World
from scenic_worlds.validity import WorldValidity


@pytest.fixture
def seen(hall: World) -> WorldValidity:
    """Has passed the hall, so that the hall's own things are not looked at again."""
    worlds = WorldValidity("party.scenic")
    worlds.check(hall)
    return worlds


def test_a_robot_that_cannot_be_is_named_on_a_floor_seen_before(seen, hall):
    robots = (hall.robots[0], dataclasses.replace(hall.robots[1], max_speed=-1.0))
    with pytest.raises(WorldError, match=r"party\.scenic: robots\[1\] \(\w+\)\.max_speed is -1"):
        seen.check(dataclasses.replace(hall, robots=robots))


def test_new_furniture_is_named_by_its_place_among_all_furniture(seen, hall):
    x_max, y_max = hall.bounds[2:]
    corner = np.array([[x_max - 0.2, y_max - 0.2], [x_max - 0.1, y_max - 0.2], [x_max, y_max]])
    flat = Furniture(name="rug", kind="rug", polygon=corner, height=-0.5)
    with pytest.raises(WorldError, match=r"furniture\[1\] \(rug\)\.height is -0\.5"):
        seen.check(dataclasses.replace(hall, furniture=(*hall.furniture, flat)))


def test_walls_that_are_new_are_looked_at(seen, hall):
    walls = (*hall.walls[:-1], dataclasses.replace(hall.walls[-1], height=float("nan")))
    with pytest.raises(WorldError, match=r"walls\[\d+\]\.height is nan m; it must be finite"):
        seen.check(dataclasses.replace(hall, walls=walls))


def test_a_refused_world_teaches_nothing(seen, hall):
    bad = (dataclasses.replace(hall.walls[0], height=-1.0), *hall.walls[1:])
    for _ in range(2):
        with pytest.raises(WorldError, match=r"walls\[0\]"):
            seen.check(dataclasses.replace(hall, walls=bad))


def test_a_start_on_new_furniture_is_refused(seen, hall):
    x, y = hall.robots[0].pose[:2]
    outline = np.array([[x - 1, y - 1], [x + 1, y - 1], [x + 1, y + 1], [x - 1, y + 1]])
    under = Furniture(name="crate", kind="crate", polygon=outline, height=1.0)
    with pytest.raises(WorldError, match=r"party\.scenic: robots\[0\].*crate"):
        seen.check(dataclasses.replace(hall, furniture=(*hall.furniture, under)))
