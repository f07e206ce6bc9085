import dataclasses
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely.geometry import LineString, Point, Polygon

from mrta_falsify.core.errors import InputError, UnknownNameError, WorldError
from mrta_falsify.core.world import write_world
from scenic_worlds.layouts import layout_names, load_layout
from scenic_worlds.layouts.derivation import derive_layout
from scenic_worlds.layouts.hospital import hospital
from simulator_interface.costmap_layers import build_costmap
from simulator_interface.formats.floor_yaml import Floor, FloorRoom, read_floor
from simulator_interface.formats.nav2 import write_nav2_map
from tests.scenic_worlds.layout_checks import crowding, lane_clearance, unreachable

CLINIC = """
name: clinic
walls:
  - {box: [0, 0, 16, 0.2]}
  - {box: [0, 9.8, 16, 10]}
  - {box: [0, 0, 0.2, 10]}
  - {box: [15.8, 0, 16, 10]}
  - {line: [[0, 3.5], [2, 3.5]]}
  - {line: [[3.2, 3.5], [9, 3.5]]}
  - {line: [[10.3, 3.5], [16, 3.5]]}
  - {line: [[6, 0], [6, 3.5]]}
  - {line: [[0, 6.5], [4, 6.5]]}
  - {line: [[5.2, 6.5], [11.5, 6.5]]}
  - {line: [[12.8, 6.5], [16, 6.5]]}
  - {line: [[8, 6.5], [8, 10]]}
furniture: [{name: bed, kind: bed, box: [13.5, 0.3, 15.6, 1.3], height: 0.8}]
"""
ROOMS = """
rooms:
  - {name: lab, point: [2.6, 1.6]}
  - {name: ward, point: [9.6, 1.6]}
  - {name: store, point: [4.6, 8.4]}
  - {name: office, point: [12.1, 8.4]}
"""


@pytest.fixture(scope="module")
def clinic(tmp_path_factory):
    file = tmp_path_factory.mktemp("floors") / "clinic.yaml"
    file.write_text(CLINIC + ROOMS)
    return load_layout(file)


def test_lanes_spots_and_times_are_derived(clinic):
    assert unreachable(clinic) == []
    assert len(clinic.lanes) == 12
    assert lane_clearance(clinic) >= 0.3
    assert crowding(clinic) >= 0.6
    assert all(len(resource.spots) for resource in clinic.resources)
    assert (clinic.travel_times + np.eye(4) > 0.0).all()
    for lane in clinic.lanes:
        assert lane.to_room[-1] == pytest.approx(clinic.rooms[lane.end].point)
        assert lane.to_queue[-1] == pytest.approx(clinic.resources[lane.end].spots[-1])


def test_doors_are_found_on_the_way_out(clinic):
    expected = [(2.6, 3.5, 1.2), (9.65, 3.5, 1.3), (4.6, 6.5, 1.2), (12.15, 6.5, 1.3)]
    for room, (x, y, width) in zip(clinic.rooms, expected, strict=True):
        assert np.allclose(room.door.mean(axis=0), [x, y], atol=0.12)
        assert np.hypot(*(room.door[1] - room.door[0])) == pytest.approx(width - 0.15, abs=0.25)
        area = Polygon(room.area)
        assert area.covers(Point(room.point))
        assert area.area > 10.0


def test_opposite_lanes_keep_right(clinic):
    lanes = {(lane.start, lane.end): lane for lane in clinic.lanes}
    east, west = lanes[0, 3].to_room, lanes[3, 0].to_room
    for x in (4.0, 6.5, 8.0):
        y_east = np.interp(x, *east[(east[:, 1] > 3.6) & (east[:, 1] < 6.4)].T)
        y_west = np.interp(x, *west[(west[:, 1] > 3.6) & (west[:, 1] < 6.4)][::-1].T)
        assert y_west - y_east > 0.5


