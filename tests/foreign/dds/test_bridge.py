"""The bridge with nodes on Cyclone DDS in another process: on trial in each coupling, and alone."""

from __future__ import annotations

import dataclasses
import os
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import yaml

pytest.importorskip("cyclonedds")
pytest.importorskip("rosbags")

from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.core.errors import ConfigError, InputError
from mrta_falsify.core.external import ExternalStack
from mrta_falsify.specs.library import build_specifications
from mrta_falsify.specs.repeatable import Repeatable
from mrta_falsify.testing.planted import STANDS
from simulator_interface.foreign.dds.bridge_settings import BridgeSettings, read_settings
from simulator_interface.foreign.dds.domains import ReservedDomain, environment
from simulator_interface.simulate import Outcome, simulate
from tests.external.lane_worlds import ROOT, lane_world

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="domains are reserved on Linux")

MARK = 5.0  # m along the lane at which the nodes stop their robot
SECONDS = 5.0  # simulated


def bridge(folder: Path, **settings) -> StackConfig:
    path = folder / "bridge.yaml"
    path.write_text(yaml.safe_dump(settings))
    stack = ExternalStack(
        command=(sys.executable, "-m", "simulator_interface.foreign.dds", str(path)),
        folder=str(ROOT),
        env={"PYTHONPATH": os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])},
        tick_limit=30.0,
    )
    return StackConfig(stack=stack, engine=Choice("kinematic"))


def nodes(coupling: str) -> list[list[str]]:
    return [[sys.executable, "-m", "tests.foreign.dds.driving_node", coupling, str(MARK), "1"]]


def run(config: StackConfig, *specifications) -> Outcome:
    world = dataclasses.replace(lane_world(head_on=False), horizon=SECONDS)
    return simulate(world, config, specifications=specifications)


@pytest.mark.long
@pytest.mark.parametrize("coupling", ["stepped", "awaited", "paced"])
def test_nodes_drive_a_robot_in_each_coupling_and_the_run_says_which(coupling, tmp_path):
    judge = Repeatable(Repeatable.Options())
    config = bridge(tmp_path, coupling=coupling, commands=nodes(coupling), rate=2.0)
    began = time.monotonic()
    outcome = run(config, judge)
    assert outcome.ended == "horizon"
    assert outcome.coupling == coupling
    x = outcome.trace.columns["pose"][:, 0, 0]
    assert x[0] == pytest.approx(4.5)
    assert MARK <= x[-1] < MARK + 0.2
    verdict = judge.verdict()
    assert not verdict.violated
    if coupling == "stepped":
        assert not verdict.not_judged
    else:
        assert f"coupling of the stack is {coupling}" in verdict.not_judged
    if coupling == "paced":
        assert time.monotonic() - began > SECONDS / 2.0


@pytest.mark.long  # what the test before this one asks of a run, asked of two
def test_stepped_runs_are_equal(tmp_path):
    config = bridge(tmp_path, commands=nodes("stepped"))
    assert run(config).trace.digest == run(config).trace.digest


@pytest.mark.long
def test_a_dispatcher_of_ros_messages_delivers_tasks_while_the_harness_drives(tmp_path):
    config = bridge(
        tmp_path,
        commands=[[sys.executable, "-m", "tests.foreign.dds.fetching_node"]],
        drives="harness",
        says=["deliveries", "goals"],
    )
    world = dataclasses.replace(lane_world(head_on=False, followers=1), horizon=90.0)
    judges = build_specifications(["all_tasks_done", "no_deadlock"])
    outcome = simulate(world, config, specifications=judges)
    assert outcome.ended == "all-tasks-done"
    assert outcome.tasks.completed == outcome.tasks.total == 2
    assert not any(verdict.not_judged or verdict.violated for verdict in outcome.verdicts)


@pytest.mark.long
def test_a_deadlock_of_stepped_nodes_is_confirmed_by_copies_with_nodes_of_their_own(tmp_path):
    config = bridge(
        tmp_path,
        commands=[[sys.executable, "-m", "tests.foreign.dds.fetching_node", "ahead"]],
        says=["deliveries", "goals"],
    )
    (judge,) = build_specifications([STANDS])

    def stop(frame) -> str:
        return "decided" if judge.verdict().violated else ""

    world = dataclasses.replace(lane_world(head_on=True), horizon=60.0)
    outcome = simulate(world, config, specifications=[judge], stop=stop)
    assert outcome.ended == "decided"
    assert judge.verdict().evidence["confirmed"] is True
    assert set(judge.verdict().who) == {"robot1", "robot2"}


