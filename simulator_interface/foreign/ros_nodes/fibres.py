"""Threads of control that wait for each other on simulated time: one runs at a time.

Which one runs next is a function of the seed. Nothing here waits on a clock of the machine, and all
of it survives a fork, which threads do not.
"""

from __future__ import annotations

import heapq
import random
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Protocol

from greenlet import getcurrent, greenlet

NS = 1_000_000_000  # in a second
LOOK = NS // 1000  # ns that a look takes which finds nothing to do


class FibreOwner(Protocol):
    """What fibres belong to: one operating system process of the stack."""

    is_dead: bool

    def enter(self) -> None:
        """Make what belongs to it alone visible; called before one of its fibres runs."""

    def fail(self, error: BaseException) -> None:
        """Take note that a fibre ended by an error."""


class Fibre:
    """One thread of control.

    Args:
        program: it belongs to.
        call: what it does.
    """

    def __init__(self, program: FibreOwner, call: Callable[[], object]) -> None:
        self.program = program
        self.is_finished = False
        self.ended = Latch()
        self._call = call
        self.turn = 0  #: counts its waits, so that it is not resumed twice for one of them
        self.control = greenlet(self._run)

    def _run(self, woken: bool) -> None:
        try:
            self._call()
        except Exception as error:
            self.program.fail(error)
        except SystemExit as end:
            if end.code not in (None, 0):
                self.program.fail(end)
        finally:
            self.is_finished = True
            self.ended.set()


class Timeline:
    """The simulated time of a stack, and what happens when.

    Args:
        order: shuffles what is due at the same time; None: first come, first served.
    """

    def __init__(self, order: random.Random | None = None) -> None:
        self.now = 0  #: [ns]
        self.current: Fibre | None = None
        self._order = order
        self._events: list[tuple[int, float, int, Callable[[], object]]] = []
        self._count = 0
        self._hub: greenlet | None = None

    def at(self, time: int, call: Callable[[], object]) -> None:
        """Have something done at ``time`` [ns], at once if that is over."""
        self._count += 1
        draw = self._order.random() if self._order is not None else 0.0
        heapq.heappush(self._events, (max(time, self.now), draw, self._count, call))

    def run_until(self, time: int) -> None:
        """Do all that is due up to ``time`` [ns], and all that follows from it by then."""
        self._hub = getcurrent()
        while self._events and self._events[0][0] <= time:
            due, _, _, call = heapq.heappop(self._events)
            self.now = due
            call()
        self.now = max(self.now, time)

    def start(self, program: FibreOwner, call: Callable[[], object], *, after: int = 0) -> Fibre:
        """Start a fibre ``after`` [ns] from now."""
        fibre = Fibre(program, call)
        self.at(self.now + after, lambda: self._resume(fibre, 0, woken=True))
        return fibre

    def park(self, until: int | None = None) -> bool:
        """Let others run until this fibre is woken, or time ``until`` [ns] has come.

        Returns:
            Whether it was woken.
        """
        fibre = self.fibre()
        turn = fibre.turn
        if until is not None:
            self.at(until, lambda: self._resume(fibre, turn, woken=False))
        if self._hub is None:
            raise RuntimeError("nothing may wait before the timeline runs")
        return bool(self._hub.switch())

    def wake(self, fibre: Fibre) -> None:
        """Have a fibre that is parked go on now."""
        turn = fibre.turn
        self.at(self.now, lambda: self._resume(fibre, turn, woken=True))

    def sleep(self, time: int) -> None:
        """Park for ``time`` [ns], whoever wakes."""
        until = self.now + time
        while self.now < until:
            self.park(until)

    def look_around(self) -> None:
        """Let a little time go by: a program that looks again and again must not stop it."""
        self.sleep(LOOK)

    def fibre(self) -> Fibre:
        """Give the fibre that runs.

        Raises:
            RuntimeError: none does.
        """
        if self.current is None:
            raise RuntimeError("only a program of the stack may wait on simulated time")
        return self.current

    def _resume(self, fibre: Fibre, turn: int, *, woken: bool) -> None:
        if fibre.is_finished or fibre.turn != turn or fibre.program.is_dead:
            return
        fibre.turn += 1
        fibre.program.enter()
        self.current = fibre
        fibre.control.parent = getcurrent()
        try:
            fibre.control.switch(woken)
        finally:
            self.current = None


class Latch:
    """What fibres wait for."""

    def __init__(self) -> None:
        self.is_set = False
        self._waiting: list[tuple[Timeline, Fibre]] = []

    def set(self) -> None:
        """Set it, and wake all that wait."""
        self.is_set = True
        waiting, self._waiting = self._waiting, []
        for timeline, fibre in waiting:
            timeline.wake(fibre)

    def clear(self) -> None:
        """Unset it."""
        self.is_set = False

    def wait(self, timeline: Timeline, until: int | None = None) -> bool:
        """Wait until it is set, or until ``until`` [ns]; say whether it is set."""
        while not self.is_set and (until is None or timeline.now < until):
            with self._listed(timeline):
                timeline.park(until)
        return self.is_set

    @contextmanager
    def _listed(self, timeline: Timeline) -> Iterator[None]:
        entry = (timeline, timeline.fibre())
        self._waiting.append(entry)
        try:
            yield
        finally:
            if entry in self._waiting:
                self._waiting.remove(entry)
