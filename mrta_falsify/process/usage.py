"""What processes use: work, sleep and memory, whatever else the machine does.

A limit must not depend on how busy the machine is. So it counts the CPU time of a process and of
all that it has started, and the time in which all of them sleep. Waiting for a processor does not
count. Neither does waiting for a disc (state D): it is the machine that is slow then, and a
process in that state cannot be killed anyhow.

psutil reads the memory of stacks. Two things are read from Linux's ``/proc`` here, because a
running child is looked at twenty times a second. First, children: psutil finds them by a scan of
all processes (16 ms among 120 processes, against 0.17 ms for the kernel's own list). Second, the
figures of one process and the states of its threads: psutil does not tell the states, and takes
1.0 ms for the figures (0.18 ms from one file). Where there is no ``/proc``, a clock counts
wall-clock time.
"""

from __future__ import annotations

import os
import time
from collections.abc import Sequence
from typing import NamedTuple

import psutil

TICKS_PER_SECOND = os.sysconf("SC_CLK_TCK")
PAGE = os.sysconf("SC_PAGESIZE")  # bytes
CAN_LOOK = os.path.exists(f"/proc/self/task/{os.getpid()}/children")
#: s between two looks that may count as asleep; of a longer time nobody knows what happened in it
LONGEST = 2.0

ASLEEP = "S"
STOPPED = "Tt"
ENDED = "ZX"


class Process(NamedTuple):
    """What ``/proc`` says of one process at one moment."""

    number: int
    started: int  #: clock ticks since the machine started
    state: str  #: of its first thread
    threads: int
    cpu: float  #: of its own [s]
    reaped: float  #: CPU time of children that have ended and that it has waited for [s]
    resident: float  #: memory [bytes]


def read_process(number: int) -> Process | None:
    """Read the figures of a process; None: it has ended, or there are no figures."""
    fields = _stat(f"/proc/{number}/stat")
    if fields is None:
        return None
    return Process(
        number=number,
        started=int(fields[19]),
        state=fields[0],
        threads=int(fields[17]),
        cpu=(int(fields[11]) + int(fields[12])) / TICKS_PER_SECOND,
        reaped=(int(fields[13]) + int(fields[14])) / TICKS_PER_SECOND,
        resident=float(fields[21]) * PAGE,
    )


class Named(NamedTuple):
    """A process, told from a later one of the same number."""

    number: int
    started: int  #: clock ticks since the machine started


def is_same(named: Named) -> bool:
    """Whether a process still runs, and is no later one of the same number."""
    process = read_process(named.number)
    return process is not None and process.started == named.started


def descendants(root: int) -> list[int]:
    """List the numbers of all processes that a process, or one of these, has started."""
    found, parents = [], [root]
    while parents:
        children = children_of(parents.pop())
        found += children
        parents += children
    return found


def children_of(process: int) -> list[int]:
    """List the numbers of the processes that a process, in any of its threads, has started."""
    return [child for thread in _threads(process) for child in _children(process, thread)]


def members_of_session(session: int) -> list[int]:
    """List the processes of a session, which its first process need not have outlived."""
    return [number for number in psutil.pids() if _session_of(number) == session]


def memory_of(processes: Sequence[int]) -> float:
    """Memory that processes take up [bytes]; what several of them share counts once."""
    return sum(_memory_of(number, shared=len(processes) > 1) for number in processes)


def _memory_of(number: int, *, shared: bool) -> float:
    try:
        process = psutil.Process(number)
        return float(process.memory_full_info().pss if shared else process.memory_info().rss)
    except psutil.Error:  # it has ended
        return 0.0


def _session_of(number: int) -> int:
    try:
        return os.getsid(number)
    except OSError:
        return 0


def cpu_of_tree(root: int) -> float:
    """CPU time of a process and of all that it has started, ended or not [s]."""
    if not CAN_LOOK:
        return time.process_time() if root == os.getpid() else 0.0
    found = filter(None, map(read_process, (root, *descendants(root))))
    return sum(process.cpu + process.reaped for process in found)


