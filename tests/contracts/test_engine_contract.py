"""What every registered engine must do; registering one puts it under this suite.

Engines obey commands within limits, stop at what is solid, and repeat bit by bit.
"""

from __future__ import annotations

import dataclasses
import hashlib
import importlib.util
import os
import subprocess
import sys

import numpy as np
import pytest

from mrta_falsify.core import registry
from mrta_falsify.core.arrays import frozen_array
from mrta_falsify.core.config import Choice
from mrta_falsify.core.errors import UnknownNameError, WorldError
from mrta_falsify.core.fleet import Command, Sensed
from mrta_falsify.core.geometry import rectangle, transform
from mrta_falsify.core.protocols import Engine
from mrta_falsify.core.world import Blockage, Furniture, HumanSpec, RobotSpec, Wall, World
from simulator_interface.engines import gaps
from simulator_interface.staging import Stage

DT = 0.05
#: engine -> the module it needs; who has not installed it skips it
NEEDS = {"bullet": "pybullet", "mujoco": "mujoco"}
ENGINES = tuple(
    name
    for name in registry.names("engine")
    if name not in NEEDS or importlib.util.find_spec(NEEDS[name])
)
FIELDS = tuple(field.name for field in dataclasses.fields(Sensed))
NOBODY = np.zeros((0, 2))


def build(name: str, **options) -> Engine:
    return registry.build("engine", Choice(name, options))


def field_world(*robots: RobotSpec, **parts) -> World:
    parts.setdefault("bounds", frozen_array([-20, -20, 20, 20]))
    return World(name="field", robots=robots, **parts)


def robot(name: str = "robot1", x: float = 0.0, y: float = 0.0, yaw: float = 0.0, **values):
    return RobotSpec(name=name, pose=frozen_array([x, y, yaw]), **values)


def drive(engine: Engine, world: World, twists, *, ticks: int, people=None) -> list[Sensed]:
    """Sensed at time 0 and after each tick of one constant command."""
    places = np.array([human.route[0] for human in world.humans]).reshape(-1, 2)
    velocity = np.zeros_like(places) if people is None else np.asarray(people, dtype=float)
    command = Command(twist=np.asarray(twists, dtype=float).reshape(-1, 3))
    seen = [engine.start(world, DT, places)]
    seen += [engine.step(command, velocity) for _ in range(ticks)]
    engine.close()
    return seen


def digest(seen: list[Sensed]) -> str:
    total = hashlib.sha256()
    for sensed in seen:
        for name in FIELDS:
            total.update(np.asarray(getattr(sensed, name)).tobytes())
    return total.hexdigest()


def busy_world() -> World:
    return field_world(
        robot("robot1", -2.0, wheel_slip=0.1),
        robot("robot2", 2.0, 0.1, np.pi, command_latency=0.12),
        robot("robot3", 0.0, 3.0, model="holonomic", radius=0.2),
        walls=(Wall(name="wall", polygon=rectangle(6.0, 0.2, (0.0, -1.0))),),
        humans=(HumanSpec(name="human1", route=frozen_array([[1.0, 1.5]])),),
        events=(Blockage(name="cart", polygon=rectangle(0.5, 0.5, (0, 2.0)), start=1.0, end=3.0),),
        ray_noise=0.01,
        seed=5,
    )


def busy_run(name: str) -> str:
    twists = [[0.8, 0.0, 0.1], [0.6, 0.0, -0.2], [0.3, -0.4, 0.5]]
    return digest(drive(build(name), busy_world(), twists, ticks=120, people=[[-0.8, -0.3]]))


# --- commands ------------------------------------------------------------------------------

