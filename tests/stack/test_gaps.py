"""Gaps that a planner finds wide enough and a barrier does not: a path leads around them."""

from __future__ import annotations

import numpy as np
import pytest
from planning_course import BEFORE, BEHIND, PARKED_RADIUS, hall, planned

from mrta_falsify.core.geometry import rectangle


def crates(gap, *, around=True, at=5.0):
    """A row of crates 0.4 m thick across the hall with a gap on its axis.

    Another gap of 2 m lies 2 m to the north, if there is a way around.
    """
    half = 0.5 * gap
    rows = [(at - 0.2, -3.0, at + 0.2, -half), (at - 0.2, half, at + 0.2, 1.0)]
    return rows if around else [*rows, (at - 0.2, 1.0, at + 0.2, 3.0)]


def crosses_at(way, x=5.0):
    """Where a way crosses the row [m]."""
    k = np.nonzero((way.path[:-1, 0] < x) & (way.path[1:, 0] >= x))[0][0]
    return way.path[k, 1]


def test_a_path_leads_around_a_gap_that_is_too_narrow():
    assert crosses_at(planned(hall(solids=crates(0.35)), BEFORE, [BEHIND])) > 1.0


def test_a_gap_as_wide_as_the_barrier_wants_is_a_way():
    assert abs(crosses_at(planned(hall(solids=crates(0.8)), BEFORE, [BEHIND]))) < 0.4


def test_the_only_way_leads_through_the_gap_all_the_same():
    way = planned(hall(solids=crates(0.35, around=False)), BEFORE, [BEHIND])
    assert not way.failed
    assert abs(crosses_at(way)) < 0.2


@pytest.mark.parametrize("at", [1.2, 8.8])
def test_who_begins_or_ends_in_a_gap_may_be_there(at):
    way = planned(hall(solids=crates(0.35, at=at)), BEFORE, [BEHIND])
    assert abs(crosses_at(way, at)) < 0.2


@pytest.mark.parametrize("angle", np.linspace(0.0, np.pi, 7))
def test_solids_on_one_side_are_no_gap(angle):
    """A path along one crate is the same with and without another one out of its way."""
    crate = [(4.0, -3.0, 6.0, -0.2)]
    step = 0.9 * np.array([np.cos(angle), np.sin(angle)])
    goal = np.array([5.0, 0.2]) + step
    alone = planned(hall(solids=crate), BEFORE, [goal])
    beside = planned(hall(solids=[*crate, (9.0, 1.0, 9.5, 3.0)]), BEFORE, [goal])
    np.testing.assert_array_equal(alone.path, beside.path)


def test_two_gaps_one_after_the_other_are_both_avoided():
    solids = crates(0.35, at=4.0) + crates(0.35, at=6.0)
    way = planned(hall(solids=solids), BEFORE, [BEHIND])
    assert min(crosses_at(way, 4.0), crosses_at(way, 6.0)) > 1.0


def test_who_cannot_avoid_both_takes_the_room_of_others_and_not_the_gap():
    room = rectangle(2.0, 2.0, (5.0, 2.0))
    way = planned(hall(solids=crates(0.35)), BEFORE, [BEHIND], rooms=[room], not_held=(0,))
    assert crosses_at(way) > 1.0


def test_robots_at_rest_in_the_wide_way_are_no_reason_to_take_the_gap():
    parked = [(5.0, 1.3), (5.0, 2.0), (5.0, 2.7)]
    way = planned(hall(solids=crates(0.35)), BEFORE, [BEHIND], parked=parked)
    assert way.through_parked
    assert crosses_at(way) > 1.0


def test_a_robot_at_rest_is_driven_around_where_there_is_room():
    way = planned(hall(), BEFORE, [BEHIND], parked=[(5.0, 0.0)])
    assert not way.through_parked
    assert abs(crosses_at(way)) > 0.5 * PARKED_RADIUS