def test_spots_keep_out_of_doors_and_of_each_other(clinic):
    spots = np.vstack([resource.spots for resource in clinic.resources])
    gaps = np.hypot(*(spots[:, None] - spots[None]).transpose(2, 0, 1))
    assert gaps[~np.eye(len(spots), dtype=bool)].min() >= 0.9
    for resource in clinic.resources:
        assert all(Polygon(resource.release_area).distance(Point(spot)) > 0.2 for spot in spots)


def test_what_the_user_gives_is_kept(tmp_path):
    file = tmp_path / "own.yaml"
    file.write_text(
        CLINIC
        + """
rooms:
  - {name: lab, point: [2.6, 1.6], door: [[2, 3.5], [3.2, 3.5]], queue: [[4, 4.1], [5, 4.1]],
     area: [[0.2, 0.2], [5.9, 0.2], [5.9, 3.4], [0.2, 3.4]], service_time: 4.0, capacity: 2}
  - {name: ward, point: [9.6, 1.6]}
lanes:
  - {start: ward, end: lab, to_room: [[9.6, 5.3], [2.6, 5.3], [2.6, 1.6]]}
parking: [[14.5, 5.0]]
travel_times: [[0, 21], [22, 0]]
"""
    )
    world = load_layout(file)
    lab = world.resources[0]
    assert np.array_equal(world.rooms[0].door, [[2, 3.5], [3.2, 3.5]])
    assert len(world.rooms[0].area) == 4
    assert np.array_equal(lab.spots, [[4, 4.1], [5, 4.1]])
    assert (lab.service_time, lab.capacity) == (4.0, 2)
    given_lane = next(lane for lane in world.lanes if (lane.start, lane.end) == (1, 0))
    assert np.array_equal(given_lane.to_room, [[9.6, 5.3], [2.6, 5.3], [2.6, 1.6]])
    assert np.array_equal(world.parking, [[14.5, 5.0]])
    assert np.array_equal(world.travel_times, [[0, 21], [22, 0]])
    assert unreachable(world) == []


def test_the_floor_file_of_the_documentation_loads(tmp_path):
    page = (Path(__file__).parents[2] / "docs" / "layouts.md").read_text()
    floor, resources = re.findall(r"```yaml\n(.*?)```", page, re.DOTALL)
    file = tmp_path / "clinic.yaml"
    file.write_text(floor + resources)
    world = load_layout(file)
    assert [room.name for room in world.rooms] == ["lab", "ward", "desk"]
    assert unreachable(world) == []
    assert np.array_equal(world.resources[2].spots, [[6.6, 8.5], [5.6, 8.5]])


def test_the_same_file_gives_the_same_layout(clinic, tmp_path):
    file = tmp_path / "clinic.yaml"
    file.write_text(CLINIC + ROOMS)
    assert load_layout(file).digest() == clinic.digest()


def test_unreachable_rooms_are_named(tmp_path):
    closed = CLINIC.replace("[[3.2, 3.5], [9, 3.5]]", "[[2, 3.5], [9, 3.5]]")
    file = tmp_path / "closed.yaml"
    file.write_text(closed + ROOMS)
    with pytest.raises(WorldError, match=r"closed\.yaml: .*'lab' cannot be reached from 'ward'"):
        load_layout(file)


def test_a_room_point_inside_furniture_is_named(tmp_path):
    file = tmp_path / "blocked.yaml"
    file.write_text(CLINIC + ROOMS.replace("[9.6, 1.6]", "[14.5, 0.8]"))
    with pytest.raises(WorldError, match=r"rooms\[1\]\.point of 'ward' .* m from an obstacle"):
        load_layout(file)


