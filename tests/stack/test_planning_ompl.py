"""The door to OMPL: its options, its silence, its random numbers."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from mrta_falsify.core import registry
from mrta_falsify.core.config import Choice
from mrta_falsify.core.costmap import INSCRIBED, Costmap
from mrta_falsify.core.errors import InputError
from mrta_falsify.stack.planning.ompl import Ompl, Options

START, GOAL = np.array([0.3, 0.3]), np.array([3.7, 0.3])


def room_with_a_wall() -> Costmap:
    cost = np.zeros((80, 80), dtype=np.uint8)
    cost[:60, 38:42] = 254
    cost[:62, 34:46][cost[:62, 34:46] == 0] = INSCRIBED
    cost[:66, 30:50][cost[:66, 30:50] == 0] = 100
    return Costmap(cost, 0.05, np.zeros(2))


@pytest.mark.parametrize("algorithm", ["BITstar", "RRTConnect", "RRTstar", "InformedRRTstar"])
def test_every_algorithm_finds_a_valid_way_and_repeats_it(algorithm):
    costmap = room_with_a_wall()
    paths = []
    for _ in range(2):
        planner = Ompl(Options(algorithm=algorithm, iterations=500))
        planner.use(costmap)
        planner.plan(GOAL, np.array([3.0, 3.5]))  # draws random numbers in between
        paths.append(planner.plan(START, GOAL).path)
    np.testing.assert_array_equal(*paths)
    assert (costmap.cost_at(paths[0]) < INSCRIBED).all()


def test_inflated_cells_are_avoided_where_there_is_another_way():
    planner = Ompl(Options())
    costmap = room_with_a_wall()
    planner.use(costmap)
    path = planner.plan(START, GOAL).path
    assert (costmap.cost_at(path) == 0).all()


def test_a_passage_that_is_inflated_all_over_is_used_in_need():
    costmap = room_with_a_wall()
    cost = costmap.cost.copy()
    cost[66:, 38:42] = 100
    planner = Ompl(Options())
    planner.use(Costmap(cost, 0.05, costmap.origin))
    assert planner.plan(START, GOAL).found


def test_an_unknown_algorithm_is_refused_with_the_known_ones():
    with pytest.raises(InputError, match="algorithm is 'RTT'; it must be one of 'BITstar'"):
        registry.build("planner", Choice("ompl", {"algorithm": "RTT"}))


def test_planning_prints_nothing(tmp_path):
    program = (
        "import numpy as np\n"
        "from mrta_falsify.core.costmap import Costmap\n"
        "from mrta_falsify.stack.planning.ompl import Ompl, Options\n"
        "planner = Ompl(Options())\n"
        "planner.use(Costmap(np.zeros((40, 40), np.uint8), 0.1, np.zeros(2)))\n"
        "for x in (1.0, 2.0, 3.0):\n"
        "    assert planner.plan(np.array([0.5, 0.5]), np.array([x, 3.0])).found\n"
    )
    ran = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True, cwd=tmp_path
    )
    assert ran.stdout == ""
    assert ran.stderr == ""
