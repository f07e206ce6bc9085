"""Open-RMF's ``*.building.yaml``, as its traffic editor writes it: one level, in metres.

Frames are those of Open-RMF. With ``coordinate_system: reference_image`` coordinates are pixels, y
down; metres per pixel are the mean over the measurements. Other levels lie on the reference level
by the fiducials that both have. With ``cartesian_meters`` they are metres, y up, as they stand.
With ``wgs84`` they are degrees.

Names may be digits without quotes, as the editor writes them: text is what was written. What is not
read is listed, so that a misspelt field is seen.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.codec import LARGEST
from mrta_falsify.core.errors import ConfigError, FormatError, UnknownNameError
from simulator_interface.formats.written import (
    is_empty,
    number_in,
    shown,
    truth_in,
    unused_note,
    whole_in,
)

T = TypeVar("T")

FIELDS = ("levels",)  # that tell a building file from others

MAX_ENTRIES = 20_000  # of one kind on one level
KINDS = {1: str, 2: int, 3: float, 4: bool}  # of parameters, by the number before the value
#: fields that Open-RMF defines; those that are not read here have no counterpart or no effect
BUILDING_FIELDS = (
    *("building_name", "coordinate_system", "crowd_sim", "graphs", "levels", "lifts", "name"),
    *("parameters", "reference_level_name", "version"),
)
LEVEL_FIELDS = (
    *("constraints", "doors", "drawing", "elevation", "features", "fiducials"),
    *("flattened_x_offset", "flattened_y_offset", "floors", "holes", "human_lanes", "lanes"),
    *("layers", "measurements", "models", "regions", "vertices", "walls", "x_meters", "y_meters"),
)
PIXELS, METRES, DEGREES = "reference_image", "cartesian_meters", "wgs84"
SEMI_MAJOR, FLATTENING = 6378137.0, 1.0 / 298.257223563  # m; of the ellipsoid WGS 84

Parameters = dict[str, Any]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Vertex:
    """A point of a level."""

    name: str
    point: Array  #: (2,) [m]
    parameters: Parameters

    def has(self, flag: str) -> bool:
        """Whether a parameter is there and set."""
        return bool(self.parameters.get(flag))


@dataclass(frozen=True, slots=True, kw_only=True)
class Edge:
    """A wall, lane or door between two vertices."""

    start: int
    end: int
    parameters: Parameters


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Level:
    """One level of a building."""

    building: str
    name: str
    others: tuple[str, ...]  #: names of the other levels
    vertices: tuple[Vertex, ...]
    walls: tuple[Edge, ...]
    doors: tuple[Edge, ...]
    lanes: tuple[Edge, ...]
    floors: tuple[tuple[int, ...], ...]  #: vertices of each outline
    holes: tuple[tuple[int, ...], ...]
    models: tuple[str, ...]  #: names of their models
    lifts: tuple[str, ...]  #: of the building
    notes: tuple[str, ...]  #: fields that Open-RMF does not define, in words


def typed(value: str | int | float | bool) -> list[Any]:
    """Write the value of a parameter with the number of its type before it."""
    return [next(number for number, kind in KINDS.items() if type(value) is kind), value]


def is_building(data: Any) -> bool:
    """Whether YAML-shaped data is a building file."""
    return isinstance(data, dict) and "levels" in data


def level_of(data: Any, path: Path, name: str | None) -> Level:
    """Read a level of a building.

    Args:
        data: lists, dicts and text, as ``codec.read_yaml`` gives them with ``as_text=FIELDS``.
        path: of the file; errors begin with it.
        name: of the level; None: the only one.

    Raises:
        InputError: what is wrong, and where; or which levels there are.
    """
    where = str(path)
    levels = _mapping(data.get("levels"), f"{where}: levels")
    if not levels:
        raise FormatError(f"{where}: levels is empty; a building has at least one")
    if name is None:
        if len(levels) > 1:
            known = ", ".join(map(str, levels))
            raise ConfigError(f"{where}: has the levels {known}; name one by --level")
        name = next(iter(levels))
    if name not in levels:
        raise UnknownNameError("level", name, levels, where=where)
    drawn = {each: _drawn(level, f"{where}: levels.{each}") for each, level in levels.items()}
    own = drawn[name]  # the others are checked, as the file's own tools do
    points = _in_metres(drawn, data, levels, name, where) if len(own.points) else own.points
    return Level(
        building=_text(data.get("building_name", data.get("name", ""))) or path.name.split(".")[0],
        name=name,
        others=tuple(other for other in levels if other != name),
        vertices=tuple(
            Vertex(name=text, point=point, parameters=given)
            for point, (text, given) in zip(points, own.vertices, strict=True)
        ),
        **own.parts,
        lifts=tuple(_mapping(_or_empty(data.get("lifts"), {}), f"{where}: lifts")),
        notes=(
            *unused_note("the building", data, BUILDING_FIELDS),
            *unused_note(f"level {name}", levels[name], LEVEL_FIELDS),
        ),
    )


class _Drawn(NamedTuple):
    """What is drawn on a level, as it stands in the file."""

    points: Array  #: (K, 2) of the vertices, in the file's coordinate system
    vertices: list[tuple[str, Parameters]]  #: name and parameters of each
    fiducials: dict[str, tuple[float, float]]  #: places by name [pixels], y up
    parts: dict[str, Any]  #: fields of a Level that need no metres


def _drawn(data: Any, place: str) -> _Drawn:
    level = _mapping(data, place)
    points, vertices = _vertices(level, place)
    count = len(vertices)
    kinds: dict[str, Callable[[Any, str], Any]] = {
        **dict.fromkeys(("walls", "doors", "lanes"), lambda e, w: _edge(e, w, count)),
        **dict.fromkeys(("floors", "holes"), lambda e, w: _outline(e, w, count)),
        "models": _model,
    }
    parts = {k: _entries(level, k, place, read) for k, read in kinds.items()}
    return _Drawn(points, vertices, _fiducials(level, place), parts)


# --- metres ----------------------------------------------------------------------------------


def _in_metres(drawn: Mapping[str, _Drawn], data: Any, levels: Any, name: str, where: str) -> Array:
    """Lay the vertices of level ``name`` ``(K, 2)`` where they are [m], y up."""
    points = drawn[name].points
    system = data.get("coordinate_system", PIXELS)
    if system == METRES:
        return points
    if system == DEGREES:
        every = np.concatenate([each.points for each in drawn.values()])
        return _from_degrees(points, every.mean(axis=0), where)
    if system != PIXELS:
        raise FormatError(
            f"{where}: coordinate_system is {shown(system)}; it must be {PIXELS}, {METRES} or "
            f"{DEGREES}"
        )
    up = points * [1.0, -1.0]
    reference = _text(data.get("reference_level_name")) or next(iter(levels))
    if reference not in levels:
        raise UnknownNameError("level", reference, levels, where=f"{where}: reference_level_name")
    if reference == name:
        return up * _scale(levels[name], f"{where}: levels.{name}")
    theirs, ours = drawn[reference].fiducials, drawn[name].fiducials
    shared = [fiducial for fiducial in ours if fiducial in theirs]
    if len(shared) < 2:
        raise FormatError(
            f"{where}: levels.{name} shares {len(shared)} fiducials with {reference!r}; at "
            "least 2 must be shared to place the level"
        )
    scale = _scale(levels[reference], f"{where}: levels.{reference}")
    source, target = (np.array([group[key] for key in shared]) for group in (ours, theirs))
    return _laid_on(up, source, target * scale, f"{where}: levels.{name}")


def _from_degrees(points: Array, origin: Array, where: str) -> Array:
    """Lay longitude and latitude ``(K, 2)`` [deg] on the plane that touches WGS 84 at ``origin``.

    By the radii of curvature along the meridian and across it; within 1 km of the origin, and away
    from the poles, that is right to a centimetre or two.

    Returns:
        Metres east and north of the origin, shape ``(K, 2)``.
    """
    if (np.abs(points) > (180.0, 85.0)).any():
        raise FormatError(
            f"{where}: coordinate_system is {DEGREES}, but not all vertices are longitude and "
            "latitude, -180 to 180 and -85 to 85"
        )
    squared = FLATTENING * (2.0 - FLATTENING)  # of the eccentricity
    latitude = np.radians(origin[1])
    bent = 1.0 - squared * np.sin(latitude) ** 2
    across = SEMI_MAJOR / np.sqrt(bent)
    along = across * (1.0 - squared) / bent
    metres: Array = np.radians(points - origin) * (across * np.cos(latitude), along)
    return metres


def _laid_on(points: Array, source: Array, target: Array, where: str) -> Array:
    """Move points ``(K, 2)`` by the similarity that lays ``source`` on ``target`` ``(F, 2)``.

    Least squares over shift, turn and scale (Umeyama 1991, in the complex plane).
    """
    a, b = (group @ [1.0, 1.0j] for group in (source, target))
    spread = float((np.abs(a - a.mean()) ** 2).sum())
    if spread <= 0.0:
        raise FormatError(f"{where}: the shared fiducials lie on one point")
    factor = (np.conj(a - a.mean()) @ (b - b.mean())) / spread
    moved = factor * (points @ [1.0, 1.0j] - a.mean()) + b.mean()
    return np.stack([moved.real, moved.imag], axis=-1)


def _scale(level: Any, where: str) -> float:
    """Metres per pixel, the mean over the measurements."""
    level = _mapping(level, where)
    points, _ = _vertices(level, where)
    found = []
    for i, edge in enumerate(
        _entries(level, "measurements", where, lambda e, w: _edge(e, w, len(points)))
    ):
        place = f"{where}: measurements[{i}]"
        given = edge.parameters.get("distance")
        metres = _number(None if given is None else str(given), f"{place}.distance")
        pixels = math.dist(points[edge.start], points[edge.end])
        if metres <= 0.0 or pixels <= 0.0:
            raise FormatError(
                f"{place} says that {pixels:g} pixels are {metres:g} m; both must be > 0"
            )
        found.append(metres / pixels)
    if not found:
        raise FormatError(
            f"{where}.measurements is empty; at least one must say how long a pixel is"
        )
    return sum(found) / len(found)


def _fiducials(level: Any, where: str) -> dict[str, tuple[float, float]]:
    """Places of a level's fiducials by name [pixels], y up."""
    rows = _entries(_mapping(level, where), "fiducials", where, _fiducial)
    return {name: (x, -y) for x, y, name in rows if name}


