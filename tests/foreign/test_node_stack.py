"""A user's nodes on trial: a launch file, the usual topics, copies, the schedule."""

from __future__ import annotations

import dataclasses
import sys
from pathlib import Path

import pytest

pytest.importorskip("rosbags")
pytest.importorskip("greenlet")

from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.core.errors import ConfigError
from mrta_falsify.core.external import ExternalStack
from mrta_falsify.specs.library import build_specifications
from mrta_falsify.testing.planted import STANDS
from simulator_interface.foreign.ros_nodes.launching import launches_of, read_launch
from simulator_interface.simulate import simulate
from tests.external.lane_worlds import lane_world

ROOT = Path(__file__).resolve().parents[2]
FOLDER = Path(__file__).with_name("ros_workspace")

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="processes are kept on Linux")


def couriers(branch: str = "auto", launch: Path = FOLDER / "couriers.yaml") -> StackConfig:
    stack = ExternalStack(
        command=(sys.executable, "-m", "simulator_interface.foreign.ros_nodes", str(launch)),
        env={"PYTHONPATH": str(ROOT)},
        branch=branch,
    )
    return dataclasses.replace(StackConfig(), engine=Choice("kinematic"), stack=stack)


def one_robot(hall):
    return dataclasses.replace(hall, robots=hall.robots[:1], humans=(), horizon=60.0)


def judged(world, config, *names: str):
    return simulate(world, config, specifications=build_specifications(list(names)))


def test_nodes_deliver_and_are_judged(hall):
    names = ("all_tasks_done", "no_deadlock", "honest_events")
    outcome = judged(one_robot(hall), couriers(), *names)
    told = {verdict.spec: verdict.outcome for verdict in outcome.verdicts}
    assert told == dict.fromkeys(names, "holds")
    again = simulate(one_robot(hall), couriers())
    assert again.trace.digest == outcome.trace.digest


@pytest.mark.slow
def test_the_schedule_is_a_part_of_the_world(hall):
    base = one_robot(hall)
    late = dataclasses.replace(
        base, stack_params={"phase.courier_robot1": 0.09, "latency_most": 0.2}
    )
    digests = [simulate(world, couriers()).trace.digest for world in (base, late, late)]
    assert digests[0] != digests[1] == digests[2]


@pytest.mark.slow
@pytest.mark.parametrize("branch", ["fork", pytest.param("replay", marks=pytest.mark.long)])
def test_two_couriers_that_meet_in_a_lane_are_found_out(branch):
    world = dataclasses.replace(lane_world(), horizon=60.0)
    (found,) = judged(world, couriers(branch), STANDS).verdicts
    assert found.outcome == "violated"
    assert set(found.who) == {"robot1", "robot2"}


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("programs: []", "programs is empty"),
        (
            "programs: [{name: a, target: courier}]",
            "target is 'courier'; it must be MODULE:FUNCTION",
        ),
        ("programs: [{name: a, target: 'a:b', nodes: 3}]", "nodes"),
        ("- a", "must be an object"),
        ("a: [", "is not valid YAML"),
    ],
)
def test_a_launch_file_that_is_none_says_why(text, words, tmp_path):
    path = tmp_path / "launch.yaml"
    path.write_text(text)
    with pytest.raises(Exception, match=r"launch\.yaml") as caught:
        read_launch(path)
    assert words in str(caught.value)


def test_a_program_with_robot_in_it_is_started_for_each(tmp_path):
    path = tmp_path / "launch.yaml"
    path.write_text(
        "programs:\n"
        "- {name: 'c_{robot}', target: 'a:b', parameters: {me: '{robot}', rest: '{others}'}}\n"
        "- {name: all, target: 'a:b', parameters: {names: '{robots}'}}\n"
    )
    made = launches_of(read_launch(path).programs, ["r1", "r2"])
    assert [launch.name for launch in made] == ["c_r1", "c_r2", "all"]
    assert made[1].parameters == {"me": "r2", "rest": ["r1"]}
    assert made[2].parameters == {"names": ["r1", "r2"]}
    twice = read_launch(path).programs[1]
    with pytest.raises(ConfigError, match="2 are named 'all'"):
        launches_of([twice, twice], ["r1"])
