"""The shipped stack through the door: the same runs as in process, copies of it included."""

from __future__ import annotations

import dataclasses
import sys
from pathlib import Path

import pytest
import yaml

import mrta_falsify as mf
from mrta_falsify.core import codec
from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.core.external import ExternalStack
from mrta_falsify.core.world import write_world
from mrta_falsify.specs.deadlock.oracle import NoDeadlock
from mrta_falsify.specs.library import build_specifications
from scenic_worlds.writing import write_program
from simulator_interface.external.transcript import read_transcript, write_transcript
from simulator_interface.simulate import Outcome, simulate
from tests.external.lane_worlds import lane_world
from tests.recorded.record import stored_cases, stored_world

ROOT = Path(__file__).resolve().parents[2]

LOOK_AHEAD = 40.0  # s

pytestmark = [
    pytest.mark.slow,  # whole runs
    pytest.mark.skipif(sys.platform != "linux", reason="processes are copied on Linux"),
]


def run(world, config, **more) -> Outcome:
    """Run until a deadlock is claimed, or to the end; copies look ahead for less than usual."""
    oracle = NoDeadlock(NoDeadlock.Options(look_ahead=LOOK_AHEAD))
    judges = (oracle, *build_specifications(["all_tasks_done"]))

    def stop(frame) -> str:
        return "decided" if judges[0].verdict().violated else ""

    return simulate(world, config, specifications=judges, stop=stop, **more)


@pytest.fixture(scope="module")
def in_process():
    """Runs of recorded worlds by the stack in this process, by name."""
    known = {}

    def outcome(name: str, engine: str):
        if (name, engine) not in known:
            world, config = case(name, engine)
            known[name, engine] = run(world, config)
        return known[name, engine]

    return outcome


def case(name: str, engine: str):
    row = next(row for row in stored_cases() if row["name"] == name)
    config = codec.decode(StackConfig, row["stack"], where=name)
    return stored_world(name), dataclasses.replace(config, engine=Choice(engine))


def outside(world, config: StackConfig, folder: Path, branch: str) -> StackConfig:
    write_world(world, folder / "world.json")
    (folder / "stack.yaml").write_text(yaml.safe_dump(codec.encode(config)))
    stack = ExternalStack(
        command=(sys.executable, "-m", "tests.external.shipped_stack"),
        folder=str(ROOT),
        env={"PYTHONPATH": str(ROOT)},
        params={"world": str(folder / "world.json"), "stack": str(folder / "stack.yaml")},
        branch=branch,
        tick_limit=300.0,  # it may compile kernels
    )
    return dataclasses.replace(config, stack=stack)


@pytest.mark.parametrize("branch", ["fork", pytest.param("replay", marks=pytest.mark.long)])
@pytest.mark.parametrize(
    ("name", "engine"),
    [
        ("narrow_pair", "kinematic"),
        pytest.param("closing_doors", "bullet", marks=pytest.mark.long),
        pytest.param("costmap_blind_to_furniture", "kinematic", marks=pytest.mark.long),
    ],
)
def test_the_same_stack_through_the_door_gives_the_same_run(
    in_process, tmp_path, name, engine, branch
):
    world, config = case(name, engine)
    usual = in_process(name, engine)
    found = run(world, outside(world, config, tmp_path, branch))
    assert found.trace.digest == usual.trace.digest
    assert found.verdicts == usual.verdicts


@pytest.mark.long
def test_stored_answers_give_the_run_again_without_the_stack(tmp_path):
    world, config = case("costmap_blind_to_furniture", "kinematic")
    through = outside(world, config, tmp_path, "fork")
    first = run(world, through)
    write_transcript(first.transcript, tmp_path / "answers.zip")
    stack = dataclasses.replace(through.stack, command=("there-is-no-such-program",))
    again = run(
        world,
        dataclasses.replace(through, stack=stack),
        transcript=read_transcript(tmp_path / "answers.zip"),
    )
    assert again.trace.digest == first.trace.digest
    assert again.verdicts == first.verdicts
    assert any(verdict.violated for verdict in again.verdicts)


def test_a_live_replay_names_the_first_tick_that_differs(tmp_path, monkeypatch):
    """A stack that draws noise without a seed is told its answers, but not found the same."""
    monkeypatch.chdir(tmp_path)
    bad = Path(__file__).with_name("bad_stack.py")
    Path("stack.yaml").write_text(
        yaml.safe_dump(
            {
                "engine": "kinematic",
                "stack": {
                    "command": [sys.executable, str(bad), "noise", "30"],
                    "env": {"PYTHONPATH": str(ROOT)},
                    "branch": "never",
                },
            }
        )
    )
    write_program(dataclasses.replace(lane_world(), horizon=5.0), Path("lane.scenic"))
    mf.campaign("lane.scenic", stack="stack.yaml", output="runs", budget=1, executor="serial")
    told, live = mf.replay("runs", 0), mf.replay("runs", 0, live=True)
    assert told.identical
    assert not live.identical
    assert live.difference.tick == 30
    assert live.difference.who == "robot1"
