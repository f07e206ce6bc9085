"""Waypoints from which a path would come back on itself."""

from __future__ import annotations

import numpy as np
from planning_course import BEFORE, BEHIND, hall, planned

#: a cupboard beside the way: what stands in it is reached from the left only
POCKET = [(4.0, 1.0, 8.0, 1.2), (8.0, 1.0, 8.2, 2.6), (4.0, 2.4, 8.0, 2.6)]


def test_a_waypoint_from_which_the_path_comes_back_is_left_out():
    way = planned(hall(solids=POCKET), BEFORE, [(7.5, 1.8), BEHIND])
    np.testing.assert_array_equal(way.route, [BEHIND])
    assert not (np.hypot(*(way.path - (7.5, 1.8)).T) < 1.0).any()


def test_a_bend_is_no_way_back():
    way = planned(hall(), BEFORE, [(5.0, 2.0), BEHIND])
    np.testing.assert_array_equal(way.route, [(5.0, 2.0), BEHIND])


def test_the_goal_itself_is_never_left_out():
    way = planned(hall(solids=POCKET), BEFORE, [(7.5, 1.8)])
    np.testing.assert_array_equal(way.path[-1], [7.5, 1.8])
