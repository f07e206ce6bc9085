"""What every registered specification must do; registering one puts it under this suite."""

import copy
import json
import sys
from pathlib import Path

import pytest

from mrta_falsify.core import registry
from mrta_falsify.core.codec import canonical_json
from mrta_falsify.core.config import DISPATCHER, STACK_LAYERS, Choice
from mrta_falsify.core.protocols import Specification
from mrta_falsify.core.spec_profile import SpecProfile, profile_of

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


class TestProfile:
    """One record on the class says what others need to know of a specification."""

    @pytest.fixture(params=sorted({*registry.names("specification")} - {*NEEDED}))
    def name(self, request) -> str:
        return request.param

    def test_it_is_on_the_class_and_found_by_name(self, name):
        profile = registry.load("specification", name).profile
        assert isinstance(profile, SpecProfile)
        assert profile_of(name) is profile

    def test_it_says_what_a_violation_means_and_what_is_safe(self, name):
        profile = profile_of(name)
        assert profile.meaning
        assert profile.meaning[0].islower()
        assert not profile.meaning.endswith(".")
        assert profile.scale > 0.0

    def test_its_place_among_violations_of_one_instant_is_its_own(self, name):
        profile = profile_of(name)
        others = {other: profile_of(other).tie for other in registry.names("specification")}
        if profile.role == "outcome" and profile.tie == -1:
            return  # comes after all that is no outcome
        assert [other for other, tie in others.items() if tie == profile.tie] == [name]

    def test_what_it_names_is_there(self, name):
        profile = profile_of(name)
        assert profile.layer in ("", DISPATCHER, *STACK_LAYERS)
        assert profile.part_of in ("", *registry.names("specification"))
        registry.build("specification", Choice(name, dict(profile.in_votes)))

    def test_verdicts_have_the_registered_name(self, name):
        built = registry.build("specification", Choice(name))
        built.start(script().world(), DT)
        assert built.verdict().spec == name

    def test_of_an_unknown_one_only_the_name_can_be_told(self):
        assert profile_of("of_my_own").meaning == "of_my_own is violated"
        assert profile_of("os:system") == SpecProfile(meaning="os:system is violated")


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
