"""Programs: what compiles, what does not and in which words, and what a seed gives."""

from __future__ import annotations

import dataclasses
import os
import subprocess
import sys

import numpy as np
import pytest

from mrta_falsify.core.candidate import Candidate, candidate_of
from mrta_falsify.core.errors import ConfigError, FormatError, InputError
from mrta_falsify.core.feedback import Cube

pytestmark = pytest.mark.filterwarnings("ignore")

#: heading in the program, yaw in the world [deg]
HEADINGS = {0: 90, 90: 180, -90: 0, 45: 135}
HEADING = f"""
model scenic_worlds.model
for i, heading in enumerate({list(HEADINGS)}):
    new Robot at (4.45, -3 - 5 * i), facing heading deg
    new Trolley at (4.45, -5 - 5 * i), facing heading deg
"""
SMALL = """
model scenic_worlds.model
new Robot with start_room 0
new Trolley in corridors
param tasks = [(0, 1, 2, Range(200, 300))]
"""
PRELUDE = "model scenic_worlds.model\nnew Robot with start_room 0\nparam tasks = [(0, 1, 2, 300)]\n"

#: lines after the prelude, and what the message says
BROKEN = {
    "syntax": ("new Robot at at\n", r"broken\.scenic:4: .*syntax"),
    "open bracket": ("x = Range(1,\n", "a bracket or a quote that was opened above is not closed"),
    "undefined name": ("new Robo with start_room 1\n", r"broken\.scenic:4: unknown name: .*Robo"),
    "specifier": ("new Bed at (0, 0), in corridors\n", r"broken\.scenic:4: .*position.*twice"),
    "no such room": ("new Bed in room('kitchen')\n", r"broken\.scenic:4: unknown room 'kitchen'"),
    "random if": ("if Range(0, 1) > 0.5:\n    pass\n", r"broken\.scenic:4: .*cannot depend on"),
    "random loop": ("for i in Uniform([1], [2]):\n    pass\n", r"broken\.scenic:4: .*random"),
    "module": ("import no_such_module\n", r"broken\.scenic:4: .*no_such_module"),
    "python": ("x = 1 / 0\n", r"broken\.scenic:4: ZeroDivisionError"),
    "outside": (
        "new Bed at (400, 400), with name 'lost'\n",
        r"broken\.scenic:4: lost at \(400, 400\) is not inside its region",
    ),
    "collision": (
        "new Cabinet at (4.45, -3)\nnew Cabinet at (4.45, -3), with name 'late'\n",
        r"broken\.scenic:5: late at \(4\.45, -3\) stands where cabinet_1 at \(4\.45, -3\)",
    ),
    "no options": ("x = Uniform()\n", r"broken\.scenic:4: .*over empty domain"),
}


def written(text: str, folder, name: str = "program.scenic"):
    path = folder / name
    path.write_text(text)
    return path


@pytest.fixture(scope="module")
def hospital_day():
    from scenic_worlds.program import compile_program, scenario_path

    return compile_program(scenario_path("hospital_day"))


# --- seeds --------------------------------------------------------------------------------------


def test_a_seed_gives_one_world_and_another_seed_another(hospital_day):
    assert hospital_day.sample(3).digest() == hospital_day.sample(3).digest()
    assert hospital_day.sample(3).digest() != hospital_day.sample(4).digest()


def test_a_seed_means_candidate_0_of_a_random_campaign_with_that_seed(hospital_day):
    from samplers.random import RandomSampler

    k = len(hospital_day.space)
    sampler = RandomSampler(RandomSampler.Options(cube=Cube(dimensions=k), seed=11))
    for number in range(3):
        candidate = candidate_of(11, number, k)
        np.testing.assert_array_equal(candidate.u, sampler.ask().u)
        assert candidate.number == number
    world = hospital_day.realise(candidate_of(11, 0, k)).world
    assert world.digest() == hospital_day.sample(11).digest()