#: seconds, forward [m/s], turn rate [rad/s]: straight, turns, arcs both ways, stop and go
COURSE = (
    (2.5, 1.0, 0.0),
    (1.5, 0.0, 0.0),
    (2.0, 0.0, 1.5),
    (2.0, 0.0, -1.5),
    (1.0, 0.0, 0.0),
    (2.5, 0.5, 0.8),
    (2.5, 0.5, -0.8),
    (1.0, 0.0, 0.0),
    (3.0, 1.5, 0.0),
    (2.0, 0.0, 0.0),
    *((1.5, 0.3, 0.0), (1.0, 0.0, 0.0)) * 2,
    (2.0, -0.4, 0.0),
)


@pytest.mark.parametrize("name", ENGINES)
@pytest.mark.parametrize(
    ("model", "scale"),
    [("waffle", (1.0, 1.0)), ("waffle_real", (0.17, 0.6)), ("burger", (0.14, 1))],
)
def test_robot_reaches_commanded_speed_and_turn_rate_within_5_percent(name, model, scale):
    engine = build(name)
    world = field_world(robot(model=model))
    engine.start(world, DT, NOBODY)
    speed = turn = 0.0  # what a robot that is perfect within its limits would do
    for seconds, v, w in COURSE:
        wanted, had, steady = np.zeros(2), np.zeros(2), []
        command = Command(twist=np.array([[v * scale[0], 0.0, w * scale[1]]]))
        for k in range(round(seconds / DT)):
            sensed = engine.step(command, NOBODY)
            for _ in range(10):
                speed += np.clip(command.twist[0, 0] - speed, -0.1 * DT, 0.1 * DT)
                turn += np.clip(command.twist[0, 2] - turn, -0.7 * DT, 0.7 * DT)
                wanted += np.array([speed, turn]) * DT / 10
            had += sensed.velocity[0, [0, 2]] * DT
            if k * DT >= seconds - 0.5:
                steady.append(sensed.velocity[0, [0, 2]])
        target = command.twist[0, [0, 2]]
        # 5 % of what was commanded; where nothing was, of a crawl and a slow turn
        assert np.abs(np.mean(steady, axis=0) - target) == pytest.approx(
            [0, 0], abs=0.05 * max(0.2, np.abs(target).max())
        )
        for k in (0, 1):
            if abs(target[k]) > 0.0:
                assert np.mean(steady, axis=0)[k] == pytest.approx(target[k], rel=0.05)
                assert had[k] == pytest.approx(wanted[k], rel=0.05)
    engine.close()


@pytest.mark.parametrize("name", ENGINES)
def test_speed_and_acceleration_stay_within_the_lower_limit_of_robot_and_model(name):
    world = field_world(robot(model="waffle_real", max_acceleration=0.2))
    seen = drive(build(name), world, [1.5, 0, 0], ticks=40)
    speeds = np.array([s.velocity[0, 0] for s in seen])
    assert speeds.max() < 0.26 * 1.05
    assert speeds[10] == pytest.approx(0.2 * 0.5, rel=0.1)
    assert np.diff(speeds[1:]).max() < 0.2 * DT * 1.3


@pytest.mark.parametrize("name", ENGINES)
def test_holonomic_base_moves_sideways_while_turning(name):
    world = field_world(robot(model="holonomic", yaw=0.5))
    sensed = drive(build(name), world, [0.3, 0.4, 0.2], ticks=60)[-1]
    assert sensed.velocity[0] == pytest.approx([0.3, 0.4, 0.2], abs=0.02)
    assert sensed.pose[0, 2] == pytest.approx(0.5 + 0.2 * 3.0, abs=0.02)


@pytest.mark.parametrize("name", ENGINES)
def test_latency_delays_and_joining_late_holds_the_robot(name):
    world = field_world(
        robot("robot1"),
        robot("robot2", y=2.0, command_latency=0.5),
        robot("robot3", y=4.0, joins_at=0.5),
    )
    seen = drive(build(name), world, [[0.5, 0, 0]] * 3, ticks=40)
    x = np.array([s.pose[:, 0] for s in seen])
    assert x[10, 0] > 0.1
    assert np.abs(x[10, 1:]).max() < 1e-3
    assert x[30, 1:] == pytest.approx(x[20, 0], abs=5e-3)


