"""A stack is asked the same again in a copy, and must answer the same."""

import dataclasses

import numpy as np
import pytest

from mrta_falsify.core import registry
from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.specs.library import build_specifications
from mrta_falsify.specs.repeatable import Repeatable
from simulator_interface.simulate import simulate

EVERY = 20  # ticks


def asked(hall, controller: str, **more):
    config = StackConfig(
        engine=Choice("kinematic"),
        controller=Choice(f"tests.failing_stacks:{controller}", more),
    )
    spec = Repeatable(Repeatable.Options(every=EVERY))
    world = dataclasses.replace(hall, horizon=3.0)
    outcome = simulate(world, config, specifications=[spec])
    return outcome.verdicts[0], outcome


@pytest.mark.parametrize(
    "controller", ["DrawsRandomly", "DrawsFromNumpy", "LooksAtTheClock", "CountsElsewhere"]
)
def test_answers_that_come_from_elsewhere_are_found(hall, controller):
    verdict, _ = asked(hall, controller)
    assert verdict.violated
    assert verdict.violated_at == 2.0
    assert verdict.evidence["field"] == "command"
    assert verdict.who == (verdict.evidence["robot"],)
    assert verdict.evidence["first"] != verdict.evidence["again"]


def test_memory_within_the_state_is_no_violation(hall):
    verdict, _ = asked(hall, "Remembers")
    assert verdict.outcome == "holds"
    assert verdict.evidence["asked"] == 4


def test_a_stack_that_is_asked_again_goes_on_as_if_it_had_not_been(hall):
    config = StackConfig(engine=Choice("kinematic"))
    world = dataclasses.replace(hall, horizon=3.0)
    spec = Repeatable(Repeatable.Options(every=EVERY))
    with_it = simulate(world, config, specifications=[spec])
    without = simulate(world, config)
    assert with_it.verdicts[0].evidence["asked"] == 4
    assert with_it.trace.digest == without.trace.digest


def test_a_short_episode_is_not_judged(hall):
    world = dataclasses.replace(hall, horizon=3.0)
    config = StackConfig(engine=Choice("kinematic"))
    (verdict,) = simulate(
        world, config, specifications=build_specifications(("repeatable",))
    ).verdicts
    assert verdict.outcome == "not_judged"


def test_a_stack_that_writes_into_its_input_changes_no_truth(hall):
    _, outcome = asked(hall, "WritesIntoItsInput", at=1.0)
    steps = np.linalg.norm(np.diff(outcome.trace.columns["pose"][:, :, :2], axis=0), axis=2)
    assert steps.max() < 0.1


def test_the_first_time_comes_early_and_the_others_seldom():
    spec = Repeatable(Repeatable.Options(every=800))
    spec.start(None, 0.05)
    assert [tick for tick in range(2500) if spec.asks_again(tick)] == [200, 800, 1600, 2400]


def test_the_specification_is_registered():
    assert registry.load("specification", "repeatable") is Repeatable
