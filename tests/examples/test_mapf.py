"""examples/mapf: robots swap rooms by a plan of places, and the driver follows."""

from __future__ import annotations

import dataclasses
import importlib.util
import sys
from pathlib import Path

import pytest

from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.core.external import ExternalStack
from mrta_falsify.specs.library import build_specifications
from simulator_interface.simulate import simulate

ROOT = Path(__file__).parent.parent.parent
SPECS = ("all_tasks_done", "no_robot_robot_contact", "no_robot_static_contact")

pytestmark = [
    pytest.mark.skipif(sys.platform != "linux", reason="processes are kept on Linux"),
    pytest.mark.skipif(
        importlib.util.find_spec("w9_pathfinding") is None, reason="w9-pathfinding is missing"
    ),
]


def test_robots_that_swap_rooms_deliver_and_the_day_is_the_same_again(hall):
    folder = Path(importlib.util.find_spec("w9_pathfinding").origin).parent.parent
    stack = ExternalStack(
        command=(sys.executable, str(ROOT / "examples/mapf/mapf_stack.py")),
        env={"PYTHONPATH": f"{ROOT / 'simulator_interface/clients'}:{folder}"},
        tick_limit=60.0,
    )
    config = dataclasses.replace(
        StackConfig(), engine=Choice("kinematic"), control_rate=10, stack=stack
    )
    world = dataclasses.replace(hall, humans=(), horizon=120.0)
    outcomes = [
        simulate(world, config, specifications=build_specifications(SPECS)) for _ in range(2)
    ]
    assert [verdict.outcome for verdict in outcomes[0].verdicts] == ["holds"] * len(SPECS)
    assert outcomes[0].trace.digest == outcomes[1].trace.digest
