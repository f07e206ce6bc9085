"""A child process: in a session of its own, ended with its parent, killed with all that it started.

A fork shares nothing with the original but its past. So an episode can be continued from any
moment, physics included, and the original stays as it was. No child hears Ctrl-C: the process that
made it does, and kills it.
"""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from typing import IO

from mrta_falsify.core.interruption import STOP_SIGNALS, signals_held
from mrta_falsify.process.parent import end_with
from mrta_falsify.process.usage import Named, descendants, is_same, members_of_session


def can_fork() -> bool:
    """Whether this system forks a process safely in mid-run."""
    return sys.platform == "linux"


class Child:
    """A process that this one has started.

    Args:
        number: of the process.
        process: that holds it, if Python's ``subprocess`` has started it.
    """

    def __init__(self, number: int, process: subprocess.Popen[bytes] | None = None) -> None:
        self.number = number
        self._process = process
        self._owner = os.getpid()
        self._code: int | None = None
        self._has_session = True  # processes of its session may be left

    def code(self, *, wait: bool = False) -> int | None:
        """Give its exit code, or the negative of the signal that ended it; None: it runs.

        What is left of its session is killed when it is found to have ended, and not later: its
        number may then be that of another process.
        """
        if self._process is not None:
            self._code = self._process.wait() if wait else self._process.poll()
        elif self._code is None:
            with contextlib.suppress(ChildProcessError):
                ended, status = os.waitpid(self.number, 0 if wait else os.WNOHANG)
                self._code = os.waitstatus_to_exitcode(status) if ended else None
        if self._code is not None and self._has_session and os.getpid() == self._owner:
            _kill_all(lambda: self._with_descendants(members_of_session(self.number)))
            self._has_session = False
        return self._code

    def kill(self, seen: Collection[Named] = ()) -> None:
        """Kill it and all that it has started, and wait for it; copies of its owner do nothing.

        Args:
            seen: processes that were below it when somebody looked; those that have left its
                session are found by no other way once their parent has ended.
        """
        if os.getpid() != self._owner:
            return
        if self.code() is None:
            _kill_all(lambda: set(descendants(self.number)))
            send(self.number, signal.SIGKILL)
            self.code(wait=True)
        _kill_all(lambda: self._with_descendants(one.number for one in seen if is_same(one)))

    def end(self) -> None:
        """Kill it, which has started nothing, and wait for it."""
        self._has_session = False
        send(self.number, signal.SIGKILL)
        self.code(wait=True)

    def _with_descendants(self, numbers: Iterable[int]) -> set[int]:
        """Add what processes, left by this one, have started."""
        found = set(numbers)
        for number in tuple(found):
            found.update(descendants(number))
        return found - {self.number, os.getpid()}


def _kill_all(look: Callable[[], set[int]]) -> None:
    """Kill the processes that ``look`` finds, until it finds no others."""
    killed: set[int] = set()
    while found := look() - killed:
        killed |= found
        for number in found:
            send(number, signal.SIGKILL)


def send(number: int, which: int) -> None:
    """Send a signal to a process that may have ended."""
    with contextlib.suppress(ProcessLookupError, PermissionError):
        os.kill(number, which)


def fork(on_parents_end: int = signal.SIGKILL) -> Child | None:
    """Copy this process.

    A caller that holds the copy until it is ended holds signals back (``signals_held``) until it
    has noted it; else Ctrl-C during the fork leaves a copy that nobody owns.

    Args:
        on_parents_end: signal that the copy is sent when this process ends.

    Returns:
        The copy; None in the copy itself.
    """
    sys.stdout.flush()
    sys.stderr.flush()
    original = os.getpid()
    with signals_held():
        number = os.fork()
    if number:
        return Child(number)
    os.setsid()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the original's business
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    signal.set_wakeup_fd(-1)  # the signals of the copy are not those of the original
    signal.pthread_sigmask(signal.SIG_UNBLOCK, STOP_SIGNALS)
    end_with(original, on_parents_end)
    return None


def spawn(
    command: Sequence[str],
    *,
    environment: Mapping[str, str],
    passed: Sequence[int],
    stdout: int | None,
    stderr: int | IO[bytes],
) -> Child:
    """Start a program of ours, which calls :func:`~.parent.end_with` at once.

    Args:
        command: program and arguments.
        environment: all of it.
        passed: file descriptors that it inherits under the same numbers.
        stdout: as ``subprocess`` takes it.
        stderr: as ``subprocess`` takes it.
    """
    process = subprocess.Popen(
        command,
        stdin=subprocess.DEVNULL,
        stdout=stdout,
        stderr=stderr,
        pass_fds=passed,
        env=dict(environment),
        start_new_session=True,
    )
    return Child(process.pid, process)
