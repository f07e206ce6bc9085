"""The watch over a process that runs episodes: its heartbeat, and what it knows of its watcher.

A page of shared memory says whether the process is inside the stack under test, at which tick, and
since when. The watching process may read it at any time, even while compiled code of the stack
holds Python's lock.
"""

from __future__ import annotations

import functools
import mmap
import os
import struct
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import NamedTuple

from mrta_falsify.core.compiled import on_compiling
from mrta_falsify.core.stack_failure import GIB, StackFailed, StackFailure, StackLimits
from mrta_falsify.process.budget import Budget

#: in the stack, compiling, entries into the stack, tick, simulated time [s], CPU time of the entry
#: [s], resident memory at the entry [bytes], bytes that earlier calls of the stack took up, process
LAYOUT = struct.Struct("=qqqqddddq")
PAGE = mmap.PAGESIZE


class Pulse(NamedTuple):
    """What a heartbeat says at one moment."""

    in_stack: bool
    compiling: bool  #: kernels are compiled, which is no time of the stack's own
    entries: int  #: into the stack so far
    tick: int  #: the last one that the stack was asked
    time: float  #: of that tick, simulated [s]
    entered_at: float  #: CPU time of the process at the last entry [s]
    resident: float  #: memory at the last entry [bytes]
    taken: float  #: memory that the calls before took up [bytes]
    process: int  #: that runs the episode, 0: it has not begun


class Heartbeat:
    """Shared memory that a process writes and its parent reads; made before the fork."""

    def __init__(self) -> None:
        self._memory = mmap.mmap(-1, PAGE)
        self._pulse = Pulse(False, False, 0, 0, 0.0, 0.0, 0.0, 0.0, 0)
        self._compiling = (0.0, 0.0)  # CPU time [s] and memory [bytes] as it began
        self._statm = -1  # file descriptor of this process's own memory figures
        self._process = 0  # this one, once it has entered the stack

    def read(self) -> Pulse:
        """Read what the process shows."""
        in_stack, compiling, *rest = LAYOUT.unpack_from(self._memory)
        return Pulse(bool(in_stack), bool(compiling), *rest)

    # --- in the process that runs the episode ----------------------------------------------

    def enter(self, tick: int, at: float) -> None:
        """Show that the stack is asked ``tick`` at ``at`` [s] of simulated time."""
        before = self._pulse
        self._show(
            Pulse(
                True,
                False,
                before.entries + 1,
                tick,
                at,
                time.process_time(),
                self._resident(),
                before.taken,
                self._process or self._identified(),
            )
        )

    def leave(self) -> float:
        """Show that the stack has answered; give the memory that its calls took up [bytes]."""
        now = self._pulse
        taken = max(0.0, now.taken + self._resident() - now.resident)
        self._show(now._replace(in_stack=False, taken=taken))
        return taken

    def compile_begins(self) -> None:
        """Show that kernels are compiled."""
        self._compiling = (time.process_time(), self._resident())
        self._show(self._pulse._replace(compiling=True))

    def compile_ends(self) -> None:
        """Show that compiling is over; its time and memory are not the stack's."""
        now, (began, resident) = self._pulse, self._compiling
        self._show(
            now._replace(
                compiling=False,
                entered_at=now.entered_at + time.process_time() - began,
                resident=now.resident + max(0.0, self._resident() - resident),
            )
        )

    def move_here(self) -> None:
        """Show this process from now on: it goes on with the run of the one it is a copy of."""
        if self._statm >= 0:
            os.close(self._statm)
        self._statm, self._process = -1, 0

    def _identified(self) -> int:
        self._process = os.getpid()
        return self._process

    def _show(self, pulse: Pulse) -> None:
        self._pulse = pulse
        LAYOUT.pack_into(self._memory, 0, *pulse)

    def _resident(self) -> float:
        if self._statm < 0:
            self._statm = os.open("/proc/self/statm", os.O_RDONLY)
        return float(os.pread(self._statm, 64, 0).split()[1]) * PAGE


class Watch:
    """What this process knows about being watched.

    Args:
        heartbeat: that is read from outside; None: nobody watches.
        budget: of the stack, for one tick.
        ending: how the stack is known to fail in this episode; it is not asked that tick again.
        may_roll_back: whether a snapshot of this process may take its place, see :mod:`.snapshot`.
    """

    def __init__(
        self,
        heartbeat: Heartbeat | None = None,
        budget: Budget | None = None,
        ending: StackFailure | None = None,
        *,
        may_roll_back: bool = False,
    ) -> None:
        self.heartbeat = heartbeat
        self.may_roll_back = may_roll_back
        self.budget = budget or Budget.of_stack(StackLimits())
        self.ending = ending

    def enter(self, tick: int, at: float) -> None:
        """Take note that the stack is asked ``tick`` at ``at`` [s].

        Raises:
            StackFailed: it is known to fail here.
        """
        if self.ending is not None and tick >= self.ending.tick:
            raise StackFailed(self.ending)
        if self.heartbeat is not None:
            self.heartbeat.enter(tick, at)

    def leave(self) -> float:
        """Take note that the stack has answered; give by how much it exceeds its memory [GiB]."""
        if self.heartbeat is None:
            return 0.0
        return max(0.0, self.heartbeat.leave() / GIB - self.budget.memory)


_watches = [Watch()]  # the last one counts


def current_watch() -> Watch:
    """Give the watch over this process."""
    return _watches[-1]


@contextmanager
def under(watch: Watch) -> Iterator[None]:
    """Put this process under a watch."""
    _watches.append(watch)
    try:
        yield
    finally:
        _watches.pop()


@functools.cache  # once in a process, and its copies
def listen_to_compiler() -> None:
    """Leave what numba compiles, which may take minutes, out of the stack's time and memory."""

    def begins() -> None:
        heartbeat = current_watch().heartbeat
        if heartbeat is not None:
            heartbeat.compile_begins()

    def ends() -> None:
        heartbeat = current_watch().heartbeat
        if heartbeat is not None:
            heartbeat.compile_ends()

    on_compiling(begins, ends)
