"""The fields of a floor file, as ``docs/layouts.md`` shows them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.codec import quantity

EXAMPLE = "rooms: [{name: lab, point: [2.0, 3.5]}, {name: store, point: [9.0, 1.5]}]"

Unknown = Literal["solid", "free"]
Hold = Literal["until_left", "until_served"]
ResourceKind = Literal["room", "corridor", "door", "elevator", "charger"]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FloorRoom:
    """A room as the file names it; what is empty is derived.

    It has a point, or an area, whose most open place becomes the point.
    """

    name: str
    point: Array = quantity(shape=("P",), unit="m", default=[])
    door: Array = quantity(shape=("D", 2), unit="m", default=[])  #: segment across the entrance
    area: Array = quantity(shape=("V", 2), unit="m", default=[])
    queue: Array = quantity(shape=("S", 2), unit="m", default=[])  #: waiting spots, head first
    capacity: int = quantity(low=1, default=1)
    service_time: float = quantity(low=0.0, unit="s", default=0.0)
    hold: Hold = "until_left"
    entry: Array = quantity(shape=("K", 2), unit="m", default=[])  #: from the door to the point
    release_area: Array = quantity(shape=("V", 2), unit="m", default=[])  #: free when left
    request_area: Array = quantity(shape=("V", 2), unit="m", default=[])  #: where robots ask


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FloorResource:
    """A corridor, door, lift or charger that robots pass on their way.

    Its area is exactly one of ``area`` and ``box``.
    """

    name: str
    kind: ResourceKind
    area: Array = quantity(shape=("V", 2), unit="m", default=[])
    box: Array = quantity(shape=("B",), unit="m", default=[])  #: x min, y min, x max, y max
    spots: Array = quantity(shape=("S", 2), unit="m", default=[])  #: waiting spots, head first
    capacity: int = quantity(low=1, default=1)
    service_time: float = quantity(low=0.0, unit="s", default=0.0)
    hold: Hold = "until_left"
    request_area: Array = quantity(shape=("V", 2), unit="m", default=[])  #: where robots ask


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FloorLane:
    """A way that the user wants driven as it is."""

    start: str  #: room name
    end: str  #: room name
    to_room: Array = quantity(shape=("K", 2), unit="m")  #: ends at the room point
    to_queue: Array = quantity(shape=("K", 2), unit="m", default=[])  #: ends at the last spot


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FloorShape:
    """A wall or piece of furniture: exactly one of ``line``, ``polygon`` and ``box``."""

    name: str = ""
    kind: str = "furniture"
    line: Array = quantity(shape=("K", 2), unit="m", default=[])
    thickness: float = quantity(above=0.0, high=5.0, unit="m", default=0.15)
    polygon: Array = quantity(shape=("V", 2), unit="m", default=[])
    box: Array = quantity(shape=("B",), unit="m", default=[])  #: x min, y min, x max, y max
    height: float = quantity(above=0.0, unit="m", default=3.0)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FloorFile:
    """The whole file."""

    name: str = ""
    map: str = ""  #: a Nav2 map beside this file
    unknown: Unknown = "solid"  #: what the map's unknown cells are
    least_patch: float = quantity(low=0.0, high=1.0, unit="m^2", default=0.0)  #: of the map
    sdf: str = ""  #: an SDF world beside this file
    skip: tuple[str, ...] = ()  #: models of the SDF world to leave out
    slice: Array = quantity(shape=(2,), low=0.0, unit="m", default=[0.05, 0.5])
    bounds: Array = quantity(shape=("B",), unit="m", default=[])
    walls: tuple[FloorShape, ...] = ()
    furniture: tuple[FloorShape, ...] = ()
    rooms: tuple[FloorRoom, ...] = ()
    lanes: tuple[FloorLane, ...] = ()
    resources: tuple[FloorResource, ...] = ()
    parking: Array = quantity(shape=("P", 2), unit="m", default=[])
    travel_times: Array = quantity(shape=("R", "R"), low=0.0, unit="s", default=[])
    spots: int = quantity(low=0, high=10, default=3)
