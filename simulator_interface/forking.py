"""Forks of this process, in which an episode can be continued and thrown away.

A copy made by ``os.fork`` shares nothing with the original but its past. So an episode can be
continued from any moment, physics included, and the original stays as it was. A copy ends with the
process that made it. It does not hear Ctrl-C: the original does, and kills it.
"""

from __future__ import annotations

import contextlib
import ctypes
import json
import os
import signal
import sys
import traceback
from collections.abc import Callable
from typing import Any, NoReturn

from mrta_falsify.core.errors import HarnessError
from mrta_falsify.core.interruption import STOP_SIGNALS

PARENT_DEATH_SIGNAL = 1  # of prctl(2), Linux: sent to a process when its parent ends

_libc = ctypes.CDLL(None) if sys.platform == "linux" else None


def can_fork() -> bool:
    """Whether this system forks a process safely in mid-run."""
    return sys.platform == "linux"


def run_in_copy(run: Callable[[], Any]) -> Any:
    """Run something in a copy of this process.

    Args:
        run: returns JSON-shaped data.

    Returns:
        What ``run`` returned.

    Raises:
        HarnessError: the copy failed; with the last line of its traceback.
        KeyboardInterrupt: Ctrl-C; the copy is killed first.
    """
    original = os.getpid()
    reader, writer = os.pipe()
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, STOP_SIGNALS)
    try:
        copy = os.fork()
        if copy == 0:
            os.close(reader)
            _answer(run, writer, original)
    except BaseException:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        raise
    try:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        os.close(writer)
        with os.fdopen(reader) as pipe:
            text = pipe.read()
        os.waitpid(copy, 0)
    except BaseException:
        _kill(copy)
        raise
    data = json.loads(text) if text else {"error": "the copy ended without an answer"}
    if "error" in data:
        raise HarnessError(f"a copy of the run failed: {data['error'].strip().splitlines()[-1]}")
    return data["answer"]


def _answer(run: Callable[[], Any], writer: int, original: int) -> NoReturn:
    """Run something in the copy, write the answer and end the copy."""
    try:
        become_copy(original)
        try:
            text = json.dumps({"answer": run()})
        except BaseException:
            text = json.dumps({"error": traceback.format_exc()})
        with os.fdopen(writer, "w") as pipe:
            pipe.write(text)
    finally:
        os._exit(0)


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


def _kill(copy: int) -> None:
    """End a copy and collect what is left of it."""
    with contextlib.suppress(ProcessLookupError):
        os.kill(copy, signal.SIGKILL)
    with contextlib.suppress(ChildProcessError):
        os.waitpid(copy, 0)
