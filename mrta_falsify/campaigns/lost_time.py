"""Time that no trial is killed for, since more than one run was needed.

A trial whose stack hangs is run again, and a third time up to there. A failure of a stack in a
process of its own is run again to see whether it comes again. What that takes is told to the
executor, so that the limit of a trial's wall clock is for the rest.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

_listeners: list[Callable[[float], None]] = []


def tell_to(listener: Callable[[float], None]) -> None:
    """Let ``listener`` be told, from now on in this process, of wall-clock time [s]."""
    _listeners.append(listener)


@contextmanager
def untimed() -> Iterator[None]:
    """Tell that what is done meanwhile does not count, however it ends."""
    began = time.perf_counter()
    try:
        yield
    finally:
        tell(time.perf_counter() - began)


def tell(seconds: float) -> None:
    """Tell that a run of ``seconds`` [s] does not count."""
    for listener in _listeners:
        listener(seconds)
