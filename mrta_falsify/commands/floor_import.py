"""A user's building as a floor: roadways, waiting spots and parking derived, a scenario to begin.

The files that come out are made anew by every call, but for the scenario, which is the user's.
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import yaml

from mrta_falsify.commands.folders import Place, make_directory
from mrta_falsify.core import codec
from mrta_falsify.core.durable import write_atomically
from mrta_falsify.core.errors import ConfigError, FormatError, WorldError
from mrta_falsify.core.world import World, write_world

if TYPE_CHECKING:
    from mrta_falsify.core.arrays import Array
    from simulator_interface.formats.floor_yaml import Floor
    from simulator_interface.formats.map_walls import MapFacts

DEFAULT_RADIUS = 0.22  # m, the waffle's
SMALLEST_RADIUS, LARGEST_RADIUS = 0.05, 1.0  # m
MAX_ROBOTS = 4  # of the scenario
SLACK = 4.0  # times what one robot needs for a task, the most that the scenario allows it
LAST_ARRIVAL = 60.0  # s
LEAST_WALK = 5.0  # m between two places that a visitor goes to
PAUSE = (5.0, 20.0)  # s that it stays at each
MAX_NAMES = 8  # of rooms in a message

BUILDING_ENDING = ".building"  # of a building's name, before ``.yaml``
FLOOR_ENDING, DERIVED_ENDING = ".floor.json", ".derived.yaml"
PICTURE_ENDING, SCENARIO_ENDING = ".floor.png", ".scenic"


@dataclass(frozen=True, slots=True, kw_only=True)
class ImportedRoom:
    """What was found out about a room."""

    name: str
    point: tuple[float, float]  #: [m]
    door: float | None  #: width of its door [m]; null: it has none
    spots: int  #: waiting spots
    spots_given: bool  #: by the user's file


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ImportedFloor:
    """What an import made, and of what."""

    floor: Path  #: the layout, for ``param layout``
    scenario: Path
    derived: Path | None  #: file of the rooms with all that was derived; null: it was the input
    picture: Path
    scenario_kept: bool  #: the program was there already
    robot_radius: float  #: [m]
    size: tuple[float, float]  #: [m]
    walls: int
    rooms: tuple[ImportedRoom, ...]
    lanes: int
    lanes_given: int
    parking: int
    parking_given: bool
    longest_travel_s: float
    map: MapFacts | None  #: null: the floor is no map
    left_out: tuple[str, ...] = ()  #: what of a building has no counterpart
    warnings: tuple[str, ...]


def import_floor(
    map: Place,
    output: Place,
    *,
    rooms: Place | None = None,
    level: str | None = None,
    radius: float = DEFAULT_RADIUS,
    on_progress: Callable[[float, float], None] | None = None,
) -> ImportedFloor:
    """Make a floor of a Nav2 map with a file of rooms, and a scenario on it.

    Args:
        map: a Nav2 map (``.yaml``), an SDF world, a floor file, or an Open-RMF building
            (``.building.yaml``).
        output: directory for NAME.floor.json, NAME.floor.png, NAME.derived.yaml and
            NAME.scenic, NAME being that of the map; the scenario is never overwritten.
        rooms: a floor file with the rooms; None: NAME.rooms.yaml beside the map.
        level: of a building; None: the only one.
        radius: of the largest robot [m].
        on_progress: called with how many steps are done, and of how many.

    Raises:
        InputError: a file is missing or broken, or a room cannot be reached; nothing is
            written then.
    """
    from scenic_worlds.layouts.derivation import derive_layout  # noqa: PLC0415 - loads numba
    from scenic_worlds.layouts.passing import move_beside_lanes  # noqa: PLC0415 - loads numba
    from simulator_interface.formats.floor_yaml import read_floor  # noqa: PLC0415

    if not SMALLEST_RADIUS <= radius <= LARGEST_RADIUS:
        raise ConfigError(
            f"--radius is {radius} m; it must be {SMALLEST_RADIUS} to {LARGEST_RADIUS} m"
        )
    source = Path(map)
    read = read_floor(source, None if rooms is None else Path(rooms), level=level)
    if len(read.rooms) < 2:
        raise FormatError(_too_few_rooms(read))
    try:
        floor = move_beside_lanes(read, radius=radius)
        world = derive_layout(floor, radius=radius, on_progress=on_progress)
    except WorldError as error:
        raise WorldError(f"{read.source}: {error}") from None
    assert floor.source is not None
    folder = make_directory(Path(output))
    name = source.stem.removesuffix(BUILDING_ENDING)
    stem = folder / (name if level is None else f"{name}_{level}")
    paths = [Path(f"{stem}{ending}") for ending in (FLOOR_ENDING, PICTURE_ENDING, DERIVED_ENDING)]
    inputs = {source.resolve(), floor.source.resolve()}
    if {path.resolve() for path in paths[:2]} & inputs:
        raise FormatError(f"{folder}: would overwrite the input; choose another directory")
    derived = None if paths[2].resolve() in inputs else paths[2]
    scenario = Path(f"{stem}{SCENARIO_ENDING}")
    is_kept = scenario.exists()
    write_world(world, paths[0])
    if derived is not None:
        write_atomically(derived, _derived_text(floor, world).encode())
    if not is_kept:
        text = scenario_text(world, paths[0].name, radius=radius, starts=floor.starts)
        write_atomically(scenario, text.encode())
    _draw(world, paths[1])
    return _summary(
        floor,
        world,
        (paths[0], scenario, derived, paths[1]),
        is_kept=is_kept,
        radius=radius,
        moved=[
            f"{now.name} (by {np.hypot(*(now.point - before.point)):.1f} m)"
            for before, now in zip(read.rooms, floor.rooms, strict=True)
            if now is not before
        ],
    )


def _too_few_rooms(floor: Floor) -> str:
    (room,) = floor.rooms
    if floor.no_rooms:
        return (
            f"{floor.source}: has one place for tasks, {room.name!r}; deliveries need two. Left "
            f"out: {'; '.join(floor.no_rooms)} (give a second vertex on a lane a name)"
        )
    return (
        f"{floor.source}: names one room, {room.name!r}; deliveries need two (add "
        "{name: ..., point: [x, y]} to rooms)"
    )


def _draw(world: World, path: Path) -> None:
    from reports import contact_sheet  # noqa: PLC0415 - matplotlib loads slowly

    contact_sheet.write_floor_picture(world, path, without_door=_without_door(world))


# --- what is written -------------------------------------------------------------------------


def _derived_text(floor: Floor, world: World) -> str:
    """Write the user's floor file again, with doors, queues and parking where it has none."""
    from simulator_interface.formats import building_file  # noqa: PLC0415 - with the reader

    assert floor.source is not None
    data: dict[str, Any] = codec.read_yaml(
        floor.source, doubled="last", as_text=building_file.FIELDS
    )
    heading = (
        "# The rooms with all that was derived. Change what does not please, and import again\n"
        "# with --rooms and this file: what it says is kept. `lanes` may be given, too.\n"
    )
    if "rooms" not in data:  # a building
        data = _without_defaults(floor.described)
        numbers = {room.name: number for number, room in enumerate(world.rooms)}
        to_queue = {(lane.start, lane.end): lane.to_queue for lane in world.lanes}
        for given in data.get("lanes", []):
            _fill(given, "to_queue", to_queue[numbers[given["start"]], numbers[given["end"]]])
        heading = (
            "# The building as a floor file, with all that was derived. Change what does not\n"
            "# please, and import this file: what it says is kept.\n"
        )
    for given, room, resource in zip(data["rooms"], world.rooms, world.resources, strict=False):
        _fill(given, "point", room.point)
        _fill(given, "door", room.door)
        _fill(given, "queue", resource.spots)
    _fill(data, "parking", world.parking)
    # libyaml writes ten thousand lanes in a second, where it is there.
    dumper = getattr(yaml, "CSafeDumper", yaml.SafeDumper)
    return heading + yaml.dump(
        data,
        Dumper=dumper,
        sort_keys=False,
        allow_unicode=True,
        width=100,
        default_flow_style=None,
    )