def test_a_hall_without_doors_has_lanes_too(tmp_path):
    file = tmp_path / "hall.yaml"
    file.write_text(
        "walls: [{line: [[0, 0], [14, 0], [14, 9], [0, 9], [0, 0]]}]\n"
        "rooms: [{name: a, point: [2, 2]}, {name: b, point: [12, 2]}, {name: c, point: [7, 7.5]}]\n"
    )
    world = load_layout(file)
    assert unreachable(world) == []
    assert len(world.lanes) == 6
    assert all(len(room.door) == 0 for room in world.rooms)
    assert lane_clearance(world) > 0.4


def test_a_single_room_is_a_layout(tmp_path):
    file = tmp_path / "one.yaml"
    file.write_text("bounds: [0, 0, 6, 6]\nrooms: [{name: a, point: [3, 3]}]\n")
    world = load_layout(file)
    assert len(world.rooms) == len(world.resources) == 1
    assert world.lanes == ()


def test_world_files_become_layouts(tmp_path):
    world = dataclasses.replace(hospital(rooms=2), name="mine", horizon=77.0)
    write_world(world, tmp_path / "mine.json")
    assert load_layout(tmp_path / "mine.json").digest() == world.digest()


@pytest.mark.parametrize("name", ["hospitl", "floor.txt", "nothing"])
def test_what_is_neither_name_nor_file_is_answered_with_the_names(name):
    with pytest.raises(UnknownNameError, match="hospital, warehouse"):
        load_layout(name)


def test_all_shipped_names_load():
    assert {"aws_hospital", "hospital", "warehouse"} <= set(layout_names())
    assert len({load_layout(name).digest() for name in layout_names()}) == len(layout_names())


@pytest.mark.parametrize("content", [b"\x00\xff", b"{", b"[1, 2", b"", b"a: &a [*a]"])
@pytest.mark.parametrize("ending", [".yaml", ".json", ".sdf", ".world"])
def test_broken_files_end_in_one_sentence(tmp_path, content, ending):
    file = tmp_path / f"broken{ending}"
    file.write_bytes(content)
    with pytest.raises(InputError, match="broken"):
        load_layout(file)


# --- maps ----------------------------------------------------------------------------------


def test_a_generated_hospital_survives_the_way_through_its_nav2_map(tmp_path):
    world = hospital(shape="ring", rooms=4, corridor_width=3.4)
    costmap = build_costmap(world)
    write_nav2_map(costmap, tmp_path / "floor.yaml")
    rooms = [f"  - {{name: {r.name}, point: {r.point.tolist()}}}" for r in world.rooms]
    (tmp_path / "floor.rooms.yaml").write_text("rooms:\n" + "\n".join(rooms) + "\n")
    again = load_layout(tmp_path / "floor.yaml")
    assert unreachable(again) == []
    assert lane_clearance(again) >= 0.3
    assert crowding(again) >= 0.6
    from_map = build_costmap(again)
    lethal, was = from_map.cost == 254, costmap.cost == 254
    assert (lethal | ~was).all()
    assert (lethal & ~was).mean() < 0.002
    for before, after in zip(world.rooms, again.rooms, strict=True):
        assert np.hypot(*(before.door.mean(axis=0) - after.door.mean(axis=0))) < 0.3
        assert Polygon(after.area).area == pytest.approx(Polygon(before.area).area, rel=0.15)


PASSAGE = """
walls:
  - {{line: [[0, 0], [18, 0], [18, 6], [0, 6], [0, 0]]}}
  - {{box: [7, 0, 11, {low}]}}
  - {{box: [7, {high}, 11, 6]}}
rooms:
  - {{name: west, point: [2, 3]}}
  - {{name: middle, {middle}}}
  - {{name: east, point: [16, 3]}}
"""


def passage(tmp_path, low, high, middle):
    """Two halls with one passage between them, and a room in it."""
    file = tmp_path / "passage.yaml"
    file.write_text(PASSAGE.format(low=low, high=high, middle=middle))
    return load_layout(file)


