"""The AWS hospital floor against its map, its published data and an independent geometry."""

from __future__ import annotations

import itertools
import json
from pathlib import Path

import fcl
import numpy as np
import pytest
import shapely
import trimesh
from scipy import ndimage

from mrta_falsify.core import codec
from mrta_falsify.core.arrays import Array, BoolArray
from mrta_falsify.core.errors import UnknownNameError
from mrta_falsify.core.geometry import signed_area
from mrta_falsify.core.world import World
from scenic_worlds.layouts import layout_names, load_layout, load_world, world_names
from tools.map_overlay import (
    MAP_ORIGIN,
    MAP_RESOLUTION,
    cell_centres,
    draw_overlay,
    overlay_scores,
    read_shipped_map,
    solid_area,
)

ROBOT_RADIUS = 0.22  # m
PUBLISHED = Path(__file__).resolve().parents[3] / "shared" / "data" / "aws_hospital"
needs_sources = pytest.mark.skipif(not PUBLISHED.exists(), reason="published sources are not here")

PAIRS = list(itertools.permutations(range(6), 2))
NARROWEST = 0.35  # m, clearance of every straight leg of the repaired lanes
CORRIDOR_WIDTH = 2.88  # m
LEFT_OVER = 0.002  # share of occupied cells that nothing explains: lidar speckle


@pytest.fixture(scope="module")
def hospital() -> World:
    return load_layout("aws_hospital")


@pytest.fixture(scope="module")
def published() -> World:
    return load_layout("aws_hospital_as_published")


@pytest.fixture(scope="module")
def solid(hospital: World) -> shapely.Geometry:
    area = solid_area(shape.polygon for shape in (*hospital.walls, *hospital.furniture))
    shapely.prepare(area)
    return area


def legs(world: World) -> list[tuple[int, int, str, Array, Array]]:
    """Straight legs of all lanes from the start room's point on."""
    found = []
    for lane in world.lanes:
        for way, points in (("to_queue", lane.to_queue), ("to_room", lane.to_room)):
            line = np.vstack([world.rooms[lane.start].point, points])
            found += [(lane.start, lane.end, way, a, b) for a, b in itertools.pairwise(line)]
    return found


def free_regions(world: World, solid: shapely.Geometry, radius: float) -> BoolArray:
    """Labels of the connected free cells of a 0.05 m raster for a disc of ``radius`` [m]."""
    x_min, y_min, x_max, y_max = world.bounds
    half = MAP_RESOLUTION / 2
    xs, ys = np.meshgrid(
        np.arange(x_min + half, x_max, MAP_RESOLUTION),
        np.arange(y_min + half, y_max, MAP_RESOLUTION),
    )
    free = ~shapely.dwithin(solid, shapely.points(xs, ys), radius)
    labels, _ = ndimage.label(free)
    return labels


def labels_at(points: Array, labels: BoolArray, world: World) -> Array:
    cells = ((points - world.bounds[:2]) / MAP_RESOLUTION).astype(int)
    return labels[cells[:, 1], cells[:, 0]]


# --- loading ----------------------------------------------------------------------------


@pytest.mark.parametrize("name", layout_names())
def test_layout_holds_no_actors_and_survives_the_codec(name: str) -> None:
    layout = load_layout(name)
    assert layout.name == name
    assert layout.robots + layout.humans + layout.tasks + layout.events == ()
    again = codec.decode(World, json.loads(codec.canonical_json(layout)))
    assert again.digest() == layout.digest()


def test_unknown_names_are_answered_with_the_nearest() -> None:
    with pytest.raises(UnknownNameError, match="did you mean 'aws_hospital'"):
        load_layout("aws_hospitl")
    with pytest.raises(UnknownNameError, match="aws_hospital_day"):
        load_world("aws_hospital_da")


