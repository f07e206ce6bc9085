"""What the deadlock oracle looks for in a forecast: progress, or robots that go free.

A *continuation* is a copy of the run that goes on without outside events. A *counterfactual* is
a continuation without one of the robots.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from mrta_falsify.core import codec
from mrta_falsify.core.arrays import Array
from mrta_falsify.core.fleet import Frame
from mrta_falsify.specs.deadlock.progress_clock import ProgressClock
from mrta_falsify.specs.deadlock.rest import ALL_REST_FOR, LastingRest

WATCH_STRIDE = 2  # ticks between two looks
STAYS_WITHIN = 0.5  # m; a robot that stays within this of one place stands, even if it shuffles ...
STAYS_FOR = 60.0  # s ... for so long at the end of a forecast
FREE_BEYOND = 1.0  # m from its place: a robot has gone free


@dataclass(frozen=True, slots=True, kw_only=True)
class ContinuationAnswer:
    """What a continuation showed; robots by number, as text."""

    stuck: dict[str, float]  #: last progress of each robot that stands for good [s]
    freed: dict[str, float]  #: when each robot in question made progress [s]
    looked: float  #: end of the continuation [s]


@dataclass(frozen=True, slots=True, kw_only=True)
class CounterfactualAnswer:
    """What a counterfactual showed."""

    freed: tuple[int, ...]  #: robots that went free


class ContinuationWatch:
    """Watches which robots still make progress before ``until``, and which never again.

    Args:
        progress: of the run so far; the watch advances it, so it belongs into a copy.
        asked: robots in question; the watch ends once all of them have made progress.
        settled: before this time, rest means nothing [s].
        until: [s].
    """

    def __init__(
        self, progress: ProgressClock, asked: Iterable[int], *, settled: float, until: float
    ) -> None:
        self._progress = progress
        self._asked = sorted(asked)
        self._settled = settled
        self._until = until
        self._rest = LastingRest()
        self._before = progress.last.copy()
        self._freed: dict[int, float] = {}
        self._with_goal = np.zeros(len(self._before), dtype=np.bool_)
        self._positions: deque[tuple[float, Array]] = deque()  # (N, 2) of the last minute [m]
        self._at_rest = False
        self._time = 0.0

    def update(self, frame: Frame) -> bool:
        """See :class:`mrta_falsify.core.protocols.Watch`."""
        if frame.sensed.tick % WATCH_STRIDE:
            return False
        self._time = time = frame.sensed.time
        last = self._progress.update(frame)
        self._with_goal = np.isfinite(frame.intent.goal[:, 0])
        for i in self._asked:
            if i not in self._freed and (last[i] > self._before[i] or not self._with_goal[i]):
                self._freed[i] = time
        self._positions.append((time, frame.sensed.pose[:, :2].copy()))
        while self._positions[0][0] <= time - STAYS_FOR:
            self._positions.popleft()
        self._at_rest = time >= self._settled and self._rest.update(frame)
        return self._at_rest or time >= self._until or len(self._freed) == len(self._asked)

    def answer(self) -> dict[str, Any]:
        """Give the :class:`ContinuationAnswer`, encoded."""
        last = self._progress.last
        late = np.array([position for _, position in self._positions])
        stands = (np.hypot(*(late - late[-1]).transpose(2, 0, 1)) <= STAYS_WITHIN).all(axis=0)
        stands |= self._at_rest
        quiet = self._time - last >= ALL_REST_FOR
        stuck = np.flatnonzero(self._with_goal & quiet & stands)
        seen = ContinuationAnswer(
            stuck={str(i): float(last[i]) for i in stuck},
            freed={str(i): time for i, time in self._freed.items()},
            looked=self._time,
        )
        encoded: dict[str, Any] = codec.encode(seen)
        return encoded


class CounterfactualWatch:
    """Watches which of ``others`` leave their places now that a robot is gone.

    Args:
        others: robots in question; the watch ends once all of them have gone free.
        settled: before this time, rest means nothing [s].
        until: [s].
    """

    def __init__(self, others: Iterable[int], *, settled: float, until: float) -> None:
        self._others = frozenset(others)
        self._settled = settled
        self._until = until
        self._rest = LastingRest()
        self._place: Array | None = None
        self._freed: set[int] = set()

    def update(self, frame: Frame) -> bool:
        """See :class:`mrta_falsify.core.protocols.Watch`."""
        if frame.sensed.tick % WATCH_STRIDE:
            return False
        time, position = frame.sensed.time, frame.sensed.pose[:, :2]
        if self._place is None:
            self._place = position.copy()
        away = np.hypot(*(position - self._place).T)
        goal = np.isfinite(frame.intent.goal[:, 0])
        self._freed |= {i for i in self._others if away[i] > FREE_BEYOND or not goal[i]}
        at_rest = time >= self._settled and self._rest.update(frame)
        return self._freed == self._others or at_rest or time >= self._until

    def answer(self) -> dict[str, Any]:
        """Give the :class:`CounterfactualAnswer`, encoded."""
        encoded: dict[str, Any] = codec.encode(
            CounterfactualAnswer(freed=tuple(sorted(self._freed)))
        )
        return encoded
