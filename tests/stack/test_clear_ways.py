"""Places to stand that leave the ways between rooms open."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy import ndimage
from shapely import unary_union
from shapely.geometry import box

from mrta_falsify.core import registry
from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.core.costmap import INSCRIBED
from mrta_falsify.core.geometry import rectangle
from mrta_falsify.core.plane import NO_POINTS
from mrta_falsify.core.world import Resource, Task
from mrta_falsify.stack.resources.clear_ways import APART, AT_ROOM, ClearWays
from mrta_falsify.testing.floors import floor, robot, two_rooms
from simulator_interface.simulate import simulate

KINEMATIC = StackConfig(engine=Choice("kinematic"))


def ways_of(world):
    source = registry.build("costmap", KINEMATIC.costmap).bind(world)
    return ClearWays(world, source.costmap(0.0, NO_POINTS))


def dead_end(width, spots=(2.0, 0.8)):
    """Room 1 is the only one with a queue; its waiting spots lie in the passage to it."""
    world = two_rooms(box(-3.0, -width / 2, 3.0, width / 2), side=4.0, gap=6.0)
    queue = Resource(
        name="queue of end1",
        room=1,
        spots=np.array([[x, 0.0] for x in spots]),
        entry=np.array([[3.3, 0.0], [5.0, 0.0]]),
        request_area=rectangle(16.0, 6.0),
        release_area=rectangle(4.4, 4.0) + np.array([4.8, 0.0]),
    )
    lanes = tuple(
        dataclasses.replace(lane, to_queue=np.vstack([lane.to_queue[:1], queue.spots[-1:]]))
        if lane.end == 1
        else lane
        for lane in world.lanes
    )
    return dataclasses.replace(
        world,
        resources=(queue,),
        lanes=lanes,
        horizon=150.0,
        robots=(robot(0, -5.0, 0.0), robot(1, 5.0, 0.0, np.pi)),
        tasks=(
            Task(arrival=0.5, start=0, end=1, deadline=900.0, pickup_time=2.0),
            Task(arrival=0.5, start=1, end=0, deadline=900.0, pickup_time=20.0),
        ),
    )


@pytest.mark.parametrize(
    ("width", "stands", "is_open"),
    [
        (1.0, [[0.0, 0.0]], False),
        (2.4, [[0.0, 0.9]], True),
        (1.6, [[0.0, 0.0]], False),
        (2.4, [[0.0, 0.55], [0.0, -0.55]], False),
        (1.0, [[-5.0, 1.5]], True),
        (1.0, [[-5.0, 0.0]], True),
    ],
)
def test_a_robot_closes_a_passage_that_is_too_narrow_to_pass_it(width, stands, is_open):
    assert ways_of(dead_end(width)).leaves_open(np.array(stands)) is is_open


def test_places_leave_the_ways_open_together_and_lie_apart():
    ways, door = ways_of(dead_end(1.0)), np.array([-2.7, 0.0])
    places = ways.places_near(door, beside=NO_POINTS, off=NO_POINTS, count=6)
    assert len(places) == 6
    assert ways.leaves_open(np.array(places))
    gaps = np.hypot(*(np.array(places)[:, None] - np.array(places)[None]).transpose(2, 0, 1))
    assert (gaps + np.eye(6) >= 0.6).all()


def stays_joined(ways, world, stands):
    """As `leaves_open`, by the parts of the whole map."""
    free = ways._map.cost < INSCRIBED
    centers = ways._map.centers(np.stack(np.indices(free.shape), -1).reshape(-1, 2))

    def pairs(free):
        parts = ndimage.label(free)[0].ravel()
        near = [np.hypot(*(centers - room.point).T) <= AT_ROOM for room in world.rooms]
        found = [set(parts[cells]) - {0} for cells in near]
        return {(i, k) for i in range(len(found)) for k in range(i) if found[i] & found[k]}

    covered = [np.hypot(*(centers - stand).T) <= APART for stand in np.round(stands, 1)]
    return pairs(free) <= pairs(free & ~np.any(covered, axis=0).reshape(free.shape))


@pytest.mark.parametrize(("width", "count"), [(1.0, 1), (1.2, 1), (1.6, 3), (2.4, 3)])
def test_a_look_around_each_stand_says_what_the_whole_map_says(width, count):
    world, random = dead_end(width), np.random.default_rng(count)
    ways = ways_of(world)
    answers = set()
    for _ in range(60):
        stands = random.uniform([-7.0, -2.0], [7.0, 2.0], size=(count, 2))
        answers.add(expected := stays_joined(ways, world, stands))
        assert ways.leaves_open(stands) == expected, stands
    assert answers == {True, False}


def waits_at(world, time):
    """Where robot1 stands at ``time`` [s], and how the episode ended."""
    outcome = simulate(world, KINEMATIC)
    return outcome.trace.columns["pose"][round(time / outcome.trace.dt), 0, :2], outcome.ended


@pytest.mark.parametrize("width", [0.9, 1.3])
def test_a_waiting_spot_that_closes_the_only_way_out_is_not_granted(width):
    (x, _), ended = waits_at(dead_end(width), 19.0)
    assert x < -3.0, "robot1 waits before the passage while robot2 must come out of it"
    assert ended == "all-tasks-done"


def test_a_waiting_spot_beside_the_way_is_granted():
    world = dead_end(2.6)
    queue = dataclasses.replace(world.resources[0], spots=np.array([[2.0, 0.95]]))
    place, _ = waits_at(dataclasses.replace(world, resources=(queue,)), 19.0)
    np.testing.assert_allclose(place, [2.0, 0.95], atol=0.25)


def crossing(width):
    """Room 2 lies on the only way between rooms 0 and 1; no place is set aside for parking."""
    ends = [box(-6.0, -1.5, -3.0, 1.5), box(3.0, -1.5, 6.0, 1.5)]
    passage = box(-3.0, -width / 2, 3.0, width / 2)
    points = np.array([[-4.5, 0.0], [4.5, 0.0], [0.0, 0.0]])
    return dataclasses.replace(
        floor(unary_union([*ends, passage]), points),
        horizon=25.0,
        robots=(robot(0, -4.5, 0.9),),
        tasks=(
            Task(arrival=0.5, start=0, end=2, deadline=900.0),
            Task(arrival=24.0, start=0, end=1, deadline=900.0),
        ),
    )


def test_a_robot_that_delivered_does_not_come_to_rest_in_a_crossing():
    world = crossing(1.0)
    outcome = simulate(world, KINEMATIC)
    kinds = [event.kind for event in outcome.trace.events]
    assert kinds.index("dropped-off") < kinds.index("makes-room")
    assert ways_of(world).leaves_open(outcome.trace.columns["pose"][-1, :, :2])


def test_a_robot_that_delivered_where_others_can_pass_stays():
    outcome = simulate(crossing(3.0), KINEMATIC)
    assert "makes-room" not in [event.kind for event in outcome.trace.events]


def test_a_robot_that_has_left_a_room_does_not_go_back_in_to_take_its_lane():
    """The lane begins with two corners inside the room, beside a robot that stands outside."""
    world = two_rooms(box(-5.0, -1.5, 5.0, 1.5))
    way = np.array([[-5.6, 0.9], [-5.6, -0.9], [4.7, -0.9], [6.5, 0.0]])
    there, back = world.lanes
    room = Resource(
        name="queue of end0",
        room=0,
        spots=np.array([[-3.0, 1.0]]),
        request_area=rectangle(16.0, 6.0),
        release_area=rectangle(3.4, 3.0) + np.array([-6.3, 0.0]),
    )
    world = dataclasses.replace(
        world,
        resources=(room,),
        lanes=(dataclasses.replace(there, to_queue=way, to_room=way), back),
        horizon=60.0,
        robots=(robot(0, -4.3, 0.9),),
        tasks=(Task(arrival=0.5, start=1, end=0, deadline=900.0),),
    )
    trace = simulate(world, KINEMATIC).trace
    picked_up = next(event.time for event in trace.events if event.kind == "picked-up")
    before = trace.columns["time"] < picked_up
    assert trace.columns["pose"][before, 0, 0].min() > -4.6
