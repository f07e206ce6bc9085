"""Robot models as data, footprints from URDF, and the geometry under both engines."""

from __future__ import annotations

import textwrap

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from shapely.geometry import LineString, MultiPoint, Point, Polygon

from mrta_falsify.core import registry
from mrta_falsify.core.arrays import frozen_array
from mrta_falsify.core.config import Choice
from mrta_falsify.core.errors import ConfigError, InputError, UnknownNameError
from mrta_falsify.core.fleet import Command
from mrta_falsify.core.geometry import rectangle
from mrta_falsify.core.world import RobotSpec, World
from simulator_interface.engines import gaps, rays
from simulator_interface.engines.robot_models import find_model, shipped_models

URDF = """
<robot name="cart">
  <link name="base">
    <inertial><origin xyz="0 0 0.06"/><mass value="6"/>
      <inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial>
    <collision><origin xyz="0 0 0.11"/><geometry><box size="0.5 0.3 0.1"/></geometry></collision>
  </link>
  <link name="front">
    <inertial><mass value="0.1"/>
      <inertia ixx="1e-4" ixy="0" ixz="0" iyy="1e-4" iyz="0" izz="1e-4"/></inertial>
    <collision><geometry><sphere radius="0.03"/></geometry></collision>
  </link>
  <joint name="front_joint" type="fixed">
    <parent link="base"/><child link="front"/><origin xyz="0.2 0 0.03"/></joint>
  <link name="rear">
    <inertial><mass value="0.1"/>
      <inertia ixx="1e-4" ixy="0" ixz="0" iyy="1e-4" iyz="0" izz="1e-4"/></inertial>
    <collision><geometry><sphere radius="0.03"/></geometry></collision>
  </link>
  <joint name="rear_joint" type="fixed">
    <parent link="base"/><child link="rear"/><origin xyz="-0.2 0 0.03"/></joint>
  {wheels}
</robot>
"""
WHEEL = """
  <link name="{side}">
    <inertial><mass value="0.3"/>
      <inertia ixx="4e-4" ixy="0" ixz="0" iyy="4e-4" iyz="0" izz="7e-4"/></inertial>
    <collision><geometry><cylinder radius="0.06" length="0.02"/></geometry></collision>
  </link>
  <joint name="{side}_joint" type="continuous">
    <parent link="base"/><child link="{side}"/>
    <origin xyz="0 {y} 0.06" rpy="-1.5707963267948966 0 0"/><axis xyz="0 0 1"/></joint>
"""
MODEL = """
urdf: cart.urdf
joints: [left_joint, right_joint]
wheel_separation: 0.4
wheel_radius: 0.06
max_speed: 0.8
"""


@pytest.fixture
def cart(tmp_path):
    wheels = "".join(WHEEL.format(side=s, y=y) for s, y in (("left", 0.2), ("right", -0.2)))
    (tmp_path / "cart.urdf").write_text(URDF.format(wheels=wheels))
    path = tmp_path / "cart.yaml"
    path.write_text(textwrap.dedent(MODEL))
    return path


@pytest.mark.parametrize("name", ["bullet", "kinematic"])
def test_robot_of_ones_own_needs_a_urdf_and_a_model_file_only(cart, name):
    spec = RobotSpec(name="cart", model=str(cart), pose=frozen_array([0, 0, 0.5]), radius=0.3)
    world = World(name="field", bounds=frozen_array([-9, -9, 9, 9]), robots=(spec,))
    engine = registry.build("engine", Choice(name))
    engine.start(world, 0.05, np.zeros((0, 2)))
    seen = [
        engine.step(Command(twist=np.array([[1.0, 0.0, 0.5]])), np.zeros((0, 2))) for _ in range(80)
    ]
    engine.close()
    steady = np.mean([s.velocity[0] for s in seen[40:]], axis=0)
    assert steady == pytest.approx([0.8, 0.0, 0.5], abs=0.03)


