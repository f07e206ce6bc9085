"""What of a map is solid: outlines as walls, and what looks like noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from scipy import ndimage
from shapely.geometry import Polygon
from shapely.geometry.base import BaseGeometry

from mrta_falsify.core.arrays import Array, BoolArray, IntArray, frozen_array
from mrta_falsify.core.world import Wall
from simulator_interface.formats.nav2 import OCCUPIED_THRESH, OccupancyGrid
from simulator_interface.formats.outlines import mask_outlines, outlines

SMALLEST_POCKET = 0.15  # m^2, the disc of a robot with a radius of 0.22 m
SPECK = 0.02  # m^2; below 8 cells of 0.05 m: the leg of a table, or noise of the mapping
SHOWN_SPECKS = 3
_TOUCHING = ndimage.generate_binary_structure(2, 2)  # also across corners


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MapFacts:
    """What a user should know about a map before robots drive on it."""

    rows: int
    cols: int
    resolution: float  #: [m]
    yaw: float  #: [rad]
    free: float  #: share of the cells
    unknown: float  #: share of the cells
    specks: int  #: solid patches below ``SPECK``, apart from everything else
    left_out: int  #: solid patches that were left out as smaller than the file's ``specks``
    speck_places: Array  #: (K, 2) [m] of the first of them, K <= 3
    doubtful: int  #: free cells as grey as those that Nav2's saver writes for unknown ones


def solid_cells(
    grid: OccupancyGrid, *, unknown_is_solid: bool = True, least_patch: float = 0.0
) -> BoolArray:
    """Mark the cells ``(rows, cols)`` that robots keep out of.

    Args:
        grid: the map; a value above ``OCCUPIED_THRESH`` is occupied.
        unknown_is_solid: whether robots keep out of what the map does not know.
        least_patch: patches of less area [m^2] are left out.
    """
    solid = grid.data > 100.0 * OCCUPIED_THRESH
    if unknown_is_solid:
        solid = solid | (grid.data < 0)
    if least_patch <= 0.0:
        return solid
    patches, sizes = _patches(solid)
    is_kept = sizes * grid.resolution**2 >= least_patch
    is_kept[0] = False
    return np.asarray(is_kept[patches])


def walls_of_map(
    grid: OccupancyGrid, *, unknown_is_solid: bool = True, least_patch: float = 0.0
) -> tuple[Wall, ...]:
    """Trace the occupied cells of a map as walls.

    Args:
        grid: the map.
        unknown_is_solid: as :func:`solid_cells`.
        least_patch: as :func:`solid_cells`.

    Returns:
        Walls marked ``traced``; on a costmap with the map's cells exactly the occupied cells
        are lethal, apart from staircases (straightened by half a cell) and closed pockets
        that no robot fits into (filled). What a turned map leaves of the box around it is
        solid.
    """
    solid = solid_cells(grid, unknown_is_solid=unknown_is_solid, least_patch=least_patch)
    rings = mask_outlines(
        solid, resolution=grid.resolution, origin=np.zeros(2), smallest_hole=SMALLEST_POCKET
    )
    rings = [_placed(grid, ring) for ring in rings]
    if grid.yaw:
        corners = map_corners(grid)
        around = shapely.box(*corners.min(axis=0), *corners.max(axis=0))
        rings += outlines(_outside(around, corners))
    return tuple(Wall(name=f"map_{i}", polygon=ring, traced=True) for i, ring in enumerate(rings))


def map_corners(grid: OccupancyGrid) -> Array:
    """Find the corners ``(4, 2)`` [m] of a map."""
    width, depth = np.array(grid.data.shape[::-1]) * grid.resolution
    return _placed(grid, np.array([[0, 0], [width, 0], [width, depth], [0, depth]]))


def describe_map(
    grid: OccupancyGrid, *, unknown_is_solid: bool = True, least_patch: float = 0.0
) -> MapFacts:
    """Count what of a map is free, unknown, or looks like noise."""
    patches, sizes = _patches(solid_cells(grid, unknown_is_solid=unknown_is_solid))
    area = sizes * grid.resolution**2
    is_left_out = area < least_patch
    is_speck = (area < SPECK) & ~is_left_out
    is_left_out[0] = is_speck[0] = False
    numbers = np.flatnonzero(is_speck)
    places = ndimage.center_of_mass(np.ones_like(patches), patches, numbers[:SHOWN_SPECKS])
    centres = (np.array(places).reshape(-1, 2)[:, ::-1] + 0.5) * grid.resolution
    rows, cols = grid.data.shape
    return MapFacts(
        rows=rows,
        cols=cols,
        resolution=grid.resolution,
        yaw=grid.yaw,
        free=float((grid.data == 0).mean()),
        unknown=float((grid.data < 0).mean()),
        specks=len(numbers),
        left_out=int(is_left_out.sum()),
        speck_places=_placed(grid, centres),
        doubtful=grid.doubtful,
    )


def _patches(solid: BoolArray) -> tuple[IntArray, IntArray]:
    """Number ``(rows, cols)`` the connected patches of solid cells, and count their cells."""
    patches = np.asarray(ndimage.label(solid, structure=_TOUCHING)[0], dtype=np.int64)
    return patches, np.bincount(patches.ravel())


def _placed(grid: OccupancyGrid, points: Array) -> Array:
    """Move points ``(K, 2)`` [m] from the map's lower left corner to the map frame."""
    turned = points
    if grid.yaw:
        cos, sin = np.cos(grid.yaw), np.sin(grid.yaw)
        turned = points @ np.array([[cos, sin], [-sin, cos]])
    return frozen_array(turned + grid.origin)


def _outside(around: BaseGeometry, corners: Array) -> BaseGeometry:
    """Cut the turned map out of the box around it, without slivers at its corners."""
    rest: BaseGeometry = around.difference(Polygon(corners))
    return rest.buffer(-1e-4, join_style="mitre").buffer(1e-4, join_style="mitre")
