"""Lists of neighbours say what a comparison of all pairs says."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mrta_falsify.core.neighbours import FEW, neighbours_within


def of_all_pairs(position, radius):
    apart = position[:, None] - position[None]
    near = (apart**2).sum(axis=2) < radius * radius
    np.fill_diagonal(near, False)
    return [row.nonzero()[0].tolist() for row in near]


def listed(position, radius):
    number, first = neighbours_within(position, radius)
    return [number[first[i] : first[i + 1]].tolist() for i in range(len(position))]


@given(
    st.integers(0, 2**32 - 1),
    st.sampled_from([0, 1, 7, FEW, FEW + 1, 2 * FEW]),
    st.sampled_from([0.3, 3.0, 40.0, np.inf]),
)
@settings(max_examples=80, deadline=None)
def test_neighbours_are_those_of_all_pairs_in_ascending_order(seed, count, radius):
    position = np.random.default_rng(seed).uniform(-10.0, 10.0, (count, 2))
    assert listed(position, radius) == of_all_pairs(position, radius)


def test_a_robot_that_was_taken_far_away_is_alone():
    position = np.zeros((FEW + 1, 2))
    position[:, 0] = np.arange(FEW + 1)
    position[1] = 1e7, -1e7
    assert listed(position, 1.5)[:4] == [[], [], [3], [2, 4]]


@pytest.mark.parametrize("width", [2, 3])
def test_further_columns_are_not_read(width):
    position = np.full((2, width), np.nan)
    position[:, :2] = [[0.0, 0.0], [0.0, 1.0]]
    assert listed(position, 1.5) == [[1], [0]]
