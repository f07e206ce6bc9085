"""The supervisor: runs a job in a child, and gives its value or says how the child ended.

A fork shows its heartbeat in shared memory. This process reads it, the CPU time and the resident
memory of the fork while it waits for an answer, and kills a fork whose stack hangs or takes too
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
from collections.abc import Callable, Collection
from multiprocessing.connection import Connection, Pipe
from typing import Any, NamedTuple, NoReturn

from mrta_falsify.core.errors import HarnessError, MrtaFalsifyError
from mrta_falsify.core.interruption import signals_held
from mrta_falsify.core.stack_failure import GIB, FailureKind, StackFailed, StackFailure
from mrta_falsify.process.budget import Budget
from mrta_falsify.process.child import Child, fork, send
from mrta_falsify.process.ending import (
    Ending,
    Outcome,
    Raised,
    name_of_ending,
    opened,
    outcome_of,
)
from mrta_falsify.process.program import Command, Program
from mrta_falsify.process.snapshot import RolledBack, is_resumed
from mrta_falsify.process.usage import Named, ProcessClock, read_process
from mrta_falsify.process.watch import (
    Heartbeat,
    Pulse,
    Watch,
    current_watch,
    listen_to_compiler,
    under,
)

LOOK_EVERY = 0.05  # s between two looks at a fork; a tick limit is kept to about twice this
DUMP_WITHIN = 1.0  # s that a fork has to write where it hangs
SHOW_PLACE = signal.SIGUSR2  # makes a fork write its traceback
MAX_DUMPED = 1 << 16  # bytes of it


class Printed(NamedTuple):
    """What became of a program."""

    code: int  #: exit code, or the negative of the signal that ended it
    text: str  #: the last that it printed


class Request(NamedTuple):
    """What a fork is asked."""

    call: Callable[[], Any]
    ending: StackFailure | None = None  #: how the stack is known to fail
    may_roll_back: bool = False  #: whether a snapshot of the fork may take its place


def run_supervised(job: Callable[[], Any], budget: Budget | None = None) -> Any:
    """Run a job once, in a fork of this process.

    Args:
        job: a function without arguments.
        budget: of the stack under test, for each tick; None: as in this process.

    Returns:
        What the job returns.

    Raises:
        Ending: the fork ended, or had to be ended, within the stack.
        StackFailed: the stack failed otherwise.
        MrtaFalsifyError: as the job.
        HarnessError: the fork ended outside the stack, or the job failed.
    """
    supervisor = Supervisor(budget)
    try:
        return supervisor.run(job)
    finally:
        supervisor.close()


def run_command(command: Command, budget: Budget) -> Printed:
    """Run a command once.

    Args:
        command: how it is started.
        budget: of the command, from its start to its end.

    Raises:
        Ending: it did not end within its budget, or somebody has killed its keeper.
        HarnessError: it cannot be started.
    """
    program = Program(command)
    try:
        if error := program.error():
            raise HarnessError(f"{command.words[0]}: cannot be started: {error}")
        clock = ProcessClock(program.number, counts_stops=True)
        while (state := program.state()) is not None and state.code is None:
            if clock.look() > budget.work:
                raise Ending("hang", f"did not end within {budget.work:g} s", lines=state.lines())
            time.sleep(LOOK_EVERY)
        if state is None or state.code is None:
            raise Ending("crash", "ended by SIGKILL", cause="SIGKILL")
        return Printed(state.code, state.tail)
    finally:
        program.close()


class Supervisor:
    """Runs jobs in a fork of this process, and keeps the fork from one to the next.

    The fork is made with the first job, which may be anything; later ones must be such as can be
    sent to another process.

    Args:
        budget: of the stack under test, for one tick; None: as in this process.
    """

    def __init__(self, budget: Budget | None = None) -> None:
        self._budget = budget or current_watch().budget
        self._heartbeat = Heartbeat()
        self._dump = os.memfd_create("traceback")
        self._ours, self._theirs = Pipe()
        self._owner = os.getpid()
        self._child: Child | None = None  # until the first job
        self._clock = _TickClock()

    def run(self, job: Callable[[], Any]) -> Any:
        """Run a job under the watch of this process.

        Raises:
            Exception: as :func:`run_supervised`.
        """
        try:
            if not self.ask(Request(job, current_watch().ending)):
                raise HarnessError("a copy of the run has ended")
            return self.answer()
        except (Ending, StackFailed, MrtaFalsifyError):
            raise
        except Exception as error:
            text = f"a copy of the run failed: {type(error).__name__}: {error}"
            raise HarnessError(text) from error

    def ask(self, request: Request) -> bool:
        """Put a request, the one before being answered; False: the fork has ended."""
        if self._child is None:
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
        return self._heartbeat.read().taken / GIB > self._budget.memory

    def answer(self, on_time: Callable[[float], None] = lambda time: None) -> Any:
        """Wait for the answer to a request.

        Args:
            on_time: called with the simulated time [s] whenever that has changed.

        Raises:
            Ending: the stack hung, took too much memory, or ended the process.
            HarnessError: the process ended outside the stack.
            Exception: what the request raised.
        """
        self._clock = _TickClock()
        shown = -1.0
        while not self._ours.poll(LOOK_EVERY):
            pulse = self._heartbeat.read()
            if pulse.time != shown:
                shown = pulse.time
                on_time(shown)
            over = self._clock.over(pulse, self._budget)
            if over:
                raise self._kill(over, pulse)
            if not self.is_alive() and not self._ours.poll(0):
                raise self._death()
        try:
            outcome = self._ours.recv()
        except EOFError:
            raise self._death() from None
        return opened(outcome)

    def is_alive(self) -> bool:
        """Whether there is a fork, and it has not ended."""
        return self._child is not None and self._child.code() is None

    def close(self) -> None:
        """End the fork; may be called twice, and does nothing in forks of this process."""
        if self._ours.closed or os.getpid() != self._owner:
            return
        if self._child is not None:
            self._child.kill(self._clock.seen)
        with contextlib.suppress(OSError):  # garbage collection may have closed it before
            self._ours.close()
        self._theirs.close()
        os.close(self._dump)

    def _begin(self, request: Request) -> None:
        with signals_held():  # Ctrl-C finds the fork owned, so `close` kills it
            self._child = fork()
            if self._child is None:
                self._serve(self._theirs, request)
        self._theirs.close()

    # --- ends -----------------------------------------------------------------------------

    def _death(self) -> Exception:
        assert self._child is not None
        how = name_of_ending(self._child.code(wait=True) or 0)
        pulse, where = self._heartbeat.read(), self._dumped()
        self.close()
        if not pulse.in_stack:
            return HarnessError(f"the process of a run ended by {how}, outside the stack")
        text = f"ended its process by {how}"
        return Ending("crash", text, cause=how, tick=pulse.tick, time=pulse.time, where=where)

    def _kill(self, kind: FailureKind, pulse: Pulse) -> Ending:
        send(pulse.process, SHOW_PLACE)
        until = time.monotonic() + DUMP_WITHIN
        while os.fstat(self._dump).st_size == 0 and time.monotonic() < until:
            time.sleep(LOOK_EVERY / 5)
        time.sleep(LOOK_EVERY / 5)  # the rest of the text
        where = self._dumped()
        self.close()
        text = (
            f"gave no answer within {self._budget.work:g} s of CPU time"
            if kind == "hang"
            else f"took up more than {self._budget.memory:g} GiB of memory"
        )
        return Ending(kind, text, tick=pulse.tick, time=pulse.time, where=where)

    def _dumped(self) -> str:
        return os.pread(self._dump, MAX_DUMPED, 0).decode(errors="replace")

    # --- in the fork -------------------------------------------------------------------------

    def _serve(self, pipe: Connection, request: Request) -> NoReturn:
        """Answer requests until the other end of the pipe is closed; never returns."""
        code = 1
        try:
            self._ours.close()
            faulthandler.enable(self._dump, all_threads=False)
            faulthandler.register(SHOW_PLACE, self._dump, all_threads=False, chain=False)
            listen_to_compiler()
            gc.freeze()  # what was made before stays; a fork of the fork shares more memory
            while True:
                self._answer_one(pipe, request)
                if is_resumed():  # the process that it was forked from takes the next request
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
        watch = Watch(
            self._heartbeat, self._budget, request.ending, may_roll_back=request.may_roll_back
        )
        try:
            with under(watch):
                outcome = outcome_of(request.call)
        except RolledBack as rolled_back:
            rolled_back.wait()  # its process has sent the answer
            return
        sys.stdout.flush()
        _send(pipe, outcome)


class _TickClock:
    """Measures how long a process has been inside one call of the stack.

    What the stack has started counts as well (:mod:`mrta_falsify.process.usage`): a stack that
    waits for what never comes hangs, too.
    """

    def __init__(self) -> None:
        self._entry = -1
        self._clock = ProcessClock(0, counts_stops=True)
        self._cpu = 0.0  # of the process itself at the first look at this entry [s]
        self._heavy = -1  # entry that was over the memory limit at the last look

    @property
    def seen(self) -> Collection[Named]:
        """Processes of the stack at the last look."""
        return self._clock.alive

    def over(self, pulse: Pulse, budget: Budget) -> FailureKind | None:
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
        if (pulse.taken + process.resident - pulse.resident) / GIB > budget.memory:
            self._heavy = pulse.entries
            return "memory" if was_heavy else None
        spent = self._cpu - pulse.entered_at + self._clock.look()
        return "hang" if spent > budget.work else None


def _send(pipe: Connection, outcome: Outcome) -> None:
    """Send an outcome; if it cannot be sent, send why."""
    try:
        pipe.send(outcome)
    except (BrokenPipeError, ConnectionResetError):
        raise
    except Exception as error:
        pipe.send(Raised.unsendable(error, outcome))
