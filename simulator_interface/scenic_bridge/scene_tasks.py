"""Tasks of a sampled scene: the entries of ``param tasks``."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

from mrta_falsify.core.errors import WorldError
from mrta_falsify.core.words import number_text
from mrta_falsify.core.world import Task
from simulator_interface.scenic_bridge.scene_contract import ScenePlaces
from simulator_interface.scenic_bridge.scene_values import SceneRejected, naming, read_number

TASK_FORM = "(arrival, start room, end room, deadline[, pickup s[, dropoff s[, active[, robot]]]])"


def read_tasks(
    entries: Any, places: ScenePlaces, names: Mapping[int, str], absent: Collection[str] = ()
) -> tuple[Task, ...]:
    """Read the tasks of a program; those that are not active are left out.

    Args:
        entries: what the program gives.
        places: of the floor.
        names: of all objects, by ``id``; a task may name its robot by the object.
        absent: robots that are not active; their tasks are left out.

    Raises:
        SceneRejected: a deadline comes before its arrival.
        InputError: an entry is not a task.
    """
    if isinstance(entries, str) or not hasattr(entries, "__len__"):
        raise WorldError(f"param tasks is {entries!r}; it must be a list of {TASK_FORM}")
    tasks = (_task(f"param tasks[{i}]", entry, places, names) for i, entry in enumerate(entries))
    return tuple(task for task in tasks if task is not None and task.robot not in absent)


def _task(where: str, entry: Any, places: ScenePlaces, names: Mapping[int, str]) -> Task | None:
    """One task; None if it is not active."""
    if not isinstance(entry, (tuple, list)) or not 4 <= len(entry) <= 8:
        raise WorldError(f"{where} is {entry!r}; it must be {TASK_FORM}")
    if len(entry) >= 7 and not entry[6]:
        return None
    arrival = read_number(entry[0], f"{where}: arrival")
    deadline = read_number(entry[3], f"{where}: deadline")
    services = [read_number(value, f"{where}: service time") for value in entry[4:6]]
    pickup, dropoff = [*services, 0.0, 0.0][:2]
    if min(arrival, pickup, dropoff) < 0.0:
        raise WorldError(f"{where} is {entry!r}; times must be >= 0 s")
    if deadline < arrival:
        raise SceneRejected(
            f"{where}: deadline {number_text(deadline)} s is before its arrival at "
            f"{number_text(arrival)} s"
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
        robot=_robot(entry[7], where, names) if len(entry) == 8 else "",
    )


def _robot(given: Any, where: str, names: Mapping[int, str]) -> str:
    """Name of the robot that a task names by its name or as an object; empty: none."""
    if given is None or isinstance(given, str):
        return given or ""
    if getattr(given, "kind", "") != "robot":
        raise WorldError(f"{where}: robot is {given!r}; it must be a Robot or the name of one")
    return names[id(given)]
