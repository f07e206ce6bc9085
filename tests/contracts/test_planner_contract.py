"""What every registered planner must do; registering one puts it under this suite."""

from __future__ import annotations

import numpy as np
import pytest

from mrta_falsify.core import registry
from mrta_falsify.core.config import Choice
from mrta_falsify.core.costmap import INSCRIBED, LETHAL, Costmap
from mrta_falsify.core.errors import HarnessError
from mrta_falsify.core.geometry import rectangle
from mrta_falsify.core.polyline import path_length
from mrta_falsify.core.protocols import Plan, Planner
from mrta_falsify.core.seeding import stream
from mrta_falsify.core.world import Wall, World
from simulator_interface.costmap_layers import build_costmap

NAMES = registry.names("planner")
CORNERS = [(-3.5, -2.0), (3.3, 2.0), (-3.0, 2.0), (0.0, -2.0), (0.9, 0.3), (3.3, 0.0)]


def walls_around(center: tuple[float, float], size: float) -> list[np.ndarray]:
    x, y = center
    return [
        rectangle(size, 0.1, (x, y - size / 2)),
        rectangle(size, 0.1, (x, y + size / 2)),
        rectangle(0.1, size, (x - size / 2, y)),
        rectangle(0.1, size, (x + size / 2, y)),
    ]


def hall(*more: np.ndarray) -> Costmap:
    """8 m x 5 m, a dividing wall with a doorway 1.1 m wide, and a closed closet."""
    solids = [
        rectangle(0.1, 3.0, (0.5, -1.0)),
        rectangle(0.1, 1.0, (0.5, 2.0 + 0.1)),
        *walls_around((3.0, -1.5), 1.5),
        *more,
    ]
    walls = tuple(Wall(name=f"w{i}", polygon=polygon) for i, polygon in enumerate(solids))
    return build_costmap(World(name="hall", bounds=np.array([-4.0, -2.5, 4.0, 2.5]), walls=walls))


def points_along(plan: Plan) -> np.ndarray:
    """The path, sampled every 5 mm."""
    steps = [
        a + (b - a) * np.linspace(0.0, 1.0, 2 + int(np.hypot(*(b - a)) / 0.005))[:, None]
        for a, b in zip(plan.path[:-1], plan.path[1:], strict=True)
    ]
    return np.concatenate(steps)


def pairs() -> list[tuple[np.ndarray, np.ndarray]]:
    return [(np.array(a), np.array(b)) for a in CORNERS for b in CORNERS if a != b]


@pytest.fixture(scope="module")
def empty_hall() -> Costmap:
    return hall()


