"""Where robots join their lanes."""

from __future__ import annotations

import numpy as np
import pytest

from mrta_falsify.stack.waypoints import join

WAY = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 5.0]])


@pytest.mark.parametrize(
    ("position", "expected"), [((0.0, 1.0), 2), ((6.0, -1.0), 2), ((11.0, 3.0), 1), ((10, 9), 1)]
)
def test_a_robot_joins_at_the_end_of_the_nearest_leg(position, expected):
    rest = join(WAY, np.array(position))
    np.testing.assert_array_equal(rest, WAY[-expected:])


def test_with_its_origin_a_way_keeps_its_first_waypoint():
    rest = join(WAY, np.array([0.0, -3.0]), np.array([0.0, -4.0]))
    np.testing.assert_array_equal(rest, WAY)


def test_a_single_waypoint_is_always_left():
    np.testing.assert_array_equal(join(WAY[-1:], np.zeros(2)), WAY[-1:])
