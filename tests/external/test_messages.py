"""What a foreign stack is told at the start."""

from __future__ import annotations

import dataclasses
import sys

import pytest

from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.core.external import ExternalStack
from simulator_interface.simulate import simulate

#: prints what it is told in place of answering
PRINTS = """
import sys
from simulator_interface.clients.mrta_stack import serve
def stack(world, harness):
    print(world["params"], [(t["task"], t["arrival"]) for t in world.get("tasks", ())], flush=True)
    sys.exit(3)
serve(stack, name="prints")
"""

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="processes are kept on Linux")


def told(world, **options) -> str:
    stack = ExternalStack(command=(sys.executable, "-c", PRINTS), params={"gain": 1.0}, **options)
    config = dataclasses.replace(StackConfig(), engine=Choice("kinematic"), stack=stack)
    with pytest.raises(Exception, match="before it was ready") as caught:
        simulate(world, config)
    return str(caught.value).partition("printed last: ")[2]


def test_parameters_of_the_world_go_before_those_of_the_file(hall):
    world = dataclasses.replace(hall, stack_params={"gain": 2.0, "latency": 0.5})
    assert told(world).startswith("{'gain': 2.0, 'latency': 0.5}")
    assert told(hall).startswith("{'gain': 1.0}")


def test_tasks_are_told_ahead_only_if_asked_for(hall):
    arrivals = [(number, task.arrival) for number, task in enumerate(hall.tasks)]
    assert told(hall, tasks_ahead=True).endswith(str(arrivals))
    assert told(hall).endswith("[]")
