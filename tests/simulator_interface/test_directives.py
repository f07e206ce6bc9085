import dataclasses

import numpy as np
import pytest
import shapely

from mrta_falsify.core import codec
from mrta_falsify.core.arrays import frozen_array
from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.core.costmap import LETHAL
from mrta_falsify.core.directives import (
    Appear,
    FollowRoute,
    Leave,
    Push,
    StandStill,
    Wait,
    WaitUntil,
    WalkTo,
    begins_outside,
)
from mrta_falsify.core.errors import ConfigError, InputError, UnknownNameError, WorldError
from mrta_falsify.core.fleet import Command
from mrta_falsify.core.geometry import rectangle, transform
from mrta_falsify.core.world import Furniture, HumanSpec, RobotSpec, World
from mrta_falsify.testing.wards import ward_layout
from scenic_worlds.layouts import load_layout
from simulator_interface.costmap_layers import build_costmap
from simulator_interface.engines.bullet import BulletEngine
from simulator_interface.engines.kinematic import KinematicEngine
from simulator_interface.engines.mujoco import MujocoEngine
from simulator_interface.episode import Episode
from simulator_interface.simulate import simulate
from simulator_interface.staging import Stage

KINEMATIC = dataclasses.replace(StackConfig(), engine=Choice("kinematic"))
BULLET = StackConfig()
ENGINES = pytest.mark.parametrize("config", [KINEMATIC, BULLET], ids=["kinematic", "bullet"])
BED = Furniture(name="bed", kind="bed", polygon=rectangle(2.0, 0.9, (6.0, 2.0)), movable=True)


def point(x, y):
    return frozen_array([x, y])


def person(*directives, at=(2.0, 2.0), name="nurse", **fields):
    return HumanSpec(name=name, route=frozen_array([at]), directives=directives, **fields)


def ward(*humans, furniture=(), robots=(((1.0, 3.5)),), horizon=12.0):
    layout = ward_layout()
    return dataclasses.replace(
        layout,
        robots=tuple(
            RobotSpec(name=f"robot{i + 1}", pose=frozen_array([*at, 0.0]))
            for i, at in enumerate(robots)
        ),
        humans=humans,
        furniture=(*layout.furniture, *furniture),
        horizon=horizon,
    )


def run(world, config=KINEMATIC):
    return simulate(world, config).trace


def at(trace, time, column="human_position"):
    tick = int(np.searchsorted(trace.columns["time"], time - 1e-6))
    return trace.columns[column][tick, 0]


EVERY_KIND = (
    FollowRoute(route=frozen_array([[1.0, 2.0], [3.0, 2.0]]), repeat=True, speed=0.5),
    WalkTo(point=point(1.0, 2.0)),
    Wait(duration=2.0),
    WaitUntil(time=9.0),
    StandStill(),
    Push(furniture="bed", point=point(9.0, 2.0)),
    Appear(point=point(1.0, 2.0)),
    Leave(),
)


def test_a_world_with_every_directive_survives_its_json():
    world = dataclasses.replace(ward(person(*EVERY_KIND), furniture=[BED]), scripted="a reason")
    back = codec.decode(World, codec.encode(world))
    assert back.digest() == world.digest()
    assert [type(d) for d in back.humans[0].directives] == [type(d) for d in EVERY_KIND]


def test_a_world_without_directives_is_written_as_before():
    data = codec.encode(ward(HumanSpec(name="a", route=frozen_array([[1.0, 2.0]]))))
    assert "scripted" not in data
    assert data["humans"][0].keys().isdisjoint({"directives", "body"})
    assert all("movable" not in item for item in data["furniture"])


def test_an_unknown_directive_names_the_field_and_the_known_kinds():
    data = codec.encode(ward(person(StandStill())))
    data["humans"][0]["directives"][0]["kind"] = "dance"
    with pytest.raises(InputError, match=r"humans\[0\]\.directives\[0\].*'dance'.*walk_to"):
        codec.decode(World, data)


