"""Queue policies: who gets a resource next."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from mrta_falsify.core.protocols import Waiter


@dataclass(frozen=True, slots=True, kw_only=True)
class _NoOptions:
    """Nothing to choose."""


class Fifo:
    """First come, first served; robot numbers break ties."""

    Options = _NoOptions

    def __init__(self, options: _NoOptions) -> None:
        self._options = options

    def order(self, waiters: Sequence[Waiter]) -> tuple[int, ...]:
        """See :class:`~mrta_falsify.core.protocols.QueuePolicy`."""
        ordered = sorted(waiters, key=lambda waiter: (waiter.since, waiter.robot))
        return tuple(waiter.robot for waiter in ordered)


class DeadlineFirst:
    """The robot whose next drop-off is due first; arrival order breaks ties."""

    Options = _NoOptions

    def __init__(self, options: _NoOptions) -> None:
        self._options = options

    def order(self, waiters: Sequence[Waiter]) -> tuple[int, ...]:
        """See :class:`~mrta_falsify.core.protocols.QueuePolicy`."""
        ordered = sorted(waiters, key=lambda w: (w.deadline, w.since, w.robot))
        return tuple(waiter.robot for waiter in ordered)
