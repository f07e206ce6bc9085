"""A user's floor as a short YAML file: walls, rooms, and as much traffic as the user wants.

Walls come from the file itself, from a Nav2 map (``map:``), from an SDF world (``sdf:``), or
from several of them together. A level of an Open-RMF building becomes such a file.
``docs/layouts.md`` shows the fields.
"""

from __future__ import annotations

import dataclasses
import warnings
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

from mrta_falsify.core import codec, registry
from mrta_falsify.core.arrays import Array
from mrta_falsify.core.config import Choice
from mrta_falsify.core.errors import ConfigError, DoubledKeyError, FormatError, InputNote
from mrta_falsify.core.world import Furniture, Resource, Wall
from simulator_interface.formats import building_file, nav2, sdf
from simulator_interface.formats.building import floor_of_level
from simulator_interface.formats.building_file import Level, is_building, level_of
from simulator_interface.formats.confinement import file_beside
from simulator_interface.formats.floor_checks import (
    check_lanes,
    check_rooms,
    checked_bounds,
    checked_times,
)
from simulator_interface.formats.floor_fields import EXAMPLE, FloorFile, FloorLane, FloorRoom
from simulator_interface.formats.floor_resources import resources_of
from simulator_interface.formats.floor_shapes import furniture_of_shapes, walls_of_shapes
from simulator_interface.formats.map_walls import (
    MapFacts,
    describe_map,
    map_corners,
    walls_of_map,
)

ROOMS_ENDING = ".rooms.yaml"  # of the file beside a map or SDF world


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Floor:
    """A user's floor before traffic is derived."""

    name: str
    bounds: Array  #: (4,) [m]
    walls: tuple[Wall, ...]
    furniture: tuple[Furniture, ...]
    rooms: tuple[FloorRoom, ...]
    lanes: tuple[FloorLane, ...] = ()
    resources: tuple[Resource, ...] = ()  #: beside those of the rooms
    parking: Array  #: (P, 2) [m], empty: derive
    travel_times: Array  #: (R, R) [s], empty: derive
    spots: int  #: waiting spots wanted per room
    source: Path | None = None  #: the file with the rooms
    map_facts: MapFacts | None = None  #: of the map that it was made from
    #: the file, or what a building makes of it
    described: FloorFile = field(default_factory=FloorFile)
    starts: tuple[tuple[str, Array], ...] = ()  #: name and place (2,) [m] of a building's robots
    #: of a building, by room: lanes (L, 2, 2) [m] near by that others drive
    driven_past: tuple[Array, ...] = ()
    left_out: tuple[str, ...] = ()  #: what of a building has no counterpart, in words
    no_rooms: tuple[str, ...] = ()  #: which of its vertices are no rooms, and why, in words
    notes: tuple[str, ...] = ()  #: what of other tools' files is not used, in words


POINT = "importer"
FALLBACK = "yaml"  # reads what no other importer claims by its ending


class FloorImporter(Protocol):
    """Reads floors from files of a kind."""

    endings: tuple[str, ...]  #: of their names, in lower case, with the dot

    def read(self, path: Path, rooms: Path | None = None, level: str | None = None) -> Floor:
        """Read a floor.

        Args:
            path: the file.
            rooms: the floor file with the rooms, if the user names one.
            level: of a building with several, if the user names one.

        Raises:
            InputError: a file is missing or broken, or ``rooms`` or ``level`` mean nothing here.
        """


def read_floor(path: Path, rooms: Path | None = None, *, level: str | None = None) -> Floor:
    """Read a floor by the importer that its ending belongs to.

    Args:
        path: a floor file (``.yaml``); a building (``.yaml`` with ``levels``); or a Nav2 map
            (``.yaml`` with ``image``) or an SDF world (``.sdf``, ``.world``), whose rooms are
            in a floor file; or what another registered importer reads.
        rooms: the floor file of a map or SDF world; None: the one beside it, whose name
            ends in ``.rooms.yaml`` instead.
        level: of a building; None: the only one.

    Raises:
        InputError: a file is missing or broken; it has no rooms; a field is not allowed.
    """
    return _importer_of(path.name.lower()).read(path, rooms, level)


