"""The costmap against shapely, cell by cell, and against its own definition."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import ndimage

from mrta_falsify.core.costmap import FREE, INSCRIBED, LETHAL
from mrta_falsify.core.defects import with_defects
from mrta_falsify.core.errors import ConfigError
from mrta_falsify.core.geometry import rectangle
from mrta_falsify.core.world import Blockage, Furniture, Wall, World
from scenic_worlds.layouts import load_layout
from simulator_interface.costmap_layers import LayeredCostmap, Options, build_costmap

NEAR = 1e-9  # m; closer than this, rounding decides

coordinate = st.one_of(
    st.floats(-1.4, 1.4),
    st.integers(-28, 28).map(lambda k: k * 0.05),  # on grid lines, too
)


@st.composite
def polygons(draw: st.DrawFn) -> np.ndarray:
    """Star-shaped polygons, convex or not, thin or wide, some on grid lines."""
    if draw(st.booleans()):
        x, y = (
            sorted(draw(st.tuples(coordinate, coordinate))),
            sorted(draw(st.tuples(coordinate, coordinate))),
        )
        return np.array([[x[0], y[0]], [x[1], y[0]], [x[1], y[1]], [x[0], y[1]]])
    corners = draw(st.integers(3, 8))
    angle = 2 * np.pi * (np.arange(corners) + 0.3) / corners
    radius = np.array(draw(st.lists(st.floats(0.02, 0.9), min_size=corners, max_size=corners)))
    center = np.array([draw(coordinate), draw(coordinate)])
    return center + radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def world_with(walls=(), furniture=(), events=(), bounds=(-1.5, -1.0, 1.51, 1.2)) -> World:
    return World(
        name="test",
        bounds=np.array(bounds),
        walls=tuple(Wall(name=f"w{i}", polygon=p) for i, p in enumerate(walls)),
        furniture=tuple(
            Furniture(name=f"f{i}", kind="bed", polygon=p) for i, p in enumerate(furniture)
        ),
        events=tuple(events),
    )


def distance_to_cells(costmap, shapes) -> np.ndarray:
    rows, cols = np.indices(costmap.cost.shape)
    x, y = (
        costmap.origin[0] + cols * costmap.resolution,
        costmap.origin[1] + rows * costmap.resolution,
    )
    cells = shapely.box(x, y, x + costmap.resolution, y + costmap.resolution)
    return np.min([shapely.distance(cells, shape) for shape in shapes], axis=0)


def reference_costs(lethal: np.ndarray, options: Options) -> np.ndarray:
    if not lethal.any():
        return np.zeros(lethal.shape)
    distance = ndimage.distance_transform_edt(~lethal) * options.resolution
    cost = np.floor(252 * np.exp(-options.cost_scaling * (distance - options.robot_radius)))
    cost[distance > options.inflation_radius + 1e-9] = FREE
    cost[distance <= options.robot_radius + 1e-9] = INSCRIBED
    cost[lethal] = LETHAL
    return cost


@settings(max_examples=60, deadline=None)
@given(st.lists(polygons(), min_size=1, max_size=4), st.lists(polygons(), max_size=2))
def test_a_cell_is_lethal_exactly_if_its_closure_meets_an_object(walls, furniture):
    costmap = build_costmap(world_with(walls, furniture))
    shapes = [shapely.Polygon(p) for p in (*walls, *furniture)]
    shapes = [s if s.area > 0 else shapely.LineString(s.exterior.coords) for s in shapes]
    distance = distance_to_cells(costmap, shapes)
    lethal = costmap.cost == LETHAL
    assert lethal[distance == 0].all()
    assert not lethal[distance > NEAR].any()


@settings(max_examples=25, deadline=None)
@given(
    st.lists(polygons(), min_size=1, max_size=3),
    st.sampled_from([(0.05, 0.5, 0.22), (0.1, 0.7, 0.3), (0.05, 0.1, 0.22), (0.25, 0.0, 0.1)]),
)
def test_costs_follow_the_nav2_formula_of_the_exact_distance(walls, setting):
    resolution, inflation, radius = setting
    options = Options(resolution=resolution, inflation_radius=inflation, robot_radius=radius)
    costmap = build_costmap(world_with(walls), options=options)
    expected = reference_costs(costmap.cost == LETHAL, options)
    np.testing.assert_array_equal(costmap.cost, expected)


@settings(max_examples=25, deadline=None)
@given(
    st.lists(polygons(), max_size=2),
    polygons(),
    st.lists(st.tuples(st.floats(-2, 2), st.floats(-2, 2)), max_size=3),
)
def test_a_map_updated_locally_equals_one_built_anew(walls, blocked, parked):
    event = Blockage(name="trolley", polygon=blocked, start=5.0, end=9.0)
    world = world_with(walls, events=[event])
    parked = np.array(parked).reshape(-1, 2)
    discs = [shapely.Point(p).buffer(0.22, quad_segs=64) for p in parked]
    updated = LayeredCostmap(Options()).bind(world).costmap(7.0, parked)
    expected = reference_costs(updated.cost == LETHAL, Options())
    np.testing.assert_array_equal(updated.cost, expected)
    anew = build_costmap(world_with([*walls, blocked]))
    lethal = updated.cost == LETHAL
    assert lethal[anew.cost == LETHAL].all()
    if discs:
        distance = distance_to_cells(updated, discs)
        assert lethal[distance == 0].all()
        assert not (lethal & (anew.cost != LETHAL))[distance > 0.001].any()


@pytest.mark.slow
def test_the_hospital_map_shows_every_object_and_nothing_else():
    world = load_layout("aws_hospital")
    costmap = build_costmap(world)
    solids = [shapely.Polygon(item.polygon) for item in (*world.walls, *world.furniture)]
    low = costmap.origin + np.argwhere(np.ones(costmap.cost.shape))[:, ::-1] * costmap.resolution
    cells = shapely.box(*low.T, *(low + costmap.resolution).T)
    met = np.unique(shapely.STRtree(cells).query(solids, predicate="intersects")[1])
    expected = np.zeros(costmap.cost.size, dtype=bool)
    expected[met] = True
    differs = np.flatnonzero(expected != (costmap.cost == LETHAL).ravel())
    distance = shapely.distance(cells[differs], shapely.union_all(solids))
    assert (distance < NEAR).all()
    assert len(met) > 50_000


def test_a_blockage_stands_from_its_start_up_to_its_end():
    event = Blockage(name="b", polygon=rectangle(0.4, 0.4), start=5.0, end=9.0)
    source = LayeredCostmap(Options()).bind(world_with(events=[event]))
    nobody = np.zeros((0, 2))
    standing = [bool(source.costmap(t, nobody).cost.any()) for t in (0.0, 4.9, 5.0, 8.9, 9.0)]
    assert standing == [False, False, True, True, False]


def test_the_same_object_is_returned_while_nothing_changes():
    event = Blockage(name="b", polygon=rectangle(0.4, 0.4), start=5.0, end=9.0)
    source = LayeredCostmap(Options()).bind(world_with(events=[event]))
    one, two = np.array([[0.5, 0.5], [-1.0, 0.0]]), np.array([[-1.0, 0.0], [0.5, 0.5]])
    assert source.costmap(0.0, np.zeros((0, 2))) is source.costmap(3.0, np.zeros((0, 2)))
    assert source.costmap(6.0, one) is source.costmap(7.0, two)
    assert source.costmap(6.0, one) is not source.costmap(9.0, one)


def test_a_map_is_read_only():
    costmap = build_costmap(world_with([rectangle(0.4, 0.4)]))
    with pytest.raises(ValueError, match="read-only"):
        costmap.cost[0, 0] = 1


def test_the_planted_defect_leaves_out_furniture_and_nothing_else():
    walls, furniture = [rectangle(0.3, 0.3, (-1.0, 0.0))], [rectangle(0.3, 0.3, (1.0, 0.0))]
    event = Blockage(name="b", polygon=rectangle(0.2, 0.2, (0.0, 0.8)), start=0.0, end=9.0)
    world = world_with(walls, furniture, [event])
    layer = with_defects(LayeredCostmap, ("costmap_blind_to_furniture",))(Options())
    blind = layer.bind(world).costmap(0.0)
    without = build_costmap(dataclasses.replace(world, furniture=()))
    np.testing.assert_array_equal(blind.cost, without.cost)
    assert build_costmap(world).cost_at(np.array([1.0, 0.0])) == LETHAL
    assert blind.cost_at(np.array([1.0, 0.0])) == FREE


def test_shifting_the_world_by_whole_cells_shifts_the_map():
    polygon = np.array([[-0.3, -0.21], [0.4, -0.1], [0.17, 0.33]])
    here = build_costmap(world_with([polygon], bounds=(-2.0, -2.0, 2.0, 2.0)))
    shift = np.array([0.25, -0.5])
    there = build_costmap(world_with([polygon + shift], bounds=(-1.75, -2.5, 2.25, 1.5)))
    np.testing.assert_array_equal(here.cost, there.cost)


def test_a_hole_made_by_a_keyhole_outline_stays_free():
    outer, inner = rectangle(2.4, 1.8), rectangle(1.6, 1.0)[::-1]
    keyhole = np.concatenate([outer, outer[:1], inner, inner[:1]])
    costmap = build_costmap(world_with([keyhole]), options=Options(inflation_radius=0.0))
    assert costmap.cost_at(np.array([0.3, 0.2])) == FREE
    assert costmap.cost_at(np.array([1.0, 0.0])) == LETHAL


def test_too_fine_a_resolution_is_refused_with_the_number_of_cells():
    with pytest.raises(ConfigError, match="100000 x 100000 cells, at most"):
        build_costmap(world_with(bounds=(-500, -500, 500, 500)), options=Options(resolution=0.01))
