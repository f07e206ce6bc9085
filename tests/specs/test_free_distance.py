"""Distances along free space, and how many maps of them are kept."""

from __future__ import annotations

import numpy as np
from frames import Robot, Script

from mrta_falsify.core.geometry import rectangle
from mrta_falsify.specs.deadlock.free_distance import MAX_MAPS, FreeDistance


def space() -> FreeDistance:
    """A wall 4 m long between two places."""
    script = Script(robots=[Robot((0.0, -1.0))], walls=[rectangle(4.0, 0.2, (0.0, 0.0))])
    return FreeDistance(script.world())


def way_between(known, position, goal):
    """The way along free space between two points [m]."""
    (cell,) = known.cells_of(position[None])
    return known.map_to(goal).item(cell)


def test_the_way_leads_round_a_wall():
    here, there = np.array([0.0, -1.0]), np.array([0.0, 1.0])
    assert 4.5 < way_between(space(), here, there) < 6.0
    assert way_between(space(), here, here + 0.5) < 0.8


def test_maps_of_goals_long_past_are_let_go_and_made_again():
    known, first = space(), np.array([0.0, 1.0])
    here = np.array([0.0, -1.0])
    before = way_between(known, here, first)
    goals = [
        np.array([x, y]) for x in np.arange(-4.0, 4.0, 0.5) for y in (-3.0, -2.0, 2.0, 3.0, 4.0)
    ]
    for goal in goals:
        way_between(known, here, goal)
    assert len(goals) > MAX_MAPS
    assert len(known._maps) == MAX_MAPS
    assert way_between(known, here, first) == before
