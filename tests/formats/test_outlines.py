import numpy as np
from hypothesis import given, settings
from hypothesis.extra import numpy as arrays
from shapely import union_all
from shapely.geometry import Point, Polygon, box

from mrta_falsify.core.world import World
from simulator_interface.costmap_layers import build_costmap
from simulator_interface.formats.map_walls import walls_of_map
from simulator_interface.formats.nav2 import OccupancyGrid
from simulator_interface.formats.outlines import mask_outlines, merged_runs, outlines

masks = arrays.arrays(np.bool_, arrays.array_shapes(min_dims=2, max_dims=2, max_side=12))


@given(masks)
def test_merged_runs_cover_every_true_cell_once(cells):
    covered = np.zeros(cells.shape, dtype=int)
    for left, right, low, high in merged_runs(cells):
        covered[low:high, left:right] += 1
    assert np.array_equal(covered, cells.astype(int))


@settings(max_examples=30)
@given(masks)
def test_outlines_of_a_mask_meet_every_cell_and_have_no_holes(cells):
    rings = mask_outlines(cells, resolution=0.5, origin=np.array([-1.0, 2.0]))
    solid = union_all([Polygon(ring) for ring in rings])
    for row, col in np.argwhere(cells):
        x, y = -1.0 + 0.5 * col, 2.0 + 0.5 * row
        assert solid.intersects(box(x, y, x + 0.5, y + 0.5))
    assert all(Polygon(ring).exterior.is_ccw for ring in rings)
    assert abs(solid.area - 0.25 * cells.sum()) <= 0.13 * cells.sum() + 1e-9


def test_a_shape_with_holes_is_cut_into_pieces_without():
    ring = box(0, 0, 10, 6).difference(box(1, 1, 3, 3)).difference(box(5, 2, 8, 5))
    pieces = outlines(ring)
    assert len(pieces) > 1
    assert union_all([Polygon(piece) for piece in pieces]).symmetric_difference(ring).area < 1e-9
    assert sum(Polygon(piece).area for piece in pieces) - ring.area < 1e-9


def test_small_holes_are_filled_on_request():
    ring = box(0, 0, 4, 4).difference(Point(2, 2).buffer(0.2))
    assert len(outlines(ring, smallest_hole=0.2)) == 1
    assert len(outlines(ring, smallest_hole=0.1)) > 1


def test_occupied_cells_of_a_map_are_the_lethal_cells_of_its_floor():
    data = np.zeros((40, 60), dtype=np.int8)
    data[[0, -1]] = 100
    data[:, [0, -1]] = 100
    data[10:30, 20:22] = 100
    data[5, 40] = -1
    grid = OccupancyGrid(data=data, resolution=0.1, origin=np.array([-2.0, 1.0]))
    for unknown_is_solid in (True, False):
        walls = walls_of_map(grid, unknown_is_solid=unknown_is_solid)
        world = World(name="map", bounds=np.array([-2.0, 1.0, 4.0, 5.0]), walls=walls)
        costmap = build_costmap(world)
        lethal = (costmap.cost == 254).reshape(40, 2, 60, 2).any(axis=(1, 3))
        assert np.array_equal(lethal, (data > 65) | (unknown_is_solid & (data < 0)))
        assert all(wall.traced for wall in walls)
