"""Open-RMF buildings become floors: frames, places, lanes, doors, mutex groups, and errors."""

from __future__ import annotations

import dataclasses
import os
import random
from pathlib import Path

import numpy as np
import pytest
import yaml
from shapely.geometry import LineString, Point, Polygon

from mrta_falsify.commands.floor_import import import_floor
from mrta_falsify.core.arrays import frozen_array
from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.core.errors import InputError
from mrta_falsify.core.world import RobotSpec, Task
from mrta_falsify.specs.library import build_specifications
from scenic_worlds.layouts import layout_names, load_layout, load_world, world_names
from scenic_worlds.layouts.derivation import derive_layout
from simulator_interface.formats.floor_yaml import read_floor
from simulator_interface.formats.open_rmf import write_open_rmf
from simulator_interface.simulate import simulate
from tests import drawn_buildings

#: a folder with office, hotel and clinic.building.yaml of open-rmf/rmf_demos; without it, skipped
MAPS = os.environ.get("OPEN_RMF_MAPS", "")


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "clinic.building.yaml"
    path.write_text(drawn_buildings.text())
    return path


def _place(floor, name):
    return next(room.point for room in floor.rooms if room.name == name)


def test_pixels_become_metres_with_y_up(file):
    floor = read_floor(file)
    assert [room.name for room in floor.rooms] == ["store", "ward", "desk", "dock_1", "dock_2"]
    assert _place(floor, "ward") == pytest.approx([13.0, -3.0])
    assert floor.name == "clinic"
    walls = [wall.polygon for wall in floor.walls if wall.name.startswith("wall")]
    assert len(walls) == len(drawn_buildings.WALLS)
    assert Polygon(walls[0]).bounds == pytest.approx((-0.05, -0.05, 16.05, 0.05))


def test_a_scale_is_the_mean_over_the_measurements(file):
    data = drawn_buildings.building()
    data["levels"]["ground"]["measurements"][1][2]["distance"][1] = 8.8  # 10 % more
    file.write_text(yaml.safe_dump(data))
    assert _place(read_floor(file), "ward") == pytest.approx([1.05 * 13.0, 1.05 * -3.0])


def test_metres_stay_as_they_are(file):
    data = drawn_buildings.building()
    data["coordinate_system"] = "cartesian_meters"
    for vertex in data["levels"]["ground"]["vertices"]:
        vertex[:2] = [0.05 * vertex[0], 0.05 * vertex[1]]
    file.write_text(yaml.safe_dump(data))
    assert _place(read_floor(file), "ward") == pytest.approx([13.0, 3.0])


def test_degrees_become_metres_on_the_ellipsoid(file):
    """At 45 degrees, one of longitude is 78,847 m long and one of latitude 111,132 m."""
    data = drawn_buildings.building()
    data["coordinate_system"] = "wgs84"
    for vertex in data["levels"]["ground"]["vertices"]:
        x, y = 0.05 * vertex[0], -0.05 * vertex[1]
        vertex[:2] = [9.0 + x / 78_847.0, 45.0 + y / 111_132.0]
    file.write_text(yaml.safe_dump(data))
    floor = read_floor(file)
    apart = np.subtract(_place(floor, "ward"), _place(floor, "desk"))
    file.write_text(drawn_buildings.text())
    plain = read_floor(file)
    expected = np.subtract(_place(plain, "ward"), _place(plain, "desk"))
    assert apart == pytest.approx(expected, rel=1e-4, abs=1e-3)


def test_another_level_lies_on_the_reference_level(file):
    file.write_text(drawn_buildings.text(("ground", "upper")))
    ground, upper = (read_floor(file, level=name) for name in ("ground", "upper"))
    for name in ("store", "ward", "desk"):
        assert _place(upper, name) == pytest.approx(_place(ground, name), abs=1e-9)
    assert upper.name == "clinic_upper"
    assert upper.left_out[0].startswith("the levels ground")