@pytest.mark.slow
def test_another_process_with_another_hash_seed_gives_the_same_world(hospital_day):
    code = (
        "from scenic_worlds.program import *;"
        "print(compile_program(scenario_path('hospital_day')).sample(5).digest())"
    )
    env = {**os.environ, "PYTHONHASHSEED": "77"}
    found = subprocess.run(
        [sys.executable, "-c", code], env=env, capture_output=True, text=True, check=True
    )
    assert found.stdout.split()[-1] == hospital_day.sample(5).digest()


def test_the_world_says_the_seed_of_its_candidate(hospital_day):
    candidate = hospital_day.candidate(2, 7)
    found = hospital_day.realise(candidate)
    assert found.world.seed == candidate.seed == found.candidate.seed
    assert found.candidate.number == 7


def test_no_delivery_of_a_day_stays_in_its_room(hospital_day):
    tasks = [task for seed in range(6) for task in hospital_day.sample(seed).tasks]
    assert len(tasks) == 36
    assert all(task.start != task.end for task in tasks)
    assert {task.start for task in tasks} == {task.end for task in tasks} == set(range(6))


def test_candidates_of_another_program_are_refused(hospital_day):
    k = len(hospital_day.space)
    with pytest.raises(ConfigError, match=rf"hospital_day has {k} dimensions"):
        hospital_day.realise(Candidate(number=0, u=np.zeros(3)))
    with pytest.raises(ConfigError, match=r"outside \[0, 1\]"):
        hospital_day.realise(Candidate(number=0, u=np.full(k, 1.5)))
    with pytest.raises(ConfigError, match="compiled with"):
        hospital_day.realise(Candidate(number=0, u=np.zeros(k), params={"horizon": 3}))
    with pytest.raises(ConfigError, match="must be repair or exact"):
        hospital_day.realise(hospital_day.candidate(0), "fast")


def test_corners_of_the_search_space_become_worlds(hospital_day):
    for value in (0.0, 1.0):
        u = np.full(len(hospital_day.space), value)
        assert hospital_day.realise(Candidate(number=0, u=u)).world.robots


# --- what programs become -----------------------------------------------------------------------


def test_generated_objects_join_the_layouts_own(hospital_day):
    from scenic_worlds.layouts import load_layout

    world = hospital_day.sample(0)
    own = load_layout("aws_hospital").furniture
    assert len(world.furniture) == len(own) + 3
    assert [robot.name for robot in world.robots] == [f"robot{i + 1}" for i in range(6)]
    assert len(world.humans) == 8
    assert sum(not human.reacts_to_robots for human in world.humans) == 3


def test_scenic_heading_zero_points_north(tmp_path):
    from scenic_worlds.program import compile_program

    world = compile_program(written(HEADING, tmp_path), needs_tasks=False).sample(0)
    carts = world.furniture[-len(HEADINGS) :]
    for yaw, robot, cart in zip(HEADINGS.values(), world.robots, carts, strict=True):
        assert np.rad2deg(robot.pose[2]) == pytest.approx(yaw)
        forward = np.array([np.cos(robot.pose[2]), np.sin(robot.pose[2])])
        assert np.ptp(cart.polygon @ forward) == pytest.approx(0.9)  # the trolley's length


def test_parameters_override_the_programs_own(tmp_path):
    from scenic_worlds.program import compile_program

    path = written("param horizon = Range(100, 200)\n" + SMALL, tmp_path)
    free = compile_program(path)
    fixed = compile_program(path, {"horizon": 77})
    assert len(free.space) == len(fixed.space) + 1
    found = fixed.realise(fixed.candidate(1))
    assert found.world.horizon == 77
    assert found.candidate.params == {"horizon": 77}


