"""Worlds that no stack can do are set apart, and only those."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from shapely.geometry import box

from benchmarks.oracle.floors import robot, two_rooms
from mrta_falsify.core.directives import Push
from mrta_falsify.core.geometry import rectangle
from mrta_falsify.core.world import Furniture, HumanSpec, Task
from mrta_falsify.possibility import why_impossible

BOTH = ("deadlines", "all_tasks_done")


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


@pytest.mark.parametrize(("width", "is_possible"), [(0.6, True), (0.12, False)])
def test_a_robot_that_is_wider_than_the_only_way_cannot_pass(width, is_possible):
    reason = why_impossible(ward(width, [across(900.0)]), BOTH)
    assert (reason == "") is is_possible
    assert is_possible or "narrow" in reason


@pytest.mark.parametrize(("width", "is_possible"), [(1.2, True), (0.6, False)])
def test_a_bed_is_not_pushed_through_a_door_that_is_narrower(width, is_possible):
    bed = Furniture(
        name="bed1", kind="bed", polygon=rectangle(2.0, 0.9) + np.array([-6.5, 0.0]), movable=True
    )
    porter = HumanSpec(
        name="porter1",
        route=np.array([[-6.5, 1.0]]),
        directives=(Push(furniture="bed1", point=np.array([6.5, 0.0])),),
    )
    world = dataclasses.replace(ward(width), furniture=(bed,), humans=(porter,))
    reason = why_impossible(world, BOTH)
    assert (reason == "") is is_possible
    assert is_possible or ("porter1" in reason and "bed1" in reason)


def test_furniture_and_people_in_the_way_are_no_reason():
    """What stands around may be the point of the world; only walls count."""
    cart = Furniture(name="cart1", kind="cart", polygon=rectangle(1.0, 1.2))
    world = dataclasses.replace(ward(tasks=[across(900.0)]), furniture=(cart,))
    assert why_impossible(world, BOTH) == ""
