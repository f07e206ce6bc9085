"""Lints find what compiles but does not do what its author expects."""

from __future__ import annotations

import pytest
import scenic

from mrta_falsify.core.candidate import Dimension, SearchSpace
from scenic_worlds.lint import lint_program
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
