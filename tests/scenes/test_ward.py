import numpy as np
import pytest
from shapely import unary_union
from shapely.geometry import LineString, Point, Polygon

from mrta_falsify.core.errors import ConfigError
from mrta_falsify.testing.wards import ward_layout

WARDS = [{}, {"rooms": 6, "two_sided": True, "room_width": 7.0}, {"rooms": 1}, {"door_width": 1.0}]


@pytest.mark.parametrize("lengths", WARDS)
def test_every_lane_and_spot_is_clear_of_the_walls(lengths):
    world = ward_layout(**lengths)
    walls = unary_union([Polygon(wall.polygon) for wall in world.walls])
    for lane in world.lanes:
        for way in (lane.to_queue, lane.to_room):
            line = LineString([world.rooms[lane.start].point, *way])
            assert line.distance(walls) >= 0.39
    for resource in world.resources:
        for spot in [*resource.spots, *resource.entry]:
            assert Point(spot).distance(walls) >= 0.3
    for spot in world.parking:
        assert Point(spot).distance(walls) >= 0.3


@pytest.mark.parametrize("lengths", WARDS)
def test_waiting_and_parked_robots_leave_the_lanes_free(lengths):
    world = ward_layout(**lengths)
    spots = np.vstack([*(resource.spots for resource in world.resources), world.parking])
    gaps = np.hypot(*(spots[:, None, :] - spots[None, :, :]).transpose(2, 0, 1))
    assert gaps[~np.eye(len(spots), dtype=bool)].min() >= 0.85
    for lane in world.lanes:
        if len(lane.to_room) == 4:
            through = LineString(lane.to_room[:2])
            assert min(through.distance(Point(spot)) for spot in spots) >= 0.9


def test_opposite_lanes_keep_right():
    world = ward_layout()
    lanes = {(lane.start, lane.end): lane for lane in world.lanes}
    assert lanes[0, 2].to_room[0, 1] < lanes[2, 0].to_room[0, 1]  # eastbound runs south


@pytest.mark.parametrize(
    ("lengths", "word"),
    [
        ({"rooms": 0}, "rooms"),
        ({"corridor_width": 2.0}, "corridor_width"),
        ({"door_width": 0.5}, "door_width"),
    ],
)
def test_a_ward_that_leaves_no_room_is_refused_by_name(lengths, word):
    with pytest.raises(ConfigError, match=word):
        ward_layout(**lengths)