def test_only_known_movable_furniture_can_be_pushed():
    push = person(Push(furniture="bad", point=point(9.0, 2.0)))
    with pytest.raises(UnknownNameError, match="did you mean 'bed'"):
        ward(push, furniture=[BED])
    fixed = dataclasses.replace(BED, movable=False)
    with pytest.raises(WorldError, match="movable true"):
        ward(person(Push(furniture="bed", point=point(9.0, 2.0))), furniture=[fixed])


def test_movable_furniture_must_be_convex():
    corner = frozen_array([[5, 1], [8, 1], [8, 2], [6, 2], [6, 3], [5, 3]])
    with pytest.raises(WorldError, match="'bed' is not convex"):
        ward(furniture=[dataclasses.replace(BED, polygon=corner)])


@ENGINES
def test_directives_are_carried_out_one_after_the_other(config):
    world = ward(
        person(
            Wait(duration=1.0),
            WalkTo(point=point(5.0, 2.0), speed=1.0),
            WaitUntil(time=7.0),
            WalkTo(point=point(2.0, 2.0)),
        )
    )
    trace = run(world, config)
    assert at(trace, 1.0) == pytest.approx([2.0, 2.0], abs=0.1)
    assert at(trace, 6.5) == pytest.approx([5.0, 2.0], abs=0.6)
    assert at(trace, 7.0) == pytest.approx([5.0, 2.0], abs=0.6)
    assert at(trace, 12.0) == pytest.approx([2.0, 2.0], abs=0.6)


def test_a_route_without_repeat_ends_and_one_with_repeat_goes_on():
    route = frozen_array([[4.0, 2.0], [2.0, 2.0]])
    once, again = (
        run(ward(person(FollowRoute(route=route, repeat=repeat)), horizon=14.0))
        for repeat in (False, True)
    )
    late = once.columns["time"] > 9.0
    assert np.ptp(once.columns["human_position"][late, 0, 0]) < 0.3
    assert np.ptp(again.columns["human_position"][late, 0, 0]) > 1.0


@ENGINES
def test_who_leaves_is_nowhere_until_it_appears_again(config):
    world = ward(
        person(Wait(duration=1.0), Leave(), Wait(duration=2.0), Appear(point=point(9.0, 2.0)))
    )
    running = Episode(world, config)
    seen = {}
    for frame in running.frames():
        perceived = running._without_absent(frame.sensed).human_position[0]
        seen[frame.sensed.tick] = (frame.sensed.human_position[0], perceived)
        if frame.sensed.time >= 5.0:
            break
    assert np.isfinite(seen[20][0]).all()
    assert np.isnan(seen[40][0]).all()
    assert np.isinf(seen[40][1]).all()
    assert seen[80][0] == pytest.approx([9.0, 2.0], abs=0.2)
    assert seen[80][1] == pytest.approx(seen[80][0])


def test_who_begins_with_appear_is_not_there_before():
    assert begins_outside((WaitUntil(time=3.0), Appear(point=point(1.0, 1.0))))
    assert not begins_outside((WalkTo(point=point(1.0, 1.0)), Appear(point=point(1.0, 1.0))))
    trace = run(ward(person(WaitUntil(time=2.0), Appear(point=point(5.0, 2.0))), horizon=4.0))
    assert np.isnan(at(trace, 1.9)).all()
    assert at(trace, 2.1) == pytest.approx([5.0, 2.0], abs=0.1)


def test_nobody_appears_on_a_robot():
    world = ward(
        person(WaitUntil(time=1.0), Appear(point=point(6.0, 2.0))),
        robots=((6.0, 2.0),),
        horizon=4.0,
    )
    trace = run(world)
    assert np.isnan(trace.columns["human_position"]).all()


@ENGINES
def test_a_pushed_bed_arrives_and_is_touched_by_nothing_on_the_way(config):
    trace = run(
        ward(person(Push(furniture="bed", point=point(10.0, 2.0))), furniture=[BED], horizon=15.0),
        config,
    )
    pose = trace.columns["furniture_pose"][:, 0]
    assert pose[0] == pytest.approx([6.0, 2.0, 0.0])
    assert pose[-1, :2] == pytest.approx([10.0, 2.0], abs=0.15)
    steps = np.hypot(*np.diff(pose[:, :2], axis=0).T)
    assert steps.max() <= 0.8 * 0.05 + 1e-9  # nobody pushes faster than 0.8 m/s
    assert not trace.columns["contact"].any()


