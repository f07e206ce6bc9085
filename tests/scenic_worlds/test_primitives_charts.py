"""Maps from the unit cube onto regions: inside, uniform, and as Scenic samples them."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import ks_2samp, kstest

pytestmark = pytest.mark.filterwarnings("ignore")

L_SHAPE = shapely.Polygon([(0, 0), (6, 0), (6, 1), (2, 1), (2, 5), (0, 5)])
RING = shapely.Point(0, 0).buffer(3).difference(shapely.Point(0.5, 0).buffer(1.2))
ISLANDS = shapely.MultiPolygon(
    [shapely.box(0, 0, 1, 1), shapely.box(3, -2, 3.5, 4), shapely.Polygon([(5, 0), (9, 2), (6, 6)])]
)
SHAPES = {"l_shape": L_SHAPE, "ring": RING, "islands": ISLANDS}
SAMPLES = 1500
SLOW = {
    "ball": 150,
    "box": 150,
    "solid": 150,
    "surface": 300,
}  # Scenic takes milliseconds for a point
LEVEL = 1e-3  # of each test; the points are fixed by their seed


def regions() -> dict[str, object]:
    import trimesh
    from scenic.core import regions as r
    from scenic.core.vectors import Orientation, Vector

    disc = r.CircularRegion(Vector(1, 2, 0), 3)
    yard = r.RectangularRegion(Vector(2, 1, 0), 0.7, 4, 2)
    table = trimesh.creation.cylinder(radius=1.0, height=2.0, sections=12)
    bracket = trimesh.creation.extrude_polygon(L_SHAPE, 1.5)
    cloud = r.PointSetRegion("spots", [(0, 0), (1, 0), (2, 3), (4, 4), (5, 1)])
    return {
        "rectangle": yard,
        "disc": disc,
        "sector": r.SectorRegion(Vector(1, 2, 0), 3, 0.4, 1.3),
        "polygon": r.PolygonalRegion(polygon=L_SHAPE, z=1),
        "polygons": r.PolygonalRegion(polygon=ISLANDS),
        "polyline": r.PolylineRegion([(0, 0), (3, 1), (3, 6), (-2, 6)]),
        "path": r.PathRegion(points=[(0, 0, 0), (3, 1, 2), (3, 6, 2)]),
        "points": cloud,
        "surface": r.MeshSurfaceRegion(table, position=Vector(1, 1, 1)),
        "box": r.BoxRegion(
            dimensions=(1, 2, 3),
            position=Vector(1, 2, 3),
            rotation=Orientation.fromEuler(0.3, 0.2, 0),
        ),
        "ball": r.SpheroidRegion(dimensions=(2, 3, 4), position=Vector(1, 2, 3)),
        "solid": r.MeshVolumeRegion(bracket),
        "union": r.UnionRegion(disc, yard),
        "difference": r.DifferenceRegion(disc, yard),
        "intersection": r.IntersectionRegion(disc, yard),
        "common_points": cloud.intersect(disc),
    }


KINDS = (
    *("rectangle", "disc", "sector", "polygon", "polygons", "polyline", "path", "points"),
    *("surface", "box", "ball", "solid", "union", "difference", "intersection"),
    "common_points",
)


def charted(region: object, numbers: np.random.Generator, count: int = SAMPLES) -> np.ndarray:
    from scenic.core.distributions import RejectionException

    from scenic_worlds.primitives.charts import chart_of

    chart = chart_of(region)
    assert chart is not None
    points = []
    while len(points) < count:
        try:
            points.append(list(chart.point(numbers.random(len(chart.axes)).tolist())))
        except RejectionException:
            continue
    return np.array(points)


def native(region, numbers: np.random.Generator, count: int) -> np.ndarray:
    from scenic.core.distributions import RejectionException

    from scenic_worlds.primitives import randomness

    points = []
    with randomness.seeded_by(numbers):
        while len(points) < count:
            try:
                points.append(list(region.uniformPointInner()))
            except RejectionException:
                continue
    return np.array(points)


@pytest.mark.parametrize("kind", KINDS)
def test_points_of_a_region_are_spread_as_scenic_spreads_them(kind):
    numbers = np.random.default_rng(7)
    region = regions()[kind]
    ours, theirs = charted(region, numbers), native(region, numbers, SLOW.get(kind, SAMPLES))
    oblique = np.array([0.6, 0.48, 0.64])
    for axis in (*np.eye(3), oblique):
        if np.ptp(theirs @ axis) > 1e-9:
            assert ks_2samp(ours @ axis, theirs @ axis).pvalue > LEVEL
        else:
            np.testing.assert_allclose(ours @ axis, (theirs @ axis)[0], atol=1e-9)


@pytest.mark.parametrize("kind", ["rectangle", "disc", "polygon", "polyline", "box", "ball"])
def test_corners_of_the_unit_cube_belong_to_the_region(kind):
    from scenic_worlds.primitives.charts import chart_of

    region = regions()[kind]
    chart = chart_of(region)
    for corner in np.ndindex(*(2,) * len(chart.axes)):
        point = chart.point([float(value) for value in corner])
        assert region.distanceTo(point) < 1e-6


def test_a_region_that_samples_in_its_own_way_has_no_chart():
    from scenic.core.regions import CircularRegion
    from scenic.core.vectors import Vector

    from scenic_worlds.primitives.charts import chart_of

    class Centre(CircularRegion):
        def uniformPointInner(self):
            return self.center

    assert chart_of(Centre(Vector(0, 0, 0), 1)) is None


@pytest.mark.parametrize("name", SHAPES)
@given(u=st.floats(0, 1), v=st.floats(0, 1))
def test_every_point_of_the_unit_square_lands_in_the_polygon(name, u, v):
    from scenic_worlds.primitives.polygons import PolygonMap

    shape = SHAPES[name]
    x, y = PolygonMap(shape).point(u, v)
    assert shape.distance(shapely.Point(x, y)) < 1e-9


@pytest.mark.parametrize("name", SHAPES)
def test_the_first_coordinate_is_the_share_of_the_area_to_the_left(name):
    from scenic_worlds.primitives.polygons import PolygonMap

    shape = SHAPES[name]
    mapped = PolygonMap(shape)
    assert mapped.area == pytest.approx(shape.area)
    for u in (0.05, 0.3, 0.5, 0.77, 0.99):
        x, _ = mapped.point(u, 0.5)
        left = shape.intersection(shapely.box(-20, -20, x, 20))
        assert left.area / shape.area == pytest.approx(u, abs=1e-9)


@pytest.mark.parametrize("name", SHAPES)
def test_the_second_coordinate_is_uniform_along_the_cut(name):
    from scenic_worlds.primitives.polygons import PolygonMap

    mapped = PolygonMap(SHAPES[name])
    shares = np.linspace(0.001, 0.999, 400)
    y = np.array([mapped.point(0.4, float(v))[1] for v in shares])
    assert (np.diff(y) > 0).all()
    x = mapped.point(0.4, 0.5)[0]
    cut = SHAPES[name].intersection(shapely.LineString([(x, -20), (x, 20)]))
    below = [cut.intersection(shapely.box(-20, -20, 20, value)).length / cut.length for value in y]
    np.testing.assert_allclose(below, shares, atol=1e-6)


def test_nearby_points_of_the_square_are_nearby_in_a_convex_polygon():
    from scenic_worlds.primitives.polygons import PolygonMap

    hexagon = shapely.Point(0, 0).buffer(2, quad_segs=2)
    mapped = PolygonMap(hexagon)
    numbers = np.random.default_rng(1)
    for u, v in numbers.uniform(0.05, 0.94, (300, 2)):
        here, there = mapped.point(u, v), mapped.point(u + 1e-6, v + 1e-6)
        assert np.hypot(here[0] - there[0], here[1] - there[1]) < 1e-4


def test_a_shape_without_area_is_refused():
    from scenic_worlds.primitives.polygons import PolygonMap

    with pytest.raises(ValueError, match="no area"):
        PolygonMap(shapely.LineString([(0, 0), (1, 1)]))


def test_marginals_of_the_disc_follow_their_formula():
    numbers = np.random.default_rng(3)
    points = charted(regions()["disc"], numbers) - (1, 2, 0)
    radius = np.hypot(points[:, 0], points[:, 1])
    assert kstest((radius / 3) ** 2, "uniform").pvalue > LEVEL
