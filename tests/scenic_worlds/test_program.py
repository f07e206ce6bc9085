import dataclasses
import os
import subprocess
import sys

import numpy as np
import pytest

pytestmark = pytest.mark.filterwarnings("ignore")

HEADING = """
model scenic_worlds.model
new Robot at (4.45, -10), facing {heading} deg, with name 'probe'
new Trolley at (4.45, -3), facing {heading} deg, with name 'cart'
"""


@pytest.fixture(scope="module")
def hospital_day():
    from scenic_worlds.program import compile_program, scenario_path

    return compile_program(scenario_path("hospital_day"))


def test_a_seed_gives_one_world_and_another_seed_another(hospital_day):
    assert hospital_day.sample(3).digest() == hospital_day.sample(3).digest()
    assert hospital_day.sample(3).digest() != hospital_day.sample(4).digest()


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


def test_generated_objects_join_the_layouts_own(hospital_day):
    from scenic_worlds.layouts import load_layout

    world = hospital_day.sample(0)
    own = load_layout("aws_hospital").furniture
    assert len(world.furniture) == len(own) + 3
    assert [robot.name for robot in world.robots] == [f"robot{i + 1}" for i in range(6)]
    assert len(world.humans) == 8
    assert sum(not human.reacts_to_robots for human in world.humans) == 3


@pytest.mark.parametrize(("heading", "yaw"), [(0, 90), (90, 180), (-90, 0), (45, 135)])
def test_scenic_heading_zero_points_north(tmp_path, heading, yaw):
    from scenic_worlds.program import compile_program

    path = tmp_path / "probe.scenic"
    path.write_text(HEADING.format(heading=heading))
    world = compile_program(path).sample(0)
    assert np.rad2deg(world.robots[0].pose[2]) == pytest.approx(yaw)
    cart = world.furniture[-1].polygon
    along = np.deg2rad(yaw)
    forward = np.array([np.cos(along), np.sin(along)])
    assert np.ptp(cart @ forward) == pytest.approx(0.9)  # the trolley's length


def test_a_program_without_our_model_is_refused(tmp_path):
    from mrta_falsify.core.errors import FormatError
    from scenic_worlds.program import compile_program

    path = tmp_path / "plain.scenic"
    path.write_text("new Object\n")
    with pytest.raises(FormatError, match=r"plain\.scenic.*model scenic_worlds\.model"):
        compile_program(path)


def test_a_syntax_error_names_file_and_line(tmp_path):
    from mrta_falsify.core.errors import FormatError
    from scenic_worlds.program import compile_program

    path = tmp_path / "broken.scenic"
    path.write_text("model scenic_worlds.model\nnew Robot at at\n")
    with pytest.raises(FormatError, match=r"broken\.scenic:2"):
        compile_program(path)


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