def _fiducial(entry: Any, where: str) -> tuple[float, float, str]:
    row = _row(entry, 3, where)
    return _number(row[0], f"{where}[0]"), _number(row[1], f"{where}[1]"), _text(row[2])


# --- entries ---------------------------------------------------------------------------------


def _or_empty(data: Any, empty: Any) -> Any:
    return empty if is_empty(data) else data


def _text(data: Any) -> str:
    return data if isinstance(data, str) else ""


def _mapping(data: Any, where: str) -> dict[str, Any]:
    if not isinstance(data, dict):
        raise FormatError(f"{where} is {shown(data)}; it must have fields")
    return data


def _entries(level: Any, field: str, where: str, read: Callable[[Any, str], T]) -> tuple[T, ...]:
    rows = _or_empty(level.get(field), [])
    if not isinstance(rows, list):
        raise FormatError(f"{where}.{field} is {shown(rows)}; it must be a list")
    if len(rows) > MAX_ENTRIES:
        raise FormatError(f"{where}.{field} has {len(rows)} entries; at most {MAX_ENTRIES}")
    return tuple(read(row, f"{where}.{field}[{i}]") for i, row in enumerate(rows))


def _vertices(level: Any, where: str) -> tuple[Array, list[tuple[str, Parameters]]]:
    """Places ``(K, 2)`` as they stand, and name and parameters of each."""
    rows = _entries(level, "vertices", where, _vertex)
    points = np.array([point for point, _, _ in rows], dtype=np.float64).reshape(-1, 2)
    return points, [(name, given) for _, name, given in rows]


