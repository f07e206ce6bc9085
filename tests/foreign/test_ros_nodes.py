"""Nodes of the user's on the stand-in for rclpy: each feature as rclpy's documentation says it."""

from __future__ import annotations

import random
import sys
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rosbags")
pytest.importorskip("greenlet")

from simulator_interface.foreign.ros_nodes.node_stack import NodeGraph, ProgramDied
from simulator_interface.foreign.ros_nodes.ros_programs import Launch
from simulator_interface.foreign.ros_nodes.schedule import WIDEST_PHASE

FOLDER = Path(__file__).with_name("ros_workspace")


@pytest.fixture(autouse=True)
def _own_import_system(monkeypatch):
    """Leave what a graph installs in this process behind."""
    state, legacy = random.getstate(), np.random.get_state()  # noqa: NPY002
    monkeypatch.setattr(sys, "meta_path", list(sys.meta_path))
    monkeypatch.setattr(sys, "argv", list(sys.argv))
    monkeypatch.setattr(np.random, "default_rng", np.random.default_rng)
    known = set(sys.modules)
    yield
    for name in set(sys.modules) - known:
        del sys.modules[name]
    random.setstate(state)
    np.random.set_state(legacy)  # noqa: NPY002


def graph(*targets: str | Launch, seed: int = 0, **params) -> NodeGraph:
    """Make a graph whose programs all start at 1 s, unless ``params`` say otherwise."""
    launches = [
        Launch(name=target, target=f"feature_nodes:{target}") if isinstance(target, str) else target
        for target in targets
    ]
    if "phases" not in params:
        at_once = {f"phase.{launch.name}": WIDEST_PHASE for launch in launches}
        params = {**at_once, **params}
    world = {"seed": seed, "params": params}
    return NodeGraph(world, launches, folders=[str(FOLDER)])


def said(made: NodeGraph, name: str) -> list[str]:
    return [line.text for line in made.program(name).lines if line.level == "info"]


def ran(*targets, until: float = 3.0, **params) -> dict[str, list[str]]:
    made = graph(*targets, **params)
    made.advance(until)
    return {program.launch.name: said(made, program.launch.name) for program in made.programs}


def test_timers_publish_and_are_cancelled():
    lines = ran("listener", "ticker")["listener"]
    assert lines == [f"heard {n} at {1_000_000_000 + n * 100_000_000}" for n in range(1, 6)]


def test_programs_have_their_own_modules():
    first, second = (Launch(name=name, target="feature_nodes:ticker") for name in ("a", "b"))
    lines = ran(first, second)
    assert lines["a"] == lines["b"] == ["made 1"]


def test_a_program_that_sleeps_loses_messages_beyond_the_depth_and_skips_ticks():
    lines = ran("sleeper", "ticker", until=0.75)["sleeper"]
    assert lines[:4] == ["1.10 tick", "1.10 1", "1.45 tick", "1.45 3"]
    assert lines[4:6] == ["1.45 4", "1.50 tick"]


def test_who_comes_late_hears_the_last_message_only_if_both_are_durable():
    assert ran("latched", "late")["late"] == ["durable 0.20000000298023224"]


def test_policies_that_do_not_match_are_said():
    made = graph("fussy")
    made.advance(1.0)
    lines = [line.text for line in made.program("fussy").lines if line.level == "warn"]
    assert lines[0].startswith("incompatible QoS on '/scans': reliability")


def test_services_answer_and_wait_no_longer_than_they_may():
    lines = ran("asking", "server")["asking"]
    assert lines == ["True as asked", "nobody False 1510000000"]


def test_a_call_inside_a_callback_blocks_one_thread_for_ever_and_not_two_groups():
    assert ran("blocked", "server")["blocked"] == ["asks"]
    assert ran("unblocked", "server")["unblocked"] == ["asks", "got as asked"]


def test_callbacks_may_be_coroutines():
    assert ran("coroutines", "server")["coroutines"] == ["awaited False"]


def test_groups_say_what_runs_at_once():
    assert ran("exclusive", until=0.75)["exclusive"] == ["1.6 1 at once", "1.7 1 at once"]
    assert ran("reentrant", until=0.75)["reentrant"] == ["1.6 2 at once", "1.6 1 at once"]


def test_actions_give_feedback_and_results_and_are_refused_and_cancelled():
    assert ran("drives", "sends", until=5.0)["sends"] == [
        "accepted True", "3.0 m left", "2.0 m left", "1.0 m left", "succeeded at 2.6",
    ]  # fmt: skip
    assert ran("drives", "refused", until=5.0)["refused"] == ["accepted False"]
    assert ran("drives", "cancels", until=5.0)["cancels"][-1] == "canceled at 2.1"


def test_parameters_and_names():
    launch = Launch(
        name="configured",
        target="feature_nodes:configured",
        parameters={"names": ["a", "b"], "configured": {"gain": 3.0}},
        remappings={"scan": "front_scan"},
        namespace="robot1",
    )
    assert ran(launch)["configured"] == [
        "3.0 ['a', 'b']",
        "[0.5, 1.0]",
        "2.0 True 2.0",
        "-1.0 False 2.0",
        "fast False 2.0",
        "ParameterNotDeclaredException",
        "/robot1/front_scan",
        "/robot1/configured/state",
        "/robot1/configured",
    ]


def test_transforms_are_chained_interpolated_and_refused():
    lines = ran("sender", "looks_up", until=0.6)["looks_up"]
    assert lines == [
        "11.20 11.15 11.20", "LookupException", "ExtrapolationException",
        "11.40 11.35 11.40", "LookupException", "ExtrapolationException",
    ]  # fmt: skip


def test_threads_of_a_program_run_on_simulated_time():
    assert ran("threaded", "ticker")["threaded"] == ["1.25 True", "1.50 True", "ok False"]


def test_a_program_that_polls_does_not_stop_time():
    lines = ran("polling", "ticker", until=0.55)["polling"]
    assert [line.split()[0] for line in lines] == ["1", "2", "3", "4", "5"]


def test_one_executor_runs_several_nodes():
    assert ran("two_nodes")["two_nodes"][0] == "made 1"
    assert len(ran("two_nodes")["two_nodes"]) == 6


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("broken", "KeyError: 'left'"),
        ("wrong_type", "TypeError: Expected <class"),
        ("int_for_float", "field must be of type 'float'"),
        ("asks", "the stand-in for rclpy has no Node.get_publishers_info_by_topic"),
        ("imports", "the stand-in for ROS 2 has no module rclpy.lifecycle"),
        ("uses_lock", "the stand-in for ROS 2 has no threading.Barrier"),
    ],
)
def test_a_program_that_dies_says_why(name, words):
    made = graph(name)
    with pytest.raises(ProgramDied, match=f"program {name} died"):
        made.advance(1.0)
    assert words in made.program(name).error


def test_an_unknown_dial_is_refused():
    with pytest.raises(ValueError, match="no program is called 'other'; there are ticker"):
        graph("ticker", **{"phase.other": 0.01})


def test_the_schedule_comes_from_the_seed_and_the_dials():
    def heard(**params):
        return tuple(ran("listener", "ticker", **params)["listener"])

    assert heard(phases=0.05, seed=1) == heard(phases=0.05, seed=1)
    assert heard(phases=0.05, seed=1) != heard(phases=0.05, seed=2)
    assert heard(**{"phase.ticker": 0.02})[0] == "heard 1 at 1070000000"
    assert heard(latency_most=0.4, schedule=3) == heard(latency_most=0.4, schedule=3)
