"""A user's floor as a short YAML file: walls, rooms, and as much traffic as the user wants.

Walls come from the file itself, from a Nav2 map (``map:``), from an SDF world (``sdf:``), or
from several of them together. ``docs/layouts.md`` shows the fields.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import shapely
from shapely.geometry import LineString, Polygon

from mrta_falsify.core import codec
from mrta_falsify.core.arrays import Array, frozen_array
from mrta_falsify.core.codec import quantity
from mrta_falsify.core.errors import FormatError, UnknownNameError
from mrta_falsify.core.world import Furniture, Wall
from simulator_interface.formats import nav2, sdf
from simulator_interface.formats.outlines import outlines

EXTENT = 2000.0  # m, farthest coordinate; more is a mistake in units
LARGEST_FLOOR = 40_000.0  # m^2; ways are planned on every 0.1 m of it
MAX_SHAPES = 50_000  # of one kind in one file
MARGIN = 0.3  # m of floor file bounds around everything in it
ROOMS_ENDING = ".rooms.yaml"  # of the file beside a map or SDF world
EXAMPLE = "rooms: [{name: lab, point: [2.0, 3.5]}, {name: store, point: [9.0, 1.5]}]"

Unknown = Literal["solid", "free"]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FloorRoom:
    """A room as the file names it; what is empty is derived."""

    name: str
    point: Array = quantity(shape=(2,), unit="m")
    door: Array = quantity(shape=("D", 2), unit="m", default=[])  #: segment across the entrance
    area: Array = quantity(shape=("V", 2), unit="m", default=[])
    queue: Array = quantity(shape=("S", 2), unit="m", default=[])  #: waiting spots, head first
    capacity: int = quantity(low=1, default=1)
    service_time: float = quantity(low=0.0, unit="s", default=0.0)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FloorLane:
    """A way that the user wants driven as it is."""

    start: str  #: room name
    end: str  #: room name
    to_room: Array = quantity(shape=("K", 2), unit="m")  #: ends at the room point
    to_queue: Array = quantity(shape=("K", 2), unit="m", default=[])  #: ends at the last spot


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Floor:
    """What is known of a user's floor before traffic is derived."""

    name: str
    bounds: Array  #: (4,) [m]
    walls: tuple[Wall, ...]
    furniture: tuple[Furniture, ...]
    rooms: tuple[FloorRoom, ...]
    lanes: tuple[FloorLane, ...] = ()
    parking: Array  #: (P, 2) [m], empty: derive
    travel_times: Array  #: (R, R) [s], empty: derive
    spots: int  #: waiting spots wanted per room


# --- the file's own shape --------------------------------------------------------------


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Shape:
    """A wall or piece of furniture: exactly one of ``line``, ``polygon`` and ``box``."""

    name: str = ""
    kind: str = "furniture"
    line: Array = quantity(shape=("K", 2), unit="m", default=[])
    thickness: float = quantity(above=0.0, high=5.0, unit="m", default=0.15)
    polygon: Array = quantity(shape=("V", 2), unit="m", default=[])
    box: Array = quantity(shape=("B",), unit="m", default=[])  #: x min, y min, x max, y max
    height: float = quantity(above=0.0, unit="m", default=3.0)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _File:
    """The whole file."""

    name: str = ""
    map: str = ""  #: a Nav2 map beside this file
    unknown: Unknown = "solid"  #: what the map's unknown cells are
    sdf: str = ""  #: an SDF world beside this file
    skip: tuple[str, ...] = ()  #: models of the SDF world to leave out
    slice: Array = quantity(shape=(2,), low=0.0, unit="m", default=[0.05, 0.5])
    bounds: Array = quantity(shape=("B",), unit="m", default=[])
    walls: tuple[_Shape, ...] = ()
    furniture: tuple[_Shape, ...] = ()
    rooms: tuple[FloorRoom, ...] = ()
    lanes: tuple[FloorLane, ...] = ()
    parking: Array = quantity(shape=("P", 2), unit="m", default=[])
    travel_times: Array = quantity(shape=("R", "R"), low=0.0, unit="s", default=[])
    spots: int = quantity(low=0, high=10, default=3)


