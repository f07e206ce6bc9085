"""Both engines: they obey commands within limits, stop at what is solid, and repeat bit by bit."""

from __future__ import annotations

import dataclasses
import hashlib
import subprocess
import sys

import numpy as np
import pytest

from mrta_falsify.core import registry
from mrta_falsify.core.arrays import frozen_array
from mrta_falsify.core.config import Choice
from mrta_falsify.core.errors import ConfigError, InputError, UnknownNameError, WorldError
from mrta_falsify.core.fleet import Command, Sensed
from mrta_falsify.core.geometry import rectangle, transform
from mrta_falsify.core.protocols import Engine
from mrta_falsify.core.world import Blockage, HumanSpec, RobotSpec, Wall, World

DT = 0.05
ENGINES = ("bullet", "kinematic")
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


def test_exact_rays_agree_with_bullets_rays(hall):
    random = np.random.default_rng(3)
    angles = np.sort(random.uniform(0, 2 * np.pi, (12, 5)), axis=1)
    stones = tuple(
        Wall(
            name=f"stone{i}",
            polygon=frozen_array(
                random.uniform([1, 1], [11, 7])
                + 0.3 * np.stack([np.cos(angles[i]), np.sin(angles[i])], axis=1)
            ),
        )
        for i in range(12)
    )
    places = [(1.0, 1.0), (11.0, 7.0), (1.0, 7.0), (11.0, 1.0), (4.0, 1.0), (8.0, 7.2)]
    robots = tuple(
        robot(f"robot{i}", *place, random.uniform(-3, 3)) for i, place in enumerate(places)
    )
    clear = tuple(
        stone
        for stone in stones
        if min(np.hypot(*(stone.polygon.mean(axis=0) - place)) for place in places) > 0.8
    )
    assert len(clear) >= 6
    world = dataclasses.replace(
        hall, walls=hall.walls + clear, robots=robots, humans=(), tasks=(), events=()
    )
    twists = [[0, 0, 0]] * 3 + [[0, 0, 0.5], [0.1, 0, 1.0], [0.1, 0, -1.0]]
    seen = [drive(build("bullet", rays=r), world, twists, ticks=120) for r in ("exact", "bullet")]
    for k in (0, 60, 120):
        exact, bullet = (run[k].obstacle_points for run in seen)
        assert bullet == pytest.approx(exact, abs=2e-3)  # inf equals inf
        assert np.isfinite(exact).mean() > 0.9
    assert (seen[0][-1].pose == seen[1][-1].pose).all()


# --- the same again ------------------------------------------------------------------------


@pytest.mark.parametrize("name", ENGINES)
def test_repeated_runs_are_bit_identical(name):
    assert busy_run(name) == busy_run(name)


def test_another_process_gives_the_same_bits():
    program = (
        "from tests.simulator_interface.test_engines import busy_run, ENGINES\n"
        "print(*(busy_run(name) for name in ENGINES))"
    )
    found = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    assert found.stdout.split() == [busy_run(name) for name in ENGINES]
    assert found.stderr == ""


def test_an_earlier_engine_with_other_options_leaves_no_trace():
    fresh = busy_run("bullet")
    drive(
        build("bullet", contact_margin=0.02, solver_iterations=3),
        busy_world(),
        np.zeros((3, 3)),
        ticks=2,
    )
    assert busy_run("bullet") == fresh


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


def test_engine_can_be_closed_twice_and_started_again():
    engine = build("bullet")
    runs = [digest(drive(engine, field_world(robot()), [0.5, 0, 0], ticks=5)) for _ in range(2)]
    engine.close()
    assert runs[0] == runs[1]


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


def test_unknown_engine_option_is_refused():
    with pytest.raises(InputError, match="step_size"):
        build("bullet", stepsize=0.1)


def test_window_without_a_display_is_refused(monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    with pytest.raises(ConfigError, match="no display"):
        build("bullet", gui=True).start(field_world(), DT, NOBODY)
