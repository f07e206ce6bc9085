"""A stack's process: started, asked within limits, and ended with all that it started."""

from __future__ import annotations

import contextlib
import importlib.metadata
import os
import re
import socket
import time
from collections.abc import Iterator, Sequence

from mrta_falsify.core.errors import ConfigError
from mrta_falsify.core.external import ExternalStack
from mrta_falsify.core.stack_failure import GIB
from mrta_falsify.process.ending import Ending, name_of_ending
from mrta_falsify.process.program import Program
from mrta_falsify.process.usage import ProcessClock, memory_of
from mrta_falsify.process.watch import current_watch
from simulator_interface.external import messages
from simulator_interface.external.answers import Ready, Wrong, read_ready
from simulator_interface.external.wire import Closed, Late, LateByWallClock, Unreadable, Wire

LINK = "MRTA_STACK_FD"
#: sources of noise that can be stilled from outside
STILL = {
    "PYTHONHASHSEED": "0",
    "TZ": "UTC",
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "PYTHONUNBUFFERED": "1",  # what is printed before a crash is seen
}
#: as Python's last line begins, and as C++ says what nobody has caught
EXCEPTION = re.compile(
    r"(?:^(?=[\w.]*(?:Error|Exception|Died|Exit|Interrupt)\b)|throwing an instance of ')([\w.:]+\w)"
)
ENDS_WITHIN = 5.0  # s from closing its connection until a program with many threads has ended
WEIGHED_EVERY = 20  # answers between two looks at the memory of a stack that is quick


class Heavy(Exception):  # noqa: N818 - says what happened to the stack
    """Its processes take up more memory than the stack may have."""


NO_ANSWER = (Closed, Late, Heavy, Unreadable, Wrong)  #: why there may be none, or none of use


