from __future__ import annotations

import numpy as np
import pytest

from mrta_falsify.core.importance import importances


def trials(seed, count=100, dimensions=20, chance=0.3):
    stream = np.random.default_rng(seed)
    points = stream.random((count, dimensions))
    return points, stream.random(count) < chance


def test_dimensions_that_do_nothing_are_rarely_said_to_matter():
    claims = sum(any(i.matters for i in importances(*trials(seed))) for seed in range(100))
    assert claims <= 10  # intervals hold for all dimensions together: 5 on average at most


@pytest.mark.parametrize("levels", [(), (0,) * 3 + (5,) + (0,) * 16])
def test_the_dimension_that_decides_comes_first(levels):
    points, _ = trials(1)
    failed = points[:, 3] >= 0.6
    first, second, *_ = importances(points, failed, levels)
    assert first.dimension == 3
    assert first.matters
    assert first.low > 0.5
    assert first.low <= first.share <= first.high
    assert not second.matters
    assert sum(group.trials for group in first.groups) == 100
    assert sum(group.failures for group in first.groups) == failed.sum()
    assert first.groups[0].failures == 0 < first.groups[-1].failures


def test_a_middle_that_fails_is_found_too():
    points, _ = trials(2)
    failed = np.abs(points[:, 7] - 0.5) < 0.2
    assert importances(points, failed)[0].dimension == 7


def test_too_few_failures_tell_nothing():
    points, _ = trials(3)
    failed = np.arange(100) < 4
    assert importances(points, failed) == ()
    assert importances(points, ~failed) == ()


def test_dimensions_that_never_vary_are_left_out():
    points, failed = trials(4, dimensions=2)
    points[:, 0] = 0.5
    assert [i.dimension for i in importances(points, failed)] == [1]