def read_floor(path: Path) -> Floor:
    """Floor of a floor file, a Nav2 map or an SDF world.

    Args:
        path: a floor file (``.yaml``); or a Nav2 map (``.yaml`` with ``image``) or an SDF
            world (``.sdf``, ``.world``) with a floor file of the same name that ends in
            ``.rooms.yaml`` beside it.

    Raises:
        InputError: a file is missing or broken; it has no rooms; a field is not allowed.
    """
    if path.suffix.lower() in (".sdf", ".world"):
        return _assembled(_rooms_beside(path), _described(_rooms_beside(path)), sdf_file=path)
    data = codec.read_yaml(path)
    if isinstance(data, dict) and "image" in data:
        beside = _rooms_beside(path)
        return _assembled(beside, _described(beside), map_file=path)
    described = _decoded(data, path)
    return _assembled(
        path,
        described,
        map_file=_confined(path, "map", described.map) if described.map else None,
        sdf_file=_confined(path, "sdf", described.sdf) if described.sdf else None,
    )


def _rooms_beside(path: Path) -> Path:
    beside = path.with_name(path.stem + ROOMS_ENDING)
    if not beside.is_file():
        # A map without rooms is a picture: nobody could be sent anywhere on it.
        raise FormatError(
            f"{path}: names no rooms; put a file {beside.name} beside it, for example: {EXAMPLE}"
        )
    return beside


def _described(path: Path) -> _File:
    described = _decoded(codec.read_yaml(path), path)
    for field in ("map", "sdf"):
        if getattr(described, field):
            raise FormatError(
                f"{path}: {field} is {getattr(described, field)!r}; the rooms of a map or SDF "
                "world name no other (load this file itself instead)"
            )
    return described


def _decoded(data: Any, path: Path) -> _File:
    if not isinstance(data, dict):
        raise FormatError(f"{path}: is not a floor file; it must have fields, such as {EXAMPLE}")
    return codec.decode(_File, data, where=str(path))


def _confined(path: Path, field: str, name: str) -> Path:
    """File that another one names, inside the folder of the first.

    Raises:
        FormatError: it lies elsewhere.
    """
    folder = path.parent.resolve()
    found = (folder / name).resolve()
    if not found.is_relative_to(folder):
        raise FormatError(f"{path}: {field} is {name!r}; it must lie in the folder of this file")
    return found


def _assembled(
    path: Path, described: _File, *, map_file: Path | None = None, sdf_file: Path | None = None
) -> Floor:
    where = str(path)
    walls: list[Wall] = _walls(described.walls, where)
    furniture: list[Furniture] = _furniture(described.furniture, where)
    extents = [wall.polygon for wall in walls] + [item.polygon for item in furniture]
    if sdf_file is not None:
        low, high = described.slice
        if not low < high:
            raise FormatError(f"{where}: slice is [{low:g}, {high:g}] m; it must grow")
        solids = sdf.read_sdf(sdf_file, low=float(low), high=float(high), skip=described.skip)
        furniture += list(solids)
        extents += [solid.polygon for solid in solids]
    if map_file is not None:
        grid = nav2.read_nav2_map(map_file)
        if grid.data.size > nav2.MAX_FLOOR_CELLS:
            raise FormatError(
                f"{map_file}: has {grid.data.size} cells; a floor may have at most "
                f"{nav2.MAX_FLOOR_CELLS} (crop it, or save it with a coarser resolution)"
            )
        walls += nav2.walls_of_map(grid, unknown_is_solid=described.unknown == "solid")
        size = np.array(grid.data.shape[::-1]) * grid.resolution
        extents.append(np.vstack([grid.origin, grid.origin + size]))
    if not described.rooms:
        raise FormatError(f"{where}: rooms is empty; name at least one, for example: {EXAMPLE}")
    if not extents and not len(described.bounds):
        raise FormatError(
            f"{where}: has no walls; give walls, map, sdf or bounds [x min, y min, x max, y max]"
        )
    bounds = _bounds(described, extents, is_map=map_file is not None, where=where)
    _check_names(described, where)
    return Floor(
        name=described.name or path.name.removesuffix(ROOMS_ENDING).removesuffix(path.suffix),
        bounds=bounds,
        walls=tuple(
            dataclasses.replace(wall, name=name)
            for wall, name in zip(walls, _named([w.name for w in walls], "wall"), strict=True)
        ),
        furniture=tuple(
            dataclasses.replace(item, name=name)
            for item, name in zip(
                furniture, _named([f.name for f in furniture], "furniture"), strict=True
            )
        ),
        rooms=described.rooms,
        lanes=described.lanes,
        parking=described.parking,
        travel_times=_checked_times(described, where),
        spots=described.spots,
    )