class StackProcess:
    """A running stack that has said who it is.

    Args:
        options: how it is started.

    Raises:
        ConfigError: it cannot be started, or does not shake hands.
    """

    def __init__(self, options: ExternalStack) -> None:
        self._options = options
        self._owner = os.getpid()
        self._program: Program | None = None  # of a stack that runs already there is none
        if options.command:
            ours, theirs = socket.socketpair()
            environment = {**os.environ, **STILL, **options.env, LINK: str(theirs.fileno())}
            folder = options.folder or os.getcwd()
            self._program = Program(options.command, folder, environment, theirs)
            theirs.close()
        else:
            ours = _connected(options)
        self._answers = 0
        self.kept = 0  #: bytes of its answers that are kept here; they count as its memory
        self.wire = Wire(ours, self._program.number if self._program is not None else None)
        self.wire.look_at_stack(self.weigh)
        try:
            self.ready = self._shake_hands()
        except BaseException:
            self.close()
            raise

    @contextlib.contextmanager
    def starting(self) -> Iterator[None]:
        """Turn what goes wrong before the first tick into an error of the user's input.

        Raises:
            ConfigError: says what the stack did, and what it printed last.
        """
        label = self._options.label()
        try:
            yield
        except Closed:
            code, lines = self.last_words()
            said = f"; it printed last: {' | '.join(lines[-3:])}" if lines else ""
            how = "closed the connection" if code is None else f"ended by {name_of_ending(code)}"
            raise ConfigError(f"the stack ({label}) {how} before it was ready{said}") from None
        except Heavy as heavy:
            raise ConfigError(f"the stack ({label}) {heavy} before it was ready") from None
        except (Late, LateByWallClock):
            limit = self._options.start_limit
            raise ConfigError(
                f"the stack ({label}) was not ready within {limit:g} s (stack.start_limit)"
            ) from None
        except (Unreadable, Wrong) as error:
            raise ConfigError(f"the stack ({label}) does not shake hands: {error}") from None

    @property
    def is_kept(self) -> bool:
        """Whether it was started here; one that runs already is not ended either."""
        return self._program is not None

    def note_answer(self) -> None:
        """Take note that it has answered; look at its memory now and then.

        Raises:
            Heavy: see :meth:`weigh`.
        """
        self._answers += 1
        if self._answers % WEIGHED_EVERY == 0:
            self.weigh()

    def weigh(self) -> None:
        """Measure the memory that all its processes take up; what several share counts once.

        What is kept here of its answers counts as well.

        Raises:
            Heavy: it is more than the stack may have.
        """
        most = current_watch().budget.memory
        taken = memory_of(self._program.kept() if self._program is not None else ())
        if taken + self.kept > most * GIB:
            ours = f", {self.kept / GIB:.1f} of them in paths, events and answers kept of it"
            raise Heavy(f"took up more than {most:g} GiB of memory{ours * (self.kept > taken)}")

    def last_words(self) -> tuple[int | None, tuple[str, ...]]:
        """Tell with which code it has ended, None: it runs; and the last lines that it printed."""
        if self._program is None:
            return None, ()
        clock = ProcessClock(self._program.number, counts_stops=True)
        state = self._program.state()
        while state is not None and state.code is None and clock.look() < ENDS_WITHIN:
            time.sleep(0.01)
            state = self._program.state()
        return (None, ()) if state is None else (state.code, state.lines())

    def printed(self) -> tuple[str, ...]:
        """Give the last lines that it printed, while it runs."""
        state = self._program.state() if self._program is not None else None
        return () if state is None else state.lines()

    def close(self) -> None:
        """End it, and all that it has started; may be called twice. A copy only lets go of it."""
        if os.getpid() != self._owner:
            self.wire.close()
            return
        self.wire.say_bye()
        self.wire.close()
        if self._program is not None:
            self._program.close()

    def _shake_hands(self) -> Ready:
        error = self._program.error() if self._program is not None else ""
        if error:
            name = self._options.command[0]
            raise ConfigError(f"the stack cannot be started: {name}: {error}")
        with self.starting():
            self.wire.allow(self._options.start_limit)
            self.wire.send(messages.hello(importlib.metadata.version("mrta-falsify")))
            ready = read_ready(self.wire.receive())
        self.wire.is_binary = ready.encoding == "msgpack"
        return ready


def why_no_answer(error: Exception, limit: float, process: StackProcess | None) -> Ending:
    """Tell why a stack gave no answer.

    Args:
        error: one of ``NO_ANSWER``.
        limit: time that it had [s].
        process: that was asked; None: a copy of it, of which only the connection is known.
    """
    match error:
        case Closed():
            code, lines = (None, ()) if process is None else process.last_words()
            if code is None:
                return Ending("crash", "closed the connection", cause="closed", lines=lines)
            how = name_of_ending(code)
            cause = named_in(lines) or how
            return Ending("crash", f"ended by {how}", cause=cause, lines=lines)
        case Late():
            return Ending("hang", f"did not answer within {limit:g} s")
        case Heavy():
            return Ending("memory", str(error))
        case Wrong(field=field):
            return Ending("answer", str(error), cause=field)
        case _:
            return Ending("answer", str(error), cause="message")


def named_in(lines: Sequence[str]) -> str:
    """Give the exception that the last words of a program in Python or C++ name; else nothing."""
    found = [match[1] for line in lines if (match := EXCEPTION.search(line))]
    return found[-1].rpartition(".")[2] if found else ""


def _connected(options: ExternalStack) -> socket.socket:
    """Connect to a stack that runs already.

    Raises:
        ConfigError: nothing answers there.
    """
    address = options.address()
    link = socket.socket(socket.AF_UNIX if isinstance(address, str) else socket.AF_INET)
    try:
        link.settimeout(options.start_limit)
        link.connect(address)
        if not isinstance(address, str):
            link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    except OSError as error:
        link.close()
        raise ConfigError(
            f"the stack ({options.label()}) cannot be reached: {error.strerror or error}"
        ) from None
    return link
