"""What a command says when it is stopped early: what is kept, and what is missing."""

from __future__ import annotations

import contextlib
import os
import signal
import threading
from collections.abc import Callable, Iterator

STOP_SIGNALS = (signal.SIGINT, signal.SIGTERM)  # that stop a command

#: What others make of Ctrl-C, which is then the cause of the error: a compiled function that it
#: meets while the type of an argument is asked for, and Python 3.11 while a class is made.
HIDES_INTERRUPT = (SystemError, RuntimeError)


class Interrupted(KeyboardInterrupt):
    """The user has stopped a command, which therefore has no result.

    It passes every ``except Exception``, as Ctrl-C does.

    Args:
        kept: what was finished and is kept, in words.
        missing: what was not finished, and how to go on.
    """

    def __init__(self, *, kept: str, missing: str) -> None:
        super().__init__(f"{missing}; kept: {kept}")
        self.kept = kept
        self.missing = missing


def is_interruption(error: BaseException) -> bool:
    """Say whether an exception is Ctrl-C, or an error of ``HIDES_INTERRUPT`` that it has caused."""
    return _interruption_in(error) is not None


def _interruption_in(error: BaseException) -> KeyboardInterrupt | None:
    found: BaseException | None = error
    while found is not None and not isinstance(found, KeyboardInterrupt):
        found = found.__cause__ if isinstance(found, HIDES_INTERRUPT) else None
    return found


def pass_on(error: Exception) -> None:
    """Do nothing, unless ``error`` hides Ctrl-C.

    Raises:
        KeyboardInterrupt: that it hides.
    """
    if interruption := _interruption_in(error):
        raise interruption


@contextlib.contextmanager
def propagate_interrupts() -> Iterator[None]:
    """Let Ctrl-C pass as a KeyboardInterrupt, whatever code inside makes of it."""
    try:
        yield
    except HIDES_INTERRUPT as error:
        pass_on(error)
        raise


@contextlib.contextmanager
def describe_interrupt(state: Callable[[], tuple[str, str]]) -> Iterator[None]:
    """Let an interruption inside say what is kept and what is missing.

    Args:
        state: returns both, in words; it is asked when the interruption has come.

    Raises:
        Interrupted: in place of any KeyboardInterrupt that does not say it yet.
    """
    try:
        with propagate_interrupts():
            yield
    except Interrupted:
        raise
    except KeyboardInterrupt:
        kept, missing = state()
        raise Interrupted(kept=kept, missing=missing) from None


@contextlib.contextmanager
def signals_held(*signals: signal.Signals) -> Iterator[None]:
    """Hold signals back; processes and threads that are started inside never hear them.

    This thread hears what came meanwhile at the end. Threads that others have started may hear it
    before, and Python then acts in the main thread: there its handlers wait for the end, too. (In
    the middle of a fork what a handler raises would be lost.)

    Args:
        signals: by default all that stop a command.
    """
    held = signals or STOP_SIGNALS
    owner = os.getpid()
    came: list[int] = []
    handlers = {}
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, held)
    try:
        if threading.current_thread() is threading.main_thread():
            for number in held:
                if callable(signal.getsignal(number)):
                    handlers[number] = signal.signal(number, lambda of, frame: came.append(of))
        yield
    finally:
        if os.getpid() != owner:  # copies have handlers of their own, and nothing came for them
            handlers.clear()
            came.clear()
        for number, handler in handlers.items():
            signal.signal(number, handler)
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        for late in set(came):
            signal.raise_signal(late)
