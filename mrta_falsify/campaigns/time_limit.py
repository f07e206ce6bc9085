"""The time limit of a trial, which begins anew with each run that comes on top of its own.

A trial whose stack hangs is run again, and a third time up to there. A failure of a stack in a
process of its own is run again to see whether it comes again. Each such run has the whole limit.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

_listeners: list[Callable[[], None]] = []


def tell_to(listener: Callable[[], None]) -> None:
    """Let ``listener`` be told, from now on in this process, that the limit begins anew."""
    _listeners.append(listener)


def begin_anew() -> None:
    """Let the limit begin anew."""
    for listener in _listeners:
        listener()


@contextmanager
def with_its_own() -> Iterator[None]:
    """Give what is done meanwhile a limit of its own, however it ends."""
    begin_anew()
    try:
        yield
    finally:
        begin_anew()
