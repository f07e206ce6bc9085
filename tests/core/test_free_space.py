"""Where a disc can go, which things shut its way, and how wide the way is."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
import shapely
from scipy import ndimage

from mrta_falsify.core.free_space import around, free_space, shut_by, widest_gap
from mrta_falsify.core.geometry import rectangle, transform

BOUNDS = (0.0, 0.0, 10.0, 6.0)
HALF_WIDTH = 0.2
WEST, EAST = np.array([1.0, 3.0]), np.array([9.0, 3.0])
#: a wall with a door of 1 m, from y = 2.5 to 3.5
DOOR = [rectangle(0.2, 2.5, (5.0, 1.25)), rectangle(0.2, 2.5, (5.0, 4.75))]


def box(name, size_x, size_y, *pose):
    return name, transform(rectangle(size_x, size_y), pose)


def shut(things, walls=DOOR, start=WEST, goal=EAST, reach=0.3):
    return shut_by(BOUNDS, walls, things, start, goal, half_width=HALF_WIDTH, reach=reach)


@pytest.mark.parametrize(
    ("things", "expected"),
    [
        ([], None),
        ([box("cart", 0.4, 0.9, 5.0, 3.0, 0.0)], ("cart",)),
        ([box("cart", 0.4, 0.9, 5.0, 3.0, 0.0), box("bed", 1.0, 1.0, 2.0, 5.0, 0.0)], ("cart",)),
        # each leaves too little beside the other
        ([box("b", 0.4, 0.3, 5.0, 3.35, 0.0), box("a", 0.4, 0.3, 5.0, 2.8, 0.0)], ("a", "b")),
        # one behind the other: only both together open it
        ([box("in", 0.4, 0.9, 4.6, 3.0, 0.0), box("out", 0.4, 0.9, 5.4, 3.0, 0.0)], ("in", "out")),
        # on the goal
        ([box("bed", 2.0, 2.0, 9.0, 3.0, 0.0)], ("bed",)),
    ],
)
def test_the_things_that_shut_the_way_are_named(things, expected):
    assert shut(things) == expected


def test_where_walls_shut_the_way_no_thing_is_named():
    walls = [rectangle(0.2, 6.0, (5.0, 3.0))]
    assert shut([box("cart", 0.4, 0.9, 5.0, 3.0, 0.0)], walls) == ()


def test_of_two_ways_the_one_with_fewer_things_is_named():
    walls = [*DOOR[:1], rectangle(0.2, 1.5, (5.0, 4.25))]  # a second door from y = 5 to 6
    twice = [box(f"south{i}", 0.2, 1.0, 4.7 + 0.3 * i, 3.0, 0.0) for i in range(3)]
    north = [box(f"north{i}", 0.3, 1.0, 4.8 + 0.4 * i, 5.5, 0.0) for i in range(2)]
    assert shut([*twice, *north], walls) == ("north0", "north1")


@pytest.mark.parametrize(("gap", "is_open"), [(0.401, True), (0.38, False)])
def test_a_gap_of_the_disc_s_width_is_open_and_one_of_two_centimetres_less_is_shut(gap, is_open):
    cart = box("cart", 0.4, 1.0 - gap, 5.0, 2.5 + 0.5 * (1.0 - gap), 0.0)
    assert (shut([cart]) is None) is is_open


@pytest.mark.parametrize("gap", [0.0, 0.12, 0.41, 1.0])
def test_the_narrowest_place_of_the_best_way_is_measured(gap):
    things = [box("cart", 0.4, 1.0 - gap, 5.0, 2.5 + 0.5 * (1.0 - gap), 0.0)] if gap < 1.0 else []
    goal = around(EAST, 0.3)
    found = widest_gap(lambda half: free_space(BOUNDS, DOOR, things, half).is_open(WEST, goal))
    assert found == pytest.approx(gap, abs=0.012)


@pytest.mark.parametrize("overlap", [0.0, 0.02])
def test_a_robot_that_stands_close_to_a_wall_is_not_shut_in(overlap):
    start = np.array([4.9 - HALF_WIDTH + overlap, 1.0])
    assert shut([], start=start) is None
    assert shut([box("cart", 0.4, 0.9, 5.0, 3.0, 0.0)], start=start) == ("cart",)


def test_nothing_is_said_of_a_disc_that_does_not_fit_where_it_stands():
    cart = box("cart", 1.0, 1.0, *WEST, 0.0)
    door = box("door", 0.4, 1.0, 5.0, 3.0, 0.0)
    assert shut([cart, door]) is None


def test_a_wall_whose_outline_crosses_itself_still_stands():
    bow = np.array([[4.9, 0.0], [5.1, 6.0], [4.9, 6.0], [5.1, 0.0]])
    assert shut([], walls=[bow]) == ()


@pytest.mark.parametrize("seed", range(12))
def test_a_flood_of_small_cells_reaches_the_same_places(seed):
    """A second implementation, right up to its cells: between two half widths."""
    random = np.random.default_rng(seed)
    things = [
        box(f"box{i}", *random.uniform(0.3, 2.5, 2), *random.uniform((0, 0, 0), (10, 6, np.pi)))
        for i in range(14)
    ]
    outlines = [outline for _, outline in things]
    points = random.uniform((0.3, 0.3), (9.7, 5.7), (10, 2))
    space = free_space(BOUNDS, [], things, HALF_WIDTH)
    wide, narrow = (_flooded(outlines, HALF_WIDTH + error) for error in (0.03, -0.03))
    compared = 0
    for a, b in itertools.permutations([p for p in points if _part(wide, p)], 2):
        if _part(wide, a) == _part(wide, b):
            assert space.is_open(a, around(b, 0.02))
        elif _part(narrow, a) != _part(narrow, b):
            assert not space.is_open(a, around(b, 0.02))
        else:
            continue
        compared += 1
    assert compared


CELL = 0.01


def _flooded(outlines, half_width):
    """Number the connected cells of the free space, 0: not free."""
    x, y = np.arange(0, 10, CELL) + CELL / 2, np.arange(0, 6, CELL) + CELL / 2
    solid = shapely.union_all([shapely.Polygon(outline) for outline in outlines])
    shapely.prepare(solid)
    taken = shapely.contains_xy(solid, *np.meshgrid(x, y))
    free = ndimage.distance_transform_edt(~taken) * CELL > half_width
    return ndimage.label(free)[0]


def _part(cells, point):
    column, row = (point / CELL).astype(int)
    return cells[row, column]
