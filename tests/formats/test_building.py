"""Open-RMF buildings become floors: frames, places, lanes, doors, mutex groups, and errors."""

from __future__ import annotations

import dataclasses
import os
import random
from pathlib import Path

import numpy as np
import pytest
import yaml
from shapely.geometry import Point, Polygon

from mrta_falsify.core.arrays import frozen_array
from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.core.errors import InputError
from mrta_falsify.core.world import RobotSpec, Task
from mrta_falsify.specs.library import build_specifications
from mrta_falsify.verbs.floor_import import import_floor
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
    assert [room.name for room in floor.rooms] == ["store", "ward", "desk"]
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


def test_another_level_lies_on_the_reference_level(file):
    file.write_text(drawn_buildings.text(("ground", "upper")))
    ground, upper = (read_floor(file, level=name) for name in ("ground", "upper"))
    for name in ("store", "ward", "desk"):
        assert _place(upper, name) == pytest.approx(_place(ground, name), abs=1e-9)
    assert upper.name == "clinic_upper"
    assert upper.left_out[0].startswith("the levels ground")


def test_lanes_keep_their_direction(file):
    lanes = {(lane.start, lane.end): lane for lane in read_floor(file).lanes}
    assert len(lanes) == 6
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


def test_chargers_are_parking_and_starts_and_holding_points_waiting_spots(file):
    floor = read_floor(file)
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
        (lambda d, g: d.update(coordinate_system="wgs84"), "coordinate_system is 'wgs84'"),
        (lambda d, g: g.update(measurements=[]), "measurements is empty"),
        (lambda d, g: g["measurements"][0][2].clear(), "measurements[0].distance is None"),
        (lambda d, g: g["measurements"][0].__setitem__(1, 0), "0 pixels are 16 m"),
        (lambda d, g: g.update(lanes=[]), "has no lanes"),
        (lambda d, g: g["lanes"].__setitem__(2, [0, 99, {}]), "lanes[2][1] is 99"),
        (lambda d, g: g["walls"].__setitem__(1, "x"), "walls[1] is 'x'"),
        (lambda d, g: g["vertices"].__setitem__(0, [0, "a", 0, ""]), "vertices[0][1] is 'a'"),
        (lambda d, g: g["lanes"][0][2].update(mutex=[1, 5]), "lanes[0][2].mutex is [1, 5]"),
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
    assert done.lanes_given == 6
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


def test_a_charger_with_a_dispenser_is_a_place_and_no_parking(file):
    data = yaml.safe_load(drawn_buildings.text())
    vertices = data["levels"]["ground"]["vertices"]
    (charger,) = [vertex for vertex in vertices if vertex[4].get("spawn_robot_name") == [1, "ada"]]
    charger[4]["pickup_dispenser"] = [1, "coke_dispenser"]
    file.write_text(yaml.safe_dump(data))
    floor = read_floor(file)
    assert charger[3] in [room.name for room in floor.rooms]
    assert floor.parking == pytest.approx(np.array([[1.5, -1.5]]))
    assert [name for name, _ in floor.starts] == ["ada", "bob"]


def test_a_building_of_chargers_alone_has_no_place_for_tasks(file):
    data = yaml.safe_load(drawn_buildings.text())
    for vertex in data["levels"]["ground"]["vertices"]:
        vertex[4]["is_charger"] = [4, True]
    file.write_text(yaml.safe_dump(data))
    with pytest.raises(InputError, match="'ground' has no place for tasks; a place is a vertex"):
        read_floor(file)


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