def _bounds(described: _File, extents: list[Array], *, is_map: bool, where: str) -> Array:
    if len(described.bounds):
        if len(described.bounds) != 4 or not (described.bounds[:2] < described.bounds[2:]).all():
            raise FormatError(
                f"{where}: bounds is {described.bounds.tolist()} m; it must be "
                "[x min, y min, x max, y max]"
            )
        bounds = described.bounds
    else:
        points = np.vstack(extents)
        low, high = points.min(axis=0), points.max(axis=0)
        if not is_map:  # a map's cells must stay cells of the costmap
            low, high = low - MARGIN, high + MARGIN
        bounds = np.concatenate([low, high])
    if np.abs(bounds).max() > EXTENT:
        raise FormatError(
            f"{where}: the floor reaches from {bounds[:2].tolist()} to {bounds[2:].tolist()} m; "
            f"coordinates must stay within {EXTENT:g} m (metres, not millimetres?)"
        )
    width, depth = (bounds[2:] - bounds[:2]).tolist()
    if width * depth > LARGEST_FLOOR:
        raise FormatError(
            f"{where}: the floor measures {width:g} x {depth:g} m; at most {LARGEST_FLOOR:g} m^2 "
            "are allowed (cut out the part that robots use)"
        )
    for i, room in enumerate(described.rooms):
        if not ((room.point >= bounds[:2]) & (room.point <= bounds[2:])).all():
            raise FormatError(
                f"{where}: rooms[{i}].point of {room.name!r} is {room.point.tolist()} m; it must "
                f"lie within the floor, {bounds[:2].tolist()} to {bounds[2:].tolist()} m"
            )
    return frozen_array(bounds)


def _check_names(described: _File, where: str) -> None:
    names = [room.name for room in described.rooms]
    for i, name in enumerate(names):
        if not name or name in names[:i]:
            problem = "is empty" if not name else f"is {name!r} again"
            raise FormatError(f"{where}: rooms[{i}].name {problem}; every room needs its own name")
    for i, room in enumerate(described.rooms):
        if len(room.door) not in (0, 2):
            raise FormatError(
                f"{where}: rooms[{i}].door has {len(room.door)} points; it must have 2, the "
                "posts of the door"
            )
        if len(room.area):
            shape = _checked_polygon(room.area, f"{where}: rooms[{i}].area")
            if not shape.covers(shapely.Point(room.point)):
                raise FormatError(
                    f"{where}: rooms[{i}].point of {room.name!r} is {room.point.tolist()} m; it "
                    "must lie in the room's area"
                )
    for i, lane in enumerate(described.lanes):
        for field in ("start", "end"):
            name = getattr(lane, field)
            if name not in names:
                raise UnknownNameError("room", name, names, where=f"{where}: lanes[{i}].{field}")
        if lane.start == lane.end:
            raise FormatError(f"{where}: lanes[{i}] leads from {lane.start!r} to itself")
        if not len(lane.to_room):
            raise FormatError(f"{where}: lanes[{i}].to_room is empty; it needs waypoints")


def _checked_times(described: _File, where: str) -> Array:
    times, rooms = described.travel_times, len(described.rooms)
    if times.size and times.shape != (rooms, rooms):
        raise FormatError(
            f"{where}: travel_times has shape {times.shape}; it must be ({rooms}, {rooms}), one "
            "row and column per room"
        )
    return times


# --- shapes ------------------------------------------------------------------------------


def _walls(entries: tuple[_Shape, ...], where: str) -> list[Wall]:
    return [
        Wall(name=entry.name, polygon=ring, height=entry.height)
        for entry, ring in _rings(entries, f"{where}: walls")
    ]


def _furniture(entries: tuple[_Shape, ...], where: str) -> list[Furniture]:
    return [
        Furniture(name=entry.name, kind=entry.kind, polygon=ring, height=entry.height)
        for entry, ring in _rings(entries, f"{where}: furniture")
    ]


def _rings(entries: tuple[_Shape, ...], where: str) -> list[tuple[_Shape, Array]]:
    if len(entries) > MAX_SHAPES:
        raise FormatError(f"{where} has {len(entries)} entries; at most {MAX_SHAPES}")
    found = []
    for i, entry in enumerate(entries):
        found += [(entry, ring) for ring in outlines(_shape(entry, f"{where}[{i}]"))]
    return found


def _shape(entry: _Shape, where: str) -> Polygon:
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
    return _checked_polygon(entry.polygon, f"{where}.polygon")


def _checked_polygon(points: Array, where: str) -> Polygon:
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


def _named(names: list[str], kind: str) -> list[str]:
    """Names with numbers behind those that occur again."""
    taken: set[str] = set()
    next_number: dict[str, int] = {}
    found = []
    for name in names:
        stem = name or kind
        number = next_number.get(stem, 0)
        wanted = name or f"{kind}_0"
        while wanted in taken:
            number += 1
            wanted = f"{stem}_{number}"
        next_number[stem] = number
        taken.add(wanted)
        found.append(wanted)
    return found


__all__ = ["Floor", "FloorLane", "FloorRoom", "read_floor"]
