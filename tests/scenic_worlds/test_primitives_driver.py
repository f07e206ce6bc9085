"""A whole program driven from the unit cube: names, order, distribution, dependence."""

from __future__ import annotations

import os
import random
import subprocess
import sys

import numpy as np
import pytest
from scipy.stats import ks_2samp

from scenic_worlds.program import compile_program

pytestmark = pytest.mark.filterwarnings("ignore")

EVERYTHING = """
import math
yard = CircularRegion((0, 0), 5)
workspace = Workspace(everywhere)
shared = Range(0.5, 0.8)

class Thing(Object):
    kind: 'thing'
    allowCollisions: True

ego = new Thing with name 'first', in yard, facing Range(0, 360) deg, with width shared
new Thing at (Range(1, 2), Normal(0, 3)), with length shared,
    with height TruncatedNormal(1, 2, 0.5, 2)
new Thing with kind 'bed', on PolylineRegion([(0, 0), (4, 0), (4, 4)])
new Thing in CircularRegion((0, 0), Range(1, 2)), with colour Uniform('red', 'green', 'blue')
new Thing at (20, 20), with weight Discrete({1: 3, 2: 1})
mutate ego

param horizon = Range(500, 600)
param tasks = [(0, DiscreteRange(2, 5), Range(1, 2) + Range(3, 4))]
param pair = (Range(0, 1), Uniform(Range(0, 1), 7))
only_required = Range(0, 1)
require only_required > -1
"""

NAMES = [
    "first.position.0",
    "first.position.1",
    "first.width",
    "first.yaw",
    "thing_2.height",
    "thing_2.position.x",
    "thing_2.position.y",
    "bed_1.position",
    "thing_3.position.0",
    "thing_3.position.1",
    "thing_3.colour",
    "thing_3.position.region",
    "thing_4.weight",
    "param horizon",
    "tasks[0][1]",
    "tasks[0][2]",
    "tasks[0][2]#2",
    "param pair[0]",
    "param pair[1]",
    "param pair[1][0]",
    "only_required",
    "first.mutation.yaw",
    "first.mutation.x",
    "first.mutation.y",
]


def driver_of(text: str):
    import scenic

    from scenic_worlds.primitives.driver import Driver

    return Driver(scenic.scenarioFromString(text))


def values_at(driver, u):
    sample = driver.begin()
    sample.move(u, 0)
    return sample.values


def numbers_of(driver, values) -> dict[str, float]:
    """Everything that a scene has, as numbers."""
    found = {}
    for thing, name in driver.names.items():
        made = values[thing]
        found |= {f"{name}.{i}": float(made.position[i]) for i in range(3)}
        found[f"{name}.yaw"] = float(made.yaw)
        found |= {f"{name}.{p}": float(getattr(made, p)) for p in ("width", "length", "height")}
        colour = getattr(made, "colour", "red")
        found[f"{name}.colour"] = float(["red", "green", "blue"].index(colour))
        found[f"{name}.weight"] = float(getattr(made, "weight", 0))
    for name, value in driver.scenario.params.items():
        flat = np.ravel(np.array(values[value], dtype=float)) if name in ("horizon", "pair") else []
        found |= {f"{name}{i}": float(v) for i, v in enumerate(flat)}
    for i, entry in enumerate(values[driver.scenario.params["tasks"]][0]):
        found[f"task{i}"] = float(entry)
    return found


@pytest.fixture(scope="module")
def everything():
    return driver_of(EVERYTHING)


def test_dimensions_are_named_after_object_and_property(everything):
    assert [dimension.name for dimension in everything.space.dimensions] == NAMES


def test_dimensions_have_kinds_and_bounds(everything):
    found = {d.name: (d.kind, d.low, d.high, d.choices) for d in everything.space.dimensions}
    assert found["first.width"] == ("range", 0.5, 0.8, 0)
    assert found["thing_2.position.y"] == ("normal", None, None, 0)
    assert found["thing_2.height"] == ("normal", 0.5, 2.0, 0)
    assert found["thing_3.colour"] == ("choice", None, None, 3)
    assert found["tasks[0][1]"] == ("integer", 2.0, 5.0, 4)
    assert found["bed_1.position"] == ("point", 0.0, 8.0, 0)
    assert found["first.mutation.x"][0] == "normal"
    assert {kind for kind, *_ in found.values()} == {
        "range",
        "normal",
        "point",
        "choice",
        "integer",
    }


def test_values_are_known_where_they_are_plain_and_equally_likely(everything):
    values = {d.name: d.values for d in everything.space.dimensions if d.choices}
    assert values == {
        "thing_3.colour": ("'red'", "'green'", "'blue'"),
        "thing_4.weight": (),  # 3 to 1
        "tasks[0][1]": ("2", "3", "4", "5"),
        "param pair[1]": (),  # one of them is random
    }


def test_uniform_coordinates_give_the_distribution_that_scenic_samples(everything):
    import scenic

    draws = np.random.default_rng(5)
    k = len(everything.space)
    ours = [numbers_of(everything, values_at(everything, draws.random(k))) for _ in range(300)]
    plain = driver_of(EVERYTHING)  # for its names; the scenario below is not driven
    scenario = scenic.scenarioFromString(EVERYTHING)
    plain.names = dict(zip(scenario.objects, plain.names.values(), strict=True))
    plain.scenario = scenario
    theirs = []
    before = random.getstate(), np.random.get_state()  # noqa: NPY002
    random.seed(1)
    np.random.seed(1)  # noqa: NPY002
    for _ in range(300):
        scene, _ = scenario.generate(maxIterations=1)
        theirs.append(numbers_of(plain, scene.sample))
    random.setstate(before[0])
    np.random.set_state(before[1])  # noqa: NPY002
    compared = 0
    for name in ours[0]:
        a, b = (np.array([entry[name] for entry in side]) for side in (ours, theirs))
        if np.ptp(b) == 0:
            np.testing.assert_array_equal(a, b)
            continue
        compared += 1
        assert ks_2samp(a, b).pvalue > 1e-3 / 25, name
    assert compared >= 19


