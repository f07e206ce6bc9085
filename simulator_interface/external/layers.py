"""One layer of the shipped stack in a process of its own: ``--set allocator=exec:CMD``.

It is asked as the layer is called, and answers by a function of what it is told: it has no memory
that decides. So a copy of the run starts a process of its own, which needs to be told nothing.
"""

from __future__ import annotations

import dataclasses
import functools
import os
import weakref
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mrta_falsify.core import codec
from mrta_falsify.core.allocation_problem import Allocation, AllocationProblem, Stop
from mrta_falsify.core.arrays import IntArray
from mrta_falsify.core.codec import quantity
from mrta_falsify.core.errors import UnknownNameError
from mrta_falsify.core.external import ExternalStack, parse_exec
from mrta_falsify.core.protocols import PriorityView, Waiter
from mrta_falsify.process.ending import Ending
from mrta_falsify.stack.allocation.timing import (
    dropoff_of,
    pickup_of,
    timed_allocation,
    without_fleet,
)
from simulator_interface.external.answers import Wrong, shown
from simulator_interface.external.messages import Message
from simulator_interface.external.process import NO_ANSWER, StackProcess, why_no_answer


class LayerFailed(Exception):  # noqa: N818 - says what became of the layer
    """A layer in a process of its own did not answer, or not as the protocol says.

    Args:
        layer: which.
        ending: how.
    """

    def __init__(self, layer: str, ending: Ending) -> None:
        super().__init__(ending.of(layer))
        self.layer, self.ending = layer, ending


@dataclass(frozen=True, slots=True, kw_only=True)
class LayerOptions:
    """Limits of a layer in a process of its own."""

    tick_limit: float = quantity(above=0.0, unit="s", default=10.0)  #: for one answer
    start_limit: float = quantity(above=0.0, unit="s", default=60.0)  #: until it is ready


class ExternalLayer:
    """Asks a process; see the subclasses for what.

    Args:
        options: its limits.
    """

    LAYER = ""
    COMMAND: ExternalStack
    Options = LayerOptions

    def __init__(self, options: LayerOptions) -> None:
        self._options = options
        self._process: StackProcess | None = None
        self._owner = 0

    def _ask(self, message: Message) -> Message:
        """Ask; the answer is a message of the same type.

        Raises:
            LayerFailed: there is none.
        """
        process = self._running()
        limit = self._options.tick_limit
        try:
            process.wire.allow(limit)
            process.wire.send(message)
            answer = process.wire.receive()
            process.note_answer()
        except NO_ANSWER as error:
            raise self._failed(why_no_answer(error, limit, process)) from None
        if answer["type"] != message["type"]:
            text = f"`{message['type']}` was answered by {shown(answer['type'])}"
            raise self._failed(Ending("answer", text, cause="type"))
        return answer

    def _read(self, message: Message, read: Callable[[Message], Any]) -> Any:
        answer = self._ask(message)
        try:
            return read(answer)
        except Wrong as wrong:
            raise self._failed(Ending("answer", str(wrong), cause=wrong.field)) from None

    def _running(self) -> StackProcess:
        if self._process is None or self._owner != os.getpid():  # a copy of this process
            if self._process is not None:
                self._process.close()
            limit = self._options.start_limit
            self._process = StackProcess(dataclasses.replace(self.COMMAND, start_limit=limit))
            self._owner = os.getpid()
            weakref.finalize(self, self._process.close)
        return self._process

    def _failed(self, ending: Ending) -> LayerFailed:
        if ending.lines is None and self._process is not None:
            ending.lines = self._process.printed()
        return LayerFailed(self.LAYER, ending)


class ExternalAllocator(ExternalLayer):
    """``allocate``: the problem; answered by ``routes``, one list of stops per robot."""

    LAYER = "allocator"

    def allocate(self, problem: AllocationProblem) -> Allocation:
        """See :class:`~mrta_falsify.core.protocols.Allocator`."""
        if not problem.robots:
            return without_fleet(problem)
        message = {"type": "allocate", **codec.encode(problem)}
        routes = self._read(message, functools.partial(_routes, problem=problem))
        return timed_allocation(problem, routes)


