"""A copy of this process that runs something, watched from outside.

The copy shows its heartbeat in shared memory. This process reads it, the CPU time and the resident
memory of the copy while it waits for an answer, and kills a copy whose stack hangs or takes too
much memory. That works whatever the stack does: a loop in Python, compiled code that holds
Python's lock, ``os._exit``, a segmentation fault.
"""

from __future__ import annotations

import contextlib
import faulthandler
import gc
import os
import signal
import sys
import time
import traceback
from collections.abc import Callable
from multiprocessing.connection import Connection, Pipe
from typing import Any, NamedTuple, NoReturn

from mrta_falsify.core.errors import HarnessError, MrtaFalsifyError
from mrta_falsify.core.interruption import signals_held
from mrta_falsify.core.process_clock import ProcessClock, descendants, read_process
from mrta_falsify.core.stack_failure import (
    GIB,
    FailureKind,
    StackFailed,
    StackFailure,
    StackLimits,
)
from simulator_interface import stack_calls
from simulator_interface.checkpoint import RolledBack, is_resumed
from simulator_interface.failing_layer import Place, dumped_places
from simulator_interface.forking import become_copy, ending_of
from simulator_interface.heartbeat import (
    Heartbeat,
    Post,
    Pulse,
    at_post,
    listen_to_compiler,
    post,
)

LOOK_EVERY = 0.05  # s between two looks at a copy; a tick limit is kept to about twice this
DUMP_WITHIN = 1.0  # s that a copy has to write where it hangs
SHOW_PLACE = signal.SIGUSR2  # makes a copy write its traceback
MAX_DUMPED = 1 << 16  # bytes of it


class CopyFailed(Exception):  # noqa: N818 - says what became of the copy
    """The stack brought down the copy that it ran in, or the copy had to be killed.

    Args:
        kind: how.
        pulse: the last heartbeat.
        exception: signal or exit code, if the copy ended by itself.
        message: in words.
        places: where it was, outermost frame first.
    """

    def __init__(
        self, kind: FailureKind, pulse: Pulse, exception: str, message: str, places: list[Place]
    ) -> None:
        super().__init__(message)
        self.kind, self.pulse, self.exception = kind, pulse, exception
        self.message, self.places = message, places


class RemoteTraceback(Exception):  # noqa: N818 - is never raised by itself
    """Where an exception was raised in a copy."""


class Request(NamedTuple):
    """What a copy is asked."""

    call: Callable[[], Any]
    ending: StackFailure | None = None  #: how the stack is known to fail
    may_roll_back: bool = False  #: whether a checkpoint of the copy may take its place


