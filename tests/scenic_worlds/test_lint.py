"""Lints find what compiles but does not do what its author expects."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest
import scenic

from mrta_falsify.core.candidate import Dimension, SearchSpace
from scenic_worlds.lint import lint_program
from scenic_worlds.lint.misspelt import RUN_PARAMS, WORLD_PARAMS
from scenic_worlds.primitives import randomness
from scenic_worlds.program import compile_program

CLEAN = """\
workspace = Workspace(everywhere)
corridors = RectangularRegion((0, 0), 0, 20, 20)
bed = new Object in corridors, with name 'bed'
param tasks = [(Range(0, 5), 0, 1, 200)]
"""


@pytest.fixture
def lints_of(tmp_path):
    def lint(more: str = "", dimensions: tuple[Dimension, ...] = ()):
        path = tmp_path / "program.scenic"
        path.write_text(CLEAN + more)
        with randomness.seeded(0, "test"):
            scenario = scenic.scenarioFromFile(str(path))
        return lint_program(scenario, path, SearchSpace(dimensions))

    return lint


def test_a_clean_program_has_no_findings(lints_of):
    assert lints_of("require (distance from bed to (0, 0)) > 1\nmutate bed\n") == ()


@pytest.mark.parametrize(
    ("more", "code", "name", "line", "part"),
    [
        (
            "gap = Range(1, 2)\n\nrequire bed.position.x > gap\n",
            "random-only-in-require",
            "gap",
            5,
            "program.scenic:7",
        ),
        (
            "\nparam options = {'speed': Range(0, 1)}\n",
            "random-in-dict",
            "param options",
            6,
            "inside a dict",
        ),
        (
            "param deep = [1, {'a': [Range(0, 1)]}]\n",
            "random-in-dict",
            "param deep",
            5,
            "inside a dict",
        ),
        (
            "new Object with name 'seat', in corridors, with tags {'a': Range(0, 1)}\n",
            "random-in-dict",
            "seat.tags",
            5,
            "inside a dict",
        ),
        (
            "require always (distance from bed to (0, 0)) > 1 as 'clearance'\n",
            "property-as-requirement",
            "clearance",
            5,
            "throws away every run",
        ),
        (
            "require eventually bed.position.x > -100\n",
            "property-as-requirement",
            "require",
            5,
            "--spec stl:FORMULA",
        ),
        (
            "monitor Watch():\n    while True:\n        require bed.position.x > 9\n        wait\n",
            "property-as-requirement",
            "monitor Watch",
            7,
            "inside monitor Watch",
        ),
        (
            "param verifaiSamplerType = 'ce'\n",
            "sampler-ignored",
            "param verifaiSamplerType",
            5,
            "campaign --sampler",
        ),
    ],
)
def test_a_finding_says_what_and_where(lints_of, more, code, name, line, part):
    (found,) = lints_of(more)
    assert (found.code, found.name) == (code, name)
    assert found.where.endswith(f"program.scenic:{line}")
    assert part in found.message


def test_a_mutator_of_the_author_is_found(lints_of):
    (found,) = lints_of(
        "from scenic.core.object_types import Mutator\n"
        "class Shift(Mutator):\n"
        "    def appliedTo(self, obj):\n"
        "        return obj, True\n"
        "class Cart(Object):\n"
        "    mutator[additive]: Shift()\n"
        "cart = new Cart in corridors\n"
        "mutate cart\n"
    )
    assert found.code == "undriven-mutation"
    assert found.where.endswith("program.scenic:12")
    assert "Shift" in found.message


def test_a_value_that_a_parameter_keeps_is_not_lonely(lints_of):
    assert lints_of("gap = Range(1, 2)\nparam gap = gap\nrequire bed.position.x > -gap\n") == ()


def test_a_compiled_and_driven_program_is_linted_alike(tmp_path):
    path = tmp_path / "program.scenic"
    path.write_text(
        "model scenic_worlds.model\n"
        "from scenic.core.object_types import Mutator\n"
        "class Shift(Mutator):\n"
        "    def appliedTo(self, obj):\n"
        "        return obj, True\n"
        "class Cart(Trolley):\n"
        "    mutator[additive]: Shift()\n"
        "new Robot with start_room 0\n"
        "cart = new Cart in corridors\n"
        "mutate cart\n"
        "gap = Range(1, 2)\n"
        "require cart.position.x > -100 * gap\n"
        "param tasks = [(Range(0, 5), 0, 1, 200)]\n"
    )
    program = compile_program(path)
    found = lint_program(program.scenario, path, program.space)
    assert [(lint.code, lint.where) for lint in found] == [
        ("undriven-mutation", f"{path}:10"),
        ("random-only-in-require", f"{path}:11"),
    ]


def test_dimensions_without_an_inverse_map_are_listed_once_each(lints_of):
    names = {"bed.position": "opaque", "bed.width": "range", "cart.mutation": "opaque"}
    dimensions = tuple(Dimension(name=name, kind=kind) for name, kind in names.items())
    (found,) = lints_of(dimensions=dimensions)
    assert (found.code, found.name) == ("opaque-dimension", "bed.position")
    assert found.where.endswith("program.scenic:3")


# --- misspelt names ------------------------------------------------------------------------------

MISSPELT = """\
param layot = 'aws_hospital'
model scenic_worlds.model
class SlowRobot(Robot):
    max_sped: 0.1
    mood: 'calm'
