"""The bridge and nodes on another vendor's DDS, in C++: each value that goes either way."""

from __future__ import annotations

import contextlib
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("cyclonedds")
pytest.importorskip("rosbags")

from simulator_interface.foreign.dds.bridge import Bridge
from simulator_interface.foreign.dds.bridge_settings import BridgeSettings
from simulator_interface.foreign.dds.domains import ReservedDomain, environment
from simulator_interface.foreign.dds.nodes import Nodes
from tests.foreign.seen_worlds import AHEAD, DT, FURTHER, WALL, tick_seen, world_seen

SOURCE = Path(__file__).with_name("fast_node.cpp")
HEADERS = Path("/usr/include")
TICKS = 300

pytestmark = [
    pytest.mark.long,  # compiles C++
    pytest.mark.skipif(sys.platform != "linux", reason="domains are reserved on Linux"),
    pytest.mark.skipif(
        shutil.which("g++") is None
        or not (HEADERS / "fastdds/dds/topic/TopicDataType.hpp").exists()
        or not (HEADERS / "fastrtps").exists(),  # of version 2
        reason="needs g++ and libfastrtps-dev",
    ),
]


@pytest.fixture(scope="module")
def fast_node(tmp_path_factory):
    program = tmp_path_factory.mktemp("fast") / "fast_node"
    libraries = ["-lfastrtps", "-lfastcdr", "-lpthread"]
    command = ["g++", "-std=c++17", "-O1", str(SOURCE), "-o", str(program), *libraries]
    subprocess.run(command, check=True, timeout=300)
    return program


def answers(program: Path, robots: int, ticks: int) -> list[dict]:
    """Ask the bridge tick after tick."""
    reserved = ReservedDomain(None)
    command = (str(program), str(reserved.number), str(robots))
    settings = BridgeSettings(commands=(command,))
    nodes = Nodes(settings.commands, environment(reserved.number), reserved.hold)
    try:
        with contextlib.closing(
            Bridge(settings, world_seen(robots), reserved.number, nodes)
        ) as bridge:
            return [bridge.step(tick_seen(number, robots)) for number in range(ticks)]
    finally:
        nodes.end()
        reserved.hold.close()


@pytest.mark.parametrize("robots", [1, 6])
def test_fast_dds_reads_each_value_of_a_tick_and_answers_in_the_same_tick(fast_node, robots):
    for number, answer in enumerate(answers(fast_node, robots, TICKS)):
        x = 10.0 * np.arange(robots) + AHEAD * number
        seen = np.full(robots, np.float32(WALL + FURTHER * number))
        time = np.full(robots, number * DT)
        np.testing.assert_allclose(answer["twist"], np.stack([x, seen, time], axis=1), atol=1e-6)
        np.testing.assert_array_equal(answer["goal"], np.stack([x + 1.0, 0.0 * x - 1.0], axis=1))
        assert [robot for robot, _ in answer["paths"]] == list(range(robots))
        for robot, path in answer["paths"]:
            np.testing.assert_array_equal(path, [[x[robot] + 0.5, 0.0], [x[robot] + 1.0, 0.0]])
        # 5 cells are solid, 2 unknown: 5 * 100 - 2
        map_and_frames = "map 4x3 498, robot1/odom to robot1/base_link"
        assert answer["events"] == [{"kind": "seen", "detail": map_and_frames}]


def test_two_runs_give_the_same_answers(fast_node):
    first, second = (answers(fast_node, 3, 50) for _ in range(2))
    for one, other in zip(first, second, strict=True):
        np.testing.assert_equal(one, other)