def _without_defaults(value: Any) -> Any:
    """Encode a floor file with the fields that are not at their default, lengths to 1 mm."""
    if isinstance(value, np.ndarray):
        return np.round(value, 3).tolist()
    if isinstance(value, tuple):
        return [_without_defaults(item) for item in value]
    if not dataclasses.is_dataclass(value):
        return value
    found = {}
    for field in dataclasses.fields(value):
        item = getattr(value, field.name)
        if isinstance(item, (np.ndarray, tuple)):
            is_default = not len(item) or field.name == "slice"
        else:
            is_default = item == field.default
        if not is_default:
            found[field.name] = _without_defaults(item)
    return found


def _fill(given: dict[str, Any], field: str, points: Any) -> None:
    if not given.get(field) and len(points):
        given[field] = np.round(points, 3).tolist()


def scenario_text(
    world: World,
    floor_file: str,
    *,
    radius: float = DEFAULT_RADIUS,
    starts: Sequence[tuple[str, Array]] = (),
) -> str:
    """Write a small scenario on a floor: deliveries between its rooms, among a few people.

    Args:
        world: the floor; at least two rooms.
        floor_file: its file, beside the scenario.
        radius: of the robots [m].
        starts: name and place ``(2,)`` [m] of robots; empty: they start in rooms.
    """
    robots = len(starts) or min(MAX_ROBOTS, len(world.rooms))
    title = re.sub(r"[^\w .-]", "_", floor_file.removesuffix(FLOOR_ENDING))
    body = "" if radius == DEFAULT_RADIUS else f", with body_radius {radius!r}"
    longest = 2.0 * float(world.travel_times.max())
    horizon = 50 * int(np.ceil((LAST_ARRIVAL + SLACK * longest) / 50.0))
    return f'''"""Deliveries between the rooms of {title}, among a few people.

What it stresses: change this line when you know.
"""
param layout = localPath({floor_file!r})
param clear_of_doors = True
model scenic_worlds.model

{_robots_text(robots, starts, body)}

for i in range(2):
    new Human with name f'visitor{{i + 1}}',
        with route random_visits(2, least={LEAST_WALK:g}), with speed Range(0.6, 1.3),
        with pause Range({PAUSE[0]:g}, {PAUSE[1]:g})

# Deadlines: 2 to {SLACK:g} times what one robot needs alone.
param tasks = tight_deadlines({robots + 2}, between=(0, {LAST_ARRIVAL:g}), factor=(2, {SLACK:g}))
param horizon = {horizon}
'''


