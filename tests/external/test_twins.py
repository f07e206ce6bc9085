"""The same algorithm in Python and in C++, copied by fork and by replay: the same run."""

from __future__ import annotations

import sys

import pytest

from mrta_falsify.specs.library import build_specifications
from simulator_interface.simulate import simulate
from tests.external.lane_worlds import built, lane_config, lane_world

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="processes are kept on Linux")


def run(world, config):
    judges = build_specifications(["no_deadlock", "all_tasks_done"])
    outcome = simulate(
        world,
        config,
        specifications=judges,
        stop=lambda frame: "decided" if judges[0].verdict().violated else "",
    )
    return outcome.trace.digest, outcome.verdicts


@pytest.mark.parametrize(
    "ways",
    [
        pytest.param([("C++", "fork")], marks=pytest.mark.slow),
        pytest.param([("Python", "replay"), ("C++", "replay")], marks=pytest.mark.long),
    ],
)
def test_language_and_way_of_copying_change_nothing(tmp_path, ways):
    program = built(tmp_path) or pytest.skip("there is no C++ compiler")
    world = lane_world(followers=1)
    wanted = run(world, lane_config(None, "fork"))
    deadlock = wanted[1][0]
    assert deadlock.violated
    assert deadlock.evidence["confirmed"]
    held = {*deadlock.evidence["members"], *deadlock.evidence["victims"]}
    assert held >= {"robot1", "robot3"}  # who meet head-on
    for language, branch in ways:
        stack = program if language == "C++" else None
        assert run(world, lane_config(stack, branch)) == wanted