def _vertex(entry: Any, where: str) -> tuple[tuple[float, float], str, Parameters]:
    row = _row(entry, 4, where)
    point = _number(row[0], f"{where}[0]"), _number(row[1], f"{where}[1]")
    if not isinstance(row[3], str):
        raise FormatError(f"{where}[3] is {shown(row[3])}; it must be the vertex's name")
    return point, row[3], _parameters(row[4] if len(row) > 4 else {}, f"{where}[4]")


def _edge(entry: Any, where: str, count: int) -> Edge:
    row = _row(entry, 2, where)
    start, end = (_index(row[k], f"{where}[{k}]", count) for k in (0, 1))
    given = _parameters(row[2] if len(row) > 2 else {}, f"{where}[2]")
    return Edge(start=start, end=end, parameters=given)


def _outline(entry: Any, where: str, count: int) -> tuple[int, ...]:
    corners = _mapping(entry, where).get("vertices")
    if not isinstance(corners, list) or len(corners) < 3:
        raise FormatError(f"{where}.vertices is {shown(corners)}; it must list 3 vertices or more")
    return tuple(_index(k, f"{where}.vertices[{i}]", count) for i, k in enumerate(corners))


def _model(entry: Any, where: str) -> str:
    return _text(_mapping(entry, where).get("model_name"))


def _parameters(data: Any, where: str) -> Parameters:
    """Read parameters, each a list of the number of its type and its value."""
    found = {}
    for name, given in _mapping(_or_empty(data, {}), where).items():
        kind, written = given if isinstance(given, list) and len(given) == 2 else (None, None)
        read = _READ.get(KINDS.get(whole_in(kind) or 0, type(None)))
        value = read(written) if read is not None and isinstance(written, str) else None
        if value is None or (isinstance(value, float) and not abs(value) < LARGEST):
            raise FormatError(
                f"{where}.{name} is {shown(given)}; it must be [type, value] with type 1 text, "
                "2 integer, 3 number, 4 true or false"
            )
        found[name] = value
    return found


_READ: dict[type[Any], Callable[[str], Any]] = {
    str: str,
    int: whole_in,
    float: number_in,
    bool: truth_in,
}


def _row(entry: Any, least: int, where: str) -> list[Any]:
    if not isinstance(entry, list) or len(entry) < least:
        raise FormatError(f"{where} is {shown(entry)}; it must be a list of {least} values or more")
    return entry


def _number(value: Any, where: str) -> float:
    number = number_in(value)
    if number is None or not abs(number) < 1e9:
        raise FormatError(f"{where} is {shown(value)}; it must be a number")
    return number


def _index(value: Any, where: str, count: int) -> int:
    number = whole_in(value)
    if number is None or not 0 <= number < count:
        raise FormatError(
            f"{where} is {shown(value)}; it must be the number of a vertex, below {count}"
        )
    return number
