"""Tasks of a sampled scene: the entries of ``param tasks``."""

from __future__ import annotations

from typing import Any

from mrta_falsify.core.errors import WorldError
from mrta_falsify.core.world import Task
from simulator_interface.scenic_bridge.scene_contract import ScenePlaces
from simulator_interface.scenic_bridge.scene_values import SceneRejected, naming, read_number

TASK_FORM = "(arrival, start room, end room, deadline[, pickup s[, dropoff s[, active]]])"


def read_tasks(entries: Any, places: ScenePlaces) -> tuple[Task, ...]:
    """Read the tasks of a program; those that are not active are left out.

    Raises:
        SceneRejected: a deadline comes before its arrival.
        InputError: an entry is not a task.
    """
    if isinstance(entries, str) or not hasattr(entries, "__len__"):
        raise WorldError(f"param tasks is {entries!r}; it must be a list of {TASK_FORM}")
    tasks = (_task(f"param tasks[{i}]", entry, places) for i, entry in enumerate(entries))
    return tuple(task for task in tasks if task is not None)


def _task(where: str, entry: Any, places: ScenePlaces) -> Task | None:
    """One task; None if it is not active."""
    if not isinstance(entry, (tuple, list)) or not 4 <= len(entry) <= 7:
        raise WorldError(f"{where} is {entry!r}; it must be {TASK_FORM}")
    if len(entry) == 7 and not entry[6]:
        return None
    arrival = read_number(entry[0], f"{where}: arrival")
    deadline = read_number(entry[3], f"{where}: deadline")
    services = [read_number(value, f"{where}: service time") for value in entry[4:6]]
    pickup, dropoff = [*services, 0.0, 0.0][:2]
    if min(arrival, pickup, dropoff) < 0.0:
        raise WorldError(f"{where} is {entry!r}; times must be >= 0 s")
    if deadline < arrival:
        raise SceneRejected(
            f"{where}: deadline {deadline:g} s is before its arrival at {arrival:g} s"
        )
    with naming(where):
        start, end = places.room_number(entry[1]), places.room_number(entry[2])
    return Task(
        arrival=arrival,
        start=start,
        end=end,
        deadline=deadline,
        pickup_time=pickup,
        dropoff_time=dropoff,
    )
