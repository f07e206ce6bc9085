"""MRTA-Sim's own input files: task streams, robot starts, people's routes.

Reference: MRTA-Sim, figures "Example configuration file" and "Example of how to specify a
task request", and the files of its public repository.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mrta_falsify.core import codec
from mrta_falsify.core.arrays import Array, frozen_array
from mrta_falsify.core.codec import quantity
from mrta_falsify.core.errors import FormatError
from mrta_falsify.core.world import HumanSpec, RobotSpec, Room, Task
from simulator_interface.formats.task_entries import check_task_entry

NEAR_ROOM = 1.0  # m; a robot this near a room point already stands in that room


@dataclass(frozen=True, slots=True, kw_only=True)
class TaskStream:
    """A testcase file: the tasks, and in which room each robot starts."""

    tasks: tuple[Task, ...]  #: in the order of the file
    agents: tuple[int, ...]  #: start room number per robot; empty if the file names none


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RobotStart:
    """One entry of a robot setup file."""

    name: str
    pose: Array  #: (3,) x [m], y [m], yaw [rad], map frame


# --- the files' own shapes; decode checks fields, types and limits against these ----------


@dataclass(frozen=True, slots=True, kw_only=True)
class _TaskEntry:
    start: int = quantity(low=0)  #: room number of the pick-up
    end: int = quantity(low=0)  #: room number of the drop-off
    deadline: float = quantity(low=0.0, unit="s")  #: of the drop-off, absolute
    pickup_time: float = quantity(low=0.0, unit="s", default=0.0)  #: at the pick-up
    dropoff_time: float = quantity(low=0.0, unit="s", default=0.0)  #: at the drop-off


@dataclass(frozen=True, slots=True, kw_only=True)
class _Batch:
    arrival: float = quantity(low=0.0, unit="s")  #: known to the dispatcher from then on
    tasks: tuple[_TaskEntry, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class TaskFile:
    """A testcase file: tasks by their arrival."""

    tasks_stream: tuple[_Batch, ...]  #: tasks that arrive together, in any order
    agents: tuple[int, ...] = quantity(low=0, default=())  #: start room number of each robot


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Start:
    start: Array = quantity(shape=("K",), unit="m")


@dataclass(frozen=True, slots=True, kw_only=True)
class _Setup:
    agents: dict[str, _Start]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Route:
    route: Array = quantity(shape=("K", 2), unit="m")


# --- readers -----------------------------------------------------------------------------


def read_task_stream(path: Path, *, rooms: int) -> TaskStream:
    """Read tasks and start rooms of a testcase JSON (``tasks_stream``, ``agents``).

    Args:
        path: the file.
        rooms: number of rooms R of the world the tasks are meant for.

    Returns:
        Tasks in file order; deadlines are absolute times, as in MRTA-Sim.

    Raises:
        InputError: not such a file; a room outside 0..R-1; a deadline before its arrival.
    """
    data = _read(path)
    if isinstance(data, dict) and "tasks_stream" not in data:
        raise FormatError(
            f"{path}: tasks_stream is missing; a task file reads "
            '{"tasks_stream": [{"arrival": 0, "tasks": [{"start": 1, "end": 4, "deadline": 200}]}]}'
        )
    parsed = codec.decode(TaskFile, data, where=str(path))
    tasks = []
    for b, batch in enumerate(parsed.tasks_stream):
        for t, entry in enumerate(batch.tasks):
            field = f"tasks_stream[{b}].tasks[{t}]"
            check_task_entry(entry, batch.arrival, rooms, where=f"{path}: {field}")
            tasks.append(
                Task(
                    arrival=batch.arrival,
                    start=entry.start,
                    end=entry.end,
                    deadline=entry.deadline,
                    pickup_time=entry.pickup_time,
                    dropoff_time=entry.dropoff_time,
                )
            )
    for i, room in enumerate(parsed.agents):
        if room >= rooms:
            raise FormatError(f"{path}: agents[{i}] is room {room}; rooms are 0 to {rooms - 1}")
    return TaskStream(tasks=tuple(tasks), agents=parsed.agents)


def read_robot_setup(path: Path) -> tuple[RobotStart, ...]:
    """Read robot starts, JSON or YAML: ``agents: {robot1: {start: [x, y]}}``.

    A third number is the start yaw [rad]; without it the yaw is 0.

    Raises:
        InputError: not such a file, a start that is not two or three numbers, no robot.
    """
    data = _read(path)
    if isinstance(data, dict) and "agents" not in data:
        raise FormatError(
            f"{path}: agents is missing; a robot file reads agents: {{robot1: {{start: [0, 2.2]}}}}"
        )
    parsed = codec.decode(_Setup, data, where=str(path))
    if not parsed.agents:
        raise FormatError(f"{path}: agents is empty; it must name at least one robot")
    starts = []
    for name, entry in parsed.agents.items():
        if len(entry.start) not in (2, 3):
            raise FormatError(
                f"{path}: agents.{name}.start is {entry.start.tolist()}; "
                "it must be [x, y] or [x, y, yaw] in m and rad"
            )
        pose = frozen_array([*entry.start.tolist(), 0.0][:3])
        starts.append(RobotStart(name=name, pose=pose))
    return tuple(starts)


def read_human_routes(path: Path) -> tuple[HumanSpec, ...]:
    """Read people of a waypoint YAML: ``actor1: [[x, y], [x, y], ...]`` in map metres.

    Raises:
        InputError: not such a file, or a route that is not a list of points.
    """
    data = _read(path)
    if not isinstance(data, dict) or not data:
        raise FormatError(f"{path}: is not a waypoint file; it must map names to lists of [x, y]")
    humans = []
    for name, points in data.items():
        route = codec.decode(_Route, {"route": points}, where=f"{path}: {name}").route
        if len(route) == 0:
            raise FormatError(f"{path}: {name} is empty; a route needs at least one [x, y]")
        humans.append(HumanSpec(name=str(name), route=route))
    return tuple(humans)


def _read(path: Path) -> Any:
    """Read JSON or YAML; of a key that stands twice the last value counts, as in MRTA-Sim."""
    if path.suffix.lower() in (".yaml", ".yml"):
        return codec.read_yaml(path, doubled="last")
    return codec.read_json(path, doubled="last")


# --- onto a world --------------------------------------------------------------------------


def robots_at_rooms(
    robots: tuple[RobotSpec, ...], agents: tuple[int, ...], rooms: tuple[Room, ...]
) -> tuple[RobotSpec, ...]:
    """Place one robot per entry of ``agents``, robot i in room ``agents[i]``.

    A robot that already stands in its room keeps its pose, others move to the room point;
    missing robots are added with default properties, surplus ones left out.
    """
    placed = []
    for i, number in enumerate(agents):
        point = rooms[number].point
        known = robots[i] if i < len(robots) else None
        if known is not None and np.hypot(*(known.pose[:2] - point)) <= NEAR_ROOM:
            placed.append(known)
            continue
        pose = frozen_array([*point, known.pose[2] if known is not None else 0.0])
        placed.append(
            RobotSpec(name=_free_name(i, robots), pose=pose)
            if known is None
            else dataclasses.replace(known, pose=pose)
        )
    return tuple(placed)


def _free_name(index: int, robots: tuple[RobotSpec, ...]) -> str:
    taken = {robot.name for robot in robots}
    number = index + 1
    while f"robot{number}" in taken:
        number += 1
    return f"robot{number}"


def robots_from_setup(
    robots: tuple[RobotSpec, ...], starts: tuple[RobotStart, ...]
) -> tuple[RobotSpec, ...]:
    """Place the robots of a setup file; known names keep their other properties."""
    known = {robot.name: robot for robot in robots}
    return tuple(
        dataclasses.replace(known[start.name], pose=start.pose)
        if start.name in known
        else RobotSpec(name=start.name, pose=start.pose)
        for start in starts
    )
