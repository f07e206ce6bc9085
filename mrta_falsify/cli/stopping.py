"""Ctrl-C and SIGTERM: the first one stops a command, and further ones do not disturb its clean-up.

The first signal becomes KeyboardInterrupt. Where Python itself swallows it, in a finalizer or a
callback of a weak reference, it is raised again. A thread watches that the process ends soon after:
it may be in compiled code, which no exception reaches, or in code that swallows the exception. It
is then ended at once, as by kill -9: what is finished is on disc by then, whatever the command.
"""

from __future__ import annotations

import atexit
import os
import signal
import sys
import threading
import time
from pathlib import Path
from types import FrameType
from typing import NoReturn

from mrta_falsify.core.interruption import STOP_SIGNALS

EXIT_CODE = 130  # of every interrupted command
PATIENCE = 1.5  # s from the signal to the end of the process
AGAIN = 0.01  # s until a swallowed signal is raised again; what swallowed it has returned by then
SHOW_CURSOR = "\x1b[?25h"  # a bar of progress has hidden it


class _State:
    """Where this process is: loading its modules, at work, or stopping."""

    is_listening = False
    at_work = False
    is_stopping = False


def listen() -> None:
    """Turn the first signal that stops a command into KeyboardInterrupt.

    Only the main thread can; elsewhere nothing changes.
    """
    _State.at_work = True
    _install()


def listen_while_loading() -> None:
    """End this process quietly on a signal that comes before there is anything to clean up.

    Does nothing unless this process is the command line; its pools' processes, which have its
    arguments, are not.
    """
    if "multiprocessing" in sys.modules:
        return
    if Path(sys.argv[0]).name == "mrta-falsify" or "mrta_falsify.cli" in sys.orig_argv:
        _install()


def stop_listening() -> None:
    """Ignore further signals, once the exit code is known."""
    if _State.is_listening:
        for number in STOP_SIGNALS:
            signal.signal(number, signal.SIG_IGN)
        signal.set_wakeup_fd(-1)


def leave() -> NoReturn:
    """End this process after an interruption; taking the interpreter down can last seconds."""
    try:
        sys.stdout.flush()
        sys.stderr.flush()
        atexit._run_exitfuncs()  # of pools and temporary folders
    finally:
        os._exit(EXIT_CODE)


def _install() -> None:
    is_main = threading.current_thread() is threading.main_thread()
    if not is_main or _State.is_listening:
        return
    ctrl_c = signal.getsignal(signal.SIGINT)
    if ctrl_c not in (signal.default_int_handler, signal.SIG_IGN):
        return  # it is someone else's
    reader, writer = os.pipe()
    os.set_blocking(writer, False)
    signal.set_wakeup_fd(writer, warn_on_full_buffer=False)
    threading.Thread(target=_watch, args=(reader,), daemon=True).start()
    for number in STOP_SIGNALS:  # Ctrl-C is ignored in the background of a script
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, _stop)
    sys.unraisablehook = _on_unraisable
    _State.is_listening = True


def _stop(number: int, frame: FrameType | None) -> None:
    """Handle a signal in the main thread."""
    del number, frame
    if not _State.at_work:
        _end_now("interrupted")
    if not _State.is_stopping:
        _State.is_stopping = True
        raise KeyboardInterrupt


def _on_unraisable(unraisable: sys.UnraisableHookArgs) -> None:
    """Let an interruption that Python has swallowed come again; print any other exception."""
    if not isinstance(unraisable.exc_value, KeyboardInterrupt):
        sys.__unraisablehook__(unraisable)
        return
    _State.is_stopping = False
    main = threading.main_thread().ident
    again = threading.Timer(AGAIN, signal.pthread_kill, (main, signal.SIGTERM))
    again.daemon = True
    again.start()


def _watch(reader: int) -> None:
    """End the process some time after a signal; the interpreter writes its number to ``reader``."""
    while os.read(reader, 1)[0] not in STOP_SIGNALS:
        pass
    time.sleep(PATIENCE)
    _end_now(
        "interrupted: ended at once, since it did not stop by itself; what was finished is kept, "
        "and the same command goes on (campaign and compare with --resume)"
    )


def _end_now(text: str) -> None:
    cursor = SHOW_CURSOR if os.isatty(2) else ""
    try:
        os.write(2, f"{cursor}{text}\n".encode())
    finally:
        os._exit(EXIT_CODE)