def _robots_text(robots: int, starts: Sequence[tuple[str, Array]], body: str) -> str:
    if not starts:
        first = f"for i in range({robots}):\n    new Robot"
        return f"{first} with name f'robot{{i + 1}}', with start_room i{body}"
    return "\n".join(
        f"new Robot at ({x:.3f}, {y:.3f}, 0.075), with name {name!r}{body}"
        for name, (x, y) in starts
    )


# --- what is told ----------------------------------------------------------------------------


def _summary(
    floor: Floor,
    world: World,
    paths: tuple[Path, Path, Path | None, Path],
    *,
    is_kept: bool,
    radius: float,
    moved: Sequence[str],
) -> ImportedFloor:
    rooms = tuple(
        ImportedRoom(
            name=room.name,
            point=(float(room.point[0]), float(room.point[1])),
            door=float(np.hypot(*(room.door[1] - room.door[0]))) if len(room.door) else None,
            spots=len(resource.spots),
            spots_given=bool(len(given.queue)),
        )
        for given, room, resource in zip(floor.rooms, world.rooms, world.resources, strict=False)
    )
    width, depth = (world.bounds[2:] - world.bounds[:2]).tolist()
    file, scenario, derived, picture = paths
    return ImportedFloor(
        floor=file,
        scenario=scenario,
        derived=derived,
        picture=picture,
        scenario_kept=is_kept,
        robot_radius=radius,
        size=(width, depth),
        walls=len(world.walls),
        rooms=rooms,
        lanes=len(world.lanes),
        lanes_given=len(floor.lanes),
        parking=len(world.parking),
        parking_given=bool(len(floor.parking)),
        longest_travel_s=float(world.travel_times.max()),
        map=floor.map_facts,
        left_out=floor.left_out,
        warnings=(
            *floor.notes,
            *_map_warnings(floor.map_facts),
            *_passing_notes(world, radius, moved),
            *_place_warnings(world, radius),
        ),
    )


