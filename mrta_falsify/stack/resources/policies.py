"""Queue policies: who gets a resource next."""

from __future__ import annotations

import operator
from collections.abc import Sequence
from dataclasses import dataclass

from mrta_falsify.core.protocols import Waiter

_robot_of = operator.attrgetter("robot")
_arrival_of = operator.attrgetter("since", "robot")
_urgency_of = operator.attrgetter("deadline", "since", "robot")


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
        return tuple(map(_robot_of, sorted(waiters, key=_arrival_of)))


class DeadlineFirst:
    """The robot whose next drop-off is due first; arrival order breaks ties."""

    Options = _NoOptions

    def __init__(self, options: _NoOptions) -> None:
        self._options = options

    def order(self, waiters: Sequence[Waiter]) -> tuple[int, ...]:
        """See :class:`~mrta_falsify.core.protocols.QueuePolicy`."""
        return tuple(map(_robot_of, sorted(waiters, key=_urgency_of)))