def test_a_bed_is_also_pulled_out_from_a_wall():
    bed = dataclasses.replace(BED, polygon=rectangle(0.9, 2.0, (6.0, 1.1)))  # head at the wall
    world = ward(person(Push(furniture="bed", point=point(6.0, 2.5))), furniture=[bed])
    trace = run(dataclasses.replace(world, horizon=20.0))
    assert trace.columns["furniture_pose"][-1, 0, 1] > 1.8


def test_a_bed_goes_round_the_corner_into_a_ward_through_its_door():
    layout = load_layout("aws_hospital")
    robot = RobotSpec(name="robot1", pose=frozen_array([0.0, 2.2, 0.0]))
    bed = dataclasses.replace(BED, polygon=rectangle(1.0, 2.2, (4.4, -6.0)))
    room = next(room for room in layout.rooms if room.name == "ward_northeast")
    porter = person(Push(furniture="bed", point=room.point), at=(4.4, -9.0))
    world = dataclasses.replace(
        layout,
        robots=(robot,),
        humans=(porter,),
        furniture=(*layout.furniture, bed),
        horizon=40.0,
    )
    trace = run(world)
    pose, people = trace.columns["furniture_pose"][:, 0], trace.columns["human_position"][:, 0]
    assert pose[-1, :2] == pytest.approx(room.point, abs=0.2)
    solids = shapely.union_all([shapely.Polygon(p) for p in world.solid_polygons()])
    for tick in range(0, len(trace), 10):
        outline = shapely.Polygon(transform(bed.polygon - np.array([4.4, -6.0]), pose[tick]))
        assert outline.buffer(-0.02).disjoint(solids)
        assert shapely.Point(people[tick]).distance(solids) > 0.15


def test_a_push_waits_for_a_robot_in_the_way_and_gives_up_in_the_end():
    world = ward(
        person(Push(furniture="bed", point=point(11.0, 2.0)), Leave()),
        furniture=[BED],
        robots=((9.0, 2.0), (9.0, 1.2), (9.0, 2.8)),
        horizon=40.0,
    )
    trace = run(world)
    end = trace.columns["furniture_pose"][-1, 0]
    assert end[0] + 1.0 < 9.0 - 0.22  # it stopped before the robots
    assert not trace.columns["contact"].any()
    assert np.isnan(trace.columns["human_position"][-1]).all()  # and went on to the next errand


def test_who_keeps_a_bed_brings_it_back_from_robots_in_the_way():
    push = Push(furniture="bed", point=point(11.0, 2.0), keeps=True)
    world = ward(
        person(push, Leave()),
        furniture=[BED],
        robots=((9.0, 2.0), (9.0, 1.2), (9.0, 2.8)),
        horizon=40.0,
    )
    trace = run(world)
    pose = trace.columns["furniture_pose"][:, 0]
    assert pose[:, 0].max() > 6.5
    assert pose[-1] == pytest.approx([6.0, 2.0, 0.0], abs=1e-6)
    assert not trace.columns["contact"].any()
    assert np.isnan(trace.columns["human_position"][-1]).all()  # and went on to the next errand


def test_who_keeps_a_bed_does_not_begin_where_it_does_not_fit():
    wide = dataclasses.replace(BED, polygon=rectangle(2.4, 2.2, (4.4, -6.0)))
    layout = load_layout("aws_hospital")
    room = next(room for room in layout.rooms if room.name == "ward_northeast")
    world = dataclasses.replace(
        layout,
        robots=(RobotSpec(name="robot1", pose=frozen_array([0.0, 2.2, 0.0])),),
        humans=(person(Push(furniture="bed", point=room.point, keeps=True), at=(4.4, -9.0)),),
        furniture=(*layout.furniture, wide),
        horizon=15.0,
    )
    poses = run(world).columns["furniture_pose"][:, 0]
    assert poses[-1] == pytest.approx(poses[0])


def test_the_same_directives_give_the_same_trace_from_the_world_file():
    world = ward(person(Push(furniture="bed", point=point(8.0, 2.0)), Leave()), furniture=[BED])
    again = codec.decode(World, codec.encode(world))
    assert run(world).digest == run(again).digest


