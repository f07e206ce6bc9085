"""What the wait-for graph of a report says where a robot waits for nobody."""

from __future__ import annotations

import numpy as np
import pytest

from mrta_falsify.core.arrays import frozen_array
from mrta_falsify.core.world import RobotSpec, World
from reports.wait_graph_drawing import draw_wait_graph


@pytest.mark.parametrize(
    ("cause", "node"), [("stalled", "nothing"), ("no-path", "no way"), ("wall", "solid")]
)
def test_the_node_fits_the_cause(cause, node):
    robot = RobotSpec(name="robot1", pose=frozen_array(np.zeros(3)))
    world = World(name="one", bounds=frozen_array([0.0, 0.0, 4.0, 3.0]), robots=(robot,))
    edge = {"robot": "robot1", "cause": cause, "blocked_by": "", "resource": ""}
    assert f"robot1 waits for {node} ({cause})" in draw_wait_graph([edge], world)
