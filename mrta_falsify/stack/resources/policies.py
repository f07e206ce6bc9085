"""Queue policies: who gets a resource next."""

from __future__ import annotations

import operator
from collections.abc import Sequence

from mrta_falsify.core.protocols import Waiter
from mrta_falsify.core.registry import WithoutOptions

_robot_of = operator.attrgetter("robot")
_arrival_of = operator.attrgetter("since", "robot")
_urgency_of = operator.attrgetter("deadline", "since", "robot")


class Fifo(WithoutOptions):
    """First come, first served; robot numbers break ties."""

    def order(self, waiters: Sequence[Waiter]) -> tuple[int, ...]:
        """See :class:`~mrta_falsify.core.protocols.QueuePolicy`."""
        return tuple(map(_robot_of, sorted(waiters, key=_arrival_of)))


class DeadlineFirst(WithoutOptions):
    """The robot whose next drop-off is due first; arrival order breaks ties."""

    def order(self, waiters: Sequence[Waiter]) -> tuple[int, ...]:
        """See :class:`~mrta_falsify.core.protocols.QueuePolicy`."""
        return tuple(map(_robot_of, sorted(waiters, key=_urgency_of)))