@pytest.mark.long
@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"commands": [["sh", "-c", "exit 7"]]}, "sh -c 'exit 7' ended by exit code 7"),
        ({"commands": [["./no-such-node"]]}, "./no-such-node: cannot be started"),
        (
            {"start_limit": 0.3, "domain": 40},
            r"no node was found within 0.3 s \(start_limit\) that publishes /clock_done",
        ),
        (
            {"coupling": "paced", "start_limit": 0.3, "domain": 39},
            r"within 0.3 s \(start_limit\) that publishes any of /robot1/cmd_vel",
        ),
        ({"coupling": "loose"}, "coupling is 'loose'"),
        ({}, "neither commands nor domain is given"),
        ({"domain": 38, "topics": {"odom": "odom"}}, "topics.odom: 'odom' is no name of a topic"),
    ],
)
def test_what_keeps_a_run_from_starting_is_bad_input_in_one_sentence(settings, said, tmp_path):
    with pytest.raises(ConfigError, match=said):
        run(bridge(tmp_path, **settings))


@pytest.mark.long
def test_nodes_that_stop_acknowledging_are_a_failure_of_the_stack(tmp_path):
    both = [*nodes("awaited"), [sys.executable, "-m", "tests.foreign.dds.silent_node"]]
    outcome = run(bridge(tmp_path, commands=both, step_limit=0.5))
    assert outcome.ended == "stack-crashed"
    said = outcome.transcript.failure
    assert said.tick == 3
    assert "clock 0.150 s was not acknowledged on /clock_done within 0.5 s" in said.frames[-1]


def test_a_domain_is_held_by_one_bridge_at_a_time():
    first = ReservedDomain(None)
    with pytest.raises(ConfigError, match=f"domain {first.number} is used by another bridge"):
        ReservedDomain(first.number)
    second = ReservedDomain(None)
    assert second.number != first.number
    second.hold.close()
    first.hold.close()
    again = ReservedDomain(first.number)
    assert again.number == first.number
    again.hold.close()


@pytest.mark.parametrize(
    ("middleware", "is_by_ros"), [("rmw_fastrtps_cpp", True), ("rmw_cyclonedds_cpp", False)]
)
def test_nodes_are_told_once_to_stay_on_this_machine(middleware, is_by_ros, monkeypatch):
    monkeypatch.setenv("RMW_IMPLEMENTATION", middleware)
    monkeypatch.delenv("ROS_LOCALHOST_ONLY", raising=False)
    found = environment(77)
    assert found["ROS_DOMAIN_ID"] == "77"
    assert ("ROS_LOCALHOST_ONLY" in found) is is_by_ros
    assert "127.0.0.1" in found["CYCLONEDDS_URI"]


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"done": []}, "done is empty"),
        ({"domain": 102}, "domain is 102; it must be from 0 to 101"),
        ({"drives": "harness", "topics": {"goal_pose": ""}}, "needs the topic goal_pose"),
        ({"drives": "stack", "topics": {"cmd_vel": ""}}, "needs the topic cmd_vel"),
        ({"rate": 0}, "rate is 0.0; it must be > 0"),
        ({"domian": 3}, "did you mean 'domain'"),
    ],
)
def test_settings_that_cannot_be_are_refused(settings, said, tmp_path):
    path = tmp_path / "bridge.yaml"
    path.write_text(yaml.safe_dump(settings))
    with pytest.raises(InputError, match=said):
        read_settings(path)


def test_an_empty_file_means_the_defaults(tmp_path):
    path = tmp_path / "bridge.yaml"
    path.write_text("")
    assert read_settings(path) == BridgeSettings()


def test_a_command_counts_until_it_is_stale():
    from simulator_interface.foreign.last_values import LastValue
    from simulator_interface.foreign.robot_topics import NANO, RobotTopics, Topics
    from tests.foreign.plain_messages import make
    from tests.foreign.seen_worlds import world_seen

    topics = RobotTopics(world_seen(2), Topics(), make)
    heard = LastValue(topics)
    topic = next(t for t in topics.heard if t.field == "cmd_vel" and t.robot == 1)
    message = make(topic.type)
    message.linear.x = 0.4
    heard.now = 2 * NANO
    heard.take_in(topic, message)
    assert heard.twist(0.5)[:, 0].tolist() == [0.0, 0.4]
    heard.now = round(2.5 * NANO)
    assert heard.twist(0.5)[1, 0] == 0.4
    heard.now += 1
    assert not np.any(heard.twist(0.5))