def test_a_restricted_dimension_stays_inside_its_part_of_the_range(tmp_path):
    from scenic_worlds.program import compile_program

    path = written("param horizon = Range(100, 200)\n" + SMALL, tmp_path)
    free = compile_program(path)
    path.write_text(path.read_text() + "param restrict = {'param horizon': (0.2, 0.4)}\n")
    inside = compile_program(path)
    horizons = [inside.sample(seed).horizon for seed in range(30)]
    assert all(120 <= horizon <= 140 for horizon in horizons)
    assert max(horizons) - min(horizons) > 10
    assert inside.space == free.space
    assert not all(120 <= free.sample(seed).horizon <= 140 for seed in range(30))


@pytest.mark.parametrize(
    ("restriction", "message"),
    [
        ("3", "must read"),
        ("{'param horizo': (0, 1)}", "unknown dimension 'param horizo'"),
        ("{'param horizon': (0.6, 0.2)}", "must read"),
        ("{'param horizon': 0.5}", "must read"),
        ("{'param horizon': (0, 1.5)}", "must read"),
    ],
)
def test_a_restriction_that_cannot_be_is_refused(restriction, message, tmp_path):
    from scenic_worlds.program import compile_program

    text = f"param horizon = Range(100, 200)\n{SMALL}param restrict = {restriction}\n"
    with pytest.raises(FormatError, match=message):
        compile_program(written(text, tmp_path))


def test_verifai_parameters_are_ordinary_dimensions(tmp_path):
    from scenic_worlds.program import compile_program

    text = """
param verifaiSamplerType = 'ce'
model scenic_worlds.model
new Robot with start_room VerifaiDiscreteRange(0, 2), with name 'r',
    with body_radius VerifaiOptions({0.2: 3, 0.21: 1})
param horizon = VerifaiRange(600, 700)
param ray_noise = VerifaiRange(0, 0.02, weights=[1, 3])
param tasks = [(0, 1, 2, 300)]
"""
    program = compile_program(written(text, tmp_path))
    kinds = {d.name: d.kind for d in program.space.dimensions}
    assert kinds["r.start_room"] == "integer"
    assert kinds["param horizon"] == "range"
    assert kinds["param ray_noise"] == "choice"
    worlds = [program.sample(seed) for seed in range(40)]
    assert all(600 <= world.horizon <= 700 for world in worlds)
    upper = sum(world.ray_noise > 0.01 for world in worlds)
    assert 20 <= upper <= 39  # three quarters of 40, four standard deviations either way


def test_parameters_of_a_foreign_stack_are_dimensions_under_its_names(tmp_path):
    from scenic_worlds.program import compile_program

    text = """
model scenic_worlds.model
new Robot with start_room 0
param tasks = [(0, 1, 2, 300)]
param stack_params = [('gain', 2), ('latency', Range(0, 0.01)), ('schedule', DiscreteRange(3, 4))]
"""
    program = compile_program(written(text, tmp_path))
    assert {d.name: d.kind for d in program.space.dimensions} == {
        "stack latency": "range", "stack schedule": "integer",
    }  # fmt: skip
    world = program.sample(1)
    assert world.stack_params["gain"] == 2
    assert 0 <= world.stack_params["latency"] <= 0.01
    assert world.stack_params["schedule"] in (3, 4)


@pytest.mark.parametrize("given", ["{'gain': 2}", "[('gain', 'high')]", "[(1, 2)]", "3"])
def test_parameters_of_a_foreign_stack_are_pairs_of_a_name_and_a_number(given, tmp_path):
    from scenic_worlds.program import compile_program

    text = f"""
model scenic_worlds.model
new Robot with start_room 0
param tasks = [(0, 1, 2, 300)]
param stack_params = {given}
"""
    with pytest.raises(InputError, match="param stack_params"):
        compile_program(written(text, tmp_path)).sample(0)


# --- what is refused ----------------------------------------------------------------------------