def test_footprint_is_the_outline_of_all_collision_shapes(cart):
    outline = Polygon(find_model(str(cart)).footprint)
    body = MultiPoint(
        np.concatenate([rectangle(0.5, 0.3), *(rectangle(0.12, 0.02, (0, y)) for y in (-0.2, 0.2))])
    ).convex_hull
    assert outline.symmetric_difference(body).area < 1e-4
    assert outline.exterior.is_ccw


def test_waffle_footprint_holds_base_and_wheels():
    outline = Polygon(find_model("waffle").footprint)
    assert outline.bounds == pytest.approx((-0.1965, -0.1525, 0.0685, 0.1525))
    assert outline.covers(Polygon(rectangle(0.265, 0.265, (-0.064, 0.0))).buffer(-1e-9))


def test_fast_and_real_profiles_are_both_named():
    models = shipped_models()
    assert (models["waffle"].max_speed, models["waffle"].max_turn_rate) == (1.5, 2.0)
    assert (models["waffle_real"].max_speed, models["waffle_real"].max_turn_rate) == (0.26, 1.0)
    assert models["holonomic"].base == "holonomic"


@pytest.mark.parametrize(
    ("change", "kind", "words"),
    [
        (("wheel_radius: 0.06", "wheel_radius: -1"), InputError, "wheel_radius.*must be > 0"),
        (("wheel_radius", "wheel_radios"), InputError, "did you mean 'wheel_radius'"),
        (("[left_joint, right_joint]", "[left_joint]"), ConfigError, "has 2"),
        (("cart.urdf", "card.urdf"), InputError, "card.urdf"),
        (
            ("left_joint,", "lift_joint,"),
            UnknownNameError,
            "did you mean 'left_joint'",
        ),
    ],
)
def test_mistake_in_a_model_file_is_named(cart, change, kind, words):
    cart.write_text(cart.read_text().replace(*change) + "wheels_touch: floor\n")
    with pytest.raises(kind, match=words):
        find_model(str(cart))


def test_broken_urdf_is_refused(cart):
    (cart.parent / "cart.urdf").write_text("<robot><link>")
    with pytest.raises(InputError, match="not a readable URDF"):
        find_model(str(cart))


# --- geometry against shapely --------------------------------------------------------------

coordinate = st.floats(-3, 3).map(lambda x: round(x, 3))
pose = st.tuples(coordinate, coordinate, st.floats(-3, 3))
WAFFLE = find_model("waffle").footprint


def placed(where) -> np.ndarray:
    out = np.zeros_like(WAFFLE)
    gaps.place_outline(WAFFLE, len(WAFFLE), np.array(where), out)
    return out


@given(one=pose, other=pose)
def test_gap_of_two_robots_is_their_distance(one, other):
    a, b = placed(one), placed(other)
    found = gaps.polygon_gap(a, len(a), b, len(b), 99.0)
    distance = Polygon(a).distance(Polygon(b))
    if distance > 1e-9:
        assert found == pytest.approx(distance, abs=1e-9)
    else:
        assert found <= 1e-9
        assert found >= -0.31


@given(robot=pose, x=coordinate, y=coordinate)
def test_gap_to_a_point_is_the_distance_and_negative_inside(robot, x, y):
    body = placed(robot)
    found = gaps.polygon_point_gap(body, len(body), x, y)
    shape = Polygon(body)
    inside = shape.contains(Point(x, y))
    expected = -shape.exterior.distance(Point(x, y)) if inside else shape.distance(Point(x, y))
    assert found == pytest.approx(expected, abs=1e-9)


def scattered(seed: int) -> list[np.ndarray]:
    random = np.random.default_rng(seed)
    shapes = []
    for _ in range(15):
        angles = np.sort(random.uniform(0, 2 * np.pi, random.integers(3, 8)))
        size = random.uniform(0.05, 0.6, (len(angles), 1))
        spokes = np.stack([np.cos(angles), np.sin(angles)], axis=1)
        shapes.append(random.uniform(-3, 3, 2) + size * spokes)
    return shapes