def _routes(answer: Message, problem: AllocationProblem) -> list[list[Stop]]:
    """Read the stops of each robot: every task once at most, picked up before it is dropped."""
    rows = answer.get("routes")
    if not isinstance(rows, list) or len(rows) != len(problem.robots):
        raise Wrong("routes", f"must be a list of {len(problem.robots)} lists, one per robot")
    tasks = {task.number: task for task in problem.tasks}
    seen: set[tuple[int, str]] = set()
    routes = []
    for plan, row in zip(problem.robots, rows, strict=True):
        aboard, route = set(plan.onboard), []
        for stop in row if isinstance(row, list) else (None,):
            if not isinstance(stop, list) or len(stop) != 2 or stop[1] not in ("pickup", "dropoff"):
                raise Wrong("routes", f"has {shown(stop)}; a stop is [task, 'pickup' or 'dropoff']")
            number, action = stop
            if number not in tasks or (number, action) in seen:
                raise Wrong("routes", f"has {shown(stop)}: no open task, or named twice")
            if (action == "dropoff") != (number in aboard):
                raise Wrong("routes", f"has {shown(stop)}: picked up before it is dropped, once")
            seen.add((number, action))
            aboard.symmetric_difference_update({number})
            route.append((pickup_of if action == "pickup" else dropoff_of)(tasks[number]))
        if aboard:
            raise Wrong("routes", f"leaves task {min(aboard)} aboard a robot")
        routes.append(route)
    return routes


class ExternalQueuePolicy(ExternalLayer):
    """``order``: who waits; answered by ``robots``, the next holder first."""

    LAYER = "queue_policy"

    def order(self, waiters: Sequence[Waiter]) -> tuple[int, ...]:
        """See :class:`~mrta_falsify.core.protocols.QueuePolicy`."""
        known = sorted(waiter.robot for waiter in waiters)
        rows = [codec.encode(waiter) for waiter in waiters]
        read = functools.partial(_permutation, field="robots", of=known)
        return tuple(self._read({"type": "order", "waiters": rows}, read))


class ExternalPriorityRule(ExternalLayer):
    """``ranks``: what each robot is about; answered by ``ranks``, 0 first."""

    LAYER = "priority_rule"

    def ranks(self, view: PriorityView) -> IntArray:
        """See :class:`~mrta_falsify.core.protocols.PriorityRule`."""
        message = {
            "type": "ranks",
            "time": view.time,
            "pose": view.pose,
            "active": view.active.tolist(),
            "distance_to_goal": view.distance_to_goal,
            "waiting_since": view.waiting_since,
        }
        read = functools.partial(_permutation, field="ranks", of=list(range(len(view.pose))))
        return np.array(self._read(message, read), dtype=np.int64)


def _permutation(answer: Message, field: str, of: list[int]) -> list[int]:
    given = answer.get(field)
    numbers = given if isinstance(given, list) else []
    if any(type(number) is not int for number in numbers) or sorted(numbers) != of:
        raise Wrong(field, f"is {shown(given)}; it must be a permutation of {shown(of)}")
    return numbers


KINDS: dict[str, type[ExternalLayer]] = {
    kind.LAYER: kind for kind in (ExternalAllocator, ExternalQueuePolicy, ExternalPriorityRule)
}


@functools.cache
def external_layer(point: str, name: str) -> type[ExternalLayer]:
    """Make the component for a layer that runs as a command.

    Args:
        point: extension point.
        name: ``exec:CMD``.

    Raises:
        InputError: the layer cannot run outside, or there is no such program.
    """
    if point not in KINDS:
        raise UnknownNameError("layer that can run by exec:", point, KINDS)
    command = parse_exec(name, where=point, folder=Path.cwd())
    return type(f"Outside{KINDS[point].__name__}", (KINDS[point],), {"COMMAND": command})
