"""Who waits for whom: knots and victims of the wait-for graph."""

from __future__ import annotations

import pytest

from mrta_falsify.core.fleet import BlockedBy
from mrta_falsify.specs.deadlock.stuck_groups import stuck_groups
from mrta_falsify.specs.deadlock.wait_graph import awaited_by, edges_by_robot, knots_of, victims_of


def graph(*pairs):
    return edges_by_robot(BlockedBy(i, "barrier", j) for i, j in pairs)


@pytest.mark.parametrize(
    ("pairs", "knots"),
    [
        ([(0, 1), (1, 0)], [(0, 1)]),
        ([(0, 1), (1, 2), (2, 0)], [(0, 1, 2)]),
        ([(0, 1), (1, 0), (2, 1)], [(0, 1)]),  # who waits for a knot is not of it
        ([(0, 1), (1, 0), (1, 2)], [(2,)]),  # an edge leads out of the pair
        ([(0, 2), (1, 2)], [(2,)]),
        ([(0, 1), (1, 0), (2, 3), (3, 2)], [(0, 1), (2, 3)]),
    ],
)
def test_knots_are_components_that_no_edge_leaves(pairs, knots):
    robots = {i for pair in pairs for i in pair}
    assert knots_of(robots, graph(*pairs)) == knots


def test_victims_wait_for_a_member_directly_or_through_others():
    edges = graph((0, 1), (1, 0), (2, 1), (3, 2), (4, 5))
    assert victims_of((0, 1), range(6), edges) == {2, 3}


def test_nobody_waits_for_a_robot_through_a_person():
    edges = edges_by_robot([BlockedBy(0, "human", 1), BlockedBy(1, "barrier", 2)])
    assert awaited_by(0, range(3), edges) == set()


@pytest.mark.parametrize(
    ("freed", "groups"),
    [
        # a pair and one behind it: only the first one's absence lets that one through
        ({0: {1, 2}, 1: {0}, 2: set()}, [((0, 1), (0, 1, 2))]),
        # a root, and a chain behind it
        ({0: {1}, 1: {2}, 2: set()}, [((0,), (0, 1, 2))]),
        # a ring of which each holds the next one only
        ({0: {1}, 1: {2}, 2: {0}}, [((0, 1, 2), (0, 1, 2))]),
        # two who each hold the third
        ({0: {2}, 1: {2}, 2: set()}, [((0,), (0, 2)), ((1,), (1, 2))]),
        # a pair that a root holds is no deadlock of its own
        ({0: {1}, 1: {2}, 2: {1}}, [((0,), (0, 1, 2))]),
    ],
)
def test_members_hold_each_other_and_nobody_holds_them(freed, groups):
    assert stuck_groups(freed, freed) == groups