def test_a_coordinate_changes_only_what_depends_on_it(everything):
    depends = {
        "first.width": {"first.width", "thing_2.length"},
        "thing_2.position.x": {"thing_2.0"},
        "thing_3.position.region": {"thing_3.0", "thing_3.1"},
        "thing_3.colour": {"thing_3.colour"},
        "first.mutation.x": {"first.0"},
        "first.yaw": {"first.yaw"},
        "tasks[0][2]": {"task2"},
        "only_required": set(),
    }
    u = np.full(len(everything.space), 0.31)
    before = numbers_of(everything, values_at(everything, u))
    for name, expected in depends.items():
        nudged = u.copy()
        nudged[NAMES.index(name)] = 0.87
        after = numbers_of(everything, values_at(everything, nudged))
        assert {key for key in after if after[key] != before[key]} == expected, name


def test_moving_a_sample_gives_what_computing_it_afresh_gives(everything):
    draws = np.random.default_rng(2)
    k = len(everything.space)
    u = draws.random(k)
    sample = everything.begin()
    sample.move(u, everything.all_units)
    for _ in range(20):
        units = int(draws.integers(1, everything.all_units))
        u = np.where(everything.coordinates(units), draws.random(k), u)
        sample.move(u, units)
        fresh = numbers_of(everything, values_at(everything, u))
        assert numbers_of(everything, sample.values) == fresh


def test_objects_are_built_as_scenic_builds_them(everything):
    from scenic.core.object_types import Object

    values = values_at(everything, np.full(len(everything.space), 0.4))
    for thing in everything.names:
        if thing.mutationScale:
            continue
        quick, slow = values[thing], Object.sampleGiven(thing, values)
        ours, theirs = (object.__getattribute__(item, "__dict__") for item in (quick, slow))
        assert ours.keys() == theirs.keys()
        for name in ours.keys() - {"_dynamicProxy", "_conditioned"}:
            assert ours[name] is theirs[name] or ours[name] == theirs[name], name


def test_a_distribution_of_the_users_own_gets_an_opaque_coordinate():
    driver = driver_of(
        """
from scenic.core.distributions import Distribution
import random
class Dice(Distribution):
    def __init__(self):
        super().__init__(valueType=float)
    def sampleGiven(self, value):
        return random.randint(1, 6)
new Object with pips Dice(), with name 'o'
"""
    )
    assert [(d.name, d.kind) for d in driver.space.dimensions] == [("o.pips", "opaque")]
    thing = next(iter(driver.names))
    state = random.getstate()
    pips = [values_at(driver, np.array([u]))[thing].pips for u in np.linspace(0, 1, 60)]
    again = [values_at(driver, np.array([u]))[thing].pips for u in np.linspace(0, 1, 60)]
    assert pips == again
    assert set(pips) == {1, 2, 3, 4, 5, 6}
    assert random.getstate() == state


def test_one_range_in_two_places_is_one_dimension():
    driver = driver_of("x = Range(0, 1)\nnew Object at (x, x), with name 'o'")
    assert len(driver.space) == 1


@pytest.mark.slow
def test_dimensions_come_in_the_same_order_whatever_the_hash_seed(everything):
    code = (
        "import sys; sys.path.insert(0, 'tests/scenic_worlds')\n"
        "import test_primitives_driver as t\n"
        "text = t.EVERYTHING + '\\n'.join(f'v{i} = Range({i}, 50)\\nrequire v{i} > -1' "
        "for i in range(30))\n"
        "print(*(d.name for d in t.driver_of(text).space.dimensions), sep='|')"
    )
    found = set()
    for seed in ("1", "77"):
        env = {**os.environ, "PYTHONHASHSEED": seed}
        done = subprocess.run(
            [sys.executable, "-c", code], env=env, capture_output=True, text=True, check=True
        )
        found.add(done.stdout.strip().splitlines()[-1])
    assert len(found) == 1
    assert "only_required|v0|v1|v2|" in found.pop()


@pytest.mark.parametrize(
    ("text", "name", "told"),
    [
        ("new Bed at (4, 4), facing Uniform(0, 90) deg", "yaw", ["0 deg", "90 deg"]),
        ("new Bed at (4, 4), facing Uniform(0 deg, 90 deg)", "yaw", ["0 deg", "90 deg"]),
        ("new Bed at (4, 4), facing Uniform(0, 1) * 90 deg", "yaw", ["option 0", "option 1"]),
        ("new Bed at (4, 4), with active Uniform(True, False)", "active", [True, False]),
        ("new Bed at (4, 4), with length Discrete({1: 3, 2: 1})", "length", [1, 2]),
        ("new Bed at (4, 4), with length Uniform(1, 2) * 0.9", "length", ["option 1", "option 2"]),
    ],
)
def test_choices_are_told_as_what_they_are(tmp_path, text, name, told):
    path = tmp_path / "choice.scenic"
    rest = "new Robot with start_room 0\nparam tasks = [(0, 2, 3, 200)]\n"
    path.write_text(f"model scenic_worlds.model\n{text}\n{rest}")
    space = compile_program(path).space
    (found,) = [d for d in space.dimensions if d.name.endswith(f".{name}")]
    assert [found.told(float(k)) for k in range(2)] == told
