"""What a scenario author may rely on: places, classes, streams, and what they become."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from scenic.core.vectors import Vector
from shapely.geometry import LineString, Point, Polygon

from mrta_falsify.core.errors import InputError, WorldError
from mrta_falsify.core.world import Blockage, CommsOutage, HumanSpec, World
from simulator_interface.scenic_bridge.world_from_scene import SceneRejected, world_from_scene

pytestmark = pytest.mark.filterwarnings("ignore")

#: name, and (width, length, height) in metres that a real one lies within
KINDS = {
    "Bed": ((0.85, 1.1), (2.0, 2.4), (0.4, 1.3)),
    "Chair": ((0.4, 0.7), (0.4, 0.7), (0.7, 1.1)),
    "Desk": ((1.2, 1.8), (0.6, 0.9), (0.65, 0.8)),
    "Bookshelf": ((0.6, 1.2), (0.25, 0.45), (1.5, 2.3)),
    "Cabinet": ((0.6, 1.2), (0.35, 0.6), (0.8, 1.6)),
    "Trolley": ((0.4, 0.75), (0.6, 1.2), (0.8, 1.2)),
    "Wheelchair": ((0.55, 0.7), (0.9, 1.2), (0.85, 1.1)),
    "IVStand": ((0.4, 0.65), (0.4, 0.65), (1.5, 2.2)),
    "Curtain": ((1.0, 3.0), (0.05, 0.3), (1.6, 2.5)),
    "TrashBin": ((0.3, 0.6), (0.3, 0.6), (0.4, 1.0)),
}


SHOWROOM = """
model scenic_worlds.model
r1 = new Robot with name 'r1', with start_room 'ward_northwest', facing 90 deg,
    with model 'burger', with body_radius 0.2, with max_speed 0.7, with max_acceleration 0.9,
    with max_turn_rate 1.9, with capacity 3, with joins_at 12, with position_noise 0.01,
    with heading_noise 0.02, with wheel_slip 0.03, with command_latency 0.04
r2 = new Robot with name 'r2', with start_room 1
new Robot with start_room 2, with active False

new Bookshelf with name 'shelf', on along_wall('ward_northeast', gap=(0.05, 0.06))
new Bed with name 'bed', on along_wall(2, fits=(1.0, 2.2))
desk = new Desk with name 'desk', in room('ward_southwest'), facing Range(0, 360) deg
new Stool with name 'stool', in beside(desk, distance=(0.3, 0.5))
new TrashBin in corridors, with active False

new Human with name 'guest',
    with route [(1, -5), 3, 'ward_northeast', new Point at (2, -4)],
    with speed 0.8, with reacts False, with repeat False, with phase 0.5,
    with appears_at 3, with leaves_at 60, with body_radius 0.3
new Human with name 'stander', at (2, -4)
new Human with name 'follower', with route route(1, 2)
new Human with name 'stroller', with route random_route(4)
new Human with name 'visitor', with route random_visits(3)
new Human with name 'walker', with route random_visits(3, least=5), with pause Range(5, 20)
new Human with name 'perhaps', with route [1, 2], with active Uniform(True, False)
new Human with route [1, 2], with active False

new Blockage with name 'parked', on route(0, 2), with during (5, Range(20, 30))
new CommsOutage with name 'outage', with robots ['r1', r2], with links ['planner'],
    with during (1, 2)
new Blockage with active False
new CommsOutage with active False

for i, kind in enumerate([KINDS]):
    new kind at (4.5, -1 - 2.6 * i), facing 0 deg, with name kind.__name__,
        with regionContainedIn everywhere, with allowCollisions True
param tasks = [(0, 1, 2, 300), (0, 1, 2, 300, 0, 0, False), (1, 'ward_northeast', 2, 300, 4, 5)]
""".replace("KINDS", ", ".join(KINDS))

STREAMS = """
model scenic_worlds.model
new Robot with start_room 0
param tasks = (
    burst(6, begin=20, within=5, slack=(100, 150), service=3)
    + hot_room('day_surgery', 8)
    + hot_room(3, 10, share=0.5)
    + tight_deadlines(5, factor=(1.2, 1.3), service=2)
    + poisson(1 / 30, between=(60, 360), most=30)
)
"""

RANDOM_FLOOR = """
from scenic_worlds.floors import hospital
param layout = hospital(
    shape='line', rooms=4, station=False, active=[True, True, True, Uniform(True, False)],
    corridor_width=Range(1.8, 4), room_width=Range(4, 8),
)
model scenic_worlds.model
for i in range(3):
    new Robot with start_room i
