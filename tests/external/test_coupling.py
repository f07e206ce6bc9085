"""How tightly a stack is coupled to simulated time: told, kept, shown, and what follows."""

from __future__ import annotations

import dataclasses
import sys

import pytest

import mrta_falsify as mf
from mrta_falsify.commands.run import summarise_run
from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.core.external import ExternalStack
from mrta_falsify.core.world import write_world
from mrta_falsify.specs.library import build_specifications
from mrta_falsify.specs.repeatable import Repeatable
from mrta_falsify.testing.planted import STANDS
from simulator_interface.external.transcript import read_transcript, write_transcript
from simulator_interface.simulate import simulate
from tests.external.lane_worlds import HERE, ROOT, lane_world

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="foreign stacks run on Linux")


def loose(coupling: str) -> StackConfig:
    stack = ExternalStack(
        command=(sys.executable, str(HERE / "loose_stack.py"), coupling),
        env={"PYTHONPATH": str(ROOT)},
    )
    return StackConfig(stack=stack, engine=Choice("kinematic"))


def short(seconds: float):
    return dataclasses.replace(lane_world(), horizon=seconds)


@pytest.mark.parametrize("coupling", ["stepped", "awaited"])
def test_a_run_says_how_its_stack_was_coupled_also_when_it_is_told_again(coupling, tmp_path):
    first = simulate(short(0.5), loose(coupling))
    write_transcript(first.transcript, tmp_path / "answers.zip")
    told = read_transcript(tmp_path / "answers.zip")
    again = simulate(short(0.5), loose(coupling), transcript=told)
    assert first.coupling == again.coupling == coupling
    assert summarise_run(again).coupling == coupling


def test_the_shipped_stack_has_no_coupling():
    config = dataclasses.replace(StackConfig(), engine=Choice("kinematic"))
    assert simulate(short(0.1), config).coupling is None


@pytest.mark.parametrize("coupling", ["awaited", "paced"])
def test_only_a_stepped_stack_is_asked_again(coupling):
    judge = Repeatable(Repeatable.Options())
    simulate(short(0.5), loose(coupling), specifications=[judge])
    assert f"coupling of the stack is {coupling}" in judge.verdict().not_judged


@pytest.mark.slow
@pytest.mark.parametrize(("coupling", "is_confirmed"), [("stepped", True), ("paced", False)])
def test_a_deadlock_is_confirmed_by_copies_of_a_stepped_stack_only(coupling, is_confirmed):
    judges = build_specifications([STANDS])
    simulate(short(60.0), loose(coupling), specifications=judges)
    assert judges[0].verdict().violated is is_confirmed


@pytest.mark.slow
def test_the_report_page_and_the_record_tell_the_coupling(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_world(short(1.0), tmp_path / "lane.json")
    command = f"exec:{sys.executable} {HERE / 'loose_stack.py'} paced"
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    mf.run("lane.json", stack=command, output="out")
    page = (tmp_path / "out" / "report.html").read_text()
    assert "paced: its parts ran by the wall clock" in page
