"""Needless driving, time and calls, compared with a reference stack."""

import dataclasses

import pytest
from frames import Robot, Script, drive
from test_books import DOWN, UP, errand

from mrta_falsify.core import registry
from mrta_falsify.core.errors import InputError
from mrta_falsify.core.fleet import Tells
from mrta_falsify.core.protocols import Comparing, Costs
from mrta_falsify.specs.library import (
    build_specifications,
    default_specifications,
    specification_choice,
)

NAMES = ("costly_way", "costly_time", "costly_calls")
REFERENCE = Costs(way=(20.0, 0.0), time=40.0, calls=6, undelivered=0)


def judged(text: str, script: Script, costs: Costs | None = REFERENCE, **changes):
    (specification,) = build_specifications([text])
    assert isinstance(specification, Comparing)
    if costs is not None:
        specification.compare_with(costs)
    world = script.world()
    specification.start(world, 0.05)
    for frame in script.frames(world):
        specification.update(dataclasses.replace(frame, **changes))
    return specification.verdict()


def wandering(metres: float) -> Script:
    robots = [Robot(drive((0, 0), (metres, 0), 1.0)), Robot((5.0, 5.0))]
    return Script(robots=robots, seconds=metres, signals=lambda t: {"allocator_calls": t // 4})


def test_they_are_off_unless_asked_for():
    assert not set(NAMES) & set(default_specifications())
    assert set(NAMES) <= set(registry.names("specification"))


def test_driving_farther_than_the_factor_allows_is_a_violation():
    assert judged("costly_way", wandering(29.0)).robustness == pytest.approx(0.05, abs=0.01)
    verdict = judged("costly_way", wandering(40.0))
    assert verdict.robustness == pytest.approx(-0.5, abs=0.01)
    assert verdict.violated_at == pytest.approx(30.0, abs=0.2)
    assert verdict.evidence["reference"] == 20.0


def test_options_follow_the_name_in_braces():
    assert not judged("costly_way{factor: 3}", wandering(40.0)).violated
    (chosen,) = build_specifications(["costly_time{reference: [allocator=nearest]}"])
    assert chosen.reference == ("allocator=nearest",)
    with pytest.raises(InputError, match=r"NAME\{option: value"):
        specification_choice("costly_way{factor")


def test_time_counts_until_the_last_delivery():
    one = errand(UP, DOWN, tasks=errand().tasks[:1], seconds=60.0, horizon=60.0)
    assert judged("costly_time", one).robustness == pytest.approx(1.5 - 13.0 / 40.0)
    verdict = judged("costly_time", errand(UP, DOWN, seconds=70.0, horizon=70.0))
    assert verdict.violated_at == pytest.approx(60.0, abs=0.2)


def test_calls_of_the_allocator_are_those_that_the_harness_counts():
    assert not judged("costly_calls", wandering(45.0)).violated
    verdict = judged("costly_calls", wandering(60.0))
    assert (verdict.violated_at, verdict.evidence["run"]) == (pytest.approx(52.0), 15.0)
    uncounted = judged("costly_calls", wandering(60.0), signals={})
    assert uncounted.not_judged == "the allocator's calls were not counted"


def test_a_reference_that_costs_next_to_nothing_counts_as_a_small_job():
    tiny = Costs(way=(0.1, 0.0), time=1.0, calls=1, undelivered=0)
    assert not judged("costly_way", wandering(14.0), tiny).violated
    assert judged("costly_way", wandering(16.0), tiny).violated


@pytest.mark.parametrize("name", NAMES)
def test_what_cannot_be_compared_is_not_judged(name):
    assert judged(name, wandering(5.0), None).outcome == "not_judged"
    lost = dataclasses.replace(REFERENCE, undelivered=2)
    assert "left 2 tasks" in judged(name, wandering(90.0), lost).not_judged
    silent = judged(name, wandering(90.0), tells=Tells(deliveries=False))
    assert silent.not_judged == "the stack does not tell its deliveries"