def _importer_of(name: str) -> FloorImporter:
    """Find the importer of a file's name: of several that fit, that of the longest ending."""

    def fit(importer: FloorImporter) -> int:
        return max((len(end) for end in importer.endings if name.endswith(end)), default=0)

    names = sorted(registry.names(POINT), key=lambda one: one == FALLBACK)  # others before ours
    importers = [registry.build(POINT, Choice(one), where="import") for one in names]
    found: FloorImporter = max(importers, key=fit)
    return found if fit(found) else importers[-1]


class SdfImporter(registry.WithoutOptions):
    """Reads worlds of Gazebo, whose rooms are in a floor file."""

    endings = (".sdf", ".world")

    def read(self, path: Path, rooms: Path | None = None, level: str | None = None) -> Floor:
        """See :class:`FloorImporter`."""
        _refuse_level(path, level)
        beside = rooms or _rooms_beside(path)
        return _assembled(beside, _described(beside), sdf_file=path)


class YamlImporter(registry.WithoutOptions):
    """Reads floor files, Nav2 maps with a floor file, and buildings of Open-RMF."""

    endings = (".yaml", ".yml")

    def read(self, path: Path, rooms: Path | None = None, level: str | None = None) -> Floor:
        """See :class:`FloorImporter`."""
        data = _read(path)
        if is_building(data):
            if rooms is not None:
                raise FormatError(
                    f"{path}: names its own places, and {rooms} cannot add to them; --rooms "
                    "belong to a map or SDF world (import the building without it, change "
                    "NAME.derived.yaml, and import that)"
                )
            return _of_building(level_of(data, path, level), path)
        _refuse_level(path, level)
        if isinstance(data, dict) and "image" in data:
            beside = rooms or _rooms_beside(path)
            return _assembled(beside, _described(beside), map_file=path)
        if rooms is not None:
            raise FormatError(
                f"{path}: names no image, so it is no Nav2 map; rooms belong to a map or SDF world "
                "(a floor file names its own)"
            )
        return floor_of_data(data, path)


def _refuse_level(path: Path, level: str | None) -> None:
    if level is not None:
        raise ConfigError(f"{path}: is no building, so it has no level {level!r}")


def _read(path: Path) -> Any:
    """Read a file of ours, in which no key may stand twice, or of others, in which one may.

    Of a building the last value counts, as in Open-RMF's building map tools.
    """
    as_text = (*building_file.FIELDS, *nav2.FIELDS)
    try:
        return codec.read_yaml(path, as_text=as_text)
    except DoubledKeyError:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", InputNote)
            data = codec.read_yaml(path, doubled="last", as_text=as_text)
        if is_building(data):
            return codec.read_yaml(path, doubled="last", as_text=as_text)
        if isinstance(data, dict) and "image" in data:  # a Nav2 map, which is read again
            return data
        raise


def _of_building(level: Level, path: Path) -> Floor:
    made = floor_of_level(level, str(path))
    floor = _assembled(path, made.described)
    return dataclasses.replace(
        floor,
        starts=made.starts,
        driven_past=made.driven_past,
        left_out=made.left_out,
        no_rooms=made.no_rooms,
        notes=(*floor.notes, *level.notes),
    )


def floor_of_data(data: Any, path: Path) -> Floor:
    """Read a floor from the data of a floor file.

    Args:
        data: YAML-shaped.
        path: of the file that holds it; other files are looked for beside it.

    Raises:
        InputError: a field is not allowed, or a file is missing or broken.
    """
    described = _decoded(data, path)
    return _assembled(
        path,
        described,
        map_file=file_beside(path, "map", described.map) if described.map else None,
        sdf_file=file_beside(path, "sdf", described.sdf) if described.sdf else None,
    )


def _rooms_beside(path: Path) -> Path:
    beside = path.with_name(path.stem + ROOMS_ENDING)
    if not beside.is_file():
        # A map without rooms is a picture: no robot could be sent anywhere on it.
        raise FormatError(
            f"{path}: names no rooms; put a file {beside.name} beside it, for example: {EXAMPLE}"
        )
    return beside