new Bed on along_wall(1, fits=(1.0, 2.2))
new Human with route random_route(2)
new Blockage in doorway(any_room()), with during (10, 20)
param tasks = burst(2) + [(0, 0, 'ward_3', 300)]
"""

PLAIN = """
model scenic_worlds.model
new Robot with start_room 0, with name 'r'
new Human at (2, -4), with name 'h'
new Blockage at (4.5, -12), with name 'b'
new CommsOutage with name 'o'
param tasks = [(0, 1, 2, 300)]
"""


def compiled(text: str, folder):
    from scenic_worlds.program import compile_program

    path = folder / "program.scenic"
    path.write_text(text)
    return compile_program(path)


def sampled(text: str, seeds: int, folder) -> list[World]:
    program = compiled(text, folder)
    return [program.sample(seed) for seed in range(seeds)]


@pytest.fixture(scope="module")
def showrooms(tmp_path_factory) -> list[World]:
    return sampled(SHOWROOM, 8, tmp_path_factory.mktemp("showroom"))


@pytest.fixture(scope="module")
def streams(tmp_path_factory) -> list[World]:
    return sampled(STREAMS, 40, tmp_path_factory.mktemp("streams"))


def thing(world: World, name: str) -> Polygon:
    """Footprint of a piece of furniture."""
    return Polygon(next(item.polygon for item in world.furniture if item.name == name))


def person(world: World, name: str) -> HumanSpec:
    return next(human for human in world.humans if human.name == name)


@pytest.fixture(scope="module")
def hospital_places():
    from scenic_worlds.places import places_of

    return places_of("aws_hospital")


# --- places --------------------------------------------------------------------------------


def test_rooms_go_by_number_and_by_name(hospital_places):
    by_name = hospital_places.room("ward_southeast")
    assert by_name is hospital_places.room(2)
    assert by_name.containsPoint(hospital_places.room_point(2))


@pytest.mark.parametrize("place", [6, -1, 1.5, "ward_7"])
def test_an_unknown_room_is_refused_with_the_known_ones(hospital_places, place):
    with pytest.raises(InputError, match=r"unknown room .*Known: .*[5w]"):
        hospital_places.room(place)


def test_corridors_rooms_and_standing_room_are_parts_of_the_free_floor(hospital_places):
    free = hospital_places.free_floor.polygons.buffer(1e-9)
    for part in ("corridors", "standing_room", "inside_rooms"):
        assert free.contains(getattr(hospital_places, part).polygons), part
    inside = shapely.union_all([hospital_places.room(i).polygons for i in range(6)])
    assert hospital_places.corridors.polygons.intersection(inside).area == pytest.approx(0.0)


def test_standing_room_leaves_room_points_and_waiting_spots_clear(hospital_places):
    standing = hospital_places.standing_room.polygons
    layout = hospital_places.layout
    spots = [spot for resource in layout.resources for spot in resource.spots]
    for point in [*(room.point for room in layout.rooms), *spots]:
        assert standing.distance(Point(point)) > 0.4


def test_a_lane_is_a_polyline_from_room_to_room(hospital_places):
    lane = hospital_places.route(1, "day_surgery")
    assert np.allclose(lane.points[0][:2], hospital_places.room_point(1))
    assert np.allclose(lane.points[-1][:2], hospital_places.room_point(3))


def test_the_queue_area_holds_the_waiting_spots(hospital_places):
    spots = next(r.spots for r in hospital_places.layout.resources if r.room == 4)
    area = hospital_places.queue_area(4).polygons
    assert all(area.contains(Point(spot)) for spot in spots)


def test_a_doorway_faces_into_the_room(hospital_places):
    doorway = hospital_places.doorway("ward_northwest")  # west of the corridor
    heading = doorway.orientation[doorway.uniformPointInner()].yaw
    assert heading == pytest.approx(np.pi / 2, abs=0.05)


def test_a_room_without_a_door_says_so(hospital_places):
    with pytest.raises(WorldError, match=r"nurses_station.* has no door.*rooms with a door: 1, 2"):
        hospital_places.doorway(0)


def test_furniture_along_a_wall_has_its_back_to_it_and_faces_the_room(showrooms):
    walls = shapely.union_all([Polygon(wall.polygon) for wall in showrooms[0].walls])
    for world in showrooms:
        corners = np.array(thing(world, "shelf").exterior.coords)
        # rectangle() begins at the back right corner, so the last of the four sides is the back
        gaps = [walls.distance(LineString(corners[i : i + 2])) for i in range(4)]
        assert min(gaps) == pytest.approx(gaps[3], abs=1e-9)
        assert gaps[3] == pytest.approx(0.055, abs=0.006)
        assert gaps[1] > gaps[3] + 0.25


def test_along_wall_keeps_to_the_places_where_a_bed_fits(showrooms):
    for world in showrooms:
        bed = thing(world, "bed")
        walls = shapely.union_all([Polygon(wall.polygon) for wall in world.walls])
        assert 0.0 < bed.distance(walls) < 0.13


def test_beside_is_near_the_object_and_faces_it(showrooms):
    for world in showrooms:
        desk, stool = thing(world, "desk"), thing(world, "stool")
        assert 0.0 < desk.distance(stool) < 0.5
        corners = np.array(stool.exterior.coords)
        back, front = corners[[0, 3]].mean(axis=0), corners[[1, 2]].mean(axis=0)
        center = np.array(desk.centroid.coords[0])
        assert np.hypot(*(front - center)) < np.hypot(*(back - center))


def test_a_thing_on_a_route_stands_on_the_lane(showrooms, hospital_places):
    lane = LineString(np.array(hospital_places.route(0, 2).points)[:, :2])
    for world in showrooms:
        assert lane.distance(Polygon(world.events[0].polygon).centroid) < 1e-6


# --- classes -------------------------------------------------------------------------------


def test_furniture_has_the_size_of_the_real_thing(showrooms):
    world = showrooms[0]
    for kind, limits in KINDS.items():
        item = next(item for item in world.furniture if item.name == kind)
        size = (*np.ptp(item.polygon, axis=0), item.height)
        for value, (low, high) in zip(size, limits, strict=True):
            assert low <= value <= high, (kind, size)


def test_a_robot_carries_every_property_into_the_world(showrooms):
    robot = showrooms[0].robots[0]
    assert np.allclose(robot.pose, [-7.75, -7.5, np.pi])
    assert (robot.name, robot.model, robot.capacity) == ("r1", "burger", 3)
    assert (robot.radius, robot.max_speed, robot.max_acceleration) == (0.2, 0.7, 0.9)
    assert (robot.max_turn_rate, robot.joins_at, robot.position_noise) == (1.9, 12.0, 0.01)
    assert (robot.heading_noise, robot.wheel_slip, robot.command_latency) == (0.02, 0.03, 0.04)


def test_a_person_walks_points_rooms_and_names(showrooms, hospital_places):
    guest = person(showrooms[0], "guest")
    wanted = [[1, -5], hospital_places.room_point(3), hospital_places.room_point(1), [2, -4]]
    assert np.allclose(guest.route, wanted)
    assert (guest.speed, guest.reacts_to_robots, guest.repeat) == (0.8, False, False)
    assert (guest.start, guest.appears_at, guest.leaves_at) == (0.5, 3.0, 60.0)
    assert guest.radius == 0.3


def test_a_person_without_a_route_stands_where_it_was_put(showrooms):
    assert np.allclose(person(showrooms[0], "stander").route, [[2, -4]])


def test_a_person_follows_a_lane(showrooms, hospital_places):
    lane = np.array(hospital_places.route(1, 2).points)[:, :2]
    assert np.allclose(person(showrooms[0], "follower").route, lane)


def test_sampled_routes_lie_where_they_were_asked_for(showrooms, hospital_places):
    corridors = hospital_places.corridors.polygons.buffer(1e-9)
    rooms = hospital_places.inside_rooms.polygons.buffer(1e-9)
    for world in showrooms:
        stroll, visits = person(world, "stroller").route, person(world, "visitor").route
        assert (len(stroll), len(visits)) == (4, 3)
        assert all(corridors.contains(Point(p)) for p in stroll)
        assert all(rooms.contains(Point(p)) for p in visits)


def test_visits_are_as_far_apart_as_asked_for(showrooms, hospital_places):
    for world in showrooms:
        walker = person(world, "walker")
        steps = walker.route - np.roll(walker.route, 1, axis=0)
        assert np.hypot(*steps.T).min() >= 5.0
        assert 5.0 <= walker.pause <= 20.0
    small = hospital_places.visits(1000.0, np.array([[0.0, 0.0]]))
    assert shapely.area(small.polygons).sum() > 0.0


def test_events_become_events(showrooms):
    for world in showrooms:
        parked, outage = world.events
        assert isinstance(parked, Blockage)
        assert (parked.name, parked.start) == ("parked", 5.0)
        assert 20.0 <= parked.end <= 30.0
        assert Polygon(parked.polygon).area == pytest.approx(1.0 * 2.2)
        assert isinstance(outage, CommsOutage)
        assert (outage.robots, outage.links) == (("r1", "r2"), ("planner",))
        assert (outage.start, outage.end) == (1.0, 2.0)


def test_what_is_not_active_is_left_out(showrooms):
    from scenic_worlds.layouts import load_layout

    own = len(load_layout("aws_hospital").furniture)
    for world in showrooms:
        assert len(world.robots) == 2
        assert len(world.events) == 2
        assert len(world.tasks) == 2
        assert len(world.furniture) == own + 4 + len(KINDS)
        assert {human.name for human in world.humans} - {"perhaps"} == {
            "guest", "stander", "follower", "stroller", "visitor", "walker",
        }  # fmt: skip


def test_a_random_flag_decides_who_is_there(showrooms):
    there = {any(human.name == "perhaps" for human in world.humans) for world in showrooms}
    assert there == {True, False}


# --- tasks ---------------------------------------------------------------------------------


def test_a_task_may_have_service_times(showrooms):
    task = showrooms[0].tasks[1]
    assert (task.arrival, task.start, task.end, task.deadline) == (1.0, 1, 2, 300.0)
    assert (task.pickup_time, task.dropoff_time) == (4.0, 5.0)


@pytest.mark.slow
def test_a_burst_arrives_within_its_time(streams):
    for world in streams:
        for task in world.tasks[:6]:
            assert 20.0 <= task.arrival <= 25.0
            assert 100.0 <= task.deadline - task.arrival <= 150.0
            assert task.start != task.end
            assert task.pickup_time == task.dropoff_time == 3.0


def test_a_hot_room_draws_all_tasks_or_a_share(streams):
    every = [task for world in streams for task in world.tasks[6:14]]
    assert {task.end for task in every} == {3}
    assert {task.start for task in every} == {0, 1, 2, 4, 5}
    ends = np.array([task.end for world in streams for task in world.tasks[14:24]])
    share = 0.5 + 0.5 / 6
    assert np.mean(ends == 3) == pytest.approx(share, abs=4 * np.sqrt(share / len(ends)))


def test_tight_deadlines_follow_the_travel_times(streams):
    for world in streams:
        for task in world.tasks[24:29]:
            times = world.travel_times
            needed = times[:, task.start].max() + times[task.start, task.end] + 4.0
            assert 1.2 <= (task.deadline - task.arrival) / needed <= 1.3


def test_poisson_arrivals_have_the_rate_asked_for(streams):
    arrivals = [[task.arrival for task in world.tasks[29:]] for world in streams]
    mean = np.mean([len(times) for times in arrivals])
    assert mean == pytest.approx(10.0, abs=4 * np.sqrt(10 / len(streams)))
    for times in arrivals:
        assert times == sorted(times)
        assert all(60.0 <= time < 360.0 for time in times)


# --- random floors ---------------------------------------------------------------------------


def test_places_follow_a_random_floor_and_scenes_without_a_named_room_are_drawn_again(tmp_path):
    worlds = sampled(RANDOM_FLOOR, 4, tmp_path)
    assert len({world.bounds[2] for world in worlds}) == 4
    for world in worlds:
        assert "ward_3" in [room.name for room in world.rooms]
        bed = Polygon(world.furniture[-1].polygon)
        assert Polygon(world.rooms[1].area).buffer(0.01).contains(bed)
        for i, robot in enumerate(world.robots):
            assert np.allclose(robot.pose[:2], world.rooms[i].point)


def test_a_warehouse_may_be_random_too(tmp_path):
    text = """
