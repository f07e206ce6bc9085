"""What a foreign stack answers when it is asked the same again.

A fork of it is asked one tick. A fresh process is told everything from the start.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from mrta_falsify.core.stack_failure import DeterminismCheck, OtherAnswer
from simulator_interface.external.branching import CannotBranch, MessageLog
from simulator_interface.external.messages import Message
from simulator_interface.external.process import NO_ANSWER
from simulator_interface.external.wire import Wire

FIRST_COMPARED = ("type", "twist")  # fields of an answer; the others follow by name
MAX_TEXT = 200  # characters of a value that are kept


class Exchange(NamedTuple):
    """Two answers of a stack in the middle of a tick."""

    tick: Message  #: as it was asked; empty: the one of the moment
    first: Message
    again: Message


def run_again(
    wire: Wire,
    exchanges: MessageLog,
    names: Sequence[str],
    *,
    limits: tuple[float, float],
    most_ticks: float,
) -> DeterminismCheck:
    """Say everything again to a fresh process, and compare what it answers.

    Args:
        wire: to it.
        exchanges: all that was said and heard.
        names: of the robots.
        limits: [s] for the first answer, and for each other one.
        most_ticks: that it is asked.

    Raises:
        CannotBranch: it does not go on, or what was said is not kept.
    """
    limit, ticks, tick = limits[0], 0, {"tick": 0, "time": 0.0}
    try:
        for said, heard in exchanges.all():
            message = wire.read(said)
            if message["type"] == "tick":
                if ticks >= most_ticks:
                    break
                ticks, tick = ticks + 1, message
            wire.allow(limit)
            wire.send_bytes(said)
            again = wire.receive_bytes()
            limit = limits[1]
            if again == heard:
                continue
            other = other_answer(Exchange(tick, wire.read(heard), wire.read(again)), names)
            if other is not None:
                return DeterminismCheck(difference=other, ticks=ticks)
    except NO_ANSWER as error:
        raise no_further(error) from None
    return DeterminismCheck(ticks=ticks)


def no_further(error: Exception) -> CannotBranch:
    """Say why a fresh process could not be told everything."""
    text = str(error) or type(error).__name__
    return CannotBranch(f"a fresh process of the stack does not go on: {text}")


def other_answer(exchange: Exchange, names: Sequence[str]) -> OtherAnswer | None:
    """Find the first field in which two answers differ, and the first robot in it.

    Args:
        exchange: with answers that are not the same bytes.
        names: of the robots.

    Returns:
        None if all values are equal, and only written otherwise.
    """
    tick, first, again = exchange
    fields = sorted({*first, *again}, key=lambda name: (name not in FIRST_COMPARED, name))
    for field in fields:
        one, other = first.get(field), again.get(field)
        if one == other:
            continue
        robot, one, other = _first_robot(one, other, len(names))
        return OtherAnswer(
            field=field,
            robot=names[robot] if robot >= 0 else "",
            first=_text(one),
            again=_text(other),
            tick=tick.get("tick", -1),
            time=tick.get("time", 0.0),
        )
    return None


def _first_robot(one: Any, other: Any, robots: int) -> tuple[int, Any, Any]:
    """Find the first robot whose share of two values differs, -1: they are not by robot."""
    for robot, a, b in _by_robot(one, other, robots):
        if a != b:
            return robot, a, b
    return -1, one, other


def _by_robot(one: Any, other: Any, robots: int) -> Iterator[tuple[int, Any, Any]]:
    """Yield what two values of a field say of each robot, as far as they are by robot."""
    one, other = _as_rows(one, robots), _as_rows(other, robots)
    if not (isinstance(one, list) and isinstance(other, list)):
        return
    if len(one) == len(other) == robots:
        yield from zip(range(robots), one, other, strict=True)
        return
    said, again = _pairs(one, robots), _pairs(other, robots)
    for robot in sorted({*said, *again}):
        yield robot, said.get(robot), again.get(robot)


def _as_rows(value: Any, robots: int) -> Any:
    """Read an array of float64 as one row per robot, if it is one."""
    if not isinstance(value, bytes) or not robots or len(value) % (8 * robots):
        return value
    rows: list[Any] = np.frombuffer(value).reshape(robots, -1).tolist()
    return rows


def _pairs(rows: list[Any], robots: int) -> dict[int, Any]:
    """Read a list of pairs of robot and value; empty if it is none."""
    pairs = [row for row in rows if isinstance(row, list) and len(row) == 2]
    found = {r: value for r, value in pairs if isinstance(r, int) and 0 <= r < robots}
    return found if len(found) == len(rows) else {}


def _text(value: Any) -> str:
    if value is None:
        return "nothing"
    if isinstance(value, bytes) and len(value) % 8 == 0:
        value = np.frombuffer(value).tolist()
    return str(value)[:MAX_TEXT]
