"""The stack is asked a tick again in a copy of the process, and must answer the same.

The copy has the same memory and input, but no more than that is promised to a stack. So the copy
shows another time of day, other states of the global random generators, and asks twice. Then
answers differ that come from a clock, from unseeded randomness, or from memory outside the
stack's state.
"""

from __future__ import annotations

import contextlib
import copy
import gc
import random
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from mrta_falsify.core.config import StackConfig
from mrta_falsify.core.fleet import FleetState
from mrta_falsify.core.protocols import FleetStack, Repeating
from mrta_falsify.core.stack_failure import DeterminismCheck, OtherAnswer
from mrta_falsify.process.child import can_fork
from mrta_falsify.process.ending import Ending
from mrta_falsify.process.supervisor import run_supervised
from mrta_falsify.process.watch import current_watch
from simulator_interface.stack_calls import Answer

CLOCKS = ("time", "monotonic", "perf_counter")
LATER = 12_345.678  # s by which the clocks of a copy are wrong
JUNK = 1000  # objects that a copy makes before, so that new ones lie elsewhere
MAX_TEXT = 200  # characters of a value that are kept


class Answered(NamedTuple):
    """An answer of the stack, in parts that can be compared and sent."""

    command: np.ndarray  #: (N, 3)
    intent: dict[str, Any]
    events: tuple[str, ...]
    state: str  #: digest of the memory for the next tick


def repeats_of(specifications: Iterable[object], config: StackConfig) -> Callable[[int], bool]:
    """Collect the ticks that specifications want to be asked again: those any of them wants.

    None are where processes cannot be copied safely, or with a window open.
    """
    wanting = [one for one in specifications if isinstance(one, Repeating)]
    if not can_fork() or config.engine.options.get("gui", False):
        wanting = []
    if len(wanting) == 1:
        return wanting[0].asks_again
    return lambda tick: any(one.asks_again(tick) for one in wanting)


def ask_again(
    stack: FleetStack, state: Any, fleet: FleetState, names: Sequence[str]
) -> Callable[[Answer], DeterminismCheck]:
    """Ask the stack a tick in a copy of this process, twice; here it has not been asked yet.

    Args:
        stack: to ask.
        state: its memory.
        fleet: what it sees.
        names: of the robots.

    Returns:
        What compares its answer here with those of the copy.
    """
    asked = partial(_ask_twice, stack, state, fleet)
    again: list[Answered] | str
    try:
        again = run_supervised(asked)
    except Ending as failed:
        again = str(failed)
    return lambda answer: compared(answer, again, names)


def _ask_twice(stack: FleetStack, state: Any, fleet: FleetState) -> list[Answered] | str:
    gc.disable()  # a collection would touch, and so copy, all memory
    random.seed()
    np.random.seed()  # noqa: NPY002 - the stack's own global state is what is tried
    for name in CLOCKS:
        _set_wrong(name)
    junk = [object() for _ in range(JUNK)]
    here = current_watch()
    here.enter(fleet.tick, fleet.time)
    try:
        memories = [state]
        with contextlib.suppress(Exception):  # a controller need not allow it
            memories.insert(0, copy.deepcopy(state))
        answers = [answered(stack.step(memory, fleet)) for memory in memories]
    except BaseException as error:
        return f"{type(error).__name__}: {error}"[:MAX_TEXT]
    finally:
        here.leave()
    del junk
    return answers


def _set_wrong(clock: str) -> None:
    """Let a clock of this process show another time; differences of times stay right."""
    right, right_ns = getattr(time, clock), getattr(time, f"{clock}_ns")
    setattr(time, clock, lambda: right() + LATER)
    setattr(time, f"{clock}_ns", lambda: right_ns() + int(LATER * 1e9))


def answered(answer: Answer) -> Answered:
    """Take an answer apart."""
    state, command, intent, events = answer
    return Answered(
        command=np.array(command.twist),
        intent={name: getattr(intent, name) for name in intent.__slots__},
        events=tuple(map(repr, events)),
        state=state.digest(),
    )


# --- what differs --------------------------------------------------------------------------


def compared(answer: Answer, again: list[Answered] | str, names: Sequence[str]) -> DeterminismCheck:
    """Compare the answer to a tick with those of :func:`ask_again`.

    Args:
        answer: of the stack in this process.
        again: the other answers, or how the stack failed in the copy.
        names: of the robots.
    """
    if isinstance(again, str):
        return DeterminismCheck(
            difference=OtherAnswer(field="answer", first="an answer", again=again)
        )
    here = answered(answer)
    for other in again:
        for difference in _differences(here, other, names):
            return DeterminismCheck(difference=difference)
    return DeterminismCheck()


def _differences(one: Answered, other: Answered, names: Sequence[str]) -> Iterator[OtherAnswer]:
    """Find what differs: the command first, then what the stack says, then its memory."""
    rows = {"command": (one.command, other.command)}
    rows |= {f"intent.{name}": (one.intent[name], other.intent[name]) for name in one.intent}
    for field, (first, again) in rows.items():
        for robot, name in enumerate(names):
            a, b = first[robot], again[robot]
            if not _same(a, b):
                yield OtherAnswer(field=field, robot=name, first=_text(a), again=_text(b))
    if one.events != other.events:
        yield OtherAnswer(field="events", first=_text(one.events), again=_text(other.events))
    if one.state != other.state:
        yield OtherAnswer(field="state", first=one.state[:16], again=other.state[:16])


def _same(one: Any, other: Any) -> bool:
    if isinstance(one, str):
        return bool(one == other)
    a, b = np.asarray(one), np.asarray(other)
    return a.shape == b.shape and a.tobytes() == b.tobytes()


def _text(value: Any) -> str:
    text = str(value.tolist()) if isinstance(value, np.ndarray | np.generic) else str(value)
    return text[:MAX_TEXT]