def _described(path: Path) -> FloorFile:
    described = _decoded(codec.read_yaml(path), path)
    for name in ("map", "sdf"):
        if getattr(described, name):
            raise FormatError(
                f"{path}: {name} is {getattr(described, name)!r}; the rooms of a map or SDF "
                "world name no other (load this file itself instead)"
            )
    return described


def _decoded(data: Any, path: Path) -> FloorFile:
    if not isinstance(data, dict):
        raise FormatError(
            f"{path}: is not a floor file; it must have fields, such as {EXAMPLE}, or be the YAML "
            "of a Nav2 map (image, resolution, origin), an SDF world or a *.building.yaml"
        )
    return codec.decode(FloorFile, data, where=str(path))


@dataclass(slots=True, eq=False)
class _Solids:
    """Walls and furniture found so far, and the points that the floor must hold."""

    walls: list[Wall]
    furniture: list[Furniture]
    extents: list[Array] = field(default_factory=list)  #: (K, 2) each [m]
    map_facts: MapFacts | None = None
    notes: list[str] = field(default_factory=list)


def _assembled(
    path: Path, described: FloorFile, *, map_file: Path | None = None, sdf_file: Path | None = None
) -> Floor:
    where = str(path)
    solids = _Solids(
        walls_of_shapes(described.walls, where), furniture_of_shapes(described.furniture, where)
    )
    solids.extents += [wall.polygon for wall in solids.walls]
    solids.extents += [item.polygon for item in solids.furniture]
    if sdf_file is not None:
        _add_sdf(solids, sdf_file, described, where)
    if map_file is not None:
        _add_map(solids, map_file, described)
    if not described.rooms:
        raise FormatError(f"{where}: rooms is empty; name at least one, for example: {EXAMPLE}")
    if not solids.extents and not len(described.bounds):
        raise FormatError(
            f"{where}: has no walls; give walls, map, sdf or bounds [x min, y min, x max, y max]"
        )
    check_rooms(described, where)
    bounds = checked_bounds(described, solids.extents, is_map=map_file is not None, where=where)
    check_lanes(described, where)
    wall_names = _named([wall.name for wall in solids.walls], "wall")
    furniture_names = _named([item.name for item in solids.furniture], "furniture")
    return Floor(
        name=described.name or path.name.removesuffix(ROOMS_ENDING).removesuffix(path.suffix),
        bounds=bounds,
        walls=tuple(
            dataclasses.replace(wall, name=name)
            for wall, name in zip(solids.walls, wall_names, strict=True)
        ),
        furniture=tuple(
            dataclasses.replace(item, name=name)
            for item, name in zip(solids.furniture, furniture_names, strict=True)
        ),
        rooms=described.rooms,
        lanes=described.lanes,
        resources=resources_of(described, where),
        parking=described.parking,
        travel_times=checked_times(described, where),
        spots=described.spots,
        source=path,
        map_facts=solids.map_facts,
        notes=tuple(solids.notes),
        described=described,
    )


def _add_sdf(solids: _Solids, file: Path, described: FloorFile, where: str) -> None:
    low, high = described.slice
    if not low < high:
        raise FormatError(f"{where}: slice is [{low:g}, {high:g}] m; it must grow")
    found = sdf.read_sdf(file, low=float(low), high=float(high), skip=described.skip)
    solids.furniture += found
    solids.extents += [solid.polygon for solid in found]


def _add_map(solids: _Solids, file: Path, described: FloorFile) -> None:
    grid = nav2.read_nav2_map(file)
    unknown_is_solid = described.unknown == "solid"
    least = described.least_patch
    solids.walls += walls_of_map(grid, unknown_is_solid=unknown_is_solid, least_patch=least)
    solids.map_facts = describe_map(grid, unknown_is_solid=unknown_is_solid, least_patch=least)
    solids.extents.append(map_corners(grid))
    solids.notes += grid.notes


def _named(names: list[str], kind: str) -> list[str]:
    """Make names unique: a name that occurs again gets a number."""
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


__all__ = ["Floor", "FloorLane", "FloorRoom", "floor_of_data", "read_floor"]
