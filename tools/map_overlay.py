"""How well a layout agrees with an occupancy map, as numbers and as a picture.

Shapes marked ``traced`` were outlined from the map itself; they are left out of the scores.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from importlib import resources
from pathlib import Path

import numpy as np
import shapely
from PIL import Image
from scipy.spatial import cKDTree

from mrta_falsify.core.arrays import Array, BoolArray, frozen_array
from mrta_falsify.core.world import Furniture, Wall, World
from reports.floor_plot import paint_floor, set_extent
from reports.floor_scene import Extent, Role, floor_scene
from reports.paper import DPI, Paper
from tools.draw_layout import draw_release_areas

#: of the AWS hospital map shipped with the layout, as in its my_map.yaml
MAP_RESOLUTION = 0.05  # m
MAP_ORIGIN = frozen_array([-12.5, -35.0])  # m, lower left corner

OUTLINE_STEP = 0.05  # m between samples of an outline


@dataclass(frozen=True, slots=True, kw_only=True)
class OverlayScores:
    """Agreement of a layout with an occupancy map; every share lies in [0, 1]."""

    cells_near_walls: float  #: occupied cells near a wall
    cells_near_shapes: float  #: occupied cells near a wall or a piece of furniture, not traced
    cells_near_all: float  #: occupied cells near any shape, traced ones included
    outline_near_cells: float  #: length of wall outline near an occupied cell


def read_shipped_map() -> BoolArray:
    """Occupied cells ``(1119, 500)`` of the AWS hospital map, row 0 at y = -35 m."""
    file = resources.files("scenic_worlds.layouts") / "aws_hospital_map.png"
    with file.open("rb") as stream:
        pixels = np.asarray(Image.open(stream).convert("L"))
    return np.asarray(pixels[::-1] == 0)


def cell_centres(occupied: BoolArray, resolution: float, origin: Array) -> Array:
    """Centres ``(C, 2)`` [m] of the occupied cells of a mask with row 0 at the bottom."""
    rows, columns = np.nonzero(occupied)
    cells = np.stack([columns, rows], axis=1).astype(np.float64)
    return (cells + 0.5) * resolution + origin


def solid_area(outlines: Iterable[Array]) -> shapely.Geometry:
    """Union of the polygons with outlines ``(V, 2)`` [m]; empty if there are none."""
    return shapely.union_all([shapely.Polygon(outline) for outline in outlines])


def overlay_scores(
    world: World,
    occupied: BoolArray,
    resolution: float,
    origin: Array,
    *,
    tolerance: float = 0.15,
) -> OverlayScores:
    """Compare the shapes of ``world`` with the occupied cells of a map.

    Args:
        world: walls and furniture are compared, events are not.
        occupied: ``(rows, columns)``, row 0 at the bottom; at least one cell.
        resolution: cell size [m].
        origin: ``(2,)`` lower left corner of the mask [m].
        tolerance: two things this near [m] agree.
    """
    walls = solid_area(wall.polygon for wall in world.walls if not wall.traced)
    furniture = solid_area(item.polygon for item in world.furniture if not item.traced)
    shapes: tuple[Wall | Furniture, ...] = (*world.walls, *world.furniture)
    traced = solid_area(shape.polygon for shape in shapes if shape.traced)
    centres = cell_centres(occupied, resolution, origin)
    near_walls = _is_near(centres, walls, tolerance)
    near_shapes = near_walls | _is_near(centres, furniture, tolerance)
    near_all = near_shapes | _is_near(centres, traced, tolerance)
    outline = shapely.get_coordinates(shapely.segmentize(walls.boundary, OUTLINE_STEP))
    distances, _ = cKDTree(centres).query(outline)
    return OverlayScores(
        cells_near_walls=float(near_walls.mean()),
        cells_near_shapes=float(near_shapes.mean()),
        cells_near_all=float(near_all.mean()),
        outline_near_cells=float((distances <= tolerance).mean()),
    )


def _is_near(points: Array, area: shapely.Geometry, tolerance: float) -> BoolArray:
    if area.is_empty:
        return np.zeros(len(points), dtype=bool)
    shapely.prepare(area)
    return np.asarray(shapely.dwithin(area, shapely.points(points), tolerance))


def draw_overlay(
    world: World,
    occupied: BoolArray,
    resolution: float,
    origin: Array,
    path: Path,
    *,
    window: Array | None = None,
    scale: float = 42.0,
) -> None:
    """Write a picture of the map's cells with everything the layout says about the floor.

    Args:
        world: the layout to draw.
        occupied: ``(rows, columns)``, row 0 at the bottom.
        resolution: cell size [m].
        origin: ``(2,)`` lower left corner of the mask [m].
        path: PNG file to write.
        window: ``(4,)`` x min, y min, x max, y max [m]; the world's bounds if not given.
        scale: pixels per metre.
    """
    extent = Extent(*map(float, world.bounds if window is None else window))
    paper = Paper.of_size(extent.width * scale / DPI, extent.height * scale / DPI)
    axes = paper.axes_at(0.0, 0.0, paper.width, paper.height)
    (x, y), (height, width) = origin, occupied.shape
    cells = (x, x + width * resolution, y, y + height * resolution)
    axes.imshow(occupied, cmap="gray_r", origin="lower", extent=cells, interpolation="nearest")
    for wall in world.walls:
        axes.fill(*wall.polygon.T, facecolor="#4a7fb540", edgecolor="#1d4e89", lw=0.8)
    for item in world.furniture:
        face, edge = ("#d9534f40", "#b52b27") if item.traced else ("#f0ad4e50", "#b5761d")
        axes.fill(*item.polygon.T, facecolor=face, edgecolor=edge, lw=0.8)
    # solids are transparent here, so that the cells below can be seen
    paint_floor(axes, (s for s in floor_scene(world) if s.role not in (Role.WALL, Role.FURNITURE)))
    draw_release_areas(axes, world)
    set_extent(axes, extent)
    paper.save(path)