def test_hospital_day_has_the_published_actors() -> None:
    assert world_names() == ("aws_hospital_day",)
    day = load_world("aws_hospital_day")
    assert [robot.name for robot in day.robots] == [f"robot{k}" for k in range(1, 7)]
    for robot, room in zip(day.robots, day.rooms, strict=True):
        assert robot.pose[:2] == pytest.approx(room.point)
    assert len(day.humans) == 8
    assert sum(not human.reacts_to_robots for human in day.humans) == 3
    assert [(t.arrival, t.start, t.end, t.deadline) for t in day.tasks] == [
        (0.0, 1, 4, 200.0),
        (0.0, 2, 5, 200.0),
        (0.0, 5, 3, 250.0),
        (180.0, 5, 0, 600.0),
        (180.0, 0, 4, 500.0),
        (180.0, 3, 1, 700.0),
    ]
    assert day.horizon == 900.0
    assert day.events == ()


def test_package_data_stays_small() -> None:
    folder = Path(__file__).resolve().parents[2] / "scenic_worlds" / "layouts"
    assert (folder / "aws_hospital.json").stat().st_size < 600_000


# --- shapes -----------------------------------------------------------------------------


def test_every_outline_is_simple_counter_clockwise_and_convex(hospital: World) -> None:
    for shape in (*hospital.walls, *hospital.furniture):
        polygon = shapely.Polygon(shape.polygon)
        assert polygon.is_valid, shape.name
        assert signed_area(shape.polygon) > 0.0, shape.name
        assert polygon.convex_hull.area == pytest.approx(polygon.area, abs=2e-4), shape.name


def test_outlines_have_few_corners(hospital: World) -> None:
    assert sum(len(s.polygon) for s in (*hospital.walls, *hospital.furniture)) < 3000


def test_no_wall_is_traced_and_nothing_hangs(hospital: World) -> None:
    assert not any(wall.traced for wall in hospital.walls)
    assert not any(item.kind in {"picture", "carpet", "tv"} for item in hospital.furniture)


def test_layout_explains_the_map(hospital: World) -> None:
    scores = overlay_scores(hospital, read_shipped_map(), MAP_RESOLUTION, MAP_ORIGIN)
    assert 0.68 < scores.cells_near_walls < 0.71  # measured elsewhere: 69 %
    assert scores.cells_near_shapes >= 0.86
    assert scores.cells_near_all >= 1.0 - LEFT_OVER
    assert scores.outline_near_cells >= 0.88


def test_a_shifted_map_scores_worse(hospital: World) -> None:
    shifted = overlay_scores(hospital, read_shipped_map(), MAP_RESOLUTION, MAP_ORIGIN + 0.4)
    assert shifted.cells_near_shapes < 0.6
    assert shifted.outline_near_cells < 0.6


@needs_sources
def test_shipped_map_is_the_published_one() -> None:
    from PIL import Image

    pixels = np.asarray(Image.open(PUBLISHED / "my_map.pgm"))
    assert np.array_equal(read_shipped_map(), pixels[::-1] == 0)


@pytest.mark.slow
def test_picture_is_written(hospital: World, tmp_path: Path) -> None:
    path = tmp_path / "overlay.png"
    window = np.array([-7.0, -4.0, 7.0, 7.0])
    draw_overlay(hospital, read_shipped_map(), MAP_RESOLUTION, MAP_ORIGIN, path, window=window)
    assert path.stat().st_size > 10_000


# --- fcl as the second opinion ----------------------------------------------------------


def extruded_floor(world: World) -> list[fcl.CollisionObject]:
    """Every footprint as a convex prism, meshed by trimesh."""
    prisms = []
    for shape in (*world.walls, *world.furniture):
        mesh = trimesh.creation.extrude_polygon(shapely.Polygon(shape.polygon), 1.0)
        sizes = np.full((len(mesh.faces), 1), 3)
        faces = np.hstack([sizes, mesh.faces]).ravel()
        prisms.append(fcl.CollisionObject(fcl.Convex(mesh.vertices, len(mesh.faces), faces)))
    return prisms


