"""A world as files of Open-RMF: ``NAME.building.yaml`` and a script that dispatches its tasks.

The map is that of the traffic editor (``rmf_traffic_editor``): vertices ``[x, y, z, name,
{parameter: [type, value]}]``, lanes and walls between two of them by number. It is in metres
(``cartesian_meters``), x east and y north as here.
"""

from __future__ import annotations

import itertools
import math
import re
import shlex
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from shapely.geometry import Point, Polygon

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.durable import naming, write_atomically
from mrta_falsify.core.world import Resource, World
from simulator_interface.formats.building_file import METRES, typed

LEVEL = "L1"
FLEET = "tinyRobot"  # of rmf_demos, where a task names its robot
SAME_PLACE = 2  # decimals [m]: points that agree in them are one vertex


@dataclass(slots=True)
class _Graph:
    """The vertices, lanes and walls of a level."""

    vertices: list[list[Any]] = field(default_factory=list)
    lanes: list[list[Any]] = field(default_factory=list)
    walls: list[list[Any]] = field(default_factory=list)
    on_lanes: list[int] = field(default_factory=list)  #: vertices that robots drive on
    _known: dict[tuple[float, float, bool], int] = field(default_factory=dict)

    def vertex(self, point: Array, name: str = "", *, drives: bool = True, **facts: Any) -> int:
        """Give the number of the vertex at a point ``(2,)`` [m]; it is made if there is none."""
        x, y = (round(float(value), SAME_PLACE) for value in point[:2])
        key = (x, y, drives)
        if key not in self._known:
            self._known[key] = len(self.vertices)
            self.vertices.append([x, y, 0.0, name, {}])
            if drives:
                self.on_lanes.append(self._known[key])
        found = self.vertices[self._known[key]]
        found[3] = found[3] or name
        found[4].update(facts)
        return self._known[key]

    def connect(self, one: int, other: int, *, both_ways: bool, mutex: str) -> None:
        """Lay a lane, unless it is there or has no length."""
        facts: dict[str, Any] = {
            "bidirectional": typed(both_ways),
            "graph_idx": typed(0),
            "orientation": typed(""),
        }
        if mutex:
            facts["mutex"] = typed(mutex)
        lane = [one, other, facts]
        if one != other and lane not in self.lanes:
            self.lanes.append(lane)

    def nearest(self, number: int) -> int | None:
        """Find the nearest other vertex that robots drive on; None if there is none."""
        here = self.vertices[number][:2]
        others = [one for one in self.on_lanes if one != number]
        return min(others, key=lambda one: math.dist(self.vertices[one][:2], here), default=None)


def write_open_rmf(world: World, directory: Path) -> tuple[Path, ...]:
    """Write a building map and a dispatch script.

    Lanes are those of the world, or straight ones between the rooms of each task if it has none.
    A corridor, door or lift for one robot becomes a mutex of the lanes inside. Rooms are where
    goods are picked up and dropped off, starts are chargers, a room may be both. Furniture becomes
    walls. Tasks become patrols from the pick-up to the drop-off. Deadlines, service times, people,
    noise and events have no counterpart.

    Args:
        world: to write.
        directory: gets the files; must exist.

    Returns:
        The map and the script.

    Raises:
        PlaceError: a file cannot be written.
    """
    name = re.sub(r"[^A-Za-z0-9_-]+", "_", world.name) or "world"
    map_file, script = directory / f"{name}.building.yaml", directory / "dispatch.sh"
    text = yaml.safe_dump(building_map(world), default_flow_style=None, sort_keys=False)
    write_atomically(map_file, text.encode())
    write_atomically(script, dispatch_script(world).encode())
    with naming(script):
        script.chmod(0o755)
    return map_file, script


def building_map(world: World) -> dict[str, Any]:
    """Make the data of a building map."""
    graph = _Graph()
    for room in world.rooms:
        at = typed(room.name)
        graph.vertex(room.point, room.name, pickup_dispenser=at, dropoff_ingestor=at)
    areas = [
        (resource.name, Polygon(resource.request_area))
        for resource in world.resources
        if _is_single_file(resource)
    ]
    for points in _ways(world):
        numbers = [graph.vertex(point) for point in points]
        for one, other in itertools.pairwise(numbers):
            mutex = _mutex(areas, (graph.vertices[one], graph.vertices[other]))
            graph.connect(one, other, both_ways=not world.lanes, mutex=mutex)
    for robot in world.robots:
        start = graph.vertex(
            robot.pose[:2],
            f"start_{robot.name}",
            is_charger=typed(True),
            is_parking_spot=typed(True),
            spawn_robot_name=typed(robot.name),
            spawn_robot_type=typed("TinyRobot"),
        )
        nearest = graph.nearest(start)
        is_on_lane = any(start in lane[:2] for lane in graph.lanes)
        if nearest is not None and not is_on_lane:
            graph.connect(start, nearest, both_ways=True, mutex="")
    for outline in (*world.solid_polygons(), *(one.polygon for one in world.movable_furniture())):
        numbers = [graph.vertex(point, drives=False) for point in outline]
        ends = zip(numbers, [*numbers[1:], *numbers[:1]], strict=True)
        graph.walls += [[one, other, {}] for one, other in ends if one != other]
    x_min, y_min, x_max, y_max = world.bounds
    corners = [(x_min, y_min), (x_max, y_min), (x_max, y_max), (x_min, y_max)]
    floor = [graph.vertex(np.array(corner), drives=False) for corner in corners]
    return {
        "name": world.name,
        "coordinate_system": METRES,
        "levels": {
            LEVEL: {
                "elevation": 0.0,
                "vertices": graph.vertices,
                "lanes": graph.lanes,
                "walls": graph.walls,
                "floors": [{"parameters": {}, "vertices": floor}],
                "doors": [],
                "measurements": [],
                "models": [],
            }
        },
        "lifts": {},
    }


def dispatch_script(world: World) -> str:
    """Make a shell script that dispatches the tasks of a world by ``rmf_demos_tasks``."""
    lines = [
        "#!/bin/sh",
        f"# The tasks of {' '.join(world.name.split())} as patrols; -st: seconds from now.",
        f'FLEET="${{FLEET:-{FLEET}}}"',
    ]
    for task in sorted(world.tasks, key=lambda one: one.arrival):
        places = shlex.join([world.rooms[task.start].name, world.rooms[task.end].name])
        robot = f' -F "$FLEET" -R {shlex.quote(task.robot)}' if task.robot else ""
        lines.append(
            f"ros2 run rmf_demos_tasks dispatch_patrol -p {places} -n 1 "
            f"-st {math.ceil(task.arrival)}{robot} --use_sim_time"
        )
    return "\n".join(lines) + "\n"


def _is_single_file(resource: Resource) -> bool:
    return resource.kind in ("corridor", "door", "elevator") and resource.capacity == 1


def _ways(world: World) -> Iterable[list[Array]]:
    """Yield the way of each lane from room to room; of each task if there are no lanes."""
    points = [room.point for room in world.rooms]
    for lane in world.lanes:
        yield [points[lane.start], *lane.to_room, points[lane.end]]
    if not world.lanes:
        for start, end in sorted({(task.start, task.end) for task in world.tasks}):
            yield [points[start], points[end]]


def _mutex(areas: list[tuple[str, Polygon]], ends: Iterable[list[Any]]) -> str:
    """Name the resource that both ends of a lane lie in; empty if there is none."""
    places = [Point(end[0], end[1]) for end in ends]
    return next((name for name, area in areas if all(map(area.covers, places))), "")