def test_lanes_keep_their_direction(file):
    lanes = {(lane.start, lane.end): lane for lane in read_floor(file).lanes}
    assert len(lanes) == 5 * 4
    assert lanes["ward", "desk"].to_room.tolist() == pytest.approx(np.array([[13.0, -6.5]]))
    back = lanes["desk", "ward"].to_room  # the lane is one way, so round by the passage's end
    assert back == pytest.approx(np.array([[11.0, -3.0], [13.0, -3.0]]))


def test_doors_on_lanes_are_passed_in_turn_and_others_stay_shut(file):
    floor = read_floor(file)
    uses = {use.name: use for use in floor.resources}
    assert uses["store_door"].kind == "door"
    assert Polygon(uses["store_door"].release_area).covers(Point(6.0, -3.0))
    (shut,) = [wall for wall in floor.walls if wall.name == "closet_door"]
    assert Polygon(shut.polygon).covers(Point(7.6, -5.0))
    assert "1 doors without a lane: robots find them shut" in floor.left_out


def test_a_mutex_group_is_a_corridor_for_one_robot(file):
    (use,) = [use for use in read_floor(file).resources if use.name == "passage"]
    area = Polygon(use.release_area)
    assert (use.kind, use.capacity) == ("corridor", 1)
    assert area.bounds == pytest.approx((5.0, -3.5, 11.0, -2.5))


def test_chargers_without_a_name_are_parking_and_holding_points_waiting_spots(file):
    data = drawn_buildings.building()
    for vertex in data["levels"]["ground"]["vertices"]:
        if vertex[3].startswith("dock"):
            vertex[3] = ""
    file.write_text(yaml.safe_dump(data))
    floor = read_floor(file)
    assert [room.name for room in floor.rooms] == ["store", "ward", "desk"]
    assert floor.parking == pytest.approx(np.array([[3.0, -6.0], [1.5, -1.5]]))
    assert [name for name, _ in floor.starts] == ["ada", "bob"]
    (ward,) = [room for room in floor.rooms if room.name == "ward"]
    assert ward.queue == pytest.approx(np.array([[11.5, -1.0]]))


def test_what_has_no_counterpart_is_told(file):
    said = "\n".join(read_floor(file).left_out)
    for words in ("1 models", "speed limits of 1 lanes", "charging"):
        assert words in said