from scenic_worlds.floors import warehouse
param layout = warehouse(aisles=4, picks=2, aisle_width=Range(2.4, 4.0))
model scenic_worlds.model
for i in range(2):
    new Robot with start_room i
param tasks = burst(2)
"""
    worlds = sampled(text, 3, tmp_path)
    assert len({world.bounds[2] for world in worlds}) == 3
    assert all(any(r.kind == "charger" for r in world.resources) for world in worlds)


# --- what is refused -------------------------------------------------------------------------


@pytest.fixture(scope="module")
def plain_scene(tmp_path_factory):
    program = compiled(PLAIN, tmp_path_factory.mktemp("plain"))
    return program.realise(program.candidate(0)).scene


@pytest.mark.parametrize(
    ("parameter", "value", "message"),
    [
        ("layout", "warehouse", r"param layout is 'warehouse' now.*give it before that line"),
        ("tasks", [(0, 1, 2)], r"param tasks\[0\] is \(0, 1, 2\); it must be \(arrival"),
        ("tasks", [(0, 1, 9, 300)], r"param tasks\[0\]: unknown room '9'.*Known: 0, 1"),
        ("tasks", [(0, "attic", 1, 300)], r"param tasks\[0\]: unknown room 'attic'"),
        ("tasks", [("soon", 1, 2, 300)], r"arrival is 'soon'; it must be a finite number"),
        ("tasks", [(-1, 1, 2, 300)], r"param tasks\[0\].*times must be >= 0 s"),
        ("tasks", 5, r"param tasks is 5; it must be a list of \(arrival"),
        ("horizon", "long", r"param horizon is 'long'; it must be a finite number"),
    ],
)
def test_a_parameter_that_can_never_be_is_refused_by_name(
    plain_scene, monkeypatch, parameter, value, message
):
    monkeypatch.setitem(plain_scene.params, parameter, value)
    with pytest.raises(InputError, match=message) as caught:
        world_from_scene(plain_scene, name="plain", seed=0)
    assert not isinstance(caught.value, SceneRejected)


@pytest.mark.parametrize(
    ("name", "field", "value", "message"),
    [
        ("h", "speed", "fast", r"h: speed is 'fast'; it must be a finite number"),
        ("h", "route", [(1,)], r"h: route has the stop \(1,\); a stop is a point"),
        ("h", "route", ["attic"], r"h: route unknown room 'attic'"),
        ("b", "during", 5, r"b: during is 5; it must be \(start, end\) in seconds"),
        ("o", "links", ["wifi"], r"o: links has 'wifi'; a link is one of dispatcher"),
        ("o", "robots", ["r9"], r"unknown robot 'r9'; did you mean 'r'"),
    ],
)
def test_a_property_that_can_never_be_is_refused_by_name(
    plain_scene, monkeypatch, name, field, value, message
):
    item = next(item for item in plain_scene.objects if item.name == name)
    monkeypatch.setattr(item, field, value)
    with pytest.raises(InputError, match=message) as caught:
        world_from_scene(plain_scene, name="plain", seed=0)
    assert not isinstance(caught.value, SceneRejected)


@pytest.mark.parametrize(
    ("name", "field", "value", "message"),
    [
        ("b", "during", (10, 5), r"b: during ends at 5 s, before its start at 10 s"),
        ("b", "position", (0, 2.2, 0), r"b: stands on r at the start"),
    ],
)
def test_contradicting_values_reject_the_scene(
    plain_scene, monkeypatch, name, field, value, message
):
    item = next(item for item in plain_scene.objects if item.name == name)
    monkeypatch.setattr(item, field, Vector(*value) if field == "position" else value)
    with pytest.raises(SceneRejected, match=message):
        world_from_scene(plain_scene, name="plain", seed=0)


def test_a_deadline_before_its_arrival_rejects_the_scene(plain_scene, monkeypatch):
    monkeypatch.setitem(plain_scene.params, "tasks", [(10, 1, 2, 5)])
    with pytest.raises(SceneRejected, match=r"tasks\[0\]: deadline 5 s is before its arrival"):
        world_from_scene(plain_scene, name="plain", seed=0)