def test_fcl_agrees_with_the_footprints(hospital: World, solid: shapely.Geometry) -> None:
    manager = fcl.DynamicAABBTreeCollisionManager()
    manager.registerObjects(extruded_floor(hospital))
    manager.setup()
    rng = np.random.default_rng(7)
    low, high = hospital.bounds[:2], hospital.bounds[2:]
    named = [
        *(room.point for room in hospital.rooms),
        *(spot for resource in hospital.resources for spot in resource.spots),
        *hospital.parking,
        *(point for lane in hospital.lanes for point in (*lane.to_queue, *lane.to_room)),
    ]
    discs = [(point, ROBOT_RADIUS) for point in named]
    discs += [(rng.uniform(low, high), rng.uniform(0.1, 0.5)) for _ in range(2000)]
    collisions = 0
    for point, radius in discs:
        gap = float(shapely.distance(solid, shapely.Point(point))) - radius
        if abs(gap) < 2e-3:  # fcl works to about a millimetre
            continue
        body = fcl.CollisionObject(fcl.Cylinder(radius, 0.4), fcl.Transform([*point, 0.5]))
        answer = fcl.CollisionData()
        manager.collide(body, answer, fcl.defaultCollisionCallback)
        assert answer.result.is_collision == (gap < 0.0), (point, radius, gap)
        collisions += answer.result.is_collision
    assert collisions > 200


# --- roads ------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["aws_hospital", "aws_hospital_as_published"])
def test_all_ordered_pairs_of_rooms_have_one_lane(name: str) -> None:
    assert [(lane.start, lane.end) for lane in load_layout(name).lanes] == PAIRS


def test_lanes_end_at_the_tail_spot_and_at_the_room(hospital: World) -> None:
    for lane in hospital.lanes:
        assert lane.to_queue[-1] == pytest.approx(hospital.resources[lane.end].spots[-1])
        assert lane.to_room[-1] == pytest.approx(hospital.rooms[lane.end].point)


def test_entries_lead_to_the_room(hospital: World) -> None:
    for resource, room in zip(hospital.resources, hospital.rooms, strict=True):
        assert resource.entry[-1] == pytest.approx(room.point)


def test_every_place_can_be_reached_from_every_other(
    hospital: World, solid: shapely.Geometry
) -> None:
    labels = free_regions(hospital, solid, ROBOT_RADIUS)
    places = np.vstack(
        [
            [room.point for room in hospital.rooms],
            *[resource.spots for resource in hospital.resources],
            *[resource.entry for resource in hospital.resources],
            hospital.parking,
            *[lane.to_queue for lane in hospital.lanes],
            *[lane.to_room for lane in hospital.lanes],
        ]
    )
    found = labels_at(places, labels, hospital)
    assert len(np.unique(found)) == 1
    assert found[0] != 0


def test_straight_legs_are_clear_of_walls_and_furniture(
    hospital: World, solid: shapely.Geometry
) -> None:
    for start, end, way, a, b in legs(hospital):
        clearance = shapely.distance(solid, shapely.LineString([a, b]))
        assert clearance >= NARROWEST, (start, end, way, a, b, clearance)


def test_straight_legs_are_clear_of_the_map_itself(hospital: World) -> None:
    centres = cell_centres(read_shipped_map(), MAP_RESOLUTION, MAP_ORIGIN)
    cells = shapely.multipoints(centres)
    for start, end, way, a, b in legs(hospital):
        clearance = shapely.distance(cells, shapely.LineString([a, b])) - MAP_RESOLUTION / 2
        assert clearance >= 0.30, (start, end, way, a, b, clearance)


def test_entry_and_queue_legs_are_clear(hospital: World, solid: shapely.Geometry) -> None:
    for resource in hospital.resources:
        inside = shapely.LineString(np.vstack([resource.spots[0], resource.entry]))
        assert shapely.distance(solid, inside) >= 0.6, resource.name
        assert shapely.distance(solid, shapely.LineString(resource.spots)) >= 0.6, resource.name


