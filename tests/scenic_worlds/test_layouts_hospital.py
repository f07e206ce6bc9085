import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image, ImageColor
from shapely.geometry import LineString, Point, Polygon

from mrta_falsify.core.errors import ConfigError, UnknownNameError
from reports.colours import PAINTS
from reports.floor_scene import Role
from scenic_worlds.layouts.hospital import RANGES, hospital
from tests.scenic_worlds.layout_checks import (
    gap_between,
    gap_to_lanes,
    lane_clearance,
    spots_of,
    unreachable,
)
from tools.draw_layout import draw_layout

SHAPES = ("line", "ell", "ring", "comb")


def within(name, **limits):
    low, high = RANGES[name]
    if isinstance(low, int) and isinstance(high, int):
        return st.integers(low, limits.get("high", high))
    return st.floats(low, high, allow_nan=False)


@st.composite
def parameters(draw):
    rooms = draw(within("rooms", high=12))
    given_ = {
        "shape": draw(st.sampled_from(SHAPES)),
        "rooms": rooms,
        "active": draw(st.lists(st.booleans(), min_size=rooms, max_size=rooms)),
        "station": draw(st.booleans()),
    }
    for name in ("corridor_width", "cross_width", "spots", "lifts", "chargers", "parking", "teeth"):
        given_[name] = draw(within(name))
    for name in ("room_width", "room_depth", "door_width", "door_offset", "bathroom"):
        given_[name] = draw(st.lists(within(name), min_size=1, max_size=4))
    return given_


@settings(max_examples=25, deadline=None)
@given(parameters())
def test_every_hospital_is_connected_and_its_lanes_are_free(lengths):
    world = hospital(**lengths)
    if not world.rooms:
        return
    assert unreachable(world) == []
    spots = spots_of(world)
    if world.lanes:
        assert lane_clearance(world) >= 0.39  # half of the narrowest door
        assert gap_to_lanes(world, spots) >= 0.77
    places = np.vstack([spots, world.parking])
    assert gap_between(places) >= 0.95 if len(places) > 1 else True
    if len(world.parking) and world.lanes:
        assert gap_to_lanes(world, world.parking) >= 0.77
    for resource in world.resources:
        area = Polygon(resource.release_area)
        assert area.is_valid
        assert all(area.distance(Point(place)) > 0.2 for place in places)
        assert Polygon(resource.request_area).contains(area.centroid)


@settings(max_examples=10, deadline=None)
@given(parameters())
def test_the_same_lengths_give_the_same_hospital(lengths):
    assert hospital(**lengths).digest() == hospital(**lengths).digest()


@pytest.mark.parametrize("shape", SHAPES)
def test_opposite_lanes_keep_right(shape):
    world = hospital(shape=shape, rooms=6)
    lanes = {(lane.start, lane.end): lane for lane in world.lanes}
    compared = 0
    for (start, end), lane in lanes.items():
        back = lanes[end, start]
        if len(lane.to_room) < 4 or len(back.to_room) < 4:
            continue
        one, two = lane.to_room[:2], back.to_room[:2]
        heading, other = one[1] - one[0], two[1] - two[0]
        if abs(heading @ other + np.hypot(*heading) * np.hypot(*other)) > 1e-6:
            continue  # not opposite: they begin on different corridors
        left = np.array([-heading[1], heading[0]]) / np.hypot(*heading)
        across = (two[0] - one[0]) @ left
        if abs(across) < 2.0:  # of the same corridor
            compared += 1
            assert across > 0.8
    assert compared


@pytest.mark.parametrize("shape", SHAPES)
def test_an_inactive_ward_is_a_closed_wall_and_changes_nothing_else(shape):
    everything = hospital(shape=shape, rooms=6)
    without = hospital(shape=shape, rooms=6, active=[True, True, False, True, True, True])
    before = {room.name: room for room in everything.rooms}
    after = {room.name: room for room in without.rooms}
    assert set(before) - set(after) == {"ward_2"}
    for name, room in after.items():
        assert np.array_equal(room.point, before[name].point)
    closed = Point(before["ward_2"].point)
    assert any(Polygon(wall.polygon).distance(closed) < 1e-6 for wall in without.walls)
    assert np.array_equal(everything.parking, without.parking)


