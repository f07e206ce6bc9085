"""Preflights: what a world asks of a stack, without running it."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from shapely.geometry import box

from mrta_falsify.commands.worlds import find_world
from mrta_falsify.core.feedback import DEMANDS
from mrta_falsify.core.geometry import rectangle
from mrta_falsify.core.world import CommsOutage, Furniture, HumanSpec, Resource, Task
from mrta_falsify.preflight import _Fleet, _ring, _soonest, _Stop, _Visit, _ways, preflight
from mrta_falsify.static_floor import StaticFloor
from mrta_falsify.testing.floors import robot, two_rooms
from scenic_worlds.zoo import load_scene, scene_names

APART = 13.0  # m between the two rooms' points


def ward(tasks=(), robots=2, **fields):
    """Two rooms 13 m apart with a wide way between them."""
    world = two_rooms(box(-5.0, -1.5, 5.0, 1.5))
    starts = (robot(0, -6.5, 0.0), robot(1, 6.5, 0.0, np.pi), robot(2, -5.5, 1.0))
    return dataclasses.replace(
        world, robots=starts[:robots], tasks=tuple(tasks), horizon=120.0, **fields
    )


def trip(start, arrival=0.0, **fields):
    return Task(arrival=arrival, start=start, end=1 - start, **{"deadline": 100.0, **fields})


def demands(world):
    return dict(zip(DEMANDS, preflight(world), strict=True))


def test_every_demand_is_measured_and_finite_also_where_nothing_is_to_be_done():
    for world in (
        ward(),
        ward(robots=0),
        ward([trip(0)], robots=0),
        ward([trip(0, deadline=float("inf"))]),
    ):
        assert np.isfinite(preflight(world)).all()


def test_a_rehearsal_is_a_function_of_the_world():
    world = ward([trip(0), trip(1)])
    first = preflight(world)
    preflight(ward([trip(0)]))  # which shares its floor
    np.testing.assert_array_equal(first, preflight(world))


def test_a_robot_that_waits_at_the_start_drives_the_way_to_the_other_room():
    one = demands(ward([trip(0)]))
    assert one["driven"] == pytest.approx(APART, rel=0.1)
    assert one["uneven"] == 2.0
    both = demands(ward([trip(0), trip(1)]))
    assert both["driven"] == pytest.approx(2.0 * APART, rel=0.1)
    assert both["uneven"] == 2.0  # each has its own


def test_the_only_robot_that_may_serve_a_task_does():
    theirs = ward([trip(0, robot="robot2")])
    names = {r.name for r in theirs.robots}
    task = trip(0, robot=sorted(names)[1])
    assert demands(ward([task]))["driven"] == pytest.approx(2.0 * APART, rel=0.15)


def test_the_robot_that_begins_first_is_found_without_planning_the_way_of_each():
    world = find_world("aws_hospital_day")
    fleet = _Fleet(world, _ways(StaticFloor.of(world)))
    robots = range(len(world.robots))
    stops = [[] for _ in robots]
    free = [3.0 * (i % 4) for i in robots]
    for task in world.tasks:
        begins = [
            (max(free[i], task.arrival) + fleet.time(i, fleet.way(i, [], task.start)), i)
            for i in robots
        ]
        assert _soonest(fleet, task, robots, free, stops) == min(begins)


def test_two_that_drive_against_each_other_meet_head_on():
    against = demands(ward([trip(0), trip(1)]))
    assert against["meetings"] >= 1.0
    assert against["head_on"] > 0.0
    one_after_the_other = demands(ward([trip(0), trip(1, arrival=60.0)]))
    assert one_after_the_other["head_on"] == 0.0


def test_robots_that_want_each_others_room_are_a_ring_the_less_they_miss_each_other():
    at_once = demands(ward([trip(0), trip(1)]))["ring"]
    assert at_once == pytest.approx(2.0)
    second = ward().robots[1].name
    late = [ward([trip(0), trip(1, arrival=s, robot=second)]) for s in (20.0, 25.0, 100.0)]
    missed = [demands(world)["ring"] for world in late]
    assert 2.0 > missed[0] > missed[1] > missed[2] == 0.0
    assert demands(ward([trip(0), trip(0)]))["ring"] == 0.0


def test_rings_are_looked_for_within_bounds_where_hundreds_go_one_way():
    stops = [_Stop(0, room, 0.0, 2.0) for room in range(6)]
    stream = [
        _Visit(stop, robot, 20.0 * place, 20.0 * place, 20.0 * place + 2.0)
        for place, stop in enumerate(stops)
        for robot in range(300)
    ]
    assert _ring(stream) == 0.0


def test_tasks_that_come_together_are_open_together_and_gather_robots():
    together = demands(ward([trip(0), trip(0), trip(0)], robots=3))
    apart = demands(ward([trip(0, 5.0), trip(0, 45.0), trip(0, 85.0)], robots=3))
    assert (together["open"], apart["open"]) == (3.0, 1.0)
    assert together["gathered"] > apart["gathered"]
    assert together["hurry"] > -100.0


def test_robots_queue_for_a_room_that_has_place_for_one():
    tasks = [trip(0, pickup_time=20.0), trip(0, pickup_time=20.0)]
    area = rectangle(3.0, 3.0, (-6.5, 0.0))
    room = Resource(name="room0", room=0, request_area=area, release_area=area)
    for capacity, waiting in ((1, 1.0), (2, 0.0)):
        found = demands(ward(tasks, resources=(dataclasses.replace(room, capacity=capacity),)))
        assert found["queue"] == waiting
        assert (found["waited"] > 0.0) == (waiting > 0.0)
        assert found["sharing"] == 2.0 - capacity


def test_a_later_deadline_is_less_of_a_hurry():
    soon, late = (demands(ward([trip(0, deadline=d)]))["hurry"] for d in (20.0, 60.0))
    assert soon - late == pytest.approx(40.0)


def test_a_second_task_in_the_room_where_the_first_ended_is_again():
    back = [trip(0), trip(1, arrival=1.0)]
    assert demands(ward(back, robots=1))["again"] == 1.0
    assert demands(ward([trip(0), trip(0, arrival=1.0)], robots=1))["again"] == 0.0


def test_furniture_people_and_outages_count_where_robots_drive():
    plain = demands(ward([trip(0)]))
    chair = Furniture(name="chair1", kind="chair", polygon=rectangle(0.5, 0.5, (0.0, 0.5)))
    beside = demands(ward([trip(0)], furniture=(chair,)))
    assert plain["furniture"] == 0.0
    assert 0.2 < beside["furniture"] < 3.0
    person = HumanSpec(name="human1", route=np.array([[0.0, 0.5]]))
    assert demands(ward([trip(0)], humans=(person,)))["people"] > 0.0
    gone = dataclasses.replace(person, appears_at=100.0)
    assert demands(ward([trip(0)], humans=(gone,)))["people"] == 0.0
    outage = CommsOutage(name="outage1", robots=(), start=0.0, end=10.0)
    assert demands(ward([trip(0)], events=(outage,)))["disturbed"] == pytest.approx(10.0, rel=0.3)


@pytest.mark.parametrize("name", scene_names())
def test_every_scene_of_the_zoo_can_be_rehearsed(name):
    found = preflight(load_scene(name).world)
    assert np.isfinite(found).all()
    assert found[DEMANDS.index("driven")] >= 0.0
