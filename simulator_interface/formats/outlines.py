"""Shapes to outlines without holes, as walls and furniture want them."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import shapely
from shapely.geometry import MultiPolygon, Polygon, box
from shapely.geometry.base import BaseGeometry
from shapely.geometry.polygon import orient

from mrta_falsify.core.arrays import Array, BoolArray, frozen_array

SMALLEST = 1e-6  # m^2; smaller pieces are rounding
MAX_SPLITS = 20_000  # cuts through holes; a shape that needs more is not a floor


def outlines(shape: BaseGeometry, *, smallest_hole: float = 0.0) -> list[Array]:
    """Cut a shape into simple counter-clockwise outlines ``(V, 2)`` that fill it.

    A part with holes is cut along lines through its holes, so that no piece has one.

    Args:
        shape: anything of shapely's; parts without an area are left out.
        smallest_hole: holes of less area [m^2] are filled.
    """
    found: list[Array] = []
    pending = [_without_small_holes(part, smallest_hole) for part in _parts(shape)][::-1]
    cuts = 0
    while pending:
        part = pending.pop()
        if not part.interiors or cuts == MAX_SPLITS:
            ring = orient(part)
            found.append(frozen_array(np.asarray(ring.exterior.coords)[:-1]))
            continue
        cuts += 1
        pending += reversed(list(_halves(part)))
    return found


def _halves(part: Polygon) -> Iterator[Polygon]:
    """Pieces of a polygon left and right of a line through its middle hole."""
    middles = sorted(0.5 * (ring.bounds[0] + ring.bounds[2]) for ring in part.interiors)
    cut = middles[len(middles) // 2]
    x1, y1, x2, y2 = part.bounds
    for left, right in ((x1 - 1.0, cut), (cut, x2 + 1.0)):
        yield from _parts(part.intersection(box(left, y1 - 1.0, right, y2 + 1.0)))


def _parts(shape: BaseGeometry) -> list[Polygon]:
    if isinstance(shape, Polygon):
        return [shape] if shape.area > SMALLEST else []
    return [part for piece in getattr(shape, "geoms", ()) for part in _parts(piece)]


def _without_small_holes(part: Polygon, smallest: float) -> Polygon:
    if smallest <= 0.0 or not part.interiors:
        return part
    kept = [ring for ring in part.interiors if Polygon(ring).area >= smallest]
    return Polygon(part.exterior, kept)


def merged_runs(cells: BoolArray) -> list[tuple[int, int, int, int]]:
    """Cover the true cells of ``(rows, cols)`` once with rectangles.

    Returns:
        (left, right, low, high) column and row numbers, ends excluded: runs of cells that
        consecutive rows have in common.
    """
    padded = np.pad(cells, ((0, 0), (1, 1))).astype(np.int8)
    steps = np.diff(padded, axis=1)
    open_runs: dict[tuple[int, int], int] = {}
    found: list[tuple[int, int, int, int]] = []
    for row in range(len(cells) + 1):
        runs: set[tuple[int, int]] = set()
        if row < len(cells):
            starts, ends = np.flatnonzero(steps[row] > 0), np.flatnonzero(steps[row] < 0)
            runs = set(zip(starts.tolist(), ends.tolist(), strict=True))
        for run in sorted(set(open_runs) - runs):
            found.append((*run, open_runs.pop(run), row))
        for run in runs:
            open_runs.setdefault(run, row)
    return found


def mask_outlines(
    cells: BoolArray, *, resolution: float, origin: Array, smallest_hole: float = 0.0
) -> list[Array]:
    """Outline the true cells of a grid.

    Args:
        cells: ``(rows, cols)``, row 0 southernmost.
        resolution: cell size [m].
        origin: ``(2,)`` south-west corner [m].
        smallest_hole: holes of less area [m^2] are filled.

    Returns:
        Simple outlines ``(V, 2)`` [m]. Every true cell meets one of them; staircases are
        straightened by at most half a cell. They keep a hair off the grid lines, so that
        on the same grid they do not touch the cells beside them.
    """
    runs = np.array(merged_runs(cells), dtype=np.float64).reshape(-1, 4)
    if not len(runs):
        return []
    shape = shapely.union_all(shapely.box(runs[:, 0], runs[:, 2], runs[:, 1], runs[:, 3]))
    area = resolution * resolution
    parts = [_without_small_holes(part, smallest_hole / area) for part in _parts(shape)]
    slim = shapely.simplify(MultiPolygon(parts), 0.5)
    slim = shapely.buffer(slim, -0.02, join_style="mitre", mitre_limit=2.0)
    return [frozen_array(ring * resolution + origin) for ring in outlines(slim)]