@pytest.mark.parametrize("shape", SHAPES)
def test_small_changes_of_lengths_move_rooms_by_little(shape):
    one = hospital(shape=shape, corridor_width=3.2, room_width=6.0, door_offset=0.5)
    two = hospital(shape=shape, corridor_width=3.201, room_width=6.001, door_offset=0.501)
    for a, b in zip(one.rooms, two.rooms, strict=True):
        assert np.hypot(*(a.point - b.point)) < 0.02
    for a, b in zip(one.lanes, two.lanes, strict=True):
        assert a.to_room.shape == b.to_room.shape
        assert np.abs(a.to_room - b.to_room).max() < 0.02


def test_walls_do_not_overlap_and_leave_the_rooms_open():
    world = hospital(shape="ring", lifts=1, bathroom=1.0)
    solids = [Polygon(wall.polygon) for wall in world.walls]
    x1, y1, x2, y2 = world.bounds
    rooms = sum(Polygon(room.area).area for room in world.rooms)
    assert sum(s.area for s in solids) < (x2 - x1) * (y2 - y1) - rooms
    for i, one in enumerate(solids):
        assert not any(one.intersection(other).area > 1e-9 for other in solids[i + 1 :])
    for room in world.rooms:
        inside = Polygon(room.area).buffer(-0.01)
        assert not any(inside.intersects(solid) for solid in solids)
        assert LineString(room.door).length >= 0.8


def test_lifts_and_chargers_are_resources_of_their_kind():
    world = hospital(lifts=1, chargers=2, rooms=4)
    kinds = {resource.name: resource.kind for resource in world.resources}
    assert kinds["lift_0"] == "elevator"
    assert kinds["charger_1"] == "charger"
    assert [room.name for room in world.rooms][:4] == [
        "nurses_station", "lift_0", "charger_0", "charger_1",
    ]  # fmt: skip


def test_travel_times_grow_with_the_way():
    world = hospital(shape="line", rooms=8, station=False, parking=0)
    times = world.travel_times
    assert times.shape == (8, 8)
    assert not times.diagonal().any()
    far = [times[1, k] for k in (3, 5, 7)]
    assert far == sorted(far)
    assert far[0] < far[-1]


@pytest.mark.parametrize(
    ("lengths", "words"),
    [
        ({"corridor_width": 1.2}, "corridor_width is 1.2; it must be between 1.8 and 5"),
        ({"door_width": [1.0, 0.5]}, "door_width is 0.5"),
        ({"rooms": 99}, "rooms is 99"),
        ({"room_depth": []}, "room_depth is empty"),
        ({"active": [True]}, "active has 1 flags"),
        ({"door_offset": float("nan")}, "door_offset is nan"),
    ],
)
def test_lengths_out_of_range_are_refused_by_name(lengths, words):
    with pytest.raises(ConfigError, match=words):
        hospital(**lengths)


def test_an_unknown_shape_is_answered_with_the_nearest():
    with pytest.raises(UnknownNameError, match="did you mean 'ring'"):
        hospital(shape="rin")


def test_a_picture_shows_every_room_where_it_is(tmp_path):
    world = hospital(shape="line", rooms=2, lifts=1)
    draw_layout(world, tmp_path / "floor.png")
    with Image.open(tmp_path / "floor.png") as picture:
        pixels = np.asarray(picture.convert("RGB")).astype(int)
    star = np.array(ImageColor.getrgb(PAINTS[Role.ROOM].fill))
    rows, columns = pixels.shape[:2]
    x1, y1, x2, y2 = world.bounds
    for room in world.rooms:
        column = round((room.point[0] - x1) / (x2 - x1) * columns)
        row = round((y2 - room.point[1]) / (y2 - y1) * rows)
        assert np.abs(pixels[row, column] - star).max() < 60
