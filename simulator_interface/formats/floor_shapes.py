"""Shapes of a floor file as walls and furniture."""

from __future__ import annotations

import shapely
from shapely.geometry import LineString, Polygon

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.errors import FormatError
from mrta_falsify.core.world import Furniture, Wall
from simulator_interface.formats.floor_fields import FloorShape
from simulator_interface.formats.outlines import outlines

MAX_SHAPES = 50_000  # of one kind in one file


def walls_of_shapes(entries: tuple[FloorShape, ...], where: str) -> list[Wall]:
    """Read walls from a floor file's entries; ``where`` begins the errors' messages.

    Raises:
        FormatError: an entry is not a shape.
    """
    return [
        Wall(name=entry.name, polygon=ring, height=entry.height)
        for entry, ring in _rings(entries, f"{where}: walls")
    ]


def furniture_of_shapes(entries: tuple[FloorShape, ...], where: str) -> list[Furniture]:
    """Read furniture from a floor file's entries, as :func:`walls_of_shapes`."""
    return [
        Furniture(name=entry.name, kind=entry.kind, polygon=ring, height=entry.height)
        for entry, ring in _rings(entries, f"{where}: furniture")
    ]


def _rings(entries: tuple[FloorShape, ...], where: str) -> list[tuple[FloorShape, Array]]:
    if len(entries) > MAX_SHAPES:
        raise FormatError(f"{where} has {len(entries)} entries; at most {MAX_SHAPES}")
    found = []
    for i, entry in enumerate(entries):
        found += [(entry, ring) for ring in outlines(_shape(entry, f"{where}[{i}]"))]
    return found


def _shape(entry: FloorShape, where: str) -> Polygon:
    given = [name for name in ("line", "polygon", "box") if len(getattr(entry, name))]
    if len(given) != 1:
        names = " and ".join(given) if given else "none of them"
        raise FormatError(f"{where} has {names}; it must have one of line, polygon and box")
    if given == ["line"]:
        if len(entry.line) < 2:
            raise FormatError(f"{where}.line has one point; a wall needs at least two")
        half = entry.thickness / 2.0
        return LineString(entry.line).buffer(half, cap_style="square", join_style="mitre")
    if given == ["box"]:
        if len(entry.box) != 4 or not (entry.box[:2] < entry.box[2:]).all():
            raise FormatError(
                f"{where}.box is {entry.box.tolist()} m; it must be [x min, y min, x max, y max]"
            )
        return shapely.box(*entry.box.tolist())
    return checked_polygon(entry.polygon, f"{where}.polygon")


def checked_polygon(points: Array, where: str) -> Polygon:
    """Make the polygon with corners ``(V, 2)`` [m].

    Raises:
        FormatError: it crosses itself or has no area.
    """
    if len(points) < 3:
        raise FormatError(f"{where} has {len(points)} corners; it needs at least 3")
    shape = Polygon(points)
    if not shape.is_valid or shape.area <= 0.0:
        raise FormatError(
            f"{where} is {_short(points)} m; its outline must not cross itself, and must hold "
            "some area"
        )
    return shape


def _short(points: Array) -> str:
    text = str(points.tolist())
    return text if len(text) <= 80 else text[:77] + "..."
