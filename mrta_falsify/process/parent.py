"""How every child ends with its parent. Imports little: a fresh process calls it first of all."""

from __future__ import annotations

import ctypes
import os
import signal
import sys

PARENT_DEATH_SIGNAL = 1  # of prctl(2), Linux: sent to a process when its parent ends

_libc = ctypes.CDLL(None) if sys.platform == "linux" else None


def end_with(parent: int, number: int = signal.SIGKILL) -> None:
    """Let the kernel send this process a signal when its parent ends, even in compiled code.

    To the kernel a parent is the thread that has started this process: it must live as long as the
    process is needed. Elsewhere than on Linux, workers of a pool see their connection close.

    Args:
        parent: process that has started this one.
        number: signal.
    """
    if _libc is not None:
        _libc.prctl(PARENT_DEATH_SIGNAL, number)
    if os.getppid() != parent:
        os._exit(1)