def test_spots_stand_apart_and_out_of_every_lane(hospital: World) -> None:
    spots = np.vstack([resource.spots for resource in hospital.resources])
    gaps = np.linalg.norm(spots[:, None] - spots[None], axis=2)
    assert gaps[~np.eye(len(spots), dtype=bool)].min() >= 0.9
    for resource in hospital.resources:
        assert len(resource.spots) == 5
        for start, end, way, a, b in legs(hospital):
            joins = way == "to_queue" and end == resource.room
            if joins and np.allclose(b, resource.spots[-1]):
                continue  # the last leg is the way onto the tail spot
            gap = shapely.distance(shapely.LineString([a, b]), shapely.multipoints(resource.spots))
            assert gap >= 0.69, (resource.name, start, end, way, a, b, gap)


def test_the_way_onto_the_tail_spot_passes_no_other_spot(hospital: World) -> None:
    for lane in hospital.lanes:
        others = shapely.multipoints(hospital.resources[lane.end].spots[:-1])
        assert shapely.distance(shapely.LineString(lane.to_queue[-2:]), others) >= 0.69


def test_leaving_robots_keep_clear_of_the_head_spot(hospital: World) -> None:
    for start, end, way, a, b in legs(hospital):
        head = shapely.Point(hospital.resources[start].spots[0])
        gap = shapely.distance(shapely.LineString([a, b]), head)
        assert gap >= 0.75, (start, end, way, a, b, gap)


def test_opposite_lanes_keep_apart_on_long_legs(hospital: World) -> None:
    long_legs = [(a, b) for *_, a, b in legs(hospital) if np.linalg.norm(b - a) > 3.0]
    for (a, b), (c, d) in itertools.combinations(long_legs, 2):
        ahead = (b - a) / np.linalg.norm(b - a)
        back = (d - c) / np.linalg.norm(d - c)
        if ahead @ back > -0.99:
            continue
        low, high = sorted([float((c - a) @ ahead), float((d - a) @ ahead)])
        if min(high, np.linalg.norm(b - a)) - max(low, 0.0) < 0.5:
            continue  # they do not run side by side
        offset = float((c - a) @ np.array([-ahead[1], ahead[0]]))
        if abs(offset) < CORRIDOR_WIDTH:
            assert offset >= 0.75, (a, b, c, d)  # the opposite lane lies on the left


def test_robots_ask_inside_the_published_box_and_before_they_turn_off_to_the_tail(
    hospital: World,
) -> None:
    for resource, room in zip(hospital.resources, hospital.rooms, strict=True):
        box = shapely.Polygon(resource.request_area).buffer(1e-3)
        assert box.covers(shapely.box(*(room.point - 5.0), *(room.point + 5.0)))
        for lane in hospital.lanes:
            if lane.end == resource.room:
                assert box.covers(shapely.Point(lane.to_queue[-2]))
        assert all(box.covers(shapely.Point(spot)) for spot in resource.spots), resource.name


def test_release_area_holds_the_entry_but_no_waiting_or_parked_robot(hospital: World) -> None:
    for resource, room in zip(hospital.resources, hospital.rooms, strict=True):
        area = shapely.Polygon(resource.release_area)
        assert area.is_valid
        assert area.covers(shapely.Point(room.point))
        assert area.covers(shapely.Polygon(room.area).buffer(-0.01)), resource.name
        for other in hospital.resources:
            for spot in other.spots:
                assert area.distance(shapely.Point(spot)) >= 0.3, resource.name
        for spot in hospital.parking:
            assert area.distance(shapely.Point(spot)) >= 0.45, resource.name


def test_a_robot_that_let_go_stands_clear_of_the_entry(hospital: World) -> None:
    for lane in hospital.lanes:
        resource = hospital.resources[lane.start]
        entry = shapely.LineString(np.vstack([resource.spots[0], resource.entry]))
        way = shapely.LineString(np.vstack([hospital.rooms[lane.start].point, lane.to_room]))
        outside = way.difference(shapely.Polygon(resource.release_area))
        assert outside.distance(entry) >= 0.55, (lane.start, lane.end)