def test_a_group_in_pieces_is_told(file):
    data = drawn_buildings.building()
    data["levels"]["ground"]["lanes"][5][2]["mutex"] = [1, "passage"]
    file.write_text(yaml.safe_dump(data))
    floor = read_floor(file)
    assert {use.name for use in floor.resources} >= {"passage", "passage_2"}
    assert any("the unity of mutex group passage" in line for line in floor.left_out)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda d, g: d.update(levels={}), "levels is empty"),
        (lambda d, g: d.update(coordinate_system="mars"), "coordinate_system is 'mars'"),
        (lambda d, g: d.update(coordinate_system="wgs84"), "not all vertices are longitude"),
        (lambda d, g: g.update(measurements=[]), "measurements is empty"),
        (lambda d, g: g["measurements"][0][2].clear(), "measurements[0].distance is None"),
        (lambda d, g: g["measurements"][0].__setitem__(1, 0), "0 pixels are 16 m"),
        (lambda d, g: g.update(lanes=[]), "has no lanes"),
        (lambda d, g: g["lanes"].__setitem__(2, [0, 99, {}]), "lanes[2][1] is 99"),
        (lambda d, g: g["walls"].__setitem__(1, "x"), "walls[1] is 'x'"),
        (lambda d, g: g["vertices"].__setitem__(0, [0, "a", 0, ""]), "vertices[0][1] is 'a'"),
        (lambda d, g: g["lanes"][0][2].update(mutex=[7, 5]), "lanes[0][2].mutex is [7, 5]"),
        (lambda d, g: g["lanes"][0][2].update(mutex=[3, "x"]), "lanes[0][2].mutex is [3, 'x']"),
        (lambda d, g: g["lanes"][0][2].update(mutex=[[], 5]), "lanes[0][2].mutex is [[], 5]"),
        (lambda d, g: g.update(floors=[{"vertices": [0]}]), "floors[0].vertices is [0]"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_told_with_its_place(file, change, words):
    data = drawn_buildings.building()
    change(data, data["levels"].get("ground", {}))
    file.write_text(yaml.safe_dump(data))
    with pytest.raises(InputError) as caught:
        read_floor(file)
    assert words in str(caught.value)
    assert str(file) in str(caught.value)


@pytest.mark.parametrize("name", ["101", "007", "1_2", "12:30", "3.10", "2024-01-31", "no"])
def test_names_that_yaml_takes_for_something_else_stay_as_they_are_written(file, name):
    data = drawn_buildings.building()
    ground = data["levels"].pop("ground")
    ground["vertices"][17][3] = "NAME"
    ground["doors"][0][2]["name"] = [1, "NAME"]
    ground["lanes"][1][2]["mutex"] = [1, "NAME"]
    data["levels"]["NAME"] = ground
    data.pop("reference_level_name", None)
    data["lifts"] = {"NAME": {}}
    file.write_text(yaml.safe_dump(data).replace("NAME", name))
    for level in (None, name):
        floor = read_floor(file, level=level)
        assert [room.name for room in floor.rooms][:3] == ["store", name, "desk"]
        assert sorted(use.name for use in floor.resources) == [f"{name}_2", f"{name}_3"]
        assert any(f"the lifts {name} " in line for line in floor.left_out)


def test_fields_that_open_rmf_does_not_define_are_told_once(file):
    data = drawn_buildings.building()
    data["colour"] = 1
    data["levels"]["ground"] |= {"wals": [], "site": {"a": 1}}
    file.write_text(yaml.safe_dump(data))
    first, second = read_floor(file).notes
    assert first == "colour of the building is not used"
    assert second == "site and wals of level ground are not used (did you mean walls?)"


def test_numbers_may_be_written_as_yaml_does_not_know_them(file):
    data = drawn_buildings.building()
    data["levels"]["ground"]["measurements"][0][2]["distance"] = [3, "LENGTH"]
    file.write_text(yaml.safe_dump(data).replace("LENGTH", "160e-1"))
    assert _place(read_floor(file), "ward") == pytest.approx([13.0, -3.0])


def test_levels_are_named_by_the_option(file):
    file.write_text(drawn_buildings.text(("ground", "upper")))
    with pytest.raises(InputError, match="has the levels ground, upper; name one by --level"):
        read_floor(file)
    with pytest.raises(InputError, match="unknown level 'uper'; did you mean 'upper'"):
        read_floor(file, level="uper")
    data = drawn_buildings.building(("ground", "upper"))
    data["levels"]["upper"]["fiducials"] = []
    file.write_text(yaml.safe_dump(data))
    with pytest.raises(InputError, match="shares 0 fiducials with 'ground'"):
        read_floor(file, level="upper")
    data["levels"]["ground"]["walls"][0] = "x"  # of a level that is not asked for
    file.write_text(yaml.safe_dump(data))
    with pytest.raises(InputError, match=r"levels\.ground\.walls\[0\] is 'x'"):
        read_floor(file, level="upper")


def _damaged(raw: bytes, rng: random.Random) -> bytes:
    lines = raw.splitlines(keepends=True)
    match rng.randrange(4):
        case 0:
            k = rng.randrange(len(raw))
            return raw[:k] + bytes([rng.randrange(256)]) + raw[k + 1 :]
        case 1:
            return raw[: rng.randrange(len(raw))]
        case 2:
            k = rng.randrange(len(lines))
            return b"".join(lines[:k] + lines[k + 1 :])
        case _:
            k, other = rng.randrange(len(lines)), rng.randrange(len(lines))
            return b"".join([*lines[:k], lines[other], *lines[k:]])


@pytest.mark.filterwarnings("ignore::mrta_falsify.core.errors.InputNote")
def test_damaged_buildings_are_told_in_a_sentence(file):
    raw = drawn_buildings.text(("ground", "upper")).encode()
    rng = random.Random(21)
    refused = []
    for _ in range(100):
        file.write_bytes(_damaged(raw, rng))
        try:
            read_floor(file, level=rng.choice(["ground", "upper"]))
        except InputError as error:
            refused.append(str(error))
    assert len(refused) > 25
    assert all(str(file) in text for text in refused)


def test_an_imported_building_can_be_changed_and_imported_again(file, tmp_path):
    done = import_floor(file, tmp_path / "out")
    assert done.floor.name == "clinic.floor.json"
    assert done.lanes_given == 20
    assert "with name 'ada'" in done.scenario.read_text()
    again = import_floor(tmp_path / "out" / "clinic.derived.yaml", tmp_path / "again")
    places, before = ([room.point for room in d.rooms] for d in (again, done))
    assert np.array(places) == pytest.approx(np.array(before))
    assert (again.walls, again.lanes, again.parking) == (done.walls, done.lanes, done.parking)


def _delivers(floor, tasks, *, radius, robots=2, horizon=600.0):
    """Run robots from the parking places on; tell what was delivered, and of how many."""
    layout = derive_layout(floor, radius=radius)
    starts = [*layout.parking, *(room.point for room in layout.rooms)]
    world = dataclasses.replace(
        layout,
        robots=tuple(
            RobotSpec(name=f"r{i}", pose=frozen_array([*starts[i], 0.0]), radius=radius)
            for i in range(robots)
        ),
        tasks=tuple(
            Task(arrival=0.0, start=a, end=b, deadline=horizon) for a, b in tasks
        ),
        horizon=horizon,
    )  # fmt: skip
    specifications = build_specifications(("no_robot_static_contact", "all_tasks_done"))
    outcome = simulate(
        world,
        StackConfig(engine=Choice("kinematic")),
        specifications=specifications,
        keep_trace=False,
    )
    assert [verdict.spec for verdict in outcome.verdicts if verdict.violated] == []
    return outcome.tasks.completed


def test_robots_deliver_in_a_building(file):
    assert _delivers(read_floor(file), [(0, 1), (2, 0), (1, 2)], radius=0.22) == 3


def test_robots_deliver_between_chargers(file):
    floor = read_floor(file)
    names = [room.name for room in floor.rooms]
    ends = names.index("dock_1"), names.index("dock_2")
    assert not len(floor.parking)
    assert [name for name, _ in floor.starts] == ["ada", "bob"]
    assert _delivers(floor, [ends, ends[::-1]], radius=0.22) == 2


def test_a_building_with_one_place_says_what_it_left_out(file, tmp_path):
    data = drawn_buildings.building(("ground", "upper"))
    for vertex in data["levels"]["ground"]["vertices"]:
        vertex[3] = "" if vertex[3] != "ward" else "ward"
    data["levels"]["ground"]["vertices"].append([50, 50, 0, "attic", {}])
    file.write_text(yaml.safe_dump(data))
    with pytest.raises(
        InputError, match="has one place for tasks, 'ward'; deliveries need two"
    ) as e:
        import_floor(file, tmp_path / "out", level="ground")
    for words in ("without a lane: attic", "7 vertices on lanes without a name", "levels upper"):
        assert words in str(e.value)


# --- places on the ways of others ------------------------------------------------------------


def _hall(depth=6.0, rows=(), lanes=(), **places):
    """A hall 20 m long with lanes along its middle: west, middle, east."""
    y = depth / 2.0
    corners = [(0.0, 0.0), (20.0, 0.0), (20.0, depth), (0.0, depth)]
    stops = [(2.0, y, "west"), (10.0, y, "middle"), (18.0, y, "east")]
    both = {"bidirectional": [4, True]}
    return {
        "name": "hall",
        "coordinate_system": "cartesian_meters",
        "levels": {
            "L1": {
                "vertices": [
                    *([x, y, 0, ""] for x, y in corners),
                    *([x, y, 0, name, places.get(name, {})] for x, y, name in stops),
                    *([*row[:2], 0, *row[2:]] for row in rows),
                ],
                "walls": [[0, 1], [1, 2], [2, 3], [3, 0]],
                "floors": [{"vertices": [0, 1, 2, 3]}],
                "lanes": [[4, 5, both], [5, 6, both], *([a, b, both] for a, b in lanes)],
            }
        },
        "lifts": {},
    }


def _imported(tmp_path, data):
    file = tmp_path / "hall.building.yaml"
    file.write_text(yaml.safe_dump(data))
    done = import_floor(file, tmp_path / "out")
    return done, load_layout(done.floor)


def _violated_by_one_who_passes(layout):
    """Run one robot past another that loads in ``middle``."""
    names = [room.name for room in layout.rooms]
    west, middle, east = (names.index(name) for name in ("west", "middle", "east"))
    starts = zip(("ada", "bob"), (middle, west), strict=True)
    world = dataclasses.replace(
        layout,
        robots=tuple(
            RobotSpec(name=name, pose=frozen_array([*layout.rooms[k].point, 0.0]))
            for name, k in starts
        ),
        tasks=(
            Task(arrival=0.0, start=middle, end=middle, deadline=200, pickup_time=30, robot="ada"),
            Task(arrival=0.0, start=west, end=east, deadline=200, robot="bob"),
        ),
        horizon=200.0,
    )
    outcome = simulate(
        world,
        StackConfig(engine=Choice("kinematic")),
        specifications=build_specifications(("exclusive_use", "all_tasks_done")),
        keep_trace=False,
    )
    return [(v.spec, v.evidence.get("resource")) for v in outcome.verdicts if v.violated]


def test_a_junction_moves_beside_the_lane_where_there_is_room(tmp_path):
    done, layout = _imported(tmp_path, _hall())
    (middle,) = [room for room in layout.rooms if room.name == "middle"]
    assert abs(middle.point[1] - 3.0) == pytest.approx(0.9, abs=0.1)
    lane = LineString([[2.0, 3.0], [18.0, 3.0]])
    assert Polygon(middle.area).distance(lane) > 0.3
    assert "middle (by 0." in "".join(done.warnings)
    assert _violated_by_one_who_passes(layout) == []
    again = import_floor(done.derived, tmp_path / "again")
    assert load_layout(again.floor).rooms[1].point == pytest.approx(middle.point, abs=1e-3)
    assert not any("beside the lane" in said for said in again.warnings)


def test_a_junction_in_a_narrow_corridor_owns_the_spot_of_one_robot_and_is_told(tmp_path):
    done, layout = _imported(tmp_path, _hall(depth=1.4))
    (middle,) = [room for room in layout.rooms if room.name == "middle"]
    assert middle.point == pytest.approx([10.0, 0.7])
    assert np.hypot(*(middle.area - middle.point).T).max() < 0.22
    assert any("middle: others drive past here" in said for said in done.warnings)
    assert ("exclusive_use", "middle") not in _violated_by_one_who_passes(layout)


def test_a_place_at_the_end_of_its_lane_keeps_its_surroundings(tmp_path):
    done, layout = _imported(tmp_path, _hall())
    for room, point in ((layout.rooms[0], [2.0, 3.0]), (layout.rooms[2], [18.0, 3.0])):
        assert room.point == pytest.approx(point)
        assert np.hypot(*(room.area - room.point).T).max() == pytest.approx(1.2)
    told = [said for said in done.warnings if "drive" in said]
    assert not any("west" in said or "east" in said for said in told)


def test_a_place_near_a_lane_of_others_keeps_off_it(tmp_path):
    beside = _hall(rows=[(6.0, 3.0, ""), (6.0, 4.0, "shelf")], lanes=[(7, 8)])
    beside["levels"]["L1"]["lanes"][0] = [4, 7, {"bidirectional": [4, True]}]
    beside["levels"]["L1"]["lanes"].append([7, 5, {"bidirectional": [4, True]}])
    _, layout = _imported(tmp_path, beside)
    (shelf,) = [room for room in layout.rooms if room.name == "shelf"]
    assert shelf.point == pytest.approx([6.0, 4.0])
    assert 0.05 < Polygon(shelf.area).distance(LineString([[2.0, 3.0], [18.0, 3.0]])) < 0.3


def test_robots_neither_park_nor_wait_on_lanes_that_others_drive(tmp_path):
    flags = {"is_holding_point": [4, True]}, {"is_parking_spot": [4, True]}
    data = _hall(rows=[(6.0, 3.0, "", flags[0]), (14.0, 3.0, "", flags[1])])
    both = {"bidirectional": [4, True]}
    data["levels"]["L1"]["lanes"] = [[a, b, both] for a, b in ((4, 7), (7, 5), (5, 8), (8, 6))]
    done, layout = _imported(tmp_path, data)
    stands = [*layout.parking, *(spot for use in layout.resources for spot in use.spots)]
    assert np.abs(np.array(stands)[:, 1] - 3.0).min() > 0.6
    assert any("on lanes that others drive" in said for said in done.left_out)


def _with_starts_in_rooms(layout):
    robots = tuple(
        RobotSpec(name=f"r{i}", pose=frozen_array([*room.point, 0.0]), radius=0.22)
        for i, room in enumerate(layout.rooms[:3])
    )
    return dataclasses.replace(layout, robots=robots)


@pytest.mark.parametrize("name", [*layout_names(), *world_names()])
def test_a_written_layout_is_read_with_the_same_rooms(name, tmp_path):
    """Robots start in rooms, which become chargers, and stay rooms."""
    is_layout = name in layout_names()
    world = _with_starts_in_rooms(load_layout(name)) if is_layout else load_world(name)
    building, _ = write_open_rmf(world, tmp_path)
    read = read_floor(building)
    derived = derive_layout(read, radius=0.22)
    assert [room.name for room in derived.rooms] == [room.name for room in world.rooms]
    for room, before in zip(derived.rooms, world.rooms, strict=True):
        assert room.point == pytest.approx(before.point, abs=0.01)
    assert {(lane.start, lane.end) for lane in derived.lanes} == {
        (lane.start, lane.end) for lane in world.lanes
    }
    assert [start for start, _ in read.starts] == [robot.name for robot in world.robots]


def test_robots_deliver_between_the_rooms_that_they_started_in(tmp_path):
    building, _ = write_open_rmf(_with_starts_in_rooms(load_layout("hospital")), tmp_path)
    assert _delivers(read_floor(building), [(0, 1), (1, 2)], radius=0.22) == 2


@pytest.mark.slow
@pytest.mark.skipif(not MAPS, reason="OPEN_RMF_MAPS names no folder of rmf_demos' maps")
@pytest.mark.parametrize(
    ("name", "level", "places", "doors", "tasks"),
    [
        ("office", None, 12, 2, [(4, 7), (10, 6), (5, 8)]),
        ("hotel", "L1", 7, 4, [(0, 2), (3, 1), (2, 4)]),
        ("clinic", "L2", 10, 4, [(0, 3), (7, 9), (4, 1)]),
    ],
)
def test_robots_deliver_on_the_maps_of_open_rmf(name, level, places, doors, tasks):
    floor = read_floor(Path(MAPS) / f"{name}.building.yaml", level=level)
    assert len(floor.rooms) == places
    assert sum(use.kind == "door" for use in floor.resources) == doors
    assert _delivers(floor, tasks, radius=0.22) == 3
