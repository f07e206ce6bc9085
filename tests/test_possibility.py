"""Worlds that no stack can do are set apart, and only those."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from shapely.geometry import Point, Polygon, box

from mrta_falsify.core.directives import Push
from mrta_falsify.core.fleet import StackEvent
from mrta_falsify.core.geometry import rectangle, transform
from mrta_falsify.core.world import Blockage, Furniture, HumanSpec, Room, Task, Wall, World
from mrta_falsify.possibility import look_at
from mrta_falsify.specs.books import ROOM_REACH, Books, stop_area
from mrta_falsify.testing.floors import robot, two_rooms

BOTH = ("deadlines", "all_tasks_done")


def why_impossible(world, specifications) -> str:
    return look_at(world, specifications).reason


def ward(width=1.2, tasks=(), **robot_fields):
    """Two rooms 10 m apart; a robot in each."""
    world = two_rooms(box(-5.0, -width / 2, 5.0, width / 2))
    robots = (robot(0, -6.5, 0.0, **robot_fields), robot(1, 6.5, 0.0, np.pi, **robot_fields))
    return dataclasses.replace(world, robots=robots, tasks=tuple(tasks), horizon=200.0)


def across(deadline, arrival=1.0, start=0):
    return Task(arrival=arrival, start=start, end=1 - start, deadline=deadline)


def test_a_task_with_five_seconds_for_a_trip_across_the_floor_is_impossible():
    reason = why_impossible(ward(tasks=[across(6.0)]), BOTH)
    assert "task0" in reason
    assert "6.0 s" in reason


@pytest.mark.parametrize(("speed", "is_possible"), [(1.5, True), (0.5, False)])
def test_the_bound_follows_the_speed_of_the_fastest_robot(speed, is_possible):
    world = ward(tasks=[across(15.0)], max_speed=speed)
    assert (why_impossible(world, BOTH) == "") is is_possible


def test_deadlines_do_not_count_where_nothing_judges_them():
    assert why_impossible(ward(tasks=[across(6.0)]), ("no_deadlock",)) == ""


def test_a_short_horizon_is_no_reason():
    assert why_impossible(ward(tasks=[across(900.0, arrival=197.0)]), BOTH) == ""


def test_tasks_that_are_possible_alone_are_proved_impossible_together():
    tasks = [across(24.0), across(24.0), across(24.0), across(24.0), across(24.0)]
    one_load = {"capacity": 1}
    alone = [why_impossible(ward(tasks=[task], **one_load), BOTH) for task in tasks]
    assert alone == [""] * 5
    assert "proved" in why_impossible(ward(tasks=tasks, **one_load), BOTH)


@pytest.mark.parametrize(("width", "is_possible"), [(0.27, True), (0.25, False)])
def test_a_robot_that_is_wider_than_the_only_way_cannot_pass(width, is_possible):
    """A Waffle is 0.265 m long."""
    reason = why_impossible(ward(width, [across(900.0)]), BOTH)
    assert (reason == "") is is_possible
    assert is_possible or "is shut by walls" in reason


@pytest.mark.parametrize(("width", "is_told"), [(1.2, False), (0.6, True)])
def test_a_bed_that_is_not_pushed_through_a_door_is_told_and_no_reason(width, is_told):
    world = dataclasses.replace(
        ward(width, [across(900.0)]),
        furniture=(furniture("bed1", 2.0, 0.9, -6.5, 0.0, movable=True),),
        humans=(porter("bed1", 6.5, 0.0),),
    )
    found = look_at(world, BOTH)
    assert found.reason == ""
    assert bool(found.stuck_pushes) is is_told
    assert not is_told or ("porter1" in found.notes[0] and "bed1" in found.notes[0])


# --- shut rooms -------------------------------------------------------------------------------


def furniture(name, size_x, size_y, x, y, *, movable=False):
    polygon = rectangle(size_x, size_y, (x, y))
    return Furniture(name=name, kind="cart", polygon=polygon, movable=movable)


def porter(piece, x, y):
    push = Push(furniture=piece, point=np.array([x, y]))
    return HumanSpec(name="porter1", route=np.array([[-6.5, 1.0]]), directives=(push,))


def shut_world(*, gap=0.0, tasks=None, wide=1.2, **more):
    """The ward with a cart across its passage at x = 2, beside which ``gap`` [m] is left."""
    cart = furniture("cart1", 0.6, wide - gap, 2.0, -gap / 2)
    world = ward(wide, [across(900.0)] if tasks is None else tasks)
    fields = {"furniture": (cart,), **more}
    return dataclasses.replace(world, **fields)


def one_robot(world, number=0):
    return dataclasses.replace(world, robots=world.robots[number : number + 1])


def test_furniture_that_fills_the_only_way_makes_a_task_impossible_and_is_named():
    found = look_at(shut_world(), BOTH)
    assert found.reason == (
        "task0: end1 is shut by cart1; no robot that may serve it fits (body 0.27 m wide, no gap)"
    )
    assert [(way.task, way.room, way.by, way.gap) for way in found.shut] == [
        (0, "end1", ("cart1",), 0.0)
    ]


@pytest.mark.parametrize(("gap", "is_possible"), [(0.12, False), (0.25, False), (0.27, True)])
def test_a_gap_counts_by_the_width_of_the_body(gap, is_possible):
    found = look_at(shut_world(gap=gap), BOTH)
    assert (found.reason == "") is is_possible
    if not is_possible:
        assert found.shut[0].gap == pytest.approx(gap, abs=0.012)


def test_a_gap_for_the_body_but_not_for_the_planning_radius_is_only_noted():
    found = look_at(shut_world(gap=0.41), BOTH)
    assert found.reason == ""
    assert [(way.room, way.by) for way in found.narrow] == [("end1", ("cart1",))]
    assert found.notes[0].startswith("only 0.41 m at end1, beside cart1")
    assert look_at(shut_world(gap=0.46), BOTH).notes == ()


def test_of_several_things_those_that_open_the_way_are_named():
    carts = (furniture("cart1", 0.6, 1.2, 2.0, 0.0), furniture("cart2", 0.6, 1.2, -2.0, 0.0))
    desk = furniture("desk1", 0.5, 0.5, 7.0, 1.0)
    assert look_at(shut_world(furniture=(*carts, desk)), BOTH).shut[0].by == ("cart1", "cart2")


def test_a_robot_inside_the_shut_room_may_serve_what_is_inside():
    inside = Task(arrival=1.0, start=1, end=1, deadline=900.0)
    assert look_at(shut_world(tasks=[inside]), BOTH).reason == ""
    assert look_at(one_robot(shut_world(tasks=[inside])), BOTH).shut[0].room == "end1"


@pytest.mark.parametrize(("robot_name", "is_possible"), [("", True), ("robot1", False)])
def test_a_task_that_is_bound_to_a_robot_counts_by_that_robot(robot_name, is_possible):
    task = dataclasses.replace(across(900.0), start=1, end=1, robot=robot_name)
    assert (look_at(shut_world(tasks=[task]), BOTH).reason == "") is is_possible


def test_a_smaller_robot_that_may_serve_the_task_makes_it_possible():
    world = shut_world(gap=0.2)
    burger = dataclasses.replace(world.robots[1], model="burger", radius=0.11)
    pair = dataclasses.replace(world, robots=(world.robots[0], burger))
    assert look_at(pair, BOTH).reason == ""
    bound = [dataclasses.replace(across(900.0), robot="robot1")]
    assert "cart1" in look_at(dataclasses.replace(pair, tasks=tuple(bound)), BOTH).reason


def test_a_robot_that_joins_after_the_horizon_serves_nothing():
    world = shut_world(tasks=[Task(arrival=1.0, start=1, end=1, deadline=900.0)])
    late = dataclasses.replace(world.robots[1], joins_at=500.0)
    assert look_at(dataclasses.replace(world, robots=(world.robots[0], late)), BOTH).reason


def test_a_task_that_arrives_after_the_horizon_is_no_reason():
    assert look_at(shut_world(tasks=[across(900.0, arrival=300.0)]), BOTH).reason == ""


def test_the_room_that_the_only_robot_cannot_leave_is_named():
    """The east room with the robot is the smaller side; the tasks are all in the west."""
    world = shut_world(tasks=[Task(arrival=1.0, start=0, end=0, deadline=900.0)])
    assert look_at(one_robot(world, 1), BOTH).shut[0].room == "end1"


@pytest.mark.parametrize(
    ("movable", "pushed", "scripted", "is_possible"),
    [
        (True, True, "", True),
        (True, False, "", False),
        (True, False, "a behavior", True),
        (False, False, "a behavior", False),
    ],
)
def test_furniture_that_somebody_pushes_is_not_in_the_way(movable, pushed, scripted, is_possible):
    world = shut_world(
        furniture=(furniture("cart1", 0.6, 1.2, 2.0, 0.0, movable=movable),),
        humans=(porter("cart1", 6.0, 1.0),) if pushed else (),
        scripted=scripted,
    )
    assert (look_at(world, BOTH).reason == "") is is_possible


def test_a_person_in_the_way_is_no_reason():
    guard = HumanSpec(name="guard", route=np.array([[2.0, 0.0]]), radius=0.6)
    assert look_at(shut_world(furniture=(), humans=(guard,)), BOTH).reason == ""


def door(start=0.0, end=200.0, x=2.0):
    polygon = rectangle(0.2, 1.2, (x, 0.0))
    return Blockage(name=f"door{x:g}", polygon=polygon, start=start, end=end)


@pytest.mark.parametrize(
    ("events", "is_possible"),
    [
        ((door(),), False),
        ((door(end=500.0),), False),
        ((door(end=150.0),), True),  # it opens
        ((door(start=100.0),), True),  # it is open until then
        ((door(start=0.5),), False),  # nobody comes there within half a second
        # where one ends a robot may stand before the next is there, which is then put down later
        ((door(end=100.0), door(start=100.0, x=2.1)), True),
    ],
)
def test_a_blockage_counts_if_nobody_can_hold_it_up_and_it_stands_to_the_horizon(
    events, is_possible
):
    assert (look_at(shut_world(furniture=(), events=events), BOTH).reason == "") is is_possible


@pytest.mark.parametrize(("x", "is_possible"), [(2.0, True), (-6.0, False)])
def test_a_blockage_is_not_put_down_on_a_person(x, is_possible):
    guard = HumanSpec(name="guard", route=np.array([[x, 0.3]]))
    world = shut_world(furniture=(), events=(door(),), humans=(guard,))
    assert (look_at(world, BOTH).reason == "") is is_possible


def test_deadlines_in_a_shut_world_are_not_what_makes_it_impossible():
    found = look_at(shut_world(tasks=[across(6.0)]), BOTH)
    assert found.shut
    assert not found.late


@pytest.mark.parametrize("seed", range(6))
def test_a_stop_counts_within_the_same_area_as_in_the_books(seed):
    """The area of :func:`stop_area` and what the books object to are one definition."""
    random = np.random.default_rng(seed)
    point = np.array([0.0, 0.0])
    walls = tuple(
        Wall(
            name=f"wall{i}",
            polygon=transform(rectangle(*random.uniform(0.1, 0.8, 2)), (*place, angle)),
        )
        for i, (place, angle) in enumerate(
            zip(random.uniform(-1.1, 1.1, (4, 2)), random.uniform(0, np.pi, 4), strict=True)
        )
    )
    world = World(
        name="stops",
        bounds=np.array([-3.0, -3.0, 3.0, 3.0]),
        walls=walls,
        rooms=(Room(name="ward", point=point),),
        tasks=(Task(arrival=0.0, start=0, end=0, deadline=9.0),),
        travel_times=np.zeros((1, 1)),
        robots=(robot(0, -2.0, -2.0),),
    )
    books, solids = Books(world), [Polygon(wall.polygon) for wall in walls]
    event = StackEvent(time=1.0, kind="picked-up", robot=0, task=0)
    area = stop_area(point, solids)
    for place in random.uniform(-1.2, 1.2, (400, 2)):
        if abs(np.hypot(*place) - ROOM_REACH) < 0.01 or area.boundary.distance(Point(place)) < 1e-6:
            continue
        assert area.contains(Point(place)) == (books._objection_of_place(event, place) == "")
