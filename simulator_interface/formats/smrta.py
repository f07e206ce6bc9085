"""SMrTa's files: task streams, travel times, and its output ``agt / ts / td / t2a``.

Reference: SMrTa, "SMT-based dynamic multi-robot task allocation", and the files of its public
repository. A task file has whole seconds; each action takes one second of service.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mrta_falsify.core import codec
from mrta_falsify.core.allocation_problem import OpenTask, Stop
from mrta_falsify.core.arrays import Array, frozen_array
from mrta_falsify.core.codec import quantity
from mrta_falsify.core.errors import FormatError
from simulator_interface.formats.task_entries import check_task_entry

MAX_TASKS = 100_000  # of one file; the arrays of more would not fit a small machine
MAX_ROBOTS = 10_000
SERVICE = 1.0  # s per action, SMrTa's `+ 1` between two action points
UNITS = {"s": 1.0, "ms": 1e-3, "min": 60.0}


@dataclass(frozen=True, slots=True, kw_only=True)
class SmrtaCase:
    """A task file: start rooms of the robots, and batches of numbered tasks by arrival."""

    rooms: tuple[int, ...]  #: start room per robot
    arrivals: tuple[float, ...]  #: of the batches, in the order of the file [s]
    batches: tuple[tuple[OpenTask, ...], ...]  #: numbered through in the order of the file

    def position(self, number: int) -> tuple[int, int]:
        """Find the batch and the place in it of a task, both from 0."""
        for b, tasks in enumerate(self.batches):
            if number < len(tasks):
                return b, number
            number -= len(tasks)
        raise KeyError(number)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TravelTable:
    """Travel times between rooms, whole seconds, closed under shortest paths."""

    times: Array  #: (R, R) [s]
    shortened: int  #: entries that were longer than a way over other rooms


@dataclass(frozen=True, slots=True, kw_only=True)
class _TaskEntry:
    start: int = quantity(low=0)
    end: int = quantity(low=0)
    deadline: int = quantity(low=0, unit="s")
    pickup_time: int = quantity(low=0, unit="s", default=int(SERVICE))
    dropoff_time: int = quantity(low=0, unit="s", default=int(SERVICE))


@dataclass(frozen=True, slots=True, kw_only=True)
class _Batch:
    arrival: int = quantity(low=0, unit="s")
    tasks: tuple[dict[str, Any], ...]


def read_case(path: Path, *, rooms: int) -> SmrtaCase:
    """Read robots and batches of a task file (``tasks_stream``, ``agents``).

    Args:
        path: the file.
        rooms: number of rooms R of the travel times.

    Raises:
        InputError: not such a file, no robot, a room outside 0..R-1, a negative or fractional
            time, a deadline before its arrival, an id given twice, or too many tasks.
    """
    data = codec.read_json(path, doubled="last")
    if not isinstance(data, dict):
        raise FormatError(f"{path}: is {type(data).__name__}; a task file is an object")
    for field in ("tasks_stream", "agents"):
        if not isinstance(data.get(field), list):
            raise FormatError(
                f"{path}: {field} is missing or not a list; a task file reads "
                '{"agents": [0, 3], "tasks_stream": [{"arrival": 0, "tasks": '
                '[{"start": 1, "end": 4, "deadline": 200}]}]}'
            )
    unknown = sorted(set(data) - {"tasks_stream", "agents"})
    if unknown:
        raise FormatError(
            f"{path}: {codec.named(unknown[0])} is not a known field; Known: agents, tasks_stream"
        )
    start_rooms = _start_rooms(path, data["agents"], rooms)
    _check_size(path, data["tasks_stream"])
    arrivals, batches = [], []
    number = 0
    seen: dict[object, str] = {}
    for b, entry in enumerate(data["tasks_stream"]):
        batch = codec.decode(
            _Batch, _whole(entry, ("arrival",)), where=f"{path}: tasks_stream[{b}]"
        )
        tasks = []
        for t, fields in enumerate(batch.tasks):
            where = f"{path}: tasks_stream[{b}].tasks[{t}]"
            tasks.append(_task(fields, batch.arrival, number, rooms, where, seen))
            number += 1
        arrivals.append(float(batch.arrival))
        batches.append(tuple(tasks))
    return SmrtaCase(rooms=start_rooms, arrivals=tuple(arrivals), batches=tuple(batches))


def _check_size(path: Path, stream: list[Any]) -> None:
    count = sum(len(b["tasks"]) for b in stream if isinstance(b, dict) and _is_list(b, "tasks"))
    if count > MAX_TASKS:
        raise FormatError(f"{path}: has {count} tasks; at most {MAX_TASKS} in one file")


def _is_list(data: dict[str, Any], field: str) -> bool:
    return isinstance(data.get(field), list)


def _start_rooms(path: Path, agents: list[Any], rooms: int) -> tuple[int, ...]:
    if not agents:
        raise FormatError(f"{path}: agents is empty; it must name the start room of each robot")
    if len(agents) > MAX_ROBOTS:
        raise FormatError(f"{path}: has {len(agents)} robots; at most {MAX_ROBOTS}")
    for i, room in enumerate(agents):
        if isinstance(room, bool) or not isinstance(room, int):
            raise FormatError(
                f"{path}: agents[{i}] is {codec.shown(room)}; it must be a room number"
            )
        if not 0 <= room < rooms:
            raise FormatError(
                f"{path}: agents[{i}] is room {codec.shown(room)}; rooms are 0 to {rooms - 1}"
            )
    return tuple(agents)


def _whole(data: Any, fields: Sequence[str]) -> Any:
    """``data`` with times such as 80.0 as whole numbers; other fractions stay, and are refused."""
    if not isinstance(data, dict):
        return data
    return {
        key: int(value)
        if key in fields and isinstance(value, float) and value.is_integer()
        else value
        for key, value in data.items()
    }


def _task(
    fields: dict[str, Any],
    arrival: int,
    number: int,
    rooms: int,
    where: str,
    seen: dict[object, str],
) -> OpenTask:
    name = fields.get("id") if isinstance(fields, dict) else None
    rest = {k: v for k, v in fields.items() if k != "id"} if isinstance(fields, dict) else fields
    entry = codec.decode(
        _TaskEntry, _whole(rest, ("deadline", "pickup_time", "dropoff_time")), where=where
    )
    if name is not None:
        key = codec.shown(name)
        if key in seen:
            raise FormatError(f"{where}: id {codec.shown(name)} was given to {seen[key]} already")
        seen[key] = where.rpartition(": ")[2]
    check_task_entry(entry, arrival, rooms, where=where)
    return OpenTask(
        number=number,
        start=entry.start,
        end=entry.end,
        arrival=float(arrival),
        deadline=float(entry.deadline),
        pickup_time=float(entry.pickup_time),
        dropoff_time=float(entry.dropoff_time),
    )


def read_travel_times(path: Path) -> TravelTable:
    """Read ``{units, rooms, statistic, travel_time}``, as ``travel-times`` writes it.

    Times are rounded up to whole seconds and closed under shortest paths. They need not be
    symmetric.

    Raises:
        InputError: not such a file, a matrix that is not square or has gaps, a negative time.
    """
    data = codec.read_json(path, doubled="last")
    matrix = data.get("travel_time") if isinstance(data, dict) else data
    if not isinstance(matrix, list) or not matrix:
        raise FormatError(
            f'{path}: travel_time is missing; it reads {{"units": "s", "travel_time": [[0, 5], '
            "[4, 0]]}"
        )
    units = data.get("units", "s") if isinstance(data, dict) else "s"
    if not isinstance(units, str) or units not in UNITS:
        raise FormatError(
            f"{path}: units is {codec.shown(units)}; it must be one of {', '.join(UNITS)}"
        )
    names = data.get("rooms") if isinstance(data, dict) else None
    if isinstance(names, list) and len(names) != len(matrix):
        raise FormatError(f"{path}: rooms names {len(names)} rooms; travel_time has {len(matrix)}")
    times = np.zeros((len(matrix), len(matrix)))
    for i, row in enumerate(matrix):
        if not isinstance(row, list) or len(row) != len(matrix):
            given = len(row) if isinstance(row, list) else codec.shown(row)
            raise FormatError(f"{path}: travel_time[{i}] has {given} entries; not {len(matrix)}")
        for j, value in enumerate(row):
            times[i, j] = _seconds(value, UNITS[units], f"{path}: travel_time[{i}][{j}]")
    closed = _closed(times)
    np.fill_diagonal(closed, 0.0)
    return TravelTable(times=frozen_array(closed), shortened=int(np.sum(closed < times)))


def _seconds(value: Any, unit: float, where: str) -> float:
    if value is None:
        raise FormatError(f"{where} is null: no way is known; the matrix must be complete")
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise FormatError(f"{where} is {codec.shown(value)}; it must be a number")
    if not 0.0 <= value <= 1e9 / unit:
        raise FormatError(f"{where} is {codec.shown(value)}; it must be from 0 to 1e9 s")
    seconds = value * unit
    return float(math.ceil(seconds - 1e-9))


def _closed(times: Array) -> Array:
    closed = times.copy()
    for k in range(len(closed)):
        closed = np.minimum(closed, closed[:, k : k + 1] + closed[k : k + 1, :])
    return closed


# --- output ------------------------------------------------------------------------------


def smrta_plan(
    case: SmrtaCase, itineraries: Sequence[Sequence[Stop]], travel: Array
) -> dict[str, Any]:
    """Write a plan as SMrTa's allocator returns it.

    Action ids: ``i`` for robot i's start and "idle from here", ``n + 2 k`` and ``n + 2 k + 1``
    for pickup and drop of task k. Times are SMrTa's: the end of an action, one second of
    service included.

    Args:
        case: what was asked.
        itineraries: stops per robot.
        travel: ``(R, R)`` [s], closed.

    Returns:
        ``agt`` a list per robot of ``{t, c, id}`` lists over its action points; ``ts``, ``td``
        and ``t2a`` per batch: pickup time, drop time and robot of each task (-1: none).
    """
    n = len(case.rooms)
    count = sum(map(len, case.batches))
    start, end, robot = [-1] * count, [-1] * count, [-1] * count
    longest = max((len(stops) for stops in itineraries), default=0) + 1
    agents = []
    for r, stops in enumerate(itineraries):
        times, loads, ids = [0], [0], [r]
        for stop in stops:
            is_drop = stop.action == "dropoff"
            times.append(round(stop.time))
            loads.append(loads[-1] + (-1 if is_drop else 1))
            ids.append(n + 2 * stop.task + is_drop)
            (end if is_drop else start)[stop.task] = round(stop.time)
            robot[stop.task] = r
        idle = longest - len(times)
        horizon = round(2 * float(travel.max(initial=0.0))) + max(times)
        agents.append(
            {
                "t": times + [horizon] * idle,
                "c": loads + [loads[-1]] * idle,
                "id": ids + [r] * idle,
            }
        )
    return {
        "agt": agents,
        "ts": _by_batch(case, start),
        "td": _by_batch(case, end),
        "t2a": _by_batch(case, robot),
    }


def _by_batch(case: SmrtaCase, values: Sequence[int]) -> list[list[int]]:
    rows, first = [], 0
    for tasks in case.batches:
        rows.append(list(values[first : first + len(tasks)]))
        first += len(tasks)
    return rows
