"""Priority rules."""

from __future__ import annotations

import numpy as np
import pytest

from mrta_falsify.core.config import Choice
from mrta_falsify.core.errors import InputError
from mrta_falsify.core.protocols import PriorityView
from mrta_falsify.core.registry import build, names


def view(distance):
    n = len(distance)
    return PriorityView(
        time=0.0,
        pose=np.zeros((n, 3)),
        active=np.ones(n, dtype=bool),
        distance_to_goal=np.array(distance, dtype=float),
        waiting_since=np.full(n, np.inf),
    )


@pytest.mark.parametrize("name", names("priority_rule"))
@pytest.mark.parametrize("n", [0, 1, 6, 24])
def test_ranks_are_a_permutation(name, n):
    rule = build("priority_rule", Choice(name))
    ranks = rule.ranks(view(np.full(n, np.inf)))
    assert ranks.dtype == np.int64
    assert sorted(ranks.tolist()) == list(range(n))


def test_largest_robot_number_goes_first_beyond_nine_robots():
    ranks = build("priority_rule", Choice("fixed")).ranks(view(np.zeros(12)))
    assert ranks.tolist() == list(reversed(range(12)))


def test_given_order_goes_first_and_the_others_follow():
    rule = build("priority_rule", Choice("fixed", {"order": [1, 3]}))
    assert rule.ranks(view(np.zeros(4))).tolist() == [3, 0, 2, 1]


def test_doubtful_order_is_refused_in_words():
    with pytest.raises(InputError, match="different robot numbers"):
        build("priority_rule", Choice("fixed", {"order": [1, 1]}))


def test_nearest_to_its_goal_goes_first_and_ties_keep_the_order():
    rule = build("priority_rule", Choice("distance_to_goal"))
    assert rule.ranks(view([5.0, np.inf, 2.0, 5.0])).tolist() == [1, 3, 0, 2]