@pytest.mark.parametrize("name", ENGINES)
def test_wheel_slip_loses_speed_and_depends_on_seed_and_name_only(name):
    slippery = field_world(robot("robot1", wheel_slip=0.2), robot("robot2", y=3.0), seed=1)
    ends = [
        drive(build(name), world, [[0.5, 0, 0]] * 2, ticks=60)[-1].pose
        for world in (slippery, slippery, dataclasses.replace(slippery, seed=2))
    ]
    assert ends[0][0, 0] < 0.95 * ends[0][1, 0]
    assert (ends[0] == ends[1]).all()
    assert ends[0][0, 0] != ends[2][0, 0]
    assert ends[2][1] == pytest.approx(ends[0][1], abs=1e-3)


@pytest.mark.parametrize("name", ENGINES)
def test_robot_without_command_stays_where_it_is(name):
    seen = drive(build(name), field_world(robot(yaw=0.3)), [0, 0, 0], ticks=600)
    assert seen[-1].pose == pytest.approx(seen[0].pose, abs=2e-3)


# --- contact -------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ENGINES)
def test_wall_stops_a_robot_and_contact_is_reported(name):
    world = field_world(robot(), walls=(Wall(name="wall", polygon=rectangle(0.2, 8.0, (2.0, 0))),))
    seen = drive(build(name), world, [1.0, 0, 0], ticks=80)
    touching = [s.contact[0].tolist() for s in seen]
    assert [False, False, True] in touching
    assert not any(row[0] or row[1] for row in touching)
    assert min(s.gap_static[0] for s in seen) > -0.03
    assert max(s.pose[0, 0] for s in seen) < 1.9
    first = next(k for k, s in enumerate(seen) if s.contact[0, 2])
    assert not any(s.contact.any() for s in seen[:first])
    assert seen[first].gap_static[0] < 0.01


@pytest.mark.parametrize("name", ENGINES)
def test_robots_that_meet_touch_and_do_not_pass_through_each_other(name):
    world = field_world(robot("robot1", -1.0), robot("robot2", 1.0, 0.0, np.pi))
    seen = drive(build(name), world, [[0.5, 0, 0]] * 2, ticks=60)
    assert seen[-1].contact[:, 0].all()
    assert seen[-1].nearest_robot.tolist() == [1, 0]
    assert min(s.gap_robot.min() for s in seen) > -0.02
    assert all(s.pose[0, 0] < s.pose[1, 0] for s in seen)


@pytest.mark.parametrize("name", ENGINES)
@pytest.mark.parametrize("twist", [(0.0, 0.0, 0.0), (0.5, 0.0, 0.0), (0.0, 0.0, 1.0)])
def test_person_walks_round_a_robot_and_never_flings_it(name, twist):
    world = field_world(
        robot(x=2.0, yaw=np.pi), humans=(HumanSpec(name="human1", route=frozen_array([[0, 0]])),)
    )
    seen = drive(build(name), world, twist, ticks=100, people=[[1.2, 0.0]])
    assert any(s.contact[0, 1] for s in seen)
    assert min(s.gap_human[0] for s in seen) > -0.02
    assert seen[-1].human_position[0, 0] > 3.5
    assert max(np.hypot(*s.velocity[0, :2]) for s in seen) < 0.7
    if not any(twist):
        assert seen[-1].pose[0, :2] == pytest.approx([2.0, 0.0], abs=0.01)


@pytest.mark.parametrize("name", ENGINES)
def test_people_exist_only_between_appearing_and_leaving(name):
    human = HumanSpec(name="human1", route=frozen_array([[0.6, 0]]), appears_at=0.5, leaves_at=1.0)
    world = field_world(robot(), humans=(human,))
    seen = drive(build(name), world, [0, 0, 0], ticks=30, people=[[0.0, 0.1]])
    assert np.isinf(seen[9].gap_human[0])
    assert seen[10].human_position[0].tolist() == [0.6, 0.0]
    assert seen[15].gap_human[0] == pytest.approx(0.6 - 0.25 - 0.0685, abs=0.01)
    assert seen[15].human_velocity[0] == pytest.approx([0.0, 0.1])
    assert np.isinf(seen[21].gap_human[0])
    assert (seen[21].human_velocity == 0.0).all()
    assert seen[30].human_position[0] == pytest.approx([0.6, 0.05])


