"""Rooms that others hold: nobody plans through them, or moves aside into them."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from control_course import Course, line
from mission_course import run, ward
from planning_course import BEFORE, BEHIND, hall, planned

from mrta_falsify.core.arrays import frozen_array
from mrta_falsify.core.costmap import INSCRIBED, LETHAL
from mrta_falsify.core.geometry import rectangle
from mrta_falsify.core.plane import signed_distances
from mrta_falsify.core.polyline import Polylines
from mrta_falsify.stack.control.cluster import ClusterCbf
from mrta_falsify.stack.detours import Closed, Detours

ROOM = rectangle(2.0, 2.0, (5.0, 0.0))


def is_inside(outline, point):
    return signed_distances(np.asarray(outline), np.array([point], dtype=float))[0] < 0.0


# --- planning ----------------------------------------------------------------------------


def way_from(start, goal, *, not_held=(0,), width=6.0):
    return planned(hall(width), start, [goal], rooms=[ROOM], not_held=not_held)


def enters_room(way):
    return bool((signed_distances(ROOM, way.path) < -0.05).any())


def test_a_path_leads_around_a_room_that_others_may_use():
    assert not enters_room(way_from(BEFORE, BEHIND))
    assert enters_room(way_from(BEFORE, BEHIND, not_held=()))


@pytest.mark.parametrize("shift", [0.01, 0.03, 0.05, 0.07, 0.09])
def test_a_way_along_the_outline_of_a_room_is_a_way_around_it(shift):
    room = ROOM + np.array([0.0, shift])
    way = planned(hall(), BEFORE, [BEHIND], rooms=[room], not_held=(0,))
    deepest = -signed_distances(room, way.path).min()
    assert deepest < 0.1 * np.sqrt(0.5)  # half a cell's diagonal


def test_the_only_way_leads_through_the_room_all_the_same():
    way = way_from(BEFORE, BEHIND, width=1.8)
    assert not way.failed
    assert enters_room(way)


@pytest.mark.parametrize(("start", "goal"), [((5.0, 0.0), BEHIND), (BEFORE, (5.0, 0.0))])
def test_who_begins_or_ends_in_a_room_may_be_there(start, goal):
    assert enters_room(way_from(start, goal))


def test_a_closed_room_stays_what_it_was_where_it_was_worse():
    costmap = hall(1.0)
    closed = Detours([ROOM]).map_without(costmap, Closed(rooms=frozenset({0})))
    (row, col), (wall_row, wall_col) = costmap.cells(np.array([[5.0, 0.0], [5.0, 0.8]]))
    assert closed.cost[row, col] == INSCRIBED
    assert closed.cost[wall_row, wall_col] == LETHAL
    assert costmap.cost[row, col] == 0


# --- moving aside --------------------------------------------------------------------------


class Shared(Course):
    """A course with one place that robots must ask for."""

    def view(self):
        n = len(self.pose)
        return dataclasses.replace(
            super().view(), shared_places=Polylines.of([self.place]), closed=np.full((n, 1), True)
        )


def where_it_goes(place):
    """Where a robot without a task stands after another one has passed where it stood [m]."""
    course = Shared(
        pose=[[-4.0, 0.0, 0.0], [0.0, 0.0, np.pi / 2.0]],
        paths=[line((-4.0, 0.0), (5.0, 0.0)), np.zeros((0, 2))],
    )
    course.place = place
    course.run(ClusterCbf(ClusterCbf.Options()), 16.0)
    assert course.pose[0, 0] > 4.5
    return course.pose[1, :2]


def test_nobody_moves_aside_into_a_place_that_others_hold():
    far_away = rectangle(1.0, 1.0, (30.0, 30.0))
    free = where_it_goes(far_away)
    place = rectangle(6.0, 4.0, (0.0, np.sign(free[1]) * 2.3))
    assert signed_distances(place, free[None])[0] < 0.0
    other = where_it_goes(place)
    assert signed_distances(place, other[None])[0] > 0.0


def test_a_robot_that_is_inside_may_leave():
    around = rectangle(0.8, 0.8, (0.0, 0.0))
    assert signed_distances(around, where_it_goes(around)[None])[0] > 0.0


# --- rooms that begin overfull --------------------------------------------------------------


def test_who_stands_at_the_door_of_a_room_at_first_lets_out_who_is_inside():
    world = ward([0, 1], [(0, 0, 1), (0, 0, 1)], rooms=2)
    outline = np.asarray(world.rooms[0].area)
    x, y = world.rooms[0].point[0], outline[:, 1].max() + 0.1
    if not is_inside(world.resources[0].release_area, (x, y)):
        y = outline[:, 1].min() - 0.1
    assert is_inside(world.resources[0].release_area, (x, y))
    assert not is_inside(outline, (x, y))
    at_the_door = dataclasses.replace(world.robots[1], pose=frozen_array([x, y, np.pi / 2.0]))
    named = zip(world.tasks, world.robots, strict=True)
    world = dataclasses.replace(
        world,
        robots=(world.robots[0], at_the_door),
        tasks=tuple(dataclasses.replace(task, robot=robot.name) for task, robot in named),
    )
    result = run(world, exclusive=False)
    assert result.done
    within = [signed_distances(outline, result.pose[:, robot, :2]) < 0.0 for robot in (0, 1)]
    assert within[1].any()
    assert not (within[0] & within[1]).any()