def test_parking_is_out_of_the_way(hospital: World, solid: shapely.Geometry) -> None:
    lanes = shapely.union_all([shapely.LineString([a, b]) for *_, a, b in legs(hospital)])
    spots = np.vstack([resource.spots for resource in hospital.resources])
    assert len(hospital.parking) >= 8
    for k, place in enumerate(hospital.parking):
        assert lanes.distance(shapely.Point(place)) >= 1.0
        assert solid.distance(shapely.Point(place)) >= 0.38
        assert np.linalg.norm(spots - place, axis=1).min() >= 1.0
        others = np.delete(hospital.parking, k, axis=0)
        assert np.linalg.norm(others - place, axis=1).min() >= 1.0
        for room in hospital.rooms:
            if len(room.door):
                assert shapely.LineString(room.door).distance(shapely.Point(place)) >= 1.0
            assert not shapely.Polygon(room.area).covers(shapely.Point(place))


def test_doors_span_the_gap_between_the_jambs(hospital: World, solid: shapely.Geometry) -> None:
    for number, room in enumerate(hospital.rooms):
        if number == 0:
            assert len(room.door) == 0  # an open counter
            continue
        middle = shapely.Point(room.door.mean(axis=0))
        assert solid.distance(middle) == pytest.approx(
            np.linalg.norm(room.door[1] - room.door[0]) / 2, abs=0.03
        )


# --- faithful copy ----------------------------------------------------------------------


@needs_sources
def test_as_published_is_a_faithful_copy(published: World) -> None:
    source = json.loads((PUBLISHED / "locations_roadways_queues.json").read_text())
    assert published.travel_times.tolist() == source["travel_time_s"]
    for lane in published.lanes:
        key = f"{lane.start}->{lane.end}"
        assert np.array_equal(lane.to_queue, source["roadways_to_queue"][key])
        assert np.array_equal(lane.to_room, source["roadways_to_room"][key])
    for number, resource in enumerate(published.resources):
        assert published.rooms[number].point.tolist() == source["locations"][str(number)]
        assert np.array_equal(resource.spots, source["queue_positions"][str(number)])
        assert np.array_equal(resource.entry, source["queue_to_room"][str(number)])
        assert np.array_equal(resource.release_area, resource.request_area)


def test_both_layouts_share_the_building(hospital: World, published: World) -> None:
    assert codec.digest(hospital.walls) == codec.digest(published.walls)
    assert codec.digest(hospital.furniture) == codec.digest(published.furniture)
    assert codec.digest(hospital.rooms) == codec.digest(published.rooms)
    assert np.array_equal(hospital.parking, published.parking)


def test_published_roadways_need_the_repair(published: World) -> None:
    """39 of 354 legs pass within the robot's radius of an occupied cell: measured elsewhere."""
    cells = shapely.multipoints(cell_centres(read_shipped_map(), MAP_RESOLUTION, MAP_ORIGIN))
    reach = ROBOT_RADIUS + MAP_RESOLUTION / 2
    found = [shapely.LineString([a, b]).distance(cells) < reach for *_, a, b in legs(published)]
    assert (sum(found), len(found)) == (39, 354)


@needs_sources
@pytest.mark.slow
def test_the_build_script_reproduces_the_shipped_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import importlib.util
    import sys

    root = Path(__file__).resolve().parents[2]
    spec = importlib.util.spec_from_file_location(
        "build_aws_hospital", root / "tools" / "build_aws_hospital.py"
    )
    assert spec is not None and spec.loader is not None  # noqa: PT018
    script = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, spec.name, script)
    spec.loader.exec_module(script)
    monkeypatch.setattr(script, "OUT", tmp_path)
    script.main(PUBLISHED.parent)
    for file in sorted(tmp_path.iterdir()):
        shipped = root / "scenic_worlds" / "layouts" / file.name
        assert file.read_bytes() == shipped.read_bytes(), file.name
