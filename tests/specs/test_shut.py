"""Rooms shut during the run, by what was pushed or by who stays there."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from mrta_falsify.core.free_space import Disc
from mrta_falsify.core.geometry import rectangle
from mrta_falsify.core.world import Blockage, Furniture, Task
from mrta_falsify.specs.deadlock.bystanders import AWAY, Bystanders
from mrta_falsify.specs.deadlock.shut import Ground
from tests.specs.frames import Human, Robot, Script

DISC = Disc((0.0, 0.0), 0.15)
WALLS = [rectangle(0.1, 4.0, (0.0, 2.5)), rectangle(0.1, 4.0, (0.0, -2.5))]  # a door of 1 m at 0, 0
INSIDE, OUTSIDE = (2.0, 0.0), (-2.0, 0.0)
FOUND, ENDED = 50.0, 290.0


def world(*, rooms=(INSIDE, OUTSIDE), humans=(), furniture=(), events=()):
    script = Script(
        robots=[Robot(OUTSIDE, goal=INSIDE)],
        humans=humans,
        walls=WALLS,
        rooms=list(rooms),
        bounds=(-4.0, -3.0, 4.0, 3.0),
    )
    return dataclasses.replace(script.world(), furniture=furniture, events=events)


NOBODY = Bystanders()


def shut(in_world, bystanders=NOBODY, *, start=OUTSIDE, goal=INSIDE):
    return ground(in_world, bystanders, start).shut_way(0, np.array(goal))


def ground(in_world, bystanders, *places):
    """The ground with robot 0, and maybe others, at ``places``; others are thin."""
    discs = [DISC, *[Disc((0.0, 0.0), 0.05)] * (len(places) - 1)]
    return Ground(
        world=in_world,
        pose=np.array([[*place, 0.0] for place in places]),
        discs=discs,
        bystanders=bystanders,
        stands_since=FOUND,
        ended=ENDED,
    )


def bed(width: float) -> Furniture:
    return Furniture(
        name="bed_1", kind="bed", polygon=rectangle(0.6, width, (3.0, 2.0)), movable=True
    )


def pushed(x: float, y: float, turn: float = 0.0, since: float = 41.0) -> Bystanders:
    return Bystanders(furniture=((x, y, turn, since),))


def test_an_open_door_is_not_shut():
    assert shut(world()) is None
    assert shut(world(furniture=(bed(0.9),)), pushed(3.0, 2.0)) is None


def test_a_bed_pushed_into_the_door_shuts_the_room_since_it_came_there():
    found = shut(world(furniture=(bed(0.9),)), pushed(0.0, 0.0))
    assert (found.by, found.since) == (("bed_1",), 41.0)
    assert found.room == world().rooms[0].name


@pytest.mark.parametrize(("gap", "is_shut"), [(0.25, True), (0.29, True), (0.31, False)])
def test_what_counts_is_whether_the_body_fits_beside_it(gap, is_shut):
    width = 0.6
    along = 0.5 - gap - 0.5 * width  # the bed's centre, so that `gap` is left at one side
    assert (shut(world(furniture=(bed(width),)), pushed(0.0, along)) is not None) == is_shut


def test_a_bed_turned_on_the_spot_shuts_with_its_turned_outline():
    narrow = Furniture(
        name="bed_1", kind="bed", polygon=rectangle(0.9, 0.3, (3.0, 2.0)), movable=True
    )
    assert shut(world(furniture=(narrow,)), pushed(0.0, 0.3)) is None
    assert shut(world(furniture=(narrow,)), pushed(0.0, 0.0, turn=np.pi / 2)) is not None


def test_a_robot_inside_is_told_to_be_shut_in():
    in_world = world(furniture=(bed(0.9),))
    found = shut(in_world, pushed(0.0, 0.0), start=INSIDE, goal=OUTSIDE)
    assert found.by == ("bed_1",)


def test_a_person_who_stays_shuts_and_one_who_came_later_or_left_does_not():
    in_world = world(humans=[Human((0.0, 0.0))], rooms=(INSIDE, OUTSIDE))
    wide = dataclasses.replace(in_world.humans[0], radius=0.45)
    in_world = dataclasses.replace(in_world, humans=(wide,))

    def person(x, y, since):
        return Bystanders(people=((x, y, since),))

    assert shut(in_world, person(0.0, 0.0, 30.0)).by == (wide.name,)
    assert shut(in_world, person(0.0, 0.0, 120.0)) is None
    assert shut(in_world, person(AWAY, AWAY, 30.0)) is None


@pytest.mark.parametrize("here", [{"leaves_at": 1.0}, {"appears_at": 100.0}])
def test_a_person_who_is_not_in_the_building_shuts_nothing(here):
    in_world = world(humans=[Human((0.0, 0.0))])
    absent = dataclasses.replace(in_world.humans[0], radius=0.45, **here)
    in_world = dataclasses.replace(in_world, humans=(absent,))
    assert shut(in_world, Bystanders(people=((0.0, 0.0, 0.0),))) is None


def test_a_blockage_that_waits_for_a_robot_to_leave_its_place_shuts_nothing():
    cart = Blockage(name="cart", polygon=rectangle(0.4, 0.9, (0.0, 0.0)), start=20.0, end=1e6)
    blocked = world(events=(cart,))
    two = dataclasses.replace(
        blocked, robots=(*blocked.robots, dataclasses.replace(blocked.robots[0], name="robot2"))
    )
    assert ground(two, NOBODY, OUTSIDE, (1.0, 2.0)).shut_way(0, np.array(INSIDE)) is not None
    assert ground(two, NOBODY, OUTSIDE, (0.0, 0.0)).shut_way(0, np.array(INSIDE)) is None


def test_a_robot_sent_where_only_another_one_fits_is_not_shut_by_the_world():
    cabinet = Furniture(name="cabinet", kind="cabinet", polygon=rectangle(0.3, 0.8, (0.0, 0.1)))
    gap = world(furniture=(cabinet,))
    task = Task(arrival=0.0, start=0, end=1, deadline=800.0)
    two = dataclasses.replace(
        gap,
        robots=(*gap.robots, dataclasses.replace(gap.robots[0], name="thin")),
        tasks=(task,),
    )

    def way(in_world):
        return ground(in_world, NOBODY, OUTSIDE, OUTSIDE).shut_way(0, np.array(INSIDE))

    assert way(two) is None
    bound = dataclasses.replace(task, robot=two.robots[0].name)
    assert way(dataclasses.replace(two, tasks=(bound,))).by == ("cabinet",)


def test_walls_alone_and_a_goal_that_is_no_room_are_not_the_world_s_doing():
    assert shut(world(), goal=(0.0, 2.5)) is None
    cabinet = Furniture(name="cabinet", kind="cabinet", polygon=rectangle(0.3, 1.0, (0.0, 0.0)))
    assert shut(world(rooms=(), furniture=(cabinet,))) is None


def test_a_blockage_shuts_only_if_it_lasts():
    def cart(end):
        return Blockage(name="cart", polygon=rectangle(0.4, 0.9, (0.0, 0.0)), start=20.0, end=end)

    found = shut(world(events=(cart(1e6),)))
    assert (found.by, found.since) == (("cart",), 20.0)
    assert shut(world(events=(cart(200.0),))) is None


def test_an_idle_robot_that_cannot_make_room_is_shut_in_by_what_keeps_it_there():
    in_world = world(furniture=(bed(0.9),))
    assert ground(in_world, pushed(0.0, 0.0), INSIDE).shut_in(0) == ("bed_1",)
    assert ground(in_world, pushed(3.0, 2.0), INSIDE).shut_in(0) == ()