@pytest.mark.parametrize("name", ENGINES)
def test_blockage_is_solid_and_seen_exactly_in_its_time(name):
    cart = Blockage(name="cart", polygon=rectangle(0.4, 2.0, (1.0, 0)), start=0.5, end=3.0)
    world = field_world(robot(), events=(cart,))
    seen = drive(build(name), world, [0.5, 0, 0], ticks=100)
    hit = np.array([np.isfinite(s.obstacle_points[0, 0, 0]) for s in seen])
    assert np.flatnonzero(hit).tolist() == list(range(10, 60))
    assert seen[10].obstacle_points[0, 0, 0] == pytest.approx(0.8)
    assert max(s.pose[0, 0] for s in seen[:60]) < 0.8
    assert np.isinf(seen[10].gap_static[0])
    assert np.isfinite(seen[11].gap_static[0])
    assert seen[-1].pose[0, 0] > 1.2


@pytest.mark.parametrize("name", ENGINES)
def test_blockage_waits_until_no_robot_is_there(name):
    cart = Blockage(name="cart", polygon=rectangle(1.0, 1.0), start=0.1, end=9.0)
    seen = drive(build(name), field_world(robot(), events=(cart,)), [0.5, 0, 0], ticks=60)
    assert not any(s.contact.any() for s in seen)
    assert np.isinf(seen[10].gap_static[0])
    assert np.isinf(seen[10].obstacle_points).all()
    gaps_seen = np.array([s.gap_static[0] for s in seen])
    down = int(np.flatnonzero(np.isfinite(gaps_seen))[0])
    assert 0.0 < gaps_seen[down] < 0.1  # at once behind the robot
    assert np.isfinite(gaps_seen[down:]).all()
    assert seen[-1].pose[0, 0] > 1.0
    assert seen[-1].gap_static[0] > 0.1


@pytest.mark.parametrize("name", ENGINES)
@pytest.mark.parametrize("turn", [0.0, np.pi / 2, -2.0])
def test_blockage_is_not_put_down_where_a_driving_robot_could_not_stop_before_it(name, turn):
    ahead = np.array([np.cos(turn), np.sin(turn)])
    outline = transform(rectangle(0.4, 0.4), (*ahead, turn))
    cart = Blockage(name="cart", polygon=outline, start=0.9, end=9.0)
    world = field_world(robot(yaw=turn), events=(cart,))
    passes = drive(build(name), world, [0.7, 0, 0], ticks=80)
    assert not any(s.contact.any() for s in passes)
    down = next(s for s in passes if np.isfinite(s.gap_static[0]))
    assert down.pose[0, :2] @ ahead > 1.2  # once the robot has gone by
    assert down.gap_static[0] < 0.1

    engine = build(name)
    sensed, stops = engine.start(world, DT, NOBODY), []
    for _ in range(80):
        speed = 0.0 if sensed.time > 0.9 else 0.7
        sensed = engine.step(Command(twist=np.array([[speed, 0, 0]])), NOBODY)
        stops.append(sensed)
    engine.close()
    down = next(s for s in stops if np.isfinite(s.gap_static[0]))
    assert not any(s.contact.any() for s in stops)
    assert down.pose[0, :2] @ ahead < 0.8
    assert stops[-1].gap_static[0] > 0.01


