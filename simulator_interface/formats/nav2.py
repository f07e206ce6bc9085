"""Nav2 maps: a YAML file that describes a picture.

Row 0 of the picture is the northernmost; ``origin`` is its lower left corner with the angle
by which the map is turned about that corner. Brightness and thresholds follow
``nav2_map_server``: with ``p = 1 - brightness`` (``brightness`` if ``negate``), a cell is
occupied if ``p > occupied_thresh``, free if ``p < free_thresh``. Other fields are listed and not
used, as there; tools that write maps have some of their own.

Reference: https://docs.nav2.org/configuration/packages/configuring-map-server.html
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path, PurePath
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from mrta_falsify.core import codec
from mrta_falsify.core.arrays import Array, ByteArray, frozen_array
from mrta_falsify.core.codec import quantity
from mrta_falsify.core.costmap import FREE, INSCRIBED, LETHAL, UNKNOWN, Costmap
from mrta_falsify.core.durable import make_folder, write_atomically
from mrta_falsify.core.errors import FormatError, InputError
from simulator_interface.formats.confinement import file_beside
from simulator_interface.formats.map_picture import read_map_picture
from simulator_interface.formats.written import number_in, truth_in, unused_note

Mode = Literal["trinary", "scale", "raw"]

FIELDS = ("image",)  # that tell a map from other files
OCCUPIED_THRESH = 0.65  # as MRTA-Sim's map
FREE_THRESH = 0.25
GREY_FREE, GREY_OCCUPIED = 254, 0  # what Nav2's map saver writes
GREY_UNKNOWN = 128  # the saver's 205 would be read as free under a free_thresh of 0.25
GREY_SAVED_UNKNOWN = 205


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class OccupancyGrid:
    """A map as ``nav_msgs/OccupancyGrid`` has it."""

    data: NDArray[np.int8]  #: (rows, cols) -1 unknown, 0 free to 100 occupied; row 0 southernmost
    resolution: float  #: cell size [m]
    origin: Array  #: (2,) lower left corner [m], map frame
    yaw: float = 0.0  #: the grid is turned about that corner [rad], counter-clockwise
    doubtful: int = 0  #: free cells as grey as those that Nav2's saver writes for unknown ones
    notes: tuple[str, ...] = ()  #: what of the file was not used, or not found where it says


@dataclass(frozen=True, slots=True, kw_only=True)
class _Description:
    """The YAML file, field by field."""

    image: str
    resolution: float = quantity(above=0.0, unit="m")
    origin: Array = quantity(shape=(3,), unit="m, m, rad")
    negate: Any = 0  #: 0, 1, false or true
    occupied_thresh: float = quantity(low=0.0, high=1.0, default=OCCUPIED_THRESH)
    free_thresh: float = quantity(low=0.0, high=1.0, default=FREE_THRESH)
    mode: Mode = "trinary"


# --- costmap to occupancy --------------------------------------------------------------


def occupancy_of(costmap: Costmap) -> OccupancyGrid:
    """Convert a costmap as Nav2 publishes it: 1-252 to 1-98, 253 to 99, 254 to 100, 255 to -1."""
    cost = np.arange(256)
    table = (1 + (97 * (cost - 1)) // 251).astype(np.int8)
    table[[FREE, INSCRIBED, LETHAL, UNKNOWN]] = [0, 99, 100, -1]
    return OccupancyGrid(
        data=table[costmap.cost], resolution=costmap.resolution, origin=costmap.origin
    )


def write_nav2_map(costmap: Costmap, path: Path, *, mode: Mode = "trinary") -> None:
    """Write ``costmap`` as a Nav2 map: ``path`` (YAML) and a PGM of the same name beside it.

    Args:
        costmap: what to write.
        path: the YAML file, ending in ``.yaml``.
        mode: ``trinary`` marks lethal cells occupied, all other known ones free: the map a
            Nav2 stack starts from. ``raw`` keeps the published value of every cell.
            ``scale`` keeps it too, but has no grey level for unknown cells.

    Raises:
        FormatError: unknown cells in mode ``scale``.
        PlaceError: a file cannot be written.
    """
    grid = occupancy_of(costmap)
    if mode == "trinary":
        walls = np.where(costmap.cost == LETHAL, 100, 0)
        data = np.where(costmap.cost == UNKNOWN, -1, walls).astype(np.int8)
        grid = OccupancyGrid(data=data, resolution=grid.resolution, origin=grid.origin)
    write_occupancy(grid, path, mode=mode)


def write_map_files(costmap: Costmap, path: Path) -> tuple[Path, Path]:
    """Write ``NAME.yaml``, or ``map.yaml`` in a directory, and the PGM file beside it.

    Raises:
        PlaceError: a file cannot be written.
    """
    target = path if path.suffix == ".yaml" else path / "map.yaml"
    make_folder(target.parent)
    write_nav2_map(costmap, target)
    return target, target.with_suffix(".pgm")


def write_costs(costmap: Costmap, path: Path) -> None:
    """Write the cost bytes themselves as a PGM picture, northernmost row first."""
    _write_pgm(path, costmap.cost[::-1])


def write_occupancy(grid: OccupancyGrid, path: Path, *, mode: Mode = "trinary") -> None:
    """Write an occupancy grid as YAML and PGM; reading them gives an equal grid.

    In mode ``trinary`` values between the thresholds become unknown, as in Nav2.

    Raises:
        FormatError: unknown cells in mode ``scale``.
        PlaceError: a file cannot be written.
    """
    image = path.with_suffix(".pgm")
    grey = _grey_levels(mode)[grid.data.astype(np.int64) + 1]
    if mode == "scale" and (grid.data < 0).any():
        count = int((grid.data < 0).sum())
        raise FormatError(
            f"{path}: {count} cells are unknown; mode scale has no grey level for them "
            "(write mode trinary or raw)"
        )
    _write_pgm(image, grey[::-1])
    x, y = grid.origin.tolist()
    text = (
        f"image: {image.name}\n"
        f"mode: {mode}\n"
        f"resolution: {grid.resolution!r}\n"
        f"origin: [{x!r}, {y!r}, {grid.yaw!r}]\n"
        "negate: 0\n"
        f"occupied_thresh: {OCCUPIED_THRESH}\n"
        f"free_thresh: {FREE_THRESH}\n"
    )
    write_atomically(path, text.encode())


def _grey_levels(mode: Mode) -> ByteArray:
    """Grey level ``(102,)`` of the values -1 to 100."""
    value = np.arange(-1, 101)
    if mode == "raw":
        return np.where(value < 0, 255, value).astype(np.uint8)
    if mode == "scale":
        share = FREE_THRESH + value / 100.0 * (OCCUPIED_THRESH - FREE_THRESH)
        grey = np.rint(255.0 * (1.0 - share))
        grey[value <= 0], grey[value == 100] = GREY_FREE, GREY_OCCUPIED
        return grey.astype(np.uint8)
    percent = value / 100.0
    known = np.where(percent > OCCUPIED_THRESH, GREY_OCCUPIED, GREY_UNKNOWN)
    known[(value >= 0) & (percent < FREE_THRESH)] = GREY_FREE
    return known.astype(np.uint8)


# --- files to occupancy ----------------------------------------------------------------


def read_nav2_map(path: Path) -> OccupancyGrid:
    """Read an occupancy grid from a Nav2 map.

    Args:
        path: the YAML file; its ``image`` lies in the same folder or below. One with a path of
            another machine is looked for there by its last part.

    Raises:
        FormatError: a file is missing or broken, or asks for what Nav2 does not define.
    """
    # as yaml-cpp reads it for Nav2
    fields, notes = _known_fields(codec.read_yaml(path, doubled="first", as_text=FIELDS))
    try:
        described = codec.decode(_Description, fields, where=str(path))
    except InputError as error:
        raise FormatError(str(error)) from None
    if described.negate not in (0, 1):
        raise FormatError(f"{path}: negate is {described.negate!r}; it must be 0 or 1")
    if not described.free_thresh < described.occupied_thresh:
        raise FormatError(
            f"{path}: free_thresh is {described.free_thresh}; it must be below "
            f"occupied_thresh, {described.occupied_thresh}"
        )
    picture = read_map_picture(
        _image_beside(path, described.image, notes),
        with_alpha=described.mode == "trinary",
        where=f"{path}: image",
    )
    occupancy = _occupancy_levels(described, picture.brightest)[picture.sums]
    if picture.see_through is not None and described.mode == "scale":
        occupancy = np.where(picture.see_through, -1, occupancy).astype(np.int8)
    grey = GREY_SAVED_UNKNOWN * picture.brightest // 255
    is_doubtful = described.mode == "trinary" and not described.negate
    return OccupancyGrid(
        data=occupancy[::-1],
        resolution=described.resolution,
        origin=frozen_array(described.origin[:2]),
        yaw=float(described.origin[2]),
        doubtful=int(((picture.sums == grey) & (occupancy == 0)).sum()) if is_doubtful else 0,
        notes=tuple(notes),
    )


def _known_fields(given: Any) -> tuple[Any, list[str]]:
    """Read the fields of a description, and say which ones are not used."""
    if not isinstance(given, dict):
        return given, []
    known = [field.name for field in dataclasses.fields(_Description)]
    fields = {name: value for name, value in given.items() if name in known}
    for name, value in fields.items():
        if name == "mode" and isinstance(value, str):
            fields[name] = value.lower()
        elif name == "origin" and isinstance(value, list):
            fields[name] = list(map(_number, value))
        elif name not in ("mode", "image"):
            fields[name] = _number(value)
    return fields, unused_note("the map", given, known)


def _number(value: Any) -> Any:
    """Read a number, or truth as 0 or 1; else the value as it is, for a message about it."""
    number, truth = number_in(value), truth_in(value)
    if truth is not None:
        return int(truth)
    return (
        int(number)
        if number is not None and number.is_integer()
        else value
        if number is None
        else number
    )


def _image_beside(path: Path, image: str, notes: list[str]) -> Path:
    """Find the picture of a map where the map says, else its last part beside the map."""
    last = PurePath(image.replace("\\", "/")).name
    try:
        found = file_beside(path, "image", image)
        if found.exists() or not (path.parent / last).is_file():
            return found
    except FormatError:
        if not (path.parent / last).is_file():
            raise
    notes.append(f"the map's image {image} was read as {last} beside the map")
    return file_beside(path, "image", last)


def _occupancy_levels(described: _Description, brightest: int) -> NDArray[np.int8]:
    """Occupancy ``(brightest + 1,)`` of every brightness."""
    bright = np.arange(brightest + 1)
    if described.mode == "raw":
        # Nav2's raw mode reads the level itself, whatever `negate` says.
        level = np.rint(bright * (255.0 / brightest))
        return np.where(level <= 100, level, -1).astype(np.int8)
    share = (bright if described.negate else brightest - bright) / brightest
    low, high = described.free_thresh, described.occupied_thresh
    between = np.rint((share - low) / (high - low) * 100.0) if described.mode == "scale" else -1
    return np.where(share > high, 100, np.where(share < low, 0, between)).astype(np.int8)


def _write_pgm(path: Path, grey: ByteArray) -> None:
    rows, cols = grey.shape
    write_atomically(path, f"P5\n{cols} {rows}\n255\n".encode() + grey.tobytes())


__all__ = [
    "Mode",
    "OccupancyGrid",
    "occupancy_of",
    "read_nav2_map",
    "write_costs",
    "write_nav2_map",
    "write_occupancy",
]
