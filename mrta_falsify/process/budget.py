"""What a child may use, and credit for what is not the fault of its job.

A trial whose stack hangs is run again, and a third time up to that tick. A failure of a foreign
stack is run again to see whether it comes again. Each such run has the whole budget.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from mrta_falsify.core.stack_failure import StackLimits

START_LIMIT = 300.0  # s for a child to import and compile, of its own work and sleep


@dataclass(frozen=True, slots=True, kw_only=True)
class Budget:
    """What a child may use."""

    #: work and sleep of the child, and of all that it has started, for one tick or one job [s]
    work: float = math.inf
    memory: float = math.inf  #: resident memory that it may take up [GiB]
    start: float = START_LIMIT  #: work and sleep until it is ready [s]

    @classmethod
    def of_stack(cls, limits: StackLimits) -> Budget:
        """Give the budget of a stack for one tick."""
        return cls(work=limits.tick, memory=limits.memory)


_listeners: list[Callable[[], None]] = []


def on_credit(listener: Callable[[], None]) -> None:
    """Call ``listener``, from now on in this process, whenever its job is given credit."""
    _listeners.append(listener)


def credit() -> None:
    """Give the job of this process its whole budget again, whatever it has used so far."""
    for listener in _listeners:
        listener()


@contextmanager
def own_budget() -> Iterator[None]:
    """Give what is done inside a budget of its own, however it ends."""
    credit()
    try:
        yield
    finally:
        credit()
