"""What every registered specification must do; registering one puts it under this suite."""

import copy
import json
import sys
from pathlib import Path

import pytest

from mrta_falsify.core import registry
from mrta_falsify.core.codec import canonical_json
from mrta_falsify.core.config import Choice
from mrta_falsify.core.protocols import Specification

sys.path.insert(0, str(Path(__file__).parents[1] / "specs"))

from frames import DT, Human, Robot, Script, drive, stop_at

NEEDED = {"stl": {"formula": "always (d_robot > 0.2)"}}


def script() -> Script:
    """Two robots that drive towards each other and stop, and a person."""
    return Script(
        robots=[
            Robot(stop_at(drive((-3, 0), (5, 0), 0.9), 3.0), goal=(5, 0)),
            Robot(stop_at(drive((3, 0), (-5, 0), 0.9), 3.0), goal=(-5, 0)),
        ],
        humans=[Human((0, 2))],
        seconds=6.0,
    )


@pytest.fixture(params=registry.names("specification"))
def specification(request) -> Specification:
    return registry.build("specification", Choice(request.param, NEEDED.get(request.param, {})))


class TestSpecification:
    def test_it_follows_the_protocol(self, specification):
        assert isinstance(specification, Specification)

    def test_a_verdict_can_be_asked_at_any_time(self, specification):
        specification.start(script().world(), DT)
        verdicts = [specification.verdict()]
        for frame in script().frames():
            specification.update(frame)
            if frame.sensed.tick % 40 == 0:
                verdicts.append(specification.verdict())
        for verdict in verdicts:
            assert verdict.robustness == verdict.robustness
            assert abs(verdict.robustness) < float("inf")
            assert verdict.violated == (verdict.robustness < 0.0)
            assert (verdict.violated_at is not None) == verdict.violated

    def test_asking_twice_changes_nothing(self, specification):
        specification.start(script().world(), DT)
        for frame in script().frames():
            specification.update(frame)
        assert canonical_json(specification.verdict()) == canonical_json(specification.verdict())

    def test_the_verdict_is_json(self, specification):
        specification.start(script().world(), DT)
        for frame in script().frames():
            specification.update(frame)
        text = canonical_json(specification.verdict())
        assert "Infinity" not in text
        assert "NaN" not in text
        assert json.loads(text)["spec"]

    def test_starting_again_forgets_the_last_episode(self, specification):
        def run():
            specification.start(script().world(), DT)
            for frame in script().frames():
                specification.update(frame)
            return canonical_json(specification.verdict())

        assert run() == run()

    def test_frames_are_not_changed(self, specification):
        specification.start(script().world(), DT)
        frame = next(iter(script().frames()))
        before = copy.deepcopy(frame.sensed.pose)
        specification.update(frame)
        assert (frame.sensed.pose == before).all()
