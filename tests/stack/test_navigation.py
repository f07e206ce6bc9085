"""The planning service, and the small geometry of ways."""

from __future__ import annotations

import numpy as np
import pytest

from mrta_falsify.core.costmap import LETHAL, Costmap
from mrta_falsify.core.polyline import cut_path, look_along, path_length
from mrta_falsify.core.protocols import Plan
from mrta_falsify.stack.planning_service import PlanningService, ServiceState
from mrta_falsify.stack.resources.crossings import find_crossing, nearest_arc
from mrta_falsify.stack.route import Way

BOX = np.array([[2.0, -1.0], [4.0, -1.0], [4.0, 1.0], [2.0, 1.0]])
LINE = np.array([[0.0, 0.0], [6.0, 0.0]])


def grid(*lethal):
    cost = np.zeros((40, 100), dtype=np.uint8)
    for row, col in lethal:
        cost[row, col] = LETHAL
    return Costmap(cost, 0.1, np.array([0.0, -2.0]))


class Source:
    def __init__(self, bare, crowded):
        self.bare, self.crowded = bare, crowded

    def costmap(self, time, parked):
        return self.crowded if len(parked) else self.bare


class Straight:
    """Plans straight lines; refuses the goals it is told to."""

    def __init__(self, **refused):
        self.refused, self.map = refused, None

    def use(self, costmap):
        self.map = costmap

    def plan(self, start, goal):
        reason = self.refused.get(f"x{goal[0]:.0f}", "")
        if reason:
            return Plan(path=np.zeros((0, 2)), length=np.inf, reason=reason)
        return Plan(path=np.stack([start, goal]), length=float(np.hypot(*(goal - start))))


def service(planner=None, bare=None, crowded=None):
    bare = bare or grid()
    return PlanningService(planner or Straight(), Source(bare, crowded or bare))


def way_to(*xs):
    return Way().head_for(np.array([[x, 0.0] for x in xs]))


def test_a_path_leads_through_the_next_two_waypoints():
    way = service().plan(ServiceState(), way_to(3.0, 5.0, 8.0), np.zeros(2), 0.0)
    assert not way.failed
    np.testing.assert_array_equal(way.path, [[0, 0], [3, 0], [5, 0]])


def test_a_covered_waypoint_is_left_out_for_good():
    planner = Straight(x3="goal-blocked")
    way = service(planner).plan(ServiceState(), way_to(3.0, 5.0, 8.0), np.zeros(2), 0.0)
    assert not way.failed
    np.testing.assert_array_equal(way.route, [[5, 0], [8, 0]])
    np.testing.assert_array_equal(way.path[-1], [8, 0])


def test_an_unreachable_goal_is_typed_and_tried_again_later():
    planner = Straight(x3="unreachable")
    way = service(planner).plan(ServiceState(), way_to(3.0), np.zeros(2), 7.0)
    assert (way.failed, way.plan_at, way.must_plan, len(way.path)) == ("unreachable", 9.0, True, 0)


def test_a_new_route_has_no_path_until_there_is_a_plan():
    way = service().plan(ServiceState(), way_to(3.0), np.zeros(2), 0.0)
    assert len(way.path)
    assert len(way.head_for(np.array([[8.0, 0.0]])).path) == 0


def test_an_obstacle_between_the_corners_of_a_path_is_seen():
    state = ServiceState()
    planner = service(bare=grid((20, 50)))
    way = planner.plan(state, way_to(8.0), np.array([0.1, 0.0]), 0.0)
    assert planner.is_obstructed(state, way, np.array([0.1, 0.0]), 0.0)
    assert not planner.is_obstructed(state, way, np.array([6.0, 0.0]), 0.0)
    assert not planner.is_obstructed(state, way, np.array([4.8, 0.0]), 0.0)  # beside itself


def test_a_halt_is_driven_to_first_and_the_route_is_kept():
    state = ServiceState()
    way = way_to(3.0, 8.0).halt_at(np.array([1.0, 0.5]))
    way = service().plan(state, way, np.zeros(2), 0.0)
    np.testing.assert_array_equal(way.path[-1], [1.0, 0.5])
    way = service().plan(state, way.resumed(), np.zeros(2), 0.0)
    np.testing.assert_array_equal(way.path[-1], [8.0, 0.0])


def test_jitter_does_not_change_who_is_parked():
    state = ServiceState()
    place = np.array([[1.0, 1.0], [4.0, 4.0]])
    state.note_parked(place, np.array([6.0, 1.0]))
    number = state.parked_number
    state.note_parked(place + 0.2, np.array([7.0, 2.0]))
    assert state.parked_number == number
    assert list(state.parked) == [0]
    state.note_parked(place, np.array([0.0, 8.0]))
    assert list(state.parked) == [1]


@pytest.mark.parametrize(
    ("points", "expected"),
    [
        (LINE, (2.0, 4.0)),
        (LINE[:1], (np.inf, np.inf)),
        (np.array([[3.0, 0.0], [6.0, 0.0]]), (0.0, 1.0)),
        (np.array([[0.0, 0.0], [3.0, 0.0]]), (2.0, np.inf)),
        (np.array([[0.0, 3.0], [6.0, 3.0]]), (np.inf, np.inf)),
    ],
)
def test_a_crossing_is_found_to_a_step(points, expected):
    found = find_crossing(points, BOX)
    np.testing.assert_allclose(found, expected, atol=0.11)


def test_the_nearest_place_of_a_way_is_found_within_reach():
    assert nearest_arc(LINE, np.array([3.0, 1.0]), np.inf) == pytest.approx(3.0)
    assert nearest_arc(LINE, np.array([3.0, 1.0]), 2.0) == pytest.approx(2.0)


def test_a_cut_path_has_the_length_asked_for():
    path = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 2.0]])
    for distance in (0.0, 0.4, 1.0, 2.5):
        assert path_length(cut_path(path, distance)) == pytest.approx(distance)
    np.testing.assert_array_equal(cut_path(path, 9.0), path)


def test_a_look_along_a_path_gives_the_rest_and_the_point_ahead():
    rest, x, y, length = look_along(LINE, 2.0, 0.1, 0.5)
    np.testing.assert_allclose(rest, [[2.0, 0.0], [6.0, 0.0]])
    assert np.hypot(x - 2.0, y - 0.1) == pytest.approx(0.5)
    assert length == pytest.approx(4.0)