class WallClock:
    """Counts wall-clock time, for what cannot be looked at; used as :class:`ProcessClock`."""

    def __init__(self) -> None:
        self.restart()

    def restart(self) -> None:
        """Count from 0 again."""
        self.spent = 0.0  #: [s]
        self._looked = time.monotonic()

    def look(self, waited: float | None = None) -> float:
        """Count on; see :meth:`ProcessClock.look`."""
        now = time.monotonic()
        self.spent += now - self._looked if waited is None else waited
        self._looked = now
        return self.spent


class ProcessClock:
    """Counts the CPU time of a process and all that it has started, and their sleep.

    CPU time is counted exactly, also of processes that have ended between two looks. Sleep is
    sampled: if all threads of all processes sleep at a look, what was no CPU time since the last
    look was sleep.

    Args:
        root: number of the process; once it is gone, wall-clock time counts.
        counts_stops: whether a stopped process (SIGSTOP) counts as asleep. A stack that stops
            itself gives no answer; a worker is stopped by somebody else, and then nothing counts.
    """

    def __init__(self, root: int, *, counts_stops: bool = False) -> None:
        self.root = root
        self._idle = ASLEEP + ENDED + (STOPPED if counts_stops else "")
        self.restart()

    def restart(self) -> None:
        """Count from 0 again, from the next look on."""
        self.spent = 0.0  #: [s]
        self._looked = time.monotonic()
        self._is_first = True
        self._known: dict[Named, Process] = {}  # all processes seen, as last seen
        self.alive: set[Named] = set()  #: processes at the last look
        self._unreaped = 0.0  # CPU time of processes that have ended, not yet told by a parent [s]

    def look(self, waited: float | None = None) -> float:
        """Count on.

        Args:
            waited: wall-clock time since the last look that may have been sleep [s]; all if None.

        Returns:
            ``spent``.
        """
        now = time.monotonic()
        since = now - self._looked if waited is None else waited
        self._looked = now
        numbers = (self.root, *descendants(self.root)) if CAN_LOOK else ()
        seen = [found for number in numbers if (found := read_process(number)) is not None]
        if not seen:  # nobody can be looked at, or is left
            self.spent += since
            return self.spent
        work = self._work(seen)
        if not self._is_first:
            self.spent += work
            if all(map(self._is_idle, seen)):
                self.spent += max(0.0, min(since, LONGEST) - work)
        self._is_first = False
        return self.spent

    def _work(self, seen: list[Process]) -> float:
        """CPU time since the last look [s]; what ended children took is counted once."""
        work = reaped = 0.0
        alive = set()
        for process in seen:
            name = Named(process.number, process.started)
            before = self._known.get(name)
            if before is not None and name not in self.alive:  # the list of children missed it
                self._unreaped -= before.cpu + before.reaped
            work += max(0.0, process.cpu - (before.cpu if before else 0.0))
            reaped += max(0.0, process.reaped - (before.reaped if before else 0.0))
            self._known[name] = process
            alive.add(name)
        for name in self.alive - alive:
            ended = self._known[name]
            self._unreaped += ended.cpu + ended.reaped
        self.alive = alive
        known = min(reaped, max(0.0, self._unreaped))
        self._unreaped -= known
        return work + reaped - known

    def _is_idle(self, process: Process) -> bool:
        if process.threads <= 1:
            return process.state in self._idle
        states = (_stat(f"/proc/{process.number}/task/{n}/stat") for n in _threads(process.number))
        return all(fields[0] in self._idle for fields in states if fields is not None)


def _stat(path: str) -> list[str] | None:
    """Read the fields behind the name of a process or thread; None: it has ended."""
    try:
        with open(path, encoding="ascii", errors="replace") as file:
            return file.read().rpartition(")")[2].split()
    except (FileNotFoundError, ProcessLookupError):
        return None


def _threads(process: int) -> list[str]:
    try:
        return os.listdir(f"/proc/{process}/task")
    except (FileNotFoundError, ProcessLookupError):
        return []


def _children(process: int, thread: str) -> list[int]:
    try:
        with open(f"/proc/{process}/task/{thread}/children", encoding="ascii") as file:
            return [int(number) for number in file.read().split()]
    except (FileNotFoundError, ProcessLookupError):
        return []