@pytest.mark.parametrize("case", BROKEN)
def test_a_program_that_does_not_compile_says_where_and_why(tmp_path, case):
    from scenic_worlds.program import compile_program

    text, message = BROKEN[case]
    with pytest.raises(FormatError, match=message):
        compile_program(written(PRELUDE + text, tmp_path, "broken.scenic"))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("new Object\n", r"has no `model scenic_worlds\.model`"),
        ("model scenic_worlds.no_model\nnew Object\n", r"program\.scenic:1: .*no_model"),
        ("model scenic_worlds.model\nparam tasks = [(0, 1, 2, 9)]\n", "has no robot; add"),
        ("model scenic_worlds.model\nnew Robot with start_room 0\n", "has no tasks; give"),
    ],
)
def test_a_program_without_what_a_run_needs_is_refused(tmp_path, text, message):
    from scenic_worlds.program import compile_program

    with pytest.raises(FormatError, match=message):
        compile_program(written(text, tmp_path))


def test_a_missing_file_is_refused(tmp_path):
    from scenic_worlds.program import compile_program

    with pytest.raises(FormatError, match="there is no such file"):
        compile_program(tmp_path / "nothing.scenic")


def test_a_failure_while_sampling_names_the_line(tmp_path):
    from scenic_worlds.program import compile_program

    text = """
from scenic.core.distributions import distributionFunction
@distributionFunction
def inverse(x):
    return 1 / (x - x)
param horizon = inverse(Range(1, 2))
"""
    program = compile_program(written(PRELUDE + text, tmp_path))
    with pytest.raises(InputError, match=r"program\.scenic:8: .*ZeroDivisionError"):
        program.sample(0)


# --- sources ------------------------------------------------------------------------------------


def test_the_sources_digest_covers_what_a_program_imports(tmp_path):
    from scenic_worlds.sources import source_files, sources_digest

    main = written("from extra import width\nmodel scenic_worlds.model\n", tmp_path)
    extra = written("import deep\nwidth = 1\n", tmp_path, "extra.scenic")
    deep = written("depth = 1\n", tmp_path, "deep.py")
    names = {path.name for path in source_files(main)}
    assert {"program.scenic", "extra.scenic", "deep.py", "model.scenic", "furniture.scenic"} < names
    digests = {sources_digest(main, None)}
    for file in (extra, deep, main):
        file.write_text(file.read_text() + "\nmore = 2\n")
        digests.add(sources_digest(main, None))
    assert len(digests) == 4


def test_programs_with_equal_sources_have_equal_digests(tmp_path):
    from scenic_worlds.program import compile_program

    paths = []
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        paths.append(written(SMALL, tmp_path / name))
    first, second = (compile_program(path).sources_digest for path in paths)
    assert first == second


# --- variation of fixed worlds ------------------------------------------------------------------


def test_varied_worlds_start_near_their_places(hospital_day):
    from scenic_worlds.layouts import load_world
    from scenic_worlds.variation import START_OFFSET, vary_world

    day = load_world("aws_hospital_day")
    varied = vary_world(day, 7)
    for before, after in zip(day.robots, varied.robots, strict=True):
        assert np.hypot(*(before.pose - after.pose)[:2]) <= START_OFFSET
    assert {h.speed for h in varied.humans} != {h.speed for h in day.humans}
    assert varied.digest() == vary_world(day, 7).digest()
    assert varied.digest() != vary_world(day, 8).digest()
    assert dataclasses.replace(varied, seed=8).digest() != varied.digest()


# --- shipped programs ---------------------------------------------------------------------------


@pytest.mark.slow
def test_shipped_programs_are_driven_smoothly_and_give_their_scenes_back():
    from scenic_worlds.program import compile_program
    from scenic_worlds.shipped import scenario_names, scenario_path

    opaque = total = 0
    for name in scenario_names():
        program = compile_program(scenario_path(name))
        kinds = [dimension.kind for dimension in program.space.dimensions]
        opaque, total = opaque + kinds.count("opaque"), total + len(kinds)
        assert len({dimension.name for dimension in program.space.dimensions}) == len(kinds)
        found = program.realise(program.candidate(6))
        again = program.realise(found.candidate, "exact")
        assert (again.attempts, again.world.digest()) == (1, found.world.digest()), name
    assert total >= 500
    assert opaque <= 0.05 * total