for i in range(2):
    new SlowRobot with start_room i + 1,
        with hieght 0.3
new Robot with start_rooom 2
new Human with route [0, 1], with raects False
new Bed in corridors, with moveable True, with zest 3
cart = new Trolley in corridors, with weight Range(1, 2), with behaviour WaitFor(3)
require cart.weight > 0
new Blockage with durring (3, 4)
param horizn = Range(10, 20)
param gap = 0.3
param used = 0.3
x = Range(0, 1)
param kept = x
require x > 0.1
y = globalParameters.used
param noise = 0.2
param tasks = [(0, 0, 1, 200)]
"""


@pytest.fixture(scope="module")
def misspelt(tmp_path_factory):
    path = tmp_path_factory.mktemp("misspelt") / "program.scenic"
    path.write_text(MISSPELT)
    program = compile_program(path)
    return lint_program(program.scenario, path, program.space)


@pytest.mark.parametrize(
    ("line", "code", "given", "nearest"),
    [
        (1, "unknown-param", "layot", "layout"),
        (4, "unknown-property", "max_sped", "max_speed"),
        (8, "unknown-property", "hieght", "height"),
        (9, "unknown-property", "start_rooom", "start_room"),
        (10, "unknown-property", "raects", "reacts"),
        (11, "unknown-property", "moveable", "movable"),
        (12, "unknown-property", "behaviour", "behavior"),
        (14, "unknown-property", "durring", "during"),
        (15, "unknown-param", "horizn", "horizon"),
        (22, "unknown-param", "noise", "ray_noise"),
    ],
)
def test_a_misspelt_name_is_found_with_its_line_and_the_nearest_one(
    misspelt, line, code, given, nearest
):
    (found,) = [lint for lint in misspelt if lint.name.endswith((f".{given}", f" {given}"))]
    assert found.code == code
    assert found.where.endswith(f"program.scenic:{line}")
    assert f"{nearest!r}" in found.message
    assert "did you mean" in found.message


def test_what_nothing_reads_is_found_though_nothing_is_near(misspelt):
    names = {lint.name: lint for lint in misspelt}
    assert "changes nothing" in names["Bed.zest"].message
    assert "globalParameters.gap" in names["param gap"].message


def test_names_of_the_author_that_the_program_uses_are_no_lints(misspelt):
    assert len(misspelt) == 12
    for name in ("weight", "mood", "used", "kept"):
        assert not [lint for lint in misspelt if lint.name.endswith(name)]


def test_a_library_that_is_imported_lacks_its_model_line(tmp_path):
    path = tmp_path / "program.scenic"
    path.write_text(
        "param horizon = 20\nfrom scenic_worlds.model import *\n"
        "new Robot with start_room 0\nparam tasks = [(0, 0, 1, 200)]\n"
    )
    program = compile_program(path)
    (found,) = lint_program(program.scenario, path, program.space)
    assert (found.code, found.where) == ("no-model-line", f"{path}:2")
    assert "`model scenic_worlds.model`" in found.message


def test_every_global_parameter_that_the_code_reads_is_known():
    root = Path(__file__).parents[2]
    files = [
        *(root / "scenic_worlds").rglob("*.py"),
        *(root / "simulator_interface" / "scenic_bridge").glob("*.py"),
    ]
    read = {name for file in files for name in _params_read(ast.parse(file.read_text()))}
    for file in (root / "scenic_worlds").glob("*.scenic"):
        read.update(re.findall(r"\bglobalParameters\.(\w+)", file.read_text()))
    known = {*WORLD_PARAMS, *RUN_PARAMS}
    assert {name for name in read if not name.startswith("_")} == known


def _params_read(tree):
    """Keys of ``params["x"]`` and ``params.get("x")``."""
    for node in ast.walk(tree):
        holder, key = None, None
        if isinstance(node, ast.Subscript):
            holder, key = node.value, node.slice
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.args:
            holder, key = node.func.value, node.args[0] if node.func.attr == "get" else None
        name = getattr(holder, "attr", getattr(holder, "id", ""))
        if name == "params" and isinstance(key, ast.Constant) and isinstance(key.value, str):
            yield key.value


# --- speeds of robots --------------------------------------------------------------------------

ROBOT = "model scenic_worlds.model\nnew Robot with name 'robot1', with start_room 1{more}\n"


@pytest.fixture
def lints_of_robot(tmp_path):
    def lint(more: str, after: str = ""):
        path = tmp_path / "program.scenic"
        path.write_text(ROBOT.format(more=more) + after + "param tasks = [(0, 1, 2, 150)]\n")
        program = compile_program(path)
        return lint_program(program.scenario, path, program.space)

    return lint


@pytest.mark.parametrize("value", ["1.2", "Range(0.5, 1)"])
def test_a_speed_given_to_a_robot_is_reported_with_the_property_that_is_meant(
    value, lints_of_robot
):
    (lint,) = lints_of_robot(f", with speed {value}")
    assert (lint.code, lint.name) == ("dynamic-property", "Robot.speed")
    assert lint.where.endswith("program.scenic:2")
    assert "changes nothing; did you mean 'max_speed'?" in lint.message


def test_a_turn_rate_given_as_scenics_own_is_reported(lints_of_robot):
    (lint,) = lints_of_robot(", with angularSpeed 0.5")
    assert "did you mean 'max_turn_rate'?" in lint.message


def test_a_speed_given_to_furniture_is_reported_and_one_to_a_person_is_not(lints_of_robot):
    found = lints_of_robot(
        "", "new Trolley in corridors, with speed 1\nnew Human with route [0, 2], with speed 1.2\n"
    )
    assert [(lint.code, lint.name) for lint in found] == [("dynamic-property", "Trolley.speed")]


@pytest.mark.parametrize("value", ["1.2", "Range(0.8, 1.5)"])
def test_a_speed_limit_that_is_never_driven_is_reported(value, lints_of_robot):
    (lint,) = lints_of_robot(f", with max_speed {value}")
    assert (lint.code, lint.name) == ("undriven-speed", "Robot.max_speed")
    assert "cruises at 0.75 m/s at most" in lint.message


@pytest.mark.parametrize(
    "more",
    [
        ", with max_speed 0.5",
        ", with max_speed Range(0.6, 1.5)",
        ", with max_speed 1.2, with cruise_speed 1.5",
        ", with cruise_speed Range(0.5, 1.5)",
    ],
)
def test_a_speed_limit_that_matters_is_not_reported(more, lints_of_robot):
    assert lints_of_robot(more) == ()
