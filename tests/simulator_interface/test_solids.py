"""FCL decides as exact plane geometry does, but for contacts below a millimetre."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

from mrta_falsify.core.geometry import rectangle, transform
from mrta_falsify.core.shapes import polygons
from scenic_worlds.layouts import load_layout
from simulator_interface.solids import Box, Boxes, Solids

SURE = 1e-3  # m
PLACEMENTS = 5_000  # of each kind

L_SHAPE = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 0.3], [0.3, 0.3], [0.3, 2.0], [0.0, 2.0]])
BOW_TIE = np.array([[0.0, 0.0], [1.0, 1.0], [1.0, 0.0], [0.0, 1.0]])
LINE = np.array([[0.0, 0.0], [1.0, 0.5], [2.0, 1.0]])


def depth(one, other) -> float:
    """Gap of two shapes [m]; negative: how far their outlines are inside each other."""
    gap = one.distance(other)
    if gap > 0.0:
        return gap
    ends = shapely.points(np.asarray(other.exterior.coords))
    inner = shapely.points(np.asarray(one.exterior.coords))
    edges = (one.exterior, other.exterior)
    deepest = [edges[0].distance(p) for p in ends if one.covers(p)]
    deepest += [edges[1].distance(p) for p in inner if other.covers(p)]
    return -max(deepest, default=1.0)  # they cross


def test_discs_on_the_hospital_meet_what_shapely_says():
    layout = load_layout("aws_hospital")
    outlines = [*layout.solid_polygons()]
    solids, shapes = Solids(outlines), polygons(outlines)
    random = np.random.default_rng(49)
    low, high = layout.bounds[:2], layout.bounds[2:]
    for x, y in random.uniform(low, high, (PLACEMENTS, 2)):
        gaps = shapely.distance(shapes, shapely.points(x, y))
        radius = float(random.uniform(0.1, 0.6))
        met = set(solids.met_by_disc(x, y, radius))
        sure = set(np.flatnonzero(gaps < radius - SURE).tolist())
        possible = set(np.flatnonzero(gaps < radius + SURE).tolist())
        assert sure <= met <= possible


def test_boxes_meet_what_shapely_says():
    random = np.random.default_rng(50)
    boxes = [
        Box(*random.uniform(-3.0, 3.0, 2), 0.5, random.uniform(-4.0, 4.0), *sides, 1.0)
        for sides in random.uniform(0.2, 1.5, (30, 2))
    ]
    standing = Boxes()
    for number, box in enumerate(boxes):
        standing.put(number, box)
    shapes = [outline(box) for box in boxes]
    for x, y, yaw in random.uniform(-4.0, 4.0, (PLACEMENTS // 10, 3)):
        box = Box(x, y, 0.5, yaw, 0.6, 0.9, 1.0)
        met = standing.met_by(box)
        for number, shape in enumerate(shapes):
            gap = depth(shape, outline(box))
            assert abs(gap) < SURE or (number in met) == (gap < 0.0)


def outline(box: Box):
    return shapely.Polygon(
        transform(rectangle(box.width, box.length), np.array([box.x, box.y, box.yaw]))
    )


@pytest.mark.parametrize("shape", [L_SHAPE, L_SHAPE[::-1], BOW_TIE, LINE])
def test_an_outline_of_any_shape_is_filled(shape):
    solids = Solids([shape])
    exact = shapely.make_valid(shapely.Polygon(shape))
    random = np.random.default_rng(51)
    for x, y in random.uniform(-0.5, 2.5, (500, 2)):
        gap = exact.distance(shapely.Point(x, y))
        met = solids.met_by_disc(x, y, 0.1)
        assert abs(gap - 0.1) < SURE or met == ([0] if gap < 0.1 else [])


def test_a_body_inside_a_solid_meets_it():
    solids = Solids([rectangle(4.0, 4.0), rectangle(1.0, 1.0, (9.0, 0.0))])
    assert solids.met_by_disc(0.0, 0.0, 0.1) == [0]
    assert solids.met_by(rectangle(0.2, 0.2)) == [0]
    assert solids.met_by(rectangle(14.0, 0.2, (4.0, 0.0))) == [0, 1]
    assert Solids([]).met_by_disc(0.0, 0.0, 1.0) == []


def test_boxes_come_and_go_and_have_a_height():
    boxes, low = Boxes(), Box(0.0, 0.0, 0.5, 0.0, 1.0, 1.0, 1.0)
    boxes.put(3, low)
    assert boxes.met_by(low) == [3]
    assert boxes.met_by(low._replace(z=2.0)) == []
    boxes.put(3, low._replace(x=5.0))
    assert boxes.met_by(low) == []
    boxes.take(3)
    boxes.take(3)
    assert boxes.met_by(low._replace(x=5.0)) == []