@pytest.mark.parametrize("name", ENGINES)
def test_blockage_waits_until_no_person_is_there(name):
    corner = frozen_array([[2, 2], [5, 2], [5, 3], [3, 3], [3, 5], [2, 5]])
    cart = Blockage(name="cart", polygon=corner, start=0.1, end=9.0)
    human = HumanSpec(name="human1", route=frozen_array([[2.5, 2.5]]))
    world = field_world(robot(), humans=(human,), events=(cart,))
    stays = drive(build(name), world, [0, 0, 0], ticks=40)
    assert all(np.isinf(s.gap_static[0]) for s in stays)
    walks = drive(build(name), world, [0, 0, 0], ticks=40, people=[[-1.0, 0.0]])
    assert np.isinf(walks[10].gap_static[0])
    assert np.isfinite(walks[-1].gap_static[0])
    assert walks[-1].human_position[0, 0] < 1.0


# --- what is measured ----------------------------------------------------------------------


@pytest.mark.parametrize("name", ENGINES)
def test_rays_begin_at_the_heading_and_see_parked_robots_only(name):
    world = field_world(
        robot("robot1", yaw=np.pi / 2),
        robot("robot2", y=2.0),
        robot("robot3", x=-2.0, yaw=np.pi / 2),
        walls=(Wall(name="wall", polygon=rectangle(0.2, 8.0, (4.0, 0))),),
        humans=(HumanSpec(name="human1", route=frozen_array([[1.0, 0.0]])),),
    )
    seen = drive(build(name), world, [[0, 0, 0], [0, 0, 0], [0.1, 0, 0]], ticks=105)
    for ticks in (0, 100):
        assert np.isinf(seen[ticks].obstacle_points[0, 0]).all()  # parked for 5 s, not for over 5 s
    last = seen[-1].obstacle_points
    assert last.shape == (3, 12, 2)
    assert last[0, 0] == pytest.approx([0.0, 2.0 - 0.1525], abs=0.01)  # robot2's side
    assert np.isinf(last[0, 3]).all()  # robot3 moves
    assert last[0, 9] == pytest.approx([3.9, 0.0], abs=0.01)  # through the person, to the wall


@pytest.mark.parametrize("name", ENGINES)
def test_ray_noise_is_seeded_and_of_the_given_size(name):
    world = field_world(
        robot(), walls=(Wall(name="wall", polygon=rectangle(0.2, 8.0, (4.0, 0))),), ray_noise=0.02
    )
    runs = [
        np.array([s.obstacle_points[0, 0, 0] for s in drive(build(name), w, [0, 0, 0], ticks=200)])
        for w in (world, world, dataclasses.replace(world, seed=1))
    ]
    assert (runs[0] == runs[1]).all()
    assert (runs[0] != runs[2]).any()
    assert np.std(runs[0]) == pytest.approx(0.02, rel=0.2)
    assert np.mean(runs[0]) == pytest.approx(3.9, abs=0.01)


# --- the same again ------------------------------------------------------------------------


@pytest.mark.parametrize("name", ENGINES)
def test_repeated_runs_are_bit_identical(name):
    assert busy_run(name) == busy_run(name)


def test_another_process_gives_the_same_bits():
    program = (
        "from tests.contracts.test_engine_contract import busy_run, ENGINES\n"
        "print(*(busy_run(name) for name in ENGINES))"
    )
    found = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    assert found.stdout.split() == [busy_run(name) for name in ENGINES]
    assert found.stderr == ""


@pytest.mark.parametrize("name", ENGINES)
@pytest.mark.parametrize("rate", [10, 20, 50])
def test_speed_does_not_depend_on_the_control_rate(name, rate):
    engine = build(name)
    engine.start(field_world(robot()), 1.0 / rate, NOBODY)
    for _ in range(2 * rate):
        sensed = engine.step(Command(twist=np.array([[0.5, 0.0, 0.4]])), NOBODY)
    engine.close()
    assert sensed.time == pytest.approx(2.0)
    assert sensed.velocity[0] == pytest.approx([0.5, 0.0, 0.4], abs=0.02)
    assert sensed.pose[0, 2] == pytest.approx(0.77, abs=0.03)


