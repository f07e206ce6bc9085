"""What must hold of a task in a task file, whichever simulator the file is for."""

from __future__ import annotations

from typing import Protocol

from mrta_falsify.core.errors import FormatError
from mrta_falsify.core.words import number_text


class TaskEntry(Protocol):
    """The fields that every task file has."""

    @property
    def start(self) -> int:
        """Number of the room to fetch from."""

    @property
    def end(self) -> int:
        """Number of the room to deliver to."""

    @property
    def deadline(self) -> float:
        """Absolute time [s]."""


def check_task_entry(entry: TaskEntry, arrival: float, rooms: int, *, where: str) -> None:
    """Refuse a task with a room that is not there, or with a deadline before its arrival.

    Args:
        entry: the task.
        arrival: of its batch [s].
        rooms: number of rooms R.
        where: what messages begin with.

    Raises:
        FormatError: names the field, what was given and what is allowed.
    """
    for field, room in (("start", entry.start), ("end", entry.end)):
        if room >= rooms:
            raise FormatError(f"{where}.{field} is room {room}; rooms are 0 to {rooms - 1}")
    if entry.deadline < arrival:
        raise FormatError(
            f"{where}.deadline is {number_text(entry.deadline)} s, before its arrival at "
            f"{number_text(arrival)} s; deadlines are absolute times"
        )
