"""The world of one episode as plain data: the artefact of record.

A :class:`World` holds everything an episode needs and nothing that runs. A *layout* is a
world without robots, humans, tasks and events; :func:`dataclasses.replace` adds them.
All lengths in metres, angles in radians, times in seconds, in the map frame of REP-103.
"""

from __future__ import annotations

import dataclasses
import functools
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, Literal

import numpy as np

from mrta_falsify.core import codec
from mrta_falsify.core.arrays import Array
from mrta_falsify.core.codec import later, quantity
from mrta_falsify.core.directives import Directive
from mrta_falsify.core.durable import write_atomically
from mrta_falsify.core.errors import FormatError, WorldError
from mrta_falsify.core.geometry import transform
from mrta_falsify.core.words import number_text
from mrta_falsify.core.world_checks import check_world

SCHEMA_VERSION = 1

CRUISE = 0.75  # m/s, MRTA-Sim's nominal law: its gain of 1.5 1/s times the look-ahead of 0.5 m

#: what a communication outage can cut
LINKS = ("dispatcher", "planner", "states", "leader")
Link = Literal["dispatcher", "planner", "states", "leader"]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Wall:
    """A solid that belongs to the building."""

    name: str  #: unique among walls
    polygon: Array = quantity(shape=("V", 2), unit="m")  #: outline, counter-clockwise, map frame
    height: float = quantity(above=0.0, unit="m", default=3.0)
    traced: bool = False  #: outlined from the occupancy map itself, so left out of map scores


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Furniture:
    """A movable or built-in object that robots must not touch."""

    name: str  #: unique among furniture
    kind: str  #: for example "bed", "chair"
    polygon: Array = quantity(shape=("V", 2), unit="m")  #: footprint, counter-clockwise, map frame
    height: float = quantity(above=0.0, unit="m", default=1.0)
    mesh: str = ""  #: name of a mesh to draw, empty for the extruded footprint
    traced: bool = False  #: outlined from the occupancy map itself, so left out of map scores
    movable: bool = later(False)  #: has wheels, so that a person can push it; convex

    @property
    def center(self) -> Array:
        """Middle ``(2,)`` of the bounding box [m], map frame."""
        return np.asarray(0.5 * (self.polygon.min(axis=0) + self.polygon.max(axis=0)))

    def outline_at(self, pose: Array) -> Array:
        """Move the footprint ``(V, 2)`` [m] to ``pose`` ``(3,)``: centre, turn since the start."""
        return transform(self.polygon - self.center, pose)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Room:
    """A place that tasks name; its index in ``World.rooms`` is the room number."""

    name: str
    point: Array = quantity(shape=(2,), unit="m")  #: where pick-ups and drop-offs happen
    door: Array = quantity(shape=("D", 2), unit="m", default=[])  #: segment across the entrance
    area: Array = quantity(shape=("V", 2), unit="m", default=[])  #: outline, may be unknown


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Lane:
    """Right-hand way from one room to another."""

    start: int = quantity(low=0)  #: room number
    end: int = quantity(low=0)  #: room number
    to_queue: Array = quantity(shape=("K", 2), unit="m")  #: waypoints that end at the queue tail
    to_room: Array = quantity(shape=("K", 2), unit="m")  #: waypoints that end at the room point


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Resource:
    """Something at most ``capacity`` robots may use at once: a room, corridor, door, lift, charger.

    A robot asks for the resource when it is on its way there and inside ``request_area``;
    while others hold it, it waits at the first free spot. It lets go when it is outside
    ``release_area`` and no longer heading for the resource.
    """

    name: str
    kind: Literal["room", "corridor", "door", "elevator", "charger"] = "room"
    room: int | None = None  #: room number, for ``kind == "room"``
    capacity: int = quantity(low=1, default=1)
    spots: Array = quantity(shape=("S", 2), unit="m", default=[])  #: waiting spots, head first
    entry: Array = quantity(
        shape=("K", 2), unit="m", default=[]
    )  #: waypoints from head spot inside
    request_area: Array = quantity(shape=("V", 2), unit="m")  #: polygon
    release_area: Array = quantity(shape=("V", 2), unit="m")  #: polygon
    hold: Literal["until_left", "until_served"] = "until_left"  #: when the holder lets go
    service_time: float = quantity(low=0.0, unit="s", default=0.0)  #: occupied this long per visit


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RobotSpec:
    """A robot as the world describes it; never changes during an episode."""

    name: str  #: unique, used in traces and reports
    model: str = "waffle"  #: robot model (URDF and body) known to the engine
    pose: Array = quantity(shape=(3,), unit="m, m, rad")  #: start pose, map frame
    radius: float = quantity(above=0.0, unit="m", default=0.22)  #: planning radius
    max_speed: float = quantity(above=0.0, unit="m/s", default=1.5)
    max_acceleration: float = quantity(above=0.0, unit="m/s^2", default=1.0)
    max_turn_rate: float = quantity(above=0.0, unit="rad/s", default=2.0)
    capacity: int = quantity(low=1, default=2)  #: items carried at once
    position_noise: float = quantity(low=0.0, unit="m", default=0.0)  #: localisation, std per axis
    heading_noise: float = quantity(low=0.0, unit="rad", default=0.0)  #: localisation, std
    wheel_slip: float = quantity(
        low=0.0, high=0.9, default=0.0
    )  #: std of relative wheel speed loss
    command_latency: float = quantity(low=0.0, high=2.0, unit="s", default=0.0)
    joins_at: float = quantity(low=0.0, unit="s", default=0.0)  #: takes no task before this time
    #: speed on a straight way, up to ``max_speed``
    cruise_speed: float = quantity(above=0.0, unit="m/s", default=CRUISE, came_later=True)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class HumanSpec:
    """A person who walks a route, or does what the directives say one after the other.

    With directives, the first point of ``route`` is where the person begins, and the rest of
    the route, ``repeat`` and ``start`` do not matter. After the last directive it stands.
    """

    name: str  #: unique
    route: Array = quantity(shape=("K", 2), unit="m")  #: points visited in turn; K = 1: stands
    repeat: bool = True  #: start again at the first point after the last
    speed: float = quantity(low=0.0, unit="m/s", default=1.0)  #: desired walking speed
    radius: float = quantity(above=0.0, unit="m", default=0.25)
    reacts_to_robots: bool = True
    start: float = quantity(
        low=0.0, high=1.0, default=0.0
    )  #: share of the route's length walked at 0
    appears_at: float = quantity(low=0.0, unit="s", default=0.0)
    leaves_at: float = quantity(low=0.0, unit="s", allow_infinite=False, default=1e9)
    directives: tuple[Directive, ...] = later(())
    body: Literal["person", "robot"] = later("person")  #: "robot": scripted, not of the fleet
    #: stands so long at each point of the route before it walks on
    pause: float = quantity(low=0.0, unit="s", default=0.0, came_later=True)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Task:
    """One delivery; its index in ``World.tasks`` is the task number."""

    arrival: float = quantity(low=0.0, unit="s")  #: known to the dispatcher from then on
    start: int = quantity(low=0)  #: room number of the pick-up
    end: int = quantity(low=0)  #: room number of the drop-off
    deadline: float = quantity(low=0.0, unit="s")  #: absolute time of the drop-off
    pickup_time: float = quantity(low=0.0, unit="s", default=0.0)  #: service time
    dropoff_time: float = quantity(low=0.0, unit="s", default=0.0)  #: service time
    robot: str = later("")  #: name of the only robot that may serve it, empty: any


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Blockage:
    """A solid that stands in the way for a time."""

    KIND: ClassVar[str] = "blockage"
    kind: Literal["blockage"] = "blockage"
    name: str
    polygon: Array = quantity(shape=("V", 2), unit="m")  #: counter-clockwise, map frame
    start: float = quantity(low=0.0, unit="s")
    end: float = quantity(low=0.0, unit="s")
    height: float = quantity(above=0.0, unit="m", default=1.0)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CommsOutage:
    """Named links of some robots that are down for a time."""

    KIND: ClassVar[str] = "comms_outage"
    kind: Literal["comms_outage"] = "comms_outage"
    name: str
    robots: tuple[str, ...]  #: robot names; empty means all
    links: tuple[Link, ...] = LINKS  # type: ignore[assignment]
    start: float = quantity(low=0.0, unit="s")
    end: float = quantity(low=0.0, unit="s")