@pytest.mark.parametrize("middle", ["point: [9, 3]", "area: [[7, 2], [11, 2], [11, 4], [7, 4]]"])
def test_a_room_across_the_only_passage_owns_no_more_than_its_spot(tmp_path, middle):
    room = passage(tmp_path, 2.3, 3.7, middle).rooms[1]
    assert np.hypot(*(room.area - room.point).T).max() < 0.22


def test_ways_keep_off_a_room_of_others_where_there_is_room(tmp_path):
    layout = passage(tmp_path, 0.2, 5.8, "point: [9, 3]")
    room = layout.rooms[1]
    ways = [LineString(lane.to_room) for lane in layout.lanes if 1 not in (lane.start, lane.end)]
    assert min(way.distance(Point(room.point)) for way in ways) > 0.6
    assert all(way.distance(Polygon(room.area)) > 0.1 for way in ways)


def test_ways_lead_around_a_room_with_two_doors(tmp_path):
    middle = "area: [[7, 1.2], [11, 1.2], [11, 3.2], [7, 3.2]]"
    file = tmp_path / "around.yaml"
    text = PASSAGE.format(low=1.2, high=5.8, middle=middle)
    file.write_text(text.replace("rooms:", "  - {box: [7, 3.2, 11, 3.4]}\nrooms:"))
    layout = load_layout(file)
    ways = [LineString(lane.to_room) for lane in layout.lanes if 1 not in (lane.start, lane.end)]
    area = Polygon(layout.rooms[1].area)
    assert area.area == pytest.approx(8.0)
    assert not any(way.intersects(area) for way in ways)


def test_robots_park_where_they_drive_through_no_room(tmp_path):
    layout = passage(tmp_path, 0.8, 5.2, "point: [9, 3]")
    rooms = [Polygon(room.area) for room in layout.rooms]
    assert len(layout.parking)
    assert not any(room.contains(Point(place)) for place in layout.parking for room in rooms)


@settings(max_examples=5, deadline=None)
@given(
    shape=st.sampled_from(["line", "ell", "ring", "comb"]),
    width=st.floats(2.4, 4.5),
    door=st.floats(0.9, 1.8),
    offset=st.floats(0.0, 1.0),
)
def test_derived_traffic_is_sound_on_many_floors(shape, width, door, offset):
    plan = hospital(
        shape=shape, rooms=4, corridor_width=width, door_width=door, door_offset=offset, parking=0
    )
    floor = Floor(
        name="many", bounds=plan.bounds, walls=plan.walls, furniture=(),
        rooms=tuple(FloorRoom(name=room.name, point=room.point) for room in plan.rooms),
        parking=np.zeros((0, 2)), travel_times=np.zeros((0, 0)), spots=2,
    )  # fmt: skip
    world = derive_layout(floor)
    assert unreachable(world) == []
    assert lane_clearance(world) >= 0.25
    assert crowding(world) >= 0.55
    assert sum(len(resource.spots) for resource in world.resources) >= len(world.rooms)


@pytest.mark.slow
def test_the_published_map_becomes_a_floor(reference_data, tmp_path):
    source = reference_data / "aws_hospital"
    for name in ("my_map.yaml", "my_map.pgm"):
        (tmp_path / name).write_bytes((source / name).read_bytes())
    shipped = load_layout("aws_hospital")
    rooms = [f"  - {{name: {r.name}, point: {r.point.tolist()}}}" for r in shipped.rooms]
    (tmp_path / "my_map.rooms.yaml").write_text("rooms:\n" + "\n".join(rooms) + "\n")
    floor = read_floor(tmp_path / "my_map.yaml")
    assert floor.bounds == pytest.approx([-12.5, -35.0, 12.5, 20.95])
    world = derive_layout(floor)
    assert unreachable(world) == []
    assert lane_clearance(world) >= 0.3
    for room, known in zip(world.rooms[1:], shipped.rooms[1:], strict=True):
        assert np.hypot(*(room.door.mean(axis=0) - known.door.mean(axis=0))) < 0.4