@pytest.mark.parametrize("name", ENGINES)
def test_world_without_robots_people_or_walls_runs(name):
    seen = drive(build(name), field_world(), np.zeros((0, 3)), ticks=2)
    assert seen[-1].obstacle_points.shape == (0, 12, 2)
    assert seen[-1].human_position.shape == (0, 2)


@pytest.mark.parametrize("name", ENGINES)
def test_engine_can_be_closed_twice_and_started_again(name):
    engine = build(name)
    runs = [digest(drive(engine, field_world(robot()), [0.5, 0, 0], ticks=5)) for _ in range(2)]
    engine.close()
    assert runs[0] == runs[1]


# --- what people change, and what copies of a run change ------------------------------------


def staged(engine: Engine, world: World, stage: Stage, *, ticks: int, twist=(0.0, 0.0, 0.0)):
    """Sensed after each tick; ``stage`` is taken in before the first."""
    places = np.array([human.route[0] for human in world.humans]).reshape(-1, 2)
    engine.start(world, DT, places)
    engine.arrange(stage)
    command = Command(twist=np.tile(twist, (len(world.robots), 1)))
    seen = [engine.step(command, np.zeros_like(places)) for _ in range(ticks)]
    engine.close()
    return seen


def bed_world(**parts) -> World:
    bed = Furniture(name="bed", kind="bed", polygon=rectangle(2.0, 0.9, (2.5, 0.0)), movable=True)
    return field_world(robot(), furniture=(bed,), **parts)


def stage(**parts) -> Stage:
    kept = {"inside": np.zeros(0, dtype=bool), "placed": np.zeros((0, 2))}
    return Stage(**{**kept, "furniture_pose": np.array([[2.5, 0.0, 0.0]]), **parts})


@pytest.mark.parametrize("name", ENGINES)
def test_pushed_furniture_stops_a_robot_where_it_stands_now(name):
    stays = staged(build(name), bed_world(), stage(), ticks=120, twist=(0.7, 0, 0))
    assert stays[-1].contact[0, gaps.STATIC]
    assert stays[-1].pose[0, 0] < 1.5
    turned = stage(furniture_pose=np.array([[3.5, 0.0, np.pi / 2]]))
    moved = staged(build(name), bed_world(), turned, ticks=120, twist=(0.7, 0, 0))
    assert moved[-1].contact[0, gaps.STATIC]
    assert moved[-1].pose[0, 0] == pytest.approx(3.5 - 0.45 - 0.0685, abs=0.03)
    away = stage(furniture_pose=np.array([[2.5, 5.0, 0.0]]))
    gone = staged(build(name), bed_world(), away, ticks=120, twist=(0.7, 0, 0))
    assert gone[-1].pose[0, 0] > 3.5
    assert not any(sensed.contact.any() for sensed in gone)


@pytest.mark.parametrize("name", ENGINES)
def test_what_people_put_down_is_solid_from_then_on(name):
    bin_ = Blockage(name="bin", polygon=rectangle(0.4, 2.0, (1.0, 0)), start=0.0, end=3.0)
    seen = staged(build(name), bed_world(), stage(added=(bin_,)), ticks=100, twist=(0.5, 0, 0))
    assert max(s.pose[0, 0] for s in seen[:58]) < 0.8
    assert any(s.contact[0, gaps.STATIC] for s in seen[:58])
    assert seen[-1].pose[0, 0] > 1.0  # it was taken away again
    assert seen[10].velocity[0, 0] > 0.2  # and meanwhile the robot drove on as before


@pytest.mark.parametrize("name", ENGINES)
def test_people_who_are_put_down_or_outside_are_where_the_stage_says(name):
    human = HumanSpec(name="human1", route=frozen_array([[9.0, 9.0]]))
    world = bed_world(humans=(human,))
    here = stage(inside=np.array([True]), placed=np.array([[0.6, 0.0]]))
    seen = staged(build(name), world, here, ticks=60, twist=(0.5, 0, 0))
    assert seen[-1].contact[0, gaps.HUMAN]
    assert seen[-1].pose[0, 0] < 0.6 - 0.25
    outside = stage(inside=np.array([False]), placed=np.array([[0.6, 0.0]]))
    alone = staged(build(name), world, outside, ticks=60, twist=(0.5, 0, 0))
    assert np.isinf(alone[-1].gap_human[0])
    assert alone[-1].pose[0, 0] > 0.6


