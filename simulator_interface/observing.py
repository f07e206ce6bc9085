"""What observers of an episode see beside motion: what the stack tells, and how often it plans."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

from mrta_falsify.core.allocation_problem import Allocation, AllocationProblem
from mrta_falsify.core.fleet import Intent, StackEvent, Tells
from mrta_falsify.core.plane import NO_POINTS
from mrta_falsify.core.protocols import Allocator
from mrta_falsify.specs.books import STOP_KINDS
from mrta_falsify.specs.costly import CALLS_SIGNAL


class TellsFilter:
    """Keeps from observers what a configuration withholds, as if the stack did not tell it."""

    def __init__(self, withheld: Sequence[str], robots: int, tells: Tells) -> None:
        told = tells._asdict()
        self.tells = Tells(**{name: told[name] and name not in withheld for name in told})
        self.keeps_back = bool(withheld)  #: whether :meth:`of` leaves out anything
        self._nowhere = np.full((robots, 2), np.nan)
        self._no_stops = np.zeros(robots, dtype=np.int64)
        self._no_paths = (NO_POINTS,) * robots

    def of(
        self, intent: Intent, events: tuple[StackEvent, ...]
    ) -> tuple[Intent, tuple[StackEvent, ...]]:
        """Leave out what is withheld."""
        if not self.tells.deliveries:
            events = tuple(event for event in events if event.kind not in STOP_KINDS)
        if not self.tells.goals:
            intent = dataclasses.replace(
                intent, goal=self._nowhere, waypoint=self._nowhere, tasks_left=self._no_stops
            )
        if not self.tells.paths:
            intent = dataclasses.replace(intent, path=self._no_paths)
        return intent, events


class AllocatorMeter:
    """Counts the calls of an episode's allocators."""

    def __init__(self) -> None:
        self.signals: Mapping[str, float] = {CALLS_SIGNAL: 0.0}  #: for the next frame

    def around(self, allocator: Allocator) -> Allocator:
        """Give an allocator that answers as ``allocator`` does and is counted."""
        return _Counted(allocator, self)

    def note_call(self) -> None:
        """Count a call."""
        self.signals = {CALLS_SIGNAL: self.signals[CALLS_SIGNAL] + 1.0}


class _Counted:
    def __init__(self, allocator: Allocator, meter: AllocatorMeter) -> None:
        self._asked, self._meter = allocator, meter

    def allocate(self, problem: AllocationProblem) -> Allocation:
        self._meter.note_call()
        return self._asked.allocate(problem)