def lethal(costmap, x, y):
    return costmap.cost_at(np.array([x, y])) == LETHAL


def test_movable_furniture_is_on_the_map_where_it_rests():
    world = ward(person(Push(furniture="bed", point=point(10.0, 2.0))), furniture=[BED])
    world = dataclasses.replace(world, horizon=30.0)
    assert lethal(build_costmap(world), 6.0, 2.0)
    running = Episode(world, KINEMATIC)
    found = {}
    for frame in running.frames():
        costmap = running._source.costmap(frame.sensed.time, np.zeros((0, 2)))
        found[frame.sensed.tick] = (lethal(costmap, 6.0, 2.0), lethal(costmap, 10.0, 2.0))
        pose = frame.sensed.furniture_pose[0]
        if frame.sensed.time >= 30.0:
            break
    assert pose[0] == pytest.approx(10.0, abs=0.15)
    assert found[0] == (True, False)
    assert (False, False) in found.values()  # while it rolls it is on no map
    assert found[max(found)] == (False, True)


def test_rays_see_a_bed_where_it_is_now():
    world = ward(
        person(Push(furniture="bed", point=point(10.0, 2.0))),
        furniture=[BED],
        robots=((8.0, 3.2),),
        horizon=12.0,
    )
    trace = run(world)
    points, pose = trace.columns["obstacle_points"][:, 0], trace.columns["furniture_pose"][:, 0]
    inside = [
        (np.abs(p[:, 0] - x) <= 1.0 + 0.01) & (np.abs(p[:, 1] - y) <= 0.45 + 0.01)
        for p, (x, y, _) in zip(points, pose, strict=True)
    ]
    seen = np.array([hits.any() for hits in inside])
    beside = np.abs(pose[:, 0] - 8.0) < 0.5
    assert seen[beside].mean() > 0.5
    assert not np.isclose(pose[beside][:, 0], 6.0).any()


@pytest.mark.parametrize("engine", [KinematicEngine, BulletEngine, MujocoEngine])
def test_a_moved_bed_counts_where_it_stands_now(engine):
    world = ward(person(StandStill()), furniture=[BED], robots=((8.5, 2.0),))
    moving = engine(engine.Options())
    try:
        before = moving.start(world, 0.05, np.array([[2.0, 2.0]]))
        moving.arrange(
            Stage(
                inside=np.array([True]),
                placed=np.full((1, 2), np.nan),
                furniture_pose=np.array([[4.0, 2.0, np.pi / 2.0]]),
            )
        )
        after = moving.step(Command(twist=np.zeros((1, 3))), np.zeros((1, 2)))
    finally:
        moving.close()
    gap = 8.5 - 6.0 - 1.0  # to the short side; the body reaches up to 0.25 m
    assert before.gap_static[0] == pytest.approx(min(gap, 2.0), abs=0.3)
    assert after.gap_static[0] > before.gap_static[0] + 0.2


class Rigid:
    """An engine for which nothing changes."""

    Options = KinematicEngine.Options

    def __init__(self, options):
        self._engine = KinematicEngine(options)

    def start(self, world, dt, human_position):
        return self._engine.start(world, dt, human_position)

    def step(self, command, human_velocity):
        return self._engine.step(command, human_velocity)

    def close(self):
        self._engine.close()


def test_an_engine_that_cannot_rearrange_is_refused_before_the_start():
    config = dataclasses.replace(KINEMATIC, engine=Choice(f"{__name__}:Rigid"))
    with pytest.raises(ConfigError, match=r"engine=.*Rigid cannot run a world with directives"):
        simulate(ward(person(StandStill())), config)
    plain = ward(HumanSpec(name="a", route=frozen_array([[2.0, 2.0]])), horizon=0.5)
    assert simulate(plain, config).ended == "horizon"


def test_a_world_that_needs_its_program_is_not_run_without_it():
    world = dataclasses.replace(ward(person(StandStill())), scripted="behaviors of its own (nurse)")
    with pytest.raises(WorldError, match=r"behaviors of its own \(nurse\).*scenic -S"):
        simulate(world, KINEMATIC)