def _map_warnings(facts: MapFacts | None) -> list[str]:
    remarks: list[str] = []
    if facts is None:
        return remarks
    if facts.doubtful:
        share = facts.doubtful / (facts.rows * facts.cols)
        remarks.append(
            f"{share:.1%} of the cells have the grey level 205, by which Nav2's saver marks "
            "unknown cells, and the map's free_thresh makes them free, as in Nav2; "
            "free_thresh: 0.196 makes them unknown"
        )
    if facts.specks:
        places = ", ".join(f"[{x:.2f}, {y:.2f}]" for x, y in facts.speck_places.tolist())
        more = ", ..." if facts.specks > len(facts.speck_places) else ""
        remarks.append(
            f"{facts.specks} solid specks (at {places}{more}) are obstacles; if they are "
            "noise, least_patch: 0.02 in the file of rooms leaves out what is smaller [m^2]"
        )
    return remarks


def _passing_notes(world: World, radius: float, moved: Sequence[str]) -> list[str]:
    """Say which rooms lie on the ways of others, and what was done about it."""
    from scenic_worlds.layouts.passing import is_mere_spot  # noqa: PLC0415 - loads numba

    remarks = []
    if moved:
        remarks.append(
            f"{', '.join(moved)}: others drive over the place, so its spot is beside the lane now"
        )
    spots = [room.name for room in world.rooms if is_mere_spot(room, radius)]
    if spots:
        remarks.append(
            f"{', '.join(spots)}: others drive past here and there is no room beside their way; a "
            "robot has only the spot where it stands, and others pass it or wait (give the room a "
            "point off the way if there is one)"
        )
    return remarks


def _without_door(world: World) -> list[str]:
    return [room.name for room in world.rooms if not len(room.door)]


def _place_warnings(world: World, radius: float) -> list[str]:
    from scenic_worlds.layouts.reach import closed_off_by_waiting  # noqa: PLC0415 - loads numba

    remarks = []
    open_rooms = _without_door(world)
    if open_rooms:
        remarks.append(
            f"no door was found between {_listed(open_rooms)} and the rest of the floor (marked in "
            "the picture): look at the area there, and give the room its door, two points, if it "
            "has one"
        )
    closed = closed_off_by_waiting(world, radius)
    if closed:
        remarks.append(
            f"robots on all waiting spots and parking places close off {_listed(closed)} (give "
            "queue or parking)"
        )
    waiting = [
        room.name
        for room, use in zip(world.rooms, world.resources, strict=False)
        if not len(use.spots)
    ]
    if waiting:
        remarks.append(
            f"no place to wait was found near {_listed(waiting)}: robots queue on the roadway "
            "there (give the room a queue if there is one)"
        )
    if not len(world.parking):
        remarks.append("no place to park was found: idle robots stay where they are")
    return remarks


def _listed(names: Sequence[str]) -> str:
    """List names, the first ones of many."""
    more = f" and {len(names) - MAX_NAMES} more" if len(names) > MAX_NAMES else ""
    return ", ".join(names[:MAX_NAMES]) + more