@given(robot=pose, seed=st.integers(0, 50))
def test_gap_to_the_nearest_solid_is_the_distance_to_the_nearest_outline(robot, seed):
    shapes = scattered(seed)
    grid = rays.build_edge_grid(rays.polygon_edges(shapes), np.array([-3.0, -3.0, 3.0, 3.0]))
    body = placed(robot)
    found = gaps.static_gap(
        grid, np.zeros((0, 4)), body, len(body), robot[0], robot[1], 0.238, gaps.FAR
    )
    outlines = [LineString(np.vstack([s, s[:1]])) for s in shapes]
    distance = min(Polygon(body).distance(outline) for outline in outlines)
    if distance > 1e-9:
        assert found == pytest.approx(distance, abs=1e-9)
    else:
        assert found <= 1e-9


def test_edges_of_chosen_bodies_follow_the_others_with_their_owners():
    edges, owner = rays.polygon_edges([rectangle(1.0, 1.0)]), np.full(4, -1)
    square, triangle = rectangle(0.4, 0.4, (3.0, 0.0)), rectangle(0.2, 0.2, (5.0, 0.0))
    placed, corners = np.stack([square, triangle, square + 1.0]), np.array([4, 3, 4])
    chosen = np.array([False, True, True])
    found, owners = rays.with_bodies(edges, owner, placed, corners, chosen)
    wanted = rays.polygon_edges([rectangle(1.0, 1.0), triangle[:3], square + 1.0])
    np.testing.assert_array_equal(found, wanted)
    assert owners.tolist() == [-1] * 4 + [1] * 3 + [2] * 4


def test_turned_rays_are_those_of_a_robot_that_has_turned():
    shapes = scattered(3)
    grid = rays.build_edge_grid(rays.polygon_edges(shapes), np.array([-3.0, -3.0, 3.0, 3.0]))
    nothing = np.zeros((0, 4)), np.zeros(0, dtype=np.int64)
    here, turned = np.array([[0.2, -0.1, 0.7]]), np.array([[0.2, -0.1, 0.7 + 0.3]])
    found = rays.cast_rays(grid, *nothing, here, 7, 10.0, 0.3)
    np.testing.assert_array_equal(found, rays.cast_rays(grid, *nothing, turned, 7, 10.0))
    points = rays.hit_points(here, found, 0.3)
    np.testing.assert_array_equal(points, rays.hit_points(turned, found))


@given(robot=pose, seed=st.integers(0, 50), count=st.integers(1, 13))
def test_rays_hit_the_nearest_outline(robot, seed, count):
    shapes = scattered(seed)
    grid = rays.build_edge_grid(rays.polygon_edges(shapes), np.array([-3.0, -3.0, 3.0, 3.0]))
    nothing = np.zeros((0, 4)), np.zeros(0, dtype=np.int64)
    start = np.array([robot])
    found = rays.cast_rays(grid, *nothing, start, count, 10.0)[0]
    brute = rays.cast_rays(
        rays.build_edge_grid(np.zeros((0, 4)), np.array([-3.0, -3.0, 3.0, 3.0])),
        grid.edges,
        np.full(len(grid.edges), -1),
        start,
        count,
        10.0,
    )[0]
    assert found == pytest.approx(brute, abs=1e-12)
    direction = rays.ray_directions(start[:, 2], count)[0, 0]
    ray = LineString([start[0, :2], start[0, :2] + 10.0 * direction])
    points = [ray.intersection(LineString(np.vstack([s, s[:1]]))) for s in shapes]
    hits = [Point(robot[:2]).distance(p) for p in points if not p.is_empty]
    assert found[0] == pytest.approx(min(hits, default=np.inf), abs=1e-6)
