"""Snapshots: a sleeping fork of a run, which takes its place if the run proves void.

A process that is watched from outside may go on before it knows what it has asked, and be taken
back to the question if the answer is not the expected one (Jefferson, *Virtual Time*, 1985). The
fork then is the run: it answers to whom the process would have answered, and the process waits.
"""

from __future__ import annotations

import contextlib
import faulthandler
import os
import signal
from multiprocessing.connection import Connection, Pipe
from typing import Any, NamedTuple

from mrta_falsify.process.child import Child, fork
from mrta_falsify.process.watch import current_watch


class RolledBack(BaseException):
    """This process's run is discarded; the fork of a snapshot continues the run.

    Args:
        child: the fork.
    """

    def __init__(self, child: Child) -> None:
        super().__init__(f"the run goes on in process {child.number}")
        self._child = child

    def wait(self) -> None:
        """Wait until the run has ended; where it ended its process, end this one alike."""
        code = self._child.code(wait=True) or 0
        if code:
            self._child.kill()  # what it has started
            faulthandler.disable()  # where this process waits is of no interest
        if code < 0:
            with contextlib.suppress(OSError):  # SIGKILL has no other handler
                signal.signal(-code, signal.SIG_DFL)
            os.kill(os.getpid(), -code)
        if code:
            os._exit(code)


class Resumed(NamedTuple):
    """What the fork of a snapshot wakes up to."""

    answer: Any


class Snapshot:
    """A fork of this process that sleeps; made by :func:`snapshot`."""

    def __init__(self, child: Child, pipe: Connection) -> None:
        self._child = child
        self._pipe = pipe

    def rollback(self, answer: Any) -> RolledBack:
        """Let the run go on from the snapshot.

        Args:
            answer: to what was asked there.

        Returns:
            An exception to be raised in this process, whose run is void.
        """
        self._pipe.send(answer)
        self._pipe.close()
        return RolledBack(self._child)

    def drop(self) -> None:
        """End the fork, which has started nothing; the run goes on in this process."""
        self._child.end()
        self._pipe.close()


def snapshot() -> Snapshot | Resumed:
    """Fork this process as it is, and let the fork sleep.

    Returns:
        In this process the snapshot. In the fork, once it is woken, what it is told.
    """
    theirs, ours = Pipe(duplex=False)
    child = fork()
    if child is None:
        return _slept(theirs, ours)
    theirs.close()
    return Snapshot(child, ours)


def _slept(pipe: Connection, other_end: Connection) -> Resumed:
    """Sleep in the fork until it is woken."""
    other_end.close()
    try:
        answer = pipe.recv()
    except EOFError:
        os._exit(0)
    pipe.close()
    _resumed.append(os.getpid())
    heartbeat = current_watch().heartbeat
    if heartbeat is not None:
        heartbeat.move_here()
    return Resumed(answer)


_resumed: list[int] = []  # processes that have taken over a run: this one, those it comes from


def is_resumed() -> bool:
    """Whether this process is the fork of a snapshot, so that another one waits for its end."""
    return os.getpid() in _resumed