class WatchedCopy:
    """A copy of this process that answers requests until it is closed.

    It is made with the first request, which reaches it as it is; later ones are sent.

    Args:
        limits: of the stack under test.
    """

    def __init__(self, limits: StackLimits) -> None:
        self._limits = limits
        self._heartbeat = Heartbeat()
        self._dump = os.memfd_create("traceback")
        self._ours, self._theirs = Pipe()
        self._owner = os.getpid()
        self._process = 0  # until there is one
        self._status: int | None = None  # of the process, once it has ended

    def ask(self, request: Request) -> bool:
        """Put a request, the one before being answered; False: the copy has ended."""
        if not self._process:
            self._begin(request)
            return True
        try:
            self._ours.send(request)
        except (BrokenPipeError, ConnectionResetError):
            return False
        return True

    @property
    def is_too_large(self) -> bool:
        """Whether the stack has taken up more memory than it may, in calls that have ended."""
        return self._heartbeat.read().taken / GIB > self._limits.memory

    def answer(self, on_time: Callable[[float], None] = lambda time: None) -> Any:
        """Wait for the answer.

        Args:
            on_time: called with the simulated time [s] whenever that has changed.

        Raises:
            CopyFailed: the stack hung, took too much memory, or ended the process.
            HarnessError: the process ended outside the stack.
            Exception: what the request raised.
        """
        clock = _Clock()
        shown = -1.0
        while not self._ours.poll(LOOK_EVERY):
            pulse = self._heartbeat.read()
            if pulse.time != shown:
                shown = pulse.time
                on_time(shown)
            over = clock.over(pulse, self._limits)
            if over:
                raise self._kill(over, pulse)
            if self._has_ended() and not self._ours.poll(0):
                raise self._death()
        try:
            outcome = self._ours.recv()
        except EOFError:
            raise self._death() from None
        return _open(outcome)

    def close(self) -> None:
        """End the copy; may be called twice, and does nothing in copies of this process."""
        if self._ours.closed or os.getpid() != self._owner:
            return
        if self._process and self._status is None:
            for process in (*descendants(self._process), self._process):
                with contextlib.suppress(ProcessLookupError):
                    os.kill(process, signal.SIGKILL)
            self._has_ended(wait=True)
        with contextlib.suppress(OSError):  # garbage collection may have closed it before
            self._ours.close()
        self._theirs.close()
        os.close(self._dump)

    def _begin(self, request: Request) -> None:
        sys.stdout.flush()
        sys.stderr.flush()
        with signals_held():
            self._process = os.fork()
            if self._process == 0:
                self._serve(self._theirs, request)
        self._theirs.close()

    # --- ends -----------------------------------------------------------------------------

    def is_alive(self) -> bool:
        """Whether there is a process, and it has not ended."""
        return bool(self._process) and not self._has_ended()

    def _has_ended(self, *, wait: bool = False) -> bool:
        if self._status is None:
            with contextlib.suppress(ChildProcessError):
                ended, status = os.waitpid(self._process, 0 if wait else os.WNOHANG)
                self._status = status if ended else None
        return self._status is not None

    def _death(self) -> Exception:
        self._has_ended(wait=True)
        pulse, places = self._heartbeat.read(), self._dumped()
        self.close()
        code = os.waitstatus_to_exitcode(self._status or 0)
        how = ending_of(code)
        if not pulse.in_stack:
            return HarnessError(f"the process of a run ended by {how}, outside the stack")
        return CopyFailed("crash", pulse, how, f"the stack ended its process by {how}", places)

    def _kill(self, kind: FailureKind, pulse: Pulse) -> CopyFailed:
        with contextlib.suppress(ProcessLookupError):
            os.kill(pulse.process, SHOW_PLACE)
        until = time.monotonic() + DUMP_WITHIN
        while os.fstat(self._dump).st_size == 0 and time.monotonic() < until:
            time.sleep(LOOK_EVERY / 5)
        time.sleep(LOOK_EVERY / 5)  # the rest of the text
        places = self._dumped()
        self.close()
        message = (
            f"the stack gave no answer within {self._limits.tick:g} s of CPU time"
            if kind == "hang"
            else f"the stack took up more than {self._limits.memory:g} GiB of memory"
        )
        return CopyFailed(kind, pulse, "", message, places)

    def _dumped(self) -> list[Place]:
        text = os.pread(self._dump, MAX_DUMPED, 0).decode(errors="replace")
        return dumped_places(text, stack_calls.__file__)

    # --- in the copy -------------------------------------------------------------------------

    def _serve(self, pipe: Connection, request: Request) -> NoReturn:
        """Answer requests until the other end of the pipe is closed; never returns."""
        code = 1
        try:
            self._ours.close()
            become_copy(self._owner)
            faulthandler.enable(self._dump, all_threads=False)
            faulthandler.register(SHOW_PLACE, self._dump, all_threads=False, chain=False)
            listen_to_compiler()
            gc.freeze()  # what was made before stays; a copy of the copy shares more memory
            while True:
                self._answer_one(pipe, request)
                if is_resumed():  # the process that it was copied from takes the next request
                    break
                gc.collect()  # a run's objects refer to each other; its arrays are large
                gc.freeze()  # what it leaves, compiled code above all, stays; it is looked at once
                request = pipe.recv()
            code = 0
        except (EOFError, BrokenPipeError, ConnectionResetError):
            code = 0
        except BaseException:
            traceback.print_exc()
        finally:
            os._exit(code)

    def _answer_one(self, pipe: Connection, request: Request) -> None:
        ending, may_roll_back = request.ending, request.may_roll_back
        here = Post(self._heartbeat, self._limits, ending, may_roll_back=may_roll_back)
        try:
            with at_post(here):
                outcome = _outcome(request.call)
        except RolledBack as rolled_back:
            rolled_back.wait()  # its process has sent the answer
            return
        sys.stdout.flush()
        _send(pipe, outcome)


