"""The fast checker gives Scenic's own answers, and says who is to blame."""

from __future__ import annotations

import random
from pathlib import Path

import numpy as np
import pytest
import scenic
from scenic.core.distributions import Samplable
from scenic.core.sample_checking import BasicChecker

from mrta_falsify.core.errors import FormatError
from mrta_falsify.core.seeding import stream
from scenic_worlds.checking import FastChecker

PROGRAMS = sorted((Path(__file__).parent / "checker_programs").glob("*.scenic"))
SLOW_TO_CHECK = {"requirements": 10}  # lines of sight take 35 ms


@pytest.fixture(autouse=True)
def _own_randomness():
    """Scenic draws from global generators: give them back as they were."""
    before = random.getstate(), np.random.get_state()  # noqa: NPY002
    yield
    random.setstate(before[0])
    np.random.set_state(before[1])  # noqa: NPY002


@pytest.fixture
def scenario_of(tmp_path):
    """Compiles the text of a program and gives it a fast checker."""

    def compile_text(text: str):
        path = tmp_path / "program.scenic"
        path.write_text(text)
        scenario = scenic.scenarioFromFile(str(path))
        checker = FastChecker()
        scenario.setSampleChecker(checker)
        return scenario, checker

    return compile_text


def seed_scenic(seed: int) -> None:
    numbers = stream(seed, "test_checking")
    random.seed(int(numbers.integers(2**63)))
    np.random.seed(int(numbers.integers(2**32)))  # noqa: NPY002


class Mixture:
    """A sample with every other object of another one."""

    def __init__(self, scenario, old, new):
        self._old, self._new = old, new
        self._kept = {id(item) for item in scenario.objects[::2]}

    def __getitem__(self, key):
        return (self._old if id(key) in self._kept else self._new)[key]

    def __contains__(self, key):
        return key in self._new


@pytest.mark.parametrize("path", PROGRAMS, ids=lambda path: path.stem)
def test_it_accepts_and_rejects_what_scenic_does(path):
    seed_scenic(3)
    scenario = scenic.scenarioFromFile(str(path))
    requirements = scenario.defaultRequirements + scenario.userRequirements
    basic, fast = BasicChecker(initialCollisionCheck=False), FastChecker()
    basic.setRequirements(requirements)
    fast.setRequirements(requirements)
    answers, before = [], None
    for number in range(SLOW_TO_CHECK.get(path.stem, 25)):
        for requirement in scenario.userRequirements:
            requirement.active = random.random() <= requirement.prob
        sample = Samplable.sampleAll(scenario.dependencies)
        samples = [sample] if before is None else [sample, Mixture(scenario, before, sample)]
        before = sample
        for judged in samples:
            expected = basic.checkRequirements(judged) is None
            assert (fast.checkRequirements(judged) is None) == expected, (number, fast.last)
            assert (fast.last is None) == expected
            answers.append(expected)
    assert {True, False} == set(answers), "the program tells nothing: it never or always passes"


def test_the_programs_cover_enough_kinds():
    assert len(PROGRAMS) >= 9


def test_a_collision_names_both_objects_and_is_counted(scenario_of):
    scenario, checker = scenario_of(
        "workspace = Workspace(everywhere)\n"
        "new Object at (Range(0, 0.1), 0, 0), with name 'bed_a'\n"
        "new Object at (Range(0, 0.1), 0.5, 0)\n"
    )
    for _ in range(3):
        checker.checkRequirements(Samplable.sampleAll(scenario.dependencies))
    last = checker.last
    assert last.kind == "collision"
    assert last.objects == scenario.objects
    assert last.message == "bed_a collides with object_2"
    assert checker.counts == {"bed_a collides with object_2": 3}


def test_an_object_outside_its_region_is_named(scenario_of):
    scenario, checker = scenario_of(
        "workspace = Workspace(RectangularRegion((0, 0), 0, 4, 4))\n"
        "new Object at (0, 0, 0)\n"
        "new Object at (Range(3, 4), 0, 0), with name 'stray'\n"
    )
    message = checker.checkRequirements(Samplable.sampleAll(scenario.dependencies))
    assert message == "stray is not inside its region"
    assert checker.last.kind == "containment"
    assert checker.last.objects == (scenario.objects[1],)


def test_a_requirement_of_the_author_is_named_with_its_line_and_objects(scenario_of):
    scenario, checker = scenario_of(
        "workspace = Workspace(everywhere)\n"
        "a = new Object at (Range(0, 1), 0, 0)\n"
        "b = new Object at (Range(5, 6), 0, 0)\n"
        "\n"
        "require b.position.x < 0 as 'b in the west'\n"
    )
    checker.checkRequirements(Samplable.sampleAll(scenario.dependencies))
    last = checker.last
    assert last.kind == "requirement"
    assert last.where == "program.scenic:5"
    assert last.requirement == "b in the west"
    assert last.objects == (scenario.objects[1],)
    assert last.message == "program.scenic:5: requirement 'b in the west' does not hold"


def test_soft_requirements_are_asked_only_when_scenic_chose_them(scenario_of):
    scenario, checker = scenario_of(
        "workspace = Workspace(everywhere)\n"
        "a = new Object at (Range(0, 1), 0, 0)\n"
        "require[0.5] a.position.x > 5\n"
    )
    sample = Samplable.sampleAll(scenario.dependencies)
    (soft,) = scenario.userRequirements
    soft.active = False
    assert checker.checkRequirements(sample) is None
    soft.active = True
    assert "program.scenic:3" in checker.checkRequirements(sample)


def test_what_cannot_be_evaluated_is_an_input_error_with_the_line(scenario_of):
    scenario, checker = scenario_of(
        "workspace = Workspace(everywhere)\n"
        "a = new Object at (Range(0, 1), 0, 0)\n"
        "require a.position.x / 0 > 1\n"
    )
    sample = Samplable.sampleAll(scenario.dependencies)
    with pytest.raises(FormatError, match=r"program\.scenic:3: requirement cannot be evaluated"):
        checker.checkRequirements(sample)


def test_the_same_objects_in_another_region_are_asked_again(scenario_of):
    scenario, checker = scenario_of(
        "from scenic.core.distributions import distributionFunction\n"
        "from scenic.core.regions import Region, RectangularRegion\n"
        "@distributionFunction\n"
        "def hall(size) -> Region:\n"
        "    return RectangularRegion((0, 0), 0, size, size)\n"
        "room = hall(Uniform(3, 30))\n"
        "workspace = Workspace(everywhere)\n"
        "new Object at (4, 0, 0), with regionContainedIn room\n"
    )
    seed_scenic(0)
    drawn = [Samplable.sampleAll(scenario.dependencies) for _ in range(20)]
    answers = [checker.checkRequirements(sample) is None for sample in drawn]
    (container,) = {r.container for r in scenario.defaultRequirements if hasattr(r, "container")}
    assert answers == [sample[container].polygons.area > 20 for sample in drawn]
    assert len(set(answers)) == 2


def test_a_region_with_a_name_is_named(scenario_of):
    scenario, checker = scenario_of(
        "from scenic.core.regions import PolygonalFootprintRegion\n"
        "import shapely\n"
        "ward = PolygonalFootprintRegion(shapely.box(0, 0, 2, 2), name='ward')\n"
        "workspace = Workspace(everywhere)\n"
        "new Object at (Range(3, 4), 0, 0), with name 'stray', with regionContainedIn ward\n"
    )
    message = checker.checkRequirements(Samplable.sampleAll(scenario.dependencies))
    assert message == "stray is not inside its region 'ward'"
    assert checker.counts == {"stray is not inside its region": 1}