Event = Blockage | CommsOutage


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class World:
    """Everything one episode needs."""

    schema: int = SCHEMA_VERSION
    name: str
    bounds: Array = quantity(shape=(4,), unit="m")  #: x min, y min, x max, y max
    walls: tuple[Wall, ...] = ()
    furniture: tuple[Furniture, ...] = ()
    rooms: tuple[Room, ...] = ()
    lanes: tuple[Lane, ...] = ()
    resources: tuple[Resource, ...] = ()
    parking: Array = quantity(shape=("P", 2), unit="m", default=[])  #: spots for idle robots
    travel_times: Array = quantity(shape=("R", "R"), low=0.0, unit="s", default=[])  #: room to room
    robots: tuple[RobotSpec, ...] = ()
    humans: tuple[HumanSpec, ...] = ()
    tasks: tuple[Task, ...] = ()
    events: tuple[Event, ...] = ()
    horizon: float = quantity(
        above=0.0, unit="s", default=900.0
    )  #: an episode ends here at the latest
    ray_noise: float = quantity(low=0.0, unit="m", default=0.0)  #: std of obstacle distances
    seed: int = quantity(low=0, default=0)  #: of all noise inside the episode
    scripted: str = later("")  #: what of its Scenic program it cannot do without, empty: nothing
    #: parameters of a foreign stack by name, over those of its file; the shipped stack has none
    stack_params: dict[str, float] = later(dict)

    def __repr__(self) -> str:
        """Write it in one line."""
        counts = ("robots", "humans", "furniture", "tasks", "events")
        told = ", ".join(f"{len(getattr(self, name))} {name}" for name in counts)
        return f"<World {self.name}: {told}, {number_text(self.horizon)} s>"

    def digest(self) -> str:
        """Compute the sha256 of the canonical JSON; kept for the last few worlds."""
        return _digest_of(self)

    def solid_polygons(self) -> tuple[Array, ...]:
        """List the outlines ``(V, 2)`` [m] of walls, then of furniture that is not movable."""
        walls = tuple(wall.polygon for wall in self.walls)
        return walls + tuple(item.polygon for item in self.furniture if not item.movable)

    def movable_furniture(self) -> tuple[Furniture, ...]:
        """List the furniture that can be pushed, in the order of ``furniture``."""
        return tuple(item for item in self.furniture if item.movable)

    def is_over(self, time: float, dt: float) -> bool:
        """Whether an episode ends at ``time`` [s], a multiple of the control period ``dt`` [s]."""
        return time >= self.horizon - 0.5 * dt

    def __post_init__(self) -> None:
        if self.schema != SCHEMA_VERSION:
            raise WorldError(f"schema is {self.schema}; this version reads {SCHEMA_VERSION}")
        check_world(self)


@functools.lru_cache(maxsize=4)
def _digest_of(world: World) -> str:
    return codec.digest(world)


def read_world(path: str | Path) -> World:
    """Read a world from a JSON file.

    Raises:
        InputError: the file cannot be read, is not JSON, or breaks the schema.
    """
    data = codec.read_json(Path(path))
    if not isinstance(data, dict) or "bounds" not in data:
        raise FormatError(f"{path}: is not a world file (no field `bounds`)")
    return codec.decode(World, data, where=str(path))


def write_world(world: World, path: str | Path) -> None:
    """Write ``world`` as canonical JSON; two equal worlds give equal bytes."""
    write_atomically(Path(path), (codec.canonical_json(world) + "\n").encode())


def without_actors(world: World) -> World:
    """Strip ``world`` to its layout: no robots, humans, tasks or events."""
    return dataclasses.replace(world, robots=(), humans=(), tasks=(), events=())
