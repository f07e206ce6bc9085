import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely.geometry import Point, Polygon

from mrta_falsify.core.errors import ConfigError
from scenic_worlds.layouts.hospital import hospital
from scenic_worlds.layouts.warehouse import RANGES as WAREHOUSE_RANGES
from scenic_worlds.layouts.warehouse import warehouse
from tests.scenic_worlds.layout_checks import (
    gap_between,
    gap_to_lanes,
    lane_clearance,
    spots_of,
    unreachable,
)


@st.composite
def parameters(draw, ranges, places):
    given_ = {}
    for name, (low, high) in ranges.items():
        if isinstance(low, int) and isinstance(high, int):
            given_[name] = draw(st.integers(low, min(high, 8)))
        else:
            given_[name] = draw(st.floats(low, high))
    count = given_[places]
    given_["active"] = draw(st.lists(st.booleans(), min_size=count, max_size=count))
    return given_


def check(world):
    if not world.rooms:
        return
    assert unreachable(world) == []
    spots = spots_of(world)
    if world.lanes:
        assert lane_clearance(world) >= 0.39
        assert gap_to_lanes(world, spots) >= 0.77
        if len(world.parking):
            assert gap_to_lanes(world, world.parking) >= 0.77
    places = np.vstack([spots, world.parking])
    assert len(places) < 2 or gap_between(places) >= 0.95
    for resource in world.resources:
        area = Polygon(resource.release_area)
        assert area.is_valid
        assert all(area.distance(Point(place)) > 0.2 for place in places)


@settings(max_examples=20, deadline=None)
@given(parameters(WAREHOUSE_RANGES, "picks"))
@pytest.mark.slow
def test_every_warehouse_is_connected_and_its_lanes_are_free(lengths):
    check(warehouse(**lengths))


def test_racks_are_furniture_and_fill_the_space_between_aisles():
    world = warehouse(aisles=3, picks=2, aisle_length=10.0, rack_depth=2.0)
    assert {item.kind for item in world.furniture} == {"shelf"}
    racks = sum(Polygon(item.polygon).area for item in world.furniture)
    bays = sum(Polygon(room.area).area for room in world.rooms if room.name.startswith("pick"))
    assert 2 * 2.0 * 10.0 - 4 * bays - 6.0 < racks <= 3 * 2.0 * 10.0


def test_an_inactive_pick_is_closed_rack_and_moves_nothing():
    everything = warehouse(picks=4)
    without = warehouse(picks=4, active=[True, False, True, True])
    points = {room.name: room.point for room in everything.rooms}
    assert {room.name for room in without.rooms} == set(points) - {"pick_1"}
    assert all(np.array_equal(room.point, points[room.name]) for room in without.rooms)
    closed = Point(points["pick_1"])
    assert any(Polygon(item.polygon).covers(closed) for item in without.furniture) or any(
        Polygon(item.polygon).distance(closed) <= 0.75 for item in without.furniture
    )
    assert np.array_equal(everything.bounds, without.bounds)


@pytest.mark.parametrize(
    ("make", "lengths", "words"),
    [
        (warehouse, {"aisles": 0}, "warehouse: aisles is 0; it must be between 1 and 24"),
        (warehouse, {"aisles": 2.5}, "it must be a whole number"),
        (warehouse, {"active": [True]}, "active has 1 flags"),
        (hospital, {"door_width": [1.0, 9.0]}, "door_width is 9"),
        (warehouse, {"aisle_width": float("inf")}, "aisle_width is inf"),
    ],
)
def test_lengths_out_of_range_are_refused_by_name(make, lengths, words):
    with pytest.raises(ConfigError, match=words):
        make(**lengths)
