"""One layer of the shipped stack in a process of its own."""

from __future__ import annotations

import dataclasses
import sys
from pathlib import Path

import pytest

from mrta_falsify.commands.stacks import load_stack
from mrta_falsify.core.errors import InputError
from mrta_falsify.core.stack_failure import StackLimits
from mrta_falsify.process.budget import Budget
from mrta_falsify.process.watch import Watch, under
from scenic_worlds.layouts import load_world
from simulator_interface.simulate import Outcome, simulate

ROOT = Path(__file__).resolve().parents[2]
LAYER = Path(__file__).with_name("layer.py")

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="processes are kept on Linux")


@pytest.fixture(autouse=True)
def path(monkeypatch):
    monkeypatch.setenv("PYTHONPATH", str(ROOT))


def outside(how: str) -> str:
    return f"exec:{sys.executable} {LAYER} {how}"


def run(*settings: str, seconds: float = 20.0) -> Outcome:
    day = dataclasses.replace(load_world("aws_hospital_day"), horizon=seconds)
    return simulate(day, load_stack(settings=["engine=kinematic", *settings]))


def test_layers_outside_give_the_run_that_they_give_inside():
    usual = run("allocator=in_turn")
    through = run(
        f"allocator={outside('well')}",
        f"queue_policy={outside('well')}",
        f"priority_rule={outside('well')}",
    )
    assert through.trace.digest == usual.trace.digest


@pytest.mark.parametrize(
    ("how", "kind", "message"),
    [
        ("raises", "crash", "the allocator ended by exit code 1"),
        ("twice", "answer", "routes has [0, 'pickup']: no open task, or named twice"),
        ("hangs", "hang", "the allocator did not answer within 2 s"),
        ("hoards", "memory", "the allocator took up more than 0.3 GiB of memory"),
    ],
)
def test_what_a_layer_does_wrong_is_a_verdict_that_names_it(how, kind, message):
    with under(Watch(budget=Budget.of_stack(StackLimits(memory=0.3)))):
        outcome = run(f"allocator={outside(how)}", "allocator.tick_limit=2")
    (verdict,) = outcome.verdicts
    assert verdict.evidence["kind"] == kind
    assert verdict.evidence["layer"] == "allocator"
    assert verdict.evidence["message"] == message


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ("planner=exec:python", "unknown layer that can run by exec: 'planner'"),
        ("allocator=exec:no-such-program", "there is no program 'no-such-program'"),
    ],
)
def test_a_layer_that_cannot_be_is_refused_before_anything_runs(setting, message):
    with pytest.raises(InputError, match=message):
        load_stack(settings=[setting])


def test_a_layer_that_is_not_ready_within_its_own_limit_is_bad_input():
    with pytest.raises(InputError, match=r"was not ready within 0.3 s"):
        run("allocator=exec:sleep 1000", "allocator.start_limit=0.3", seconds=1.0)
