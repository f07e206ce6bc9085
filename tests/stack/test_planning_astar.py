"""A* against SciPy's Dijkstra, against itself, and the shape of its paths."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from mrta_falsify.core.costmap import INSCRIBED, UNKNOWN, Costmap
from mrta_falsify.core.polyline import path_length
from mrta_falsify.core.seeding import stream
from mrta_falsify.stack.planning import search_kernels as kernels
from mrta_falsify.stack.planning.astar import AStar, Options
from mrta_falsify.stack.planning.grid import build_grid

STEPS = [(0, 1), (1, 0), (1, 1), (1, -1)]
costs = arrays(
    np.uint8, (9, 11), elements=st.sampled_from([0, 0, 0, 40, 120, 252, 253, 254, 254, 255])
)


def costmap_of(cost: np.ndarray, resolution: float = 0.05) -> Costmap:
    return Costmap(np.asarray(cost, dtype=np.uint8), resolution, np.array([-1.0, 2.0]))


def random_cost(name: str, rows: int = 60, cols: int = 80) -> np.ndarray:
    """Blocks with inflated seams."""
    random = stream(1, name)
    cost = np.zeros((rows, cols), dtype=np.uint8)
    for _ in range(14):
        r, c = random.integers(0, rows), random.integers(0, cols)
        h, w = random.integers(2, 16, size=2)
        for value, margin in ((120, 4), (200, 2), (253, 0)):
            area = np.s_[max(0, r - margin) : r + h + margin, max(0, c - margin) : c + w + margin]
            cost[area] = np.maximum(cost[area], value)
    return cost


def graph_of(prices: np.ndarray) -> csr_array:
    """The graph that ``kernels`` says it searches, built naively: what each step costs."""
    steps: dict[tuple[int, int], int] = {}
    rows, width = prices.shape
    for r in range(1, rows - 1):
        for c in range(1, width - 1):
            if prices[r, c] == 0:
                continue
            for dr, dc in STEPS:
                if prices[r + dr, c + dc] == 0:
                    continue
                pay = int(prices[r, c]) + int(prices[r + dr, c + dc])
                if dr and dc:
                    if prices[r, c + dc] == 0 or prices[r + dr, c] == 0:
                        continue
                    pay = pay * 181 // 128
                steps[r * width + c, (r + dr) * width + c + dc] = pay
    ends = np.array(list(steps), dtype=int).reshape(-1, 2)
    return csr_array((list(steps.values()), tuple(ends.T)), shape=(prices.size, prices.size))


def costs_to(graph: csr_array, goal: int) -> np.ndarray:
    """Least costs ``(N,)`` from every cell, infinite where there is no way."""
    return dijkstra(graph, directed=False, indices=int(goal))


def new_field(prices: np.ndarray, goal: int):
    cost = np.full(prices.size, -1, dtype=np.int32)  # a cost that is not there yet is not read
    cost[goal] = 0
    return cost, np.zeros(prices.size, dtype=np.uint8), np.array([goal], dtype=np.int32)


def grid_of(cost: np.ndarray, **options):
    defaults = {"resolution": 0.05, "cost_weight": 2.0, "allow_unknown": True}
    return build_grid(costmap_of(cost), **{**defaults, **options})


@settings(max_examples=60, deadline=None)
@given(costs, st.randoms(use_true_random=False))
def test_costs_equal_those_of_dijkstra_whatever_was_asked_before(cost, random):
    prices = grid_of(cost).prices
    graph = graph_of(prices)
    cells = np.flatnonzero(prices).tolist()
    if len(cells) < 2:
        return
    goal = random.choice(cells)
    expected = costs_to(graph, goal)
    found, marks, frontier = new_field(prices, goal)
    for start in random.choices(cells, k=5):
        frontier = kernels.expand(prices, found, marks, frontier, start)
        is_reached = np.isfinite(expected[start])
        assert (marks[start] == kernels.CLOSED) == is_reached
        for cell in np.flatnonzero(marks == kernels.CLOSED):
            assert found[cell] == expected[cell]
        if not is_reached:
            continue
        path = kernels.descend(prices, found, marks, start)
        assert (path[0], path[-1]) == (start, goal)
        both = graph + graph.T
        assert sum(both[a, b] for a, b in itertools.pairwise(path.tolist())) == expected[start]


def test_costs_stay_exact_on_a_long_detour_and_in_a_wide_hall():
    maze = np.zeros((60, 60), dtype=np.uint8)
    maze[3::4, 1:], maze[1::4, :-1] = 254, 254
    maze[maze == 0] = 240  # dear: keys outgrow the first bucket array
    hall = stream(7, "hall").integers(0, 253, size=(110, 110))  # a long frontier
    for cost in (maze, hall):
        prices = grid_of(cost).prices
        goal, start = np.flatnonzero(prices)[[0, -1]]
        found, marks, frontier = new_field(prices, goal)
        kernels.expand(prices, found, marks, frontier, start)
        expected = costs_to(graph_of(prices), goal)
        assert marks[start] == kernels.CLOSED
        assert all(
            found[cell] == expected[cell] for cell in np.flatnonzero(marks == kernels.CLOSED)
        )


@pytest.mark.parametrize("name", ["a", "b", "c"])
def test_a_path_is_the_same_from_a_fresh_field_and_from_one_grown_for_other_starts(name):
    prices = grid_of(random_cost(name)).prices
    free = np.flatnonzero(prices)
    random = stream(2, name)
    goal = int(random.choice(free))
    grown = new_field(prices, goal)
    frontier = grown[2]
    for start in random.choice(free, size=40):
        frontier = kernels.expand(prices, grown[0], grown[1], frontier, start)
        fresh = new_field(prices, goal)
        kernels.expand(prices, *fresh, start)
        is_closed = grown[1][start] == kernels.CLOSED
        assert is_closed == (fresh[1][start] == kernels.CLOSED)
        if is_closed:
            np.testing.assert_array_equal(
                kernels.descend(prices, *grown[:2], start),
                kernels.descend(prices, *fresh[:2], start),
            )


@pytest.mark.parametrize("name", ["d", "e"])
def test_pulling_a_path_taut_never_makes_it_dearer(name):
    prices = grid_of(random_cost(name)).prices
    width = prices.shape[1]
    free = np.flatnonzero(prices)
    random = stream(3, name)
    for _ in range(20):
        start, goal = random.choice(free, size=2)
        cost, marks, frontier = new_field(prices, goal)
        kernels.expand(prices, cost, marks, frontier, start)
        if marks[start] != kernels.CLOSED:
            continue
        cells = kernels.descend(prices, cost, marks, start)
        corners = kernels.pull_taut(prices, cost, cells)
        xy = np.stack([corners % width, corners // width], axis=1) + 0.5
        paid = sum(kernels.line_cost(prices, *a, *b) for a, b in itertools.pairwise(xy))
        assert paid <= kernels.DEARER * cost[start] + 1e-6
        assert len(corners) <= len(cells)


def test_a_line_costs_the_integral_of_the_price_along_it():
    prices = grid_of(random_cost("line")).prices
    random = stream(4, "line")
    for _ in range(50):
        a, b = random.uniform([1, 1], np.array(prices.shape[::-1]) - 1.001, size=(2, 2))
        share = (np.arange(20_000) + 0.5) / 20_000
        on_line = a + share[:, None] * (b - a)
        met = prices[on_line[:, 1].astype(int), on_line[:, 0].astype(int)].astype(float)
        paid = kernels.line_cost(prices, *a, *b)
        if (met == 0).any():
            assert paid == np.inf
        else:
            assert paid == pytest.approx(2 * met.mean() * np.hypot(*(b - a)), rel=2e-3)


def test_a_line_does_not_slip_between_two_blocked_corners():
    prices = grid_of(np.array([[0, 253], [253, 0]])).prices
    assert kernels.line_cost(prices, 1.5, 1.5, 2.5, 2.5) == np.inf
    assert kernels.line_cost(prices, 2.5, 2.5, 1.5, 1.5) == np.inf


def test_points_of_a_path_are_at_most_a_tenth_of_a_metre_apart():
    planner = AStar(Options())
    planner.use(costmap_of(random_cost("far")))
    plan = planner.plan(np.array([-0.97, 2.02]), np.array([2.9, 4.9]))
    steps = np.hypot(*np.diff(plan.path, axis=0).T)
    assert steps.max() <= 0.1 + 1e-9
    assert plan.length == pytest.approx(path_length(plan.path))


def test_a_free_way_is_a_straight_line():
    planner = AStar(Options())
    planner.use(costmap_of(np.zeros((100, 100))))
    start, goal = np.array([-0.7, 2.3]), np.array([3.1, 5.9])
    assert planner.plan(start, goal).length == pytest.approx(np.hypot(*(goal - start)))


def test_a_dear_cell_is_avoided_when_the_way_around_is_cheap():
    cost = np.zeros((40, 40), dtype=np.uint8)
    cost[10:30, 19:21] = 252
    planner = AStar(Options(cost_weight=20.0))
    planner.use(costmap_of(cost))
    planned = planner.plan(np.array([-0.5, 3.0]), np.array([0.5, 3.0]))
    assert (planner_costs(cost, planned.path) == 0).all()
    straight = AStar(Options(cost_weight=0.0))
    straight.use(costmap_of(cost))
    assert straight.plan(np.array([-0.5, 3.0]), np.array([0.5, 3.0])).length == pytest.approx(1.0)


def planner_costs(cost: np.ndarray, path: np.ndarray) -> np.ndarray:
    return costmap_of(cost).cost_at(path)


def test_a_map_that_is_written_into_gives_the_grid_of_what_it_says_now():
    cost = np.zeros((6, 8), dtype=np.uint8)
    assert grid_of(cost).prices[1:-1, 1:-1].all()
    cost[2, 3] = INSCRIBED  # the same array, as a source may keep it
    assert np.argwhere(grid_of(cost).prices[1:-1, 1:-1] == 0).tolist() == [[2, 3]]


def test_a_coarser_grid_blocks_every_cell_that_holds_a_blocked_one():
    cost = random_cost("coarse", 61, 83)
    grid = grid_of(cost, resolution=0.1)
    rows, cols = np.nonzero(cost >= INSCRIBED)
    assert (grid.prices[rows // 2 + 1, cols // 2 + 1] == 0).all()
    assert grid.resolution == 0.1
    centers = grid.points(np.flatnonzero(grid.prices))
    assert (costmap_of(cost).cost_at(centers) < INSCRIBED).all()


def test_a_coarser_planner_gives_paths_that_are_valid_on_the_fine_map():
    costmap = costmap_of(random_cost("d"))
    free = np.argwhere(costmap.cost == 0)
    planner = AStar(Options(resolution=0.1))
    planner.use(costmap)
    found = 0
    for i, j in stream(5, "coarse").choice(len(free), size=(30, 2)):
        plan = planner.plan(*costmap.centers(free[[i, j]]))
        if plan.found:
            found += 1
            assert (costmap.cost_at(plan.path[6:]) < INSCRIBED).all()  # after leaving the start
    assert found > 10


def test_unknown_cells_are_entered_only_where_the_options_allow_it():
    cost = np.zeros((20, 40), dtype=np.uint8)
    cost[:, 18:22] = UNKNOWN
    query = np.array([-0.5, 2.5]), np.array([0.5, 2.5])
    for allow, reason in ((True, ""), (False, "unreachable")):
        planner = AStar(Options(allow_unknown=allow))
        planner.use(costmap_of(cost))
        assert planner.plan(*query).reason == reason


def test_forgetting_goal_fields_changes_no_path():
    costmap = costmap_of(random_cost("f"))
    free = np.argwhere(costmap.cost == 0)
    goals = costmap.centers(free[stream(6, "goals").choice(len(free), size=6)])
    forgetful, keeping = AStar(Options(goal_cache=1)), AStar(Options(goal_cache=100))
    for planner in (forgetful, keeping):
        planner.use(costmap)
    for start in goals[::-1]:
        for goal in goals:
            np.testing.assert_array_equal(
                forgetful.plan(start, goal).path, keeping.plan(start, goal).path
            )


def test_a_robot_between_a_pocket_and_the_open_leaves_to_the_side_of_its_goal():
    cost = np.full((30, 30), INSCRIBED, dtype=np.uint8)
    cost[10:20, 2:8] = 0  # the pocket, nearer to the start
    cost[10:20, 12:28] = 0
    planner = AStar(Options())
    costmap = costmap_of(cost)
    planner.use(costmap)
    start, goal = costmap.centers(np.array([[15, 9], [15, 20]]))
    plan = planner.plan(start, goal)
    assert plan.found
    assert plan.length < 0.7