@pytest.mark.parametrize("name", ENGINES)
def test_person_who_appears_on_a_robot_does_not_throw_it(name):
    people = tuple(
        HumanSpec(name=f"human{k}", route=frozen_array([[x, 0.0]]), appears_at=0.5)
        for k, x in enumerate((0.1, 3.0))
    )
    world = field_world(robot("robot1"), robot("robot2", 2.0), humans=people)
    velocity = np.array([[0.0, 1.0], [0.0, 0.0]])
    seen = drive(build(name), world, [[0, 0, 0], [0.5, 0, 0]], ticks=80, people=velocity)
    assert any(s.contact[0, gaps.HUMAN] for s in seen)
    assert seen[-1].pose[0, :2] == pytest.approx([0.0, 0.0], abs=0.01)
    assert not seen[-1].contact[0].any()
    assert seen[-1].human_position[0, 1] > 2.0
    assert seen[-1].pose[1, 0] < 3.0 - 0.25  # the other person is solid for the other robot


@pytest.mark.parametrize("name", ENGINES)
def test_people_who_left_a_robot_they_appeared_on_are_solid_for_it(name):
    human = HumanSpec(name="human1", route=frozen_array([[0.1, 0.0]]), appears_at=0.2)
    engine = build(name)
    engine.start(field_world(robot(), humans=(human,)), DT, np.array([[0.1, 0.0]]))
    for k in range(200):
        speed = 0.5 if k >= 60 else 0.0
        walk = np.array([[0.8 if k < 40 else 0.0, 0.0]])
        sensed = engine.step(Command(twist=np.array([[speed, 0.0, 0.0]])), walk)
    engine.close()
    assert sensed.human_position[0, 0] > 1.0
    assert sensed.contact[0, gaps.HUMAN]
    assert sensed.pose[0, 0] < sensed.human_position[0, 0] - 0.25


@pytest.mark.parametrize("name", ENGINES)
def test_removed_robot_is_in_nobodys_way(name):
    engine = build(name)
    engine.start(field_world(robot("robot1"), robot("robot2", 1.0)), DT, NOBODY)
    drive_on = Command(twist=np.array([[0.5, 0.0, 0.0], [0.0, 0.0, 0.0]]))
    for _ in range(60):
        sensed = engine.step(drive_on, NOBODY)
    assert sensed.contact[0, gaps.ROBOT]
    engine.remove(1)
    for _ in range(60):
        sensed = engine.step(drive_on, NOBODY)
    engine.close()
    assert sensed.pose[0, 0] > 1.5
    assert np.isinf(sensed.gap_robot[0])
    assert np.hypot(*sensed.pose[1, :2]) > 50.0


@pytest.mark.parametrize("name", ENGINES)
@pytest.mark.parametrize("model", ["waffle", "holonomic"])
def test_shifted_robots_drive_on_as_before_a_little_aside(name, model):
    ends = []
    for offset in (0.0, 0.004):
        engine = build(name)
        engine.start(field_world(robot(model=model), robot("other", y=5.0)), DT, NOBODY)
        command = Command(twist=np.tile([0.5, 0.0, 0.0], (2, 1)))
        for _ in range(20):
            engine.step(command, NOBODY)
        engine.shift(np.array([[0.0, offset], [0.0, 0.0]]))
        for _ in range(20):
            sensed = engine.step(command, NOBODY)
        engine.close()
        ends.append(sensed)
    aside = ends[1].pose - ends[0].pose
    assert aside[0] == pytest.approx([0.0, 0.004, 0.0], abs=5e-4)
    assert np.abs(aside[1]).max() < 1e-9
    assert ends[1].velocity[0] == pytest.approx(ends[0].velocity[0], abs=1e-3)