class _Clock:
    """Measures how long a process has been inside one call of the stack.

    What the stack has started counts as well (:mod:`mrta_falsify.core.process_clock`): a stack that
    waits for what never comes hangs, too.
    """

    def __init__(self) -> None:
        self._entry = -1
        self._clock = ProcessClock(0, counts_stops=True)
        self._cpu = 0.0  # of the process itself at the first look at this entry [s]
        self._heavy = -1  # entry that was over the memory limit at the last look

    def over(self, pulse: Pulse, limits: StackLimits) -> FailureKind | None:
        """Say which limit the stack exceeds, None if it keeps to all."""
        if not pulse.in_stack or pulse.compiling:
            self._entry = -1
            return None
        process = read_process(pulse.process)
        if process is None:  # it has just ended
            return None
        if pulse.entries != self._entry:
            self._entry, self._cpu = pulse.entries, process.cpu
            self._clock = ProcessClock(pulse.process, counts_stops=True)
            self._clock.look()
            return None
        # Memory first, since what takes up too much is slow as well. Two looks at one entry: the
        # figures of one may be of two moments.
        was_heavy, self._heavy = self._heavy == pulse.entries, -1
        if (pulse.taken + process.resident - pulse.resident) / GIB > limits.memory:
            self._heavy = pulse.entries
            return "memory" if was_heavy else None
        spent = self._cpu - pulse.entered_at + self._clock.look()
        return "hang" if spent > limits.tick else None


class _Raised(NamedTuple):
    """An exception on its way to another process."""

    kind: type[BaseException]
    args: tuple[Any, ...]
    more: dict[str, Any]  #: attributes
    traceback: str

    def rebuilt(self) -> BaseException:
        # Constructors of ours take other arguments than exceptions keep.
        if issubclass(self.kind, OSError):
            return self.kind(*self.args)
        error = self.kind.__new__(self.kind)
        error.args = self.args
        vars(error).update(self.more)
        return error


def _outcome(call: Callable[[], Any]) -> tuple[str, Any]:
    """Run a call; give what it returns or raises."""
    try:
        return "returned", call()
    except (Exception, KeyboardInterrupt) as error:
        args = error.args
        if isinstance(error, OSError) and error.filename is not None:
            args = (error.errno, error.strerror, error.filename)
        return "raised", _Raised(type(error), args, dict(vars(error)), traceback.format_exc())


def _send(pipe: Connection, outcome: tuple[str, Any]) -> None:
    """Send an outcome; if it cannot be sent, send why."""
    try:
        pipe.send(outcome)
    except (BrokenPipeError, ConnectionResetError):
        raise
    except Exception as error:
        fate, content = outcome
        text = f"{content.kind.__name__}: {content.args}" if fate == "raised" else str(error)
        pipe.send(("raised", _Raised(HarnessError, (text,), {}, traceback.format_exc())))


def _open(outcome: tuple[str, Any]) -> Any:
    """Return what a copy's call returned, or raise what it raised."""
    fate, content = outcome
    if fate == "returned":
        return content
    raise content.rebuilt() from RemoteTraceback(f"\n{content.traceback}")


class CallableCopy:
    """A copy of this process, under the limits of this one, in which things are run.

    It is made with the first call, which may be anything; later ones must be such as can be sent.
    """

    def __init__(self) -> None:
        self._copy = WatchedCopy(post().limits)

    def call(self, call: Callable[[], Any]) -> Any:
        """Run something in the copy.

        Raises:
            CopyFailed: the stack hung, took too much memory, or ended the process.
            StackFailed: the stack failed otherwise.
            InputError: as ``call``.
            HarnessError: the process ended outside the stack, or ``call`` failed.
        """
        try:
            if not self._copy.ask(Request(call, post().ending)):
                raise HarnessError("a copy of the run has ended")
            return self._copy.answer()
        except (CopyFailed, StackFailed, MrtaFalsifyError):
            raise
        except Exception as error:
            text = f"a copy of the run failed: {type(error).__name__}: {error}"
            raise HarnessError(text) from error

    def is_alive(self) -> bool:
        """Whether the copy can be called again."""
        return self._copy.is_alive()

    def close(self) -> None:
        """End the copy; may be called twice."""
        self._copy.close()


def run_in_watched_copy(call: Callable[[], Any]) -> Any:
    """Run something once in a copy of this process, under the limits of this one.

    Raises:
        MrtaFalsifyError: as :meth:`CallableCopy.call`.
        CopyFailed: as there.
        StackFailed: as there.
    """
    copy = CallableCopy()
    try:
        return copy.call(call)
    finally:
        copy.close()
