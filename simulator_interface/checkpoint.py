"""Checkpoints: a sleeping copy of a run, which takes its place if the run proves void.

A process that is watched from outside may go on before it knows what it has asked, and be taken
back to the question if the answer is not the expected one (Jefferson, *Virtual Time*, 1985). The
copy then is the run: it answers to whom the process would have answered, and the process waits.
"""

from __future__ import annotations

import contextlib
import faulthandler
import os
import signal
import sys
from multiprocessing.connection import Connection, Pipe
from typing import Any, NamedTuple

from mrta_falsify.core.interruption import signals_held
from simulator_interface.forking import become_copy
from simulator_interface.heartbeat import post


class RolledBack(BaseException):
    """The run of this process is void; it goes on in the copy of a checkpoint.

    Args:
        process: the copy.
    """

    def __init__(self, process: int) -> None:
        super().__init__(f"the run goes on in process {process}")
        self._process = process

    def wait(self) -> None:
        """Wait until the run has ended; where it ended its process, end this one alike."""
        _, status = os.waitpid(self._process, 0)
        code = os.waitstatus_to_exitcode(status)
        if code < 0:
            faulthandler.disable()  # where this process waits is of no interest
            signal.signal(-code, signal.SIG_DFL)
            os.kill(os.getpid(), -code)
        if code:
            os._exit(code)


class Resumed(NamedTuple):
    """What the copy of a checkpoint wakes up to."""

    answer: Any


class Checkpoint:
    """A copy of this process that sleeps; made by :func:`set_checkpoint`."""

    def __init__(self, process: int, pipe: Connection) -> None:
        self._process = process
        self._pipe = pipe

    def roll_back(self, answer: Any) -> RolledBack:
        """Let the run go on from the checkpoint.

        Args:
            answer: to what was asked there.

        Returns:
            An exception to be raised in this process, whose run is void.
        """
        self._pipe.send(answer)
        self._pipe.close()
        return RolledBack(self._process)

    def drop(self) -> None:
        """End the copy; the run goes on in this process."""
        with contextlib.suppress(ProcessLookupError):
            os.kill(self._process, signal.SIGKILL)
        os.waitpid(self._process, 0)
        self._pipe.close()


def set_checkpoint() -> Checkpoint | Resumed:
    """Copy this process as it is, and let the copy sleep.

    Returns:
        In this process the checkpoint. In the copy, once it is woken, what it is told.
    """
    sys.stdout.flush()
    sys.stderr.flush()
    theirs, ours = Pipe(duplex=False)
    original = os.getpid()
    with signals_held():
        process = os.fork()
        if process == 0:
            return _slept(original, theirs, ours)
    theirs.close()
    return Checkpoint(process, ours)


def _slept(original: int, pipe: Connection, other_end: Connection) -> Resumed:
    """Sleep in the copy until it is woken."""
    other_end.close()
    become_copy(original)
    try:
        answer = pipe.recv()
    except EOFError:
        os._exit(0)
    pipe.close()
    _resumed.append(os.getpid())
    heartbeat = post().heartbeat
    if heartbeat is not None:
        heartbeat.move_here()
    return Resumed(answer)


_resumed: list[int] = []  # processes that have taken over a run: this one, those it comes from


def is_resumed() -> bool:
    """Whether this process is the copy of a checkpoint, so that another one waits for its end."""
    return os.getpid() in _resumed
