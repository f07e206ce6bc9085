"""Worlds written as Scenic programs come back as they were."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from mrta_falsify.core import codec
from mrta_falsify.core.arrays import frozen_array
from mrta_falsify.core.config import StackConfig
from mrta_falsify.core.directives import (
    Appear,
    FollowRoute,
    Leave,
    Push,
    StandStill,
    Wait,
    WaitUntil,
    WalkTo,
)
from mrta_falsify.core.errors import WorldError
from mrta_falsify.core.geometry import rectangle, transform
from mrta_falsify.core.world import Blockage, CommsOutage, Furniture, HumanSpec
from mrta_falsify.trial import Job, judge, on_kinematic_engine
from scenic_worlds.program import compile_program, scenario_path
from scenic_worlds.writing import write_program

pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore")]  # compiles Scenic programs

#: every kind of thing that programs place: furniture, people, blockages, outages, noise, streams
QUICK = ("blockage_mid_run", "communication_outage", "crowded_corridor", "narrow_doors")
SLOW = ("bookshelf", "hospital_day", "parametric_hospital", "warehouse_shift", "worn_fleet")


def read_back(world, path):
    files = write_program(world, path)
    back = compile_program(path).sample(7)
    return dataclasses.replace(back, name=world.name), files


@pytest.mark.parametrize("name", [*QUICK, *(pytest.param(n, marks=pytest.mark.slow) for n in SLOW)])
def test_a_sampled_world_comes_back_bit_for_bit(name, tmp_path):
    world = compile_program(scenario_path(name)).sample(3)
    back, _ = read_back(world, tmp_path / "written.scenic")
    assert codec.canonical_json(back) == codec.canonical_json(world)


@pytest.mark.slow
def test_the_written_program_gives_the_same_trace(tmp_path):
    world = compile_program(scenario_path("worn_fleet")).sample(5)
    short = dataclasses.replace(world, horizon=30.0)
    back, _ = read_back(short, tmp_path / "written.scenic")
    config = on_kinematic_engine(StackConfig())
    digests = {judge(Job(world=w, config=config)).outcome.trace.digest for w in (short, back)}
    assert len(digests) == 1


def test_a_shipped_building_is_named_and_another_one_lies_beside(hall, tmp_path):
    aws = compile_program(scenario_path("burst_of_tasks")).sample(0)
    files = write_program(aws, tmp_path / "aws.scenic")
    assert [file.name for file in files] == ["aws.scenic"]
    assert "param layout = 'aws_hospital'\n" in files[0].read_text()
    back, files = read_back(hall, tmp_path / "hall.min.scenic")
    assert [file.name for file in files] == ["hall.min.scenic", "hall.min.layout.json"]
    assert [piece.name for piece in back.furniture] == ["table"]
    assert np.allclose(back.furniture[0].polygon, hall.furniture[0].polygon, atol=1e-12)


def test_a_layout_that_was_written_anew_is_read_anew(hall, tmp_path):
    read_back(hall, tmp_path / "hall.scenic")
    wider = dataclasses.replace(hall, bounds=frozen_array([-0.5, -0.5, 14.5, 8.5]))
    back, _ = read_back(wider, tmp_path / "hall.scenic")
    assert back.bounds[2] == 14.5


@pytest.fixture
def busy_hall(hall):
    """The hall with everything that a world can hold, at values that are not the defaults."""
    turned = transform(rectangle(0.9, 0.6), (3.0, 3.3, 0.4321))
    directives = (
        WaitUntil(time=3.0),
        Appear(point=frozen_array([2.0, 6.0])),
        WalkTo(point=frozen_array([3.0, 6.0]), speed=0.7),
        Push(furniture="cart", point=frozen_array([4.0, 6.5])),
        Push(furniture="cart", point=frozen_array([4.0, 5.5]), keeps=True),
        Wait(duration=2.5),
        FollowRoute(route=frozen_array([[8.0, 6.5], [2.0, 6.5]]), repeat=False, speed=0.3),
        Leave(),
    )
    robot = dataclasses.replace(
        hall.robots[0],
        pose=frozen_array([1.5, 2.0, -2.345678]),
        capacity=1,
        wheel_slip=0.05,
        command_latency=0.1,
        joins_at=4.0,
    )
    return dataclasses.replace(
        hall,
        furniture=(
            *hall.furniture,
            Furniture(
                name="wedge", kind="stand", polygon=frozen_array([[8, 1], [9, 1], [8.5, 1.7]])
            ),
            Furniture(name="cart", kind="trolley", polygon=turned, mesh="trolley", movable=True),
            Furniture(name="o'box", kind="odd", polygon=rectangle(0.3, 0.3, (9.0, 3.0))),
        ),
        robots=(robot, hall.robots[1]),
        humans=(
            HumanSpec(name="nurse", route=frozen_array([[2.0, 6.0]]), directives=directives),
            HumanSpec(name="guard", route=frozen_array([[5.0, 7.0]]), directives=(StandStill(),)),
            HumanSpec(
                name="cleaner", route=frozen_array([[7.0, 7.0]]), speed=0.5, body="robot",
                radius=0.3, directives=(WalkTo(point=frozen_array([3.0, 7.0])),),
            ),
            HumanSpec(
                name="walker", route=frozen_array([[7.0, 1.5], [3.0, 1.5]]), repeat=False,
                start=0.25, appears_at=2.0, leaves_at=50.0, reacts_to_robots=False,
            ),
        ),
        tasks=tuple(dataclasses.replace(t, pickup_time=1.5, dropoff_time=2.5) for t in hall.tasks),
        events=(
            Blockage(name="parked", polygon=rectangle(1.0, 0.5, (6.0, 6.0)), start=5.0, end=9.5),
            CommsOutage(name="all", robots=(), links=("planner",), start=1.0, end=2.0),
            CommsOutage(name="one", robots=("robot2",), start=3.0, end=4.0),
        ),
        ray_noise=0.01,
        seed=12345678901234567,
        stack_params={"latency_most": 0.005, "phase.cbf_robot1": 0.01},
    )  # fmt: skip


def test_everything_a_world_can_hold_is_said(busy_hall, tmp_path):
    back, _ = read_back(busy_hall, tmp_path / "busy.scenic")
    for given, wanted in zip(back.robots, busy_hall.robots, strict=True):
        assert np.allclose(given.pose, wanted.pose, atol=1e-12)
    same = tuple(
        dataclasses.replace(robot, pose=wanted.pose)
        for robot, wanted in zip(back.robots, busy_hall.robots, strict=True)
    )
    back = dataclasses.replace(back, robots=same)
    for field in dataclasses.fields(busy_hall):
        if field.name != "furniture":
            given, wanted = (codec.encode(getattr(w, field.name)) for w in (back, busy_hall))
            assert given == wanted, field.name
    assert [piece.name for piece in back.furniture] == [p.name for p in busy_hall.furniture]
    for given, wanted in zip(back.furniture, busy_hall.furniture, strict=True):
        assert (given.kind, given.mesh, given.movable) == (wanted.kind, wanted.mesh, wanted.movable)
        assert np.allclose(given.polygon, wanted.polygon, atol=1e-12)


def test_a_world_that_needs_its_own_program_is_refused(hall, tmp_path):
    scripted = dataclasses.replace(hall, scripted="its compose block")
    with pytest.raises(WorldError, match="needs its compose block of its program"):
        write_program(scripted, tmp_path / "no.scenic")
    assert not list(tmp_path.iterdir())


def test_a_blockage_that_is_not_a_rectangle_is_refused(hall, tmp_path):
    wedge = Blockage(
        name="wedge", polygon=frozen_array([[5, 5], [6, 5], [5.5, 6]]), start=0.0, end=5.0
    )
    with pytest.raises(WorldError, match="'wedge' is not a rectangle"):
        write_program(dataclasses.replace(hall, events=(wedge,)), tmp_path / "no.scenic")


@pytest.mark.parametrize("seed", ["-1", "2.5", "'x'"])
def test_a_noise_seed_is_a_whole_number(seed, hall, tmp_path):
    path = tmp_path / "hall.scenic"
    write_program(hall, path)
    path.write_text(path.read_text().replace("noise_seed = 0", f"noise_seed = {seed}"))
    with pytest.raises(WorldError, match="param noise_seed is"):
        compile_program(path).sample(0)