@pytest.mark.parametrize("name", ENGINES)
def test_blockages_that_are_forgotten_never_stand(name):
    cart = Blockage(name="cart", polygon=rectangle(0.4, 2.0, (1.0, 0)), start=0.5, end=9.0)
    engine = build(name)
    engine.start(field_world(robot(), events=(cart,)), DT, NOBODY)
    engine.forget_after(0.2)
    for _ in range(80):
        sensed = engine.step(Command(twist=np.array([[0.5, 0.0, 0.0]])), NOBODY)
    engine.close()
    assert sensed.pose[0, 0] > 1.2
    assert np.isinf(sensed.gap_static[0])


@pytest.mark.parametrize("name", ENGINES)
def test_forked_copy_goes_on_bit_by_bit_as_the_run_does(name):
    engine, command = build(name), Command(twist=np.array([[0.8, 0, 0.1], [0.6, 0, -0.2]]))
    people = np.array([[-0.8, -0.3]])
    human = HumanSpec(name="human1", route=frozen_array([[1.0, 0.3]]))
    world = field_world(robot("robot1", -2.0), robot("robot2", 2.0, 0.1, np.pi), humans=(human,))
    engine.start(world, DT, np.array([human.route[0]]))
    for _ in range(40):
        engine.step(command, people)
    read, write = os.pipe()
    if os.fork() == 0:
        os.write(write, digest([engine.step(command, people) for _ in range(40)]).encode())
        os._exit(0)
    os.close(write)
    here = digest([engine.step(command, people) for _ in range(40)])
    with os.fdopen(read, "rb") as pipe:
        assert pipe.read().decode() == here
    os.wait()
    engine.close()


@pytest.mark.parametrize("name", ENGINES)
def test_solid_with_a_notch_lets_robots_into_the_notch(name):
    """Outlines need not be convex: here a U that opens towards the robot."""
    cup = frozen_array([[1, -1], [4, -1], [4, 1], [1, 1], [1, 0.6], [3, 0.6], [3, -0.6], [1, -0.6]])
    world = field_world(robot(), walls=(Wall(name="cup", polygon=cup),))
    seen = drive(build(name), world, [0.7, 0, 0], ticks=120)
    assert seen[-1].contact[0, gaps.STATIC]
    assert seen[-1].pose[0, 0] == pytest.approx(3.0 - 0.0685, abs=0.02)
    assert seen[-1].pose[0, 1] == pytest.approx(0.0, abs=0.02)


# --- bad input -----------------------------------------------------------------------------


@pytest.mark.parametrize("name", ENGINES)
def test_start_in_a_wall_or_in_another_robot_names_what_it_touches(name):
    wall = Wall(name="kerb", polygon=rectangle(2.0, 0.2, (0.0, 0.1)))
    with pytest.raises(WorldError, match=r"robots\[0\].*robot1.*kerb"):
        build(name).start(field_world(robot(), walls=(wall,)), DT, NOBODY)
    with pytest.raises(WorldError, match=r"robot2.*robot1"):
        build(name).start(field_world(robot("robot1"), robot("robot2", 0.2)), DT, NOBODY)


@pytest.mark.parametrize("name", ENGINES)
def test_corner_beyond_the_planning_radius_in_a_wall_is_refused(name):
    wall = Wall(name="kerb", polygon=rectangle(0.2, 0.2, (-0.294, -0.23)))
    world = field_world(robot(radius=0.1), walls=(wall,))
    with pytest.raises(WorldError, match="body touches walls"):
        build(name).start(world, DT, NOBODY)


@pytest.mark.parametrize("name", ENGINES)
def test_unknown_model_suggests_the_nearest(name):
    with pytest.raises(UnknownNameError, match="did you mean 'waffle'"):
        build(name).start(field_world(robot(model="wafle")), DT, NOBODY)
