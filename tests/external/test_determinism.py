"""A foreign stack is asked the same again, and must answer the same."""

from __future__ import annotations

import dataclasses
import sys
from pathlib import Path

import pytest

from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.core.external import ExternalStack
from mrta_falsify.specs.repeatable import Repeatable
from reports.sentences import violation_sentence
from simulator_interface.external.second_run import Exchange, other_answer
from simulator_interface.external.transcript import read_transcript, write_transcript
from simulator_interface.simulate import simulate

ROOT = Path(__file__).resolve().parents[2]
EVERY = 20  # ticks

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="processes are copied on Linux")


def noisy(source: str, branch: str = "auto", first: int = 0) -> StackConfig:
    stack = ExternalStack(
        command=(
            sys.executable,
            str(Path(__file__).with_name("noisy_stack.py")),
            source,
            f"{first}",
        ),
        folder=str(ROOT),
        env={"PYTHONPATH": str(ROOT)},
        branch=branch,
    )
    return StackConfig(engine=Choice("kinematic"), stack=stack)


def asked(hall, config: StackConfig, **more):
    """Judge 2 s."""
    spec = Repeatable(Repeatable.Options(every=EVERY))
    outcome = simulate(
        dataclasses.replace(hall, horizon=2.0), config, specifications=[spec], **more
    )
    return outcome.verdicts[0], outcome


@pytest.mark.parametrize("branch", ["auto", "fork", "replay"])
def test_a_stack_that_answers_the_same_holds_however_it_is_copied(hall, branch):
    verdict, outcome = asked(hall, noisy("seeded", branch))
    assert verdict.outcome == "holds"
    forks, ticks = 3, len(outcome.trace)  # at ticks 5, 20 and 40
    expected = {"auto": forks + ticks, "fork": forks, "replay": ticks}
    assert verdict.evidence["asked"] == expected[branch]


@pytest.mark.parametrize(
    ("source", "branch", "tick"),
    [
        ("clock", "auto", EVERY),
        ("clock", "fork", EVERY),
        ("clock", "replay", 7),
        ("unseeded", "auto", 7),
        ("thread", "auto", 7),
    ],
)
def test_noise_is_found_and_named_with_its_first_tick_robot_and_field(hall, source, branch, tick):
    verdict, _ = asked(hall, noisy(source, branch, first=7))
    assert verdict.violated
    assert verdict.evidence["tick"] == tick
    assert verdict.violated_at == pytest.approx(tick * 0.05)
    assert (verdict.evidence["field"], verdict.who) == ("twist", (hall.robots[-1].name,))
    sentence = violation_sentence(verdict)
    assert f"(tick {tick})" in sentence
    assert f"twist of {hall.robots[-1].name}" in sentence
    assert "threads, clocks" in sentence


def test_hashes_of_texts_are_no_noise_since_the_harness_fixes_their_seed(hall):
    verdict, _ = asked(hall, noisy("hash"))
    assert verdict.outcome == "holds"


def test_a_fork_hides_an_unseeded_generator_so_a_fresh_process_is_asked_as_well(hall):
    verdict, _ = asked(hall, noisy("unseeded", "fork"))
    assert verdict.outcome == "holds"


@pytest.mark.parametrize("source", ["seeded", "thread"])
def test_a_stack_that_may_not_be_copied_is_not_judged(hall, source):
    verdict, _ = asked(hall, noisy(source, "never"))
    assert verdict.not_judged == "the stack is not copied by replay (branch: never)"


def test_stored_answers_give_the_verdict_again(hall, tmp_path):
    for source in ("seeded", "unseeded"):
        verdict, outcome = asked(hall, noisy(source))
        write_transcript(outcome.transcript, tmp_path / "answers.zip")
        again, _ = asked(
            hall, noisy("no such source"), transcript=read_transcript(tmp_path / "answers.zip")
        )
        assert again == verdict


@pytest.mark.parametrize(
    ("first", "again", "field", "robot", "texts"),
    [
        ({"goal": [[0, 1], [2, 3]]}, {"goal": [[0, 1], [2, 4]]}, "goal", "b", ("[2, 3]", "[2, 4]")),
        ({"paths": []}, {"paths": [[1, [0.0]]]}, "paths", "b", ("nothing", "[0.0]")),
        ({"waits_for": [[0, "b"]]}, {}, "waits_for", "", ("[[0, 'b']]", "nothing")),
        ({"took": 0.1}, {"took": 0.2}, "took", "", ("0.1", "0.2")),
        ({"a": 1, "twist": "x"}, {"a": 2, "twist": "y"}, "twist", "", ("x", "y")),
    ],
)
def test_the_first_field_and_robot_that_differ_are_named(first, again, field, robot, texts):
    found = other_answer(Exchange({"tick": 3, "time": 0.15}, first, again), ["a", "b"])
    assert (found.field, found.robot) == (field, robot)
    assert (found.first, found.again) == texts
    assert (found.tick, found.time) == (3, 0.15)


def test_equal_values_written_otherwise_are_the_same_answer():
    assert other_answer(Exchange({}, {"a": 1, "b": 2.0}, {"b": 2, "a": 1}), ["a"]) is None