@pytest.mark.parametrize("name", NAMES)
class TestPlanner:
    def build(self, name: str, costmap: Costmap | None = None) -> Planner:
        planner = registry.build("planner", Choice(name))
        if costmap is not None:
            planner.use(costmap)
        return planner

    def test_it_offers_the_protocol(self, name):
        assert isinstance(self.build(name), Planner)

    def test_a_path_leads_from_the_start_to_the_goal(self, name, empty_hall):
        planner = self.build(name, empty_hall)
        for start, goal in pairs():
            plan = planner.plan(start, goal)
            assert plan.found
            assert plan.reason == ""
            np.testing.assert_array_equal(plan.path[0], start)
            np.testing.assert_array_equal(plan.path[-1], goal)
            assert plan.length == pytest.approx(path_length(plan.path))
            assert np.hypot(*(goal - start)) - 1e-9 <= plan.length < 20.0

    def test_a_path_never_enters_a_cell_where_the_robot_would_touch(self, name, empty_hall):
        planner = self.build(name, empty_hall)
        for start, goal in pairs():
            on_way = points_along(planner.plan(start, goal))
            assert (empty_hall.cost_at(on_way) < INSCRIBED).all()

    def test_a_plan_does_not_depend_on_what_was_asked_before(self, name, empty_hall):
        queries = pairs()
        first = self.build(name, empty_hall)
        expected = [first.plan(*query).path for query in queries]
        order = stream(0, "order").permutation(len(queries))
        second = self.build(name, hall(rectangle(0.5, 0.5, (-2.0, 0.0))))
        second.plan(*queries[0])
        second.use(empty_hall)
        for i in order:
            np.testing.assert_array_equal(second.plan(*queries[i]).path, expected[i])
        for i in order[::5]:
            fresh = self.build(name, empty_hall)
            np.testing.assert_array_equal(fresh.plan(*queries[i]).path, expected[i])

    def test_a_goal_behind_walls_is_unreachable_and_the_others_are_not(self, name, empty_hall):
        planner = self.build(name, empty_hall)
        plan = planner.plan(np.array([-3.5, -2.0]), np.array([3.0, -1.5]))
        assert not plan.found
        assert plan.path.shape == (0, 2)
        assert plan.length == np.inf
        assert plan.reason == "unreachable"
        assert planner.plan(np.array([-3.5, -2.0]), np.array([3.3, 2.0])).found

    def test_a_robot_locked_in_gets_a_typed_answer(self, name, empty_hall):
        plan = self.build(name, empty_hall).plan(np.array([3.0, -1.5]), np.array([3.3, 2.0]))
        assert plan.reason == "unreachable"

    def test_a_goal_inside_an_obstacle_is_refused_and_one_near_it_is_moved(self, name, empty_hall):
        planner = self.build(name, empty_hall)
        start = np.array([-3.5, -2.0])
        block = hall(rectangle(1.2, 1.2, (-2.0, 1.0)))
        planner.use(block)
        assert planner.plan(start, np.array([-2.0, 1.0])).reason == "goal-blocked"
        close = np.array([-2.0, 0.3])  # 0.1 m from its side
        plan = planner.plan(start, close)
        assert plan.found
        assert np.hypot(*(plan.path[-1] - close)) <= 0.25 + 1e-9
        assert block.cost_at(plan.path[-1]) < INSCRIBED

    @pytest.mark.parametrize("place", [(9.0, 0.0), (np.nan, 0.0), (-np.inf, 1.0)])
    def test_a_place_outside_the_map_is_blocked(self, name, empty_hall, place):
        planner = self.build(name, empty_hall)
        inside = np.array([-3.5, -2.0])
        assert planner.plan(inside, np.array(place)).reason == "goal-blocked"
        assert planner.plan(np.array(place), inside).reason == "start-blocked"

    def test_a_robot_pushed_against_a_wall_gets_away_on_its_own_side(self, name, empty_hall):
        planner = self.build(name, empty_hall)
        start, goal = np.array([0.38, -1.5]), np.array([-3.5, -2.0])  # 0.07 m from the wall
        plan = planner.plan(start, goal)
        assert plan.found
        np.testing.assert_array_equal(plan.path[0], start)
        on_way = points_along(plan)
        cost = empty_hall.cost_at(on_way)
        assert (cost < LETHAL).all()
        left = np.hypot(*(on_way - start).T) > 0.5
        assert (cost[left] < INSCRIBED).all()
        assert plan.length < 4.5

    def test_a_robot_inside_an_obstacle_without_a_way_out_is_start_blocked(self, name):
        costmap = hall(rectangle(2.0, 2.0, (-2.0, 0.0)))
        plan = self.build(name, costmap).plan(np.array([-2.0, 0.0]), np.array([-3.5, -2.0]))
        assert plan.reason == "start-blocked"

    def test_standing_at_the_goal_is_a_path_of_length_0(self, name, empty_hall):
        here = np.array([-3.0, 2.0])
        plan = self.build(name, empty_hall).plan(here, here)
        assert plan.found
        assert plan.length == 0.0

    def test_planning_without_a_costmap_is_our_own_mistake(self, name):
        with pytest.raises(HarnessError, match="call use"):
            self.build(name).plan(np.zeros(2), np.ones(2))

    def test_arguments_are_not_changed(self, name, empty_hall):
        start, goal = np.array(CORNERS[0]), np.array(CORNERS[1])
        before = empty_hall.cost.copy()
        self.build(name, empty_hall).plan(start, goal)
        assert (start.tolist(), goal.tolist()) == ([*CORNERS[0]], [*CORNERS[1]])
        np.testing.assert_array_equal(empty_hall.cost, before)
