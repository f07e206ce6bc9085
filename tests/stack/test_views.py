"""What robots see of their ways ahead."""

from __future__ import annotations

import numpy as np

from mrta_falsify.core.polyline import look_along
from mrta_falsify.stack.cruising import Cruise
from mrta_falsify.stack.lookahead import Outlook
from mrta_falsify.stack.route import LOOK_AHEAD, Way

PATH = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 3.0]])


def outlook_of(robots: int, speed: float = 0.75) -> Outlook:
    return Outlook([Cruise(speed, 0.4)] * robots)


def way(path: np.ndarray = PATH) -> Way:
    return Way(route=path[-1:], path=path)


def test_views_are_what_a_look_along_each_path_gives():
    outlook = outlook_of(2)
    for x in (0.3, 0.3, 1.1):  # standing still, then moving
        pose = np.array([[x, 0.1, 0.0], [2.1, x, 1.0]])
        views = outlook.views([way(), way(PATH[::-1].copy())], pose)
        for robot, path in enumerate((PATH, PATH[::-1].copy())):
            rest, target_x, target_y, length = look_along(path, *pose[robot, :2], LOOK_AHEAD)
            np.testing.assert_array_equal(views.rest[robot], rest)
            np.testing.assert_array_equal(views.target[robot], [target_x, target_y])
            assert views.length[robot] == length


def test_a_new_path_is_looked_at_even_from_the_same_place():
    outlook, pose = outlook_of(1), np.array([[0.5, 0.0, 0.0]])
    before = outlook.views([way()], pose)
    after = outlook.views([way(PATH[:2].copy())], pose)
    assert before.length[0] == 4.5
    assert after.length[0] == 1.5


def test_a_robot_without_a_path_or_a_route_has_nothing_ahead():
    views = outlook_of(2).views([Way(), Way(path=PATH)], np.zeros((2, 3)))
    assert [len(rest) for rest in views.rest] == [0, 0]
    assert np.isnan(views.target).all()
    assert np.isinf(views.length).all()


def test_shortening_a_view_leaves_the_next_tick_alone():
    outlook, pose, ways = outlook_of(1), np.array([[0.5, 0.0, 0.0]]), [way()]
    views = outlook.views(ways, pose).shortened({0: 0.4}, pose)
    assert views.length[0] == 0.4
    np.testing.assert_array_equal(views.rest[0][-1], [0.9, 0.0])
    assert outlook.views(ways, pose).length[0] == 4.5


def test_an_empty_fleet_sees_nothing():
    views = outlook_of(0).views([], np.zeros((0, 3)))
    assert views.target.shape == (0, 2)
    assert views.length.shape == (0,)
