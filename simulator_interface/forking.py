"""What a fork of this process needs to be a copy that can be thrown away.

A copy made by ``os.fork`` shares nothing with the original but its past. So an episode can be
continued from any moment, physics included, and the original stays as it was. A copy ends with the
process that made it. It does not hear Ctrl-C: the original does, and kills it.
:mod:`simulator_interface.watched_copy` makes all copies.
"""

from __future__ import annotations

import ctypes
import os
import signal
import sys

from mrta_falsify.core.interruption import STOP_SIGNALS

PARENT_DEATH_SIGNAL = 1  # of prctl(2), Linux: sent to a process when its parent ends

_libc = ctypes.CDLL(None) if sys.platform == "linux" else None


def can_fork() -> bool:
    """Whether this system forks a process safely in mid-run."""
    return sys.platform == "linux"


def become_copy(original: int) -> None:
    """Make this process, just forked, a copy that ends with its original and hears no Ctrl-C.

    The kernel kills it when the original ends, even in compiled code.

    Args:
        original: process that made it, with the signals that stop a command held back.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the original's business
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    signal.set_wakeup_fd(-1)  # the signals of the copy are not those of the original
    signal.pthread_sigmask(signal.SIG_UNBLOCK, STOP_SIGNALS)
    if _libc is not None:
        _libc.prctl(PARENT_DEATH_SIGNAL, signal.SIGKILL)
    if os.getppid() != original:
        os._exit(1)


def ending_of(code: int) -> str:
    """Say how a process ended: its exit code, or the signal, of which ``code`` is the negative."""
    if code >= 0:
        return f"exit code {code}"
    known = {known.value: known.name for known in signal.Signals}
    return known.get(-code, f"signal {-code}")  # real-time signals have no name
