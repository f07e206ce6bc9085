"""A program of somebody else: it outlives neither its owner nor what it was started for.

A stack may start processes of its own, and may be killed, as may the process that asks it. So a
*keeper* stands between: a fork of the owner that is the parent of the program, and adopts what
that leaves behind (``PR_SET_CHILD_SUBREAPER``). When its owner ends, or says so, it kills all of
them. It reads what they print and keeps the last of it.
"""

from __future__ import annotations

import contextlib
import ctypes
import json
import os
import select
import signal
import socket
import subprocess
import sys
import time
import traceback
from collections.abc import Mapping, Sequence
from types import FrameType
from typing import Any, NamedTuple, NoReturn

from mrta_falsify.core.interruption import signals_held
from mrta_falsify.process.child import Child, fork, send
from mrta_falsify.process.parent import end_with
from mrta_falsify.process.usage import ENDED, STOPPED, children_of, descendants, read_process

CHILD_SUBREAPER = 36  # of prctl(2), Linux
TAIL = 1 << 14  # bytes of output that are kept
LAST_LINES = 8  # of them
LONGEST_LINE = 300  # characters
PATIENCE = 5.0  # s without an answer after which the owner looks whether the keeper lives
GRACE = 0.2  # s between bye and the end by force
AT_MOST = 60.0  # s in which what was killed ends, on however busy a machine

_libc = ctypes.CDLL(None) if sys.platform == "linux" else None


class Command(NamedTuple):
    """How a program is started."""

    words: Sequence[str]  #: its name and its arguments
    environment: Mapping[str, str]  #: all of it
    folder: str = "."  #: where it runs
    link: socket.socket | None = None  #: that it inherits under the same number
    is_quiet: bool = True  #: its output is kept; else it goes where that of this process goes


class ProgramState(NamedTuple):
    """What a program does."""

    code: int | None = None  #: exit code, or the negative of a signal; None: it runs
    tail: str = ""  #: of its output

    def lines(self) -> tuple[str, ...]:
        """Give the last lines of its output."""
        lines = (line.rstrip()[:LONGEST_LINE] for line in self.tail.splitlines())
        return tuple(line for line in lines if line)[-LAST_LINES:]


class Program:
    """Starts a program and keeps it; one object per process.

    Args:
        command: how it is started.
    """

    def __init__(self, command: Command) -> None:
        self._ours, theirs = socket.socketpair()
        self._ours.settimeout(PATIENCE)
        self._owner = os.getpid()
        self._begun: dict[str, Any] = {}  # what the keeper has said of the start
        self._asked = 0  # questions so far
        self._heard = b""  # of answers, not yet read
        self._keeper: Child | None = None  # until it is forked
        try:
            with signals_held():  # Ctrl-C finds the keeper owned
                self._keeper = keeper = fork(on_parents_end=signal.SIGTERM)
                if keeper is None:
                    _keep(theirs, command)
                self.number = keeper.number  #: of the process that has started the program
            theirs.close()
        except BaseException:
            theirs.close()
            self.close()  # nobody else knows of it yet
            raise

    def error(self) -> str:
        """Wait until the program has begun; why it could not, empty: it could."""
        return str(self._beginning().get("error", ""))

    def state(self) -> ProgramState | None:
        """Tell what it does; None: somebody has killed its keeper, which ends it."""
        answer = self._ask("state")
        return ProgramState(answer.get("exit"), answer.get("tail", "")) if answer else None

    def has_ended(self) -> bool:
        """Say whether it has ended, which takes less than its state."""
        process = read_process(self._beginning().get("program", 0))
        return process is None or process.state in ENDED

    def kept(self) -> list[int]:
        """List the numbers of all processes that the program has started, itself among them."""
        return descendants(self.number)

    def ask_to_end(self) -> None:
        """Send SIGTERM to the program, and to what it has started in its process group."""
        if program := self._beginning().get("program"):
            with contextlib.suppress(ProcessLookupError, PermissionError):
                os.killpg(program, signal.SIGTERM)

    def close(self) -> None:
        """Kill all that the program has started; may be called twice, not by copies."""
        if self._ours.fileno() < 0 or os.getpid() != self._owner:
            return
        with contextlib.suppress(OSError):  # the keeper has been killed
            self._ours.shutdown(socket.SHUT_RDWR)  # copies of this process may hold it open
        self._ours.close()
        if self._keeper is not None:
            self._keeper.code(wait=True)
            self._keeper.kill()  # what it may have left if it was killed itself

    def _beginning(self) -> dict[str, Any]:
        if not self._begun:
            self._begun = self._ask("begun")
        return self._begun

    def _ask(self, question: str) -> dict[str, Any]:
        """Ask the keeper, however slow it is; empty: somebody has killed or stopped it."""
        self._asked += 1
        question = f"{question} {self._asked}"
        try:
            self._ours.sendall(question.encode() + b"\n")
            while True:
                answer: dict[str, Any] = json.loads(self._line())
                if answer["question"] == question:  # not one that came too late
                    return answer
        except OSError:
            return {}

    def _line(self) -> bytes:
        while b"\n" not in self._heard:
            try:
                part = self._ours.recv(1 << 16)
            except TimeoutError:
                keeper = read_process(self.number)
                if keeper is None or keeper.state in ENDED + STOPPED:
                    raise
                continue
            if not part:
                raise ConnectionResetError
            self._heard += part
        line, _, self._heard = self._heard.partition(b"\n")
        return line


# --- in the keeper's process -----------------------------------------------------------------


def _keep(control: socket.socket, command: Command) -> NoReturn:
    def hang_up(number: int, frame: FrameType | None) -> None:
        with contextlib.suppress(OSError):
            control.shutdown(socket.SHUT_RDWR)  # `serve` ends as if the owner had closed it

    try:
        signal.signal(signal.SIGTERM, hang_up)  # the owner has ended
        _close_all_but(control.fileno(), *([command.link.fileno()] if command.link else []))
        if _libc is not None:
            _libc.prctl(CHILD_SUBREAPER, 1)
        keeper = _Keeper(control)
        try:
            keeper.start(command)
            with contextlib.suppress(BrokenPipeError, ConnectionResetError):  # the owner is gone
                keeper.serve()
        finally:
            keeper.end_all()
    except Exception:
        traceback.print_exc()
    finally:
        os._exit(0)


class _Keeper:
    def __init__(self, control: socket.socket) -> None:
        self._control = control
        self._tail = b""
        self._error = ""
        self._program: subprocess.Popen[bytes] | None = None

    def start(self, command: Command) -> None:
        """Start the program."""
        keeper = os.getpid()
        try:
            self._program = subprocess.Popen(
                command.words,
                cwd=command.folder,
                env=dict(command.environment),
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE if command.is_quiet else None,
                stderr=subprocess.STDOUT if command.is_quiet else None,
                pass_fds=[command.link.fileno()] if command.link else [],
                process_group=0,
                preexec_fn=lambda: end_with(keeper),  # noqa: PLW1509 - this process has one thread
            )
        except OSError as error:
            self._error = error.strerror or str(error)
        if command.link:
            command.link.close()

    def serve(self) -> None:
        """Answer the owner until it is gone."""
        output = self._program.stdout if self._program and self._program.stdout else None
        rest = b""
        while True:
            watched: list[Any] = [self._control] if output is None else [self._control, output]
            ready, _, _ = select.select(watched, [], [])
            if output in ready and output is not None:
                part = os.read(output.fileno(), 1 << 16)
                if not part:
                    output = None
                self._tail = (self._tail + part)[-TAIL:]
            if self._control in ready:
                part = self._control.recv(1 << 10)
                if not part:
                    break
                *questions, rest = (rest + part).split(b"\n")
                for question in questions:
                    self._answer(question.decode(), output)

    def _answer(self, question: str, output: Any) -> None:
        answer: dict[str, Any] = {"question": question, "error": self._error}
        if self._program is not None:
            answer["program"] = self._program.pid
        if question.startswith("state") and self._program is not None:
            code = self._program.poll()
            if code is not None and output is not None:
                self._drain(output)
            answer |= {
                "exit": code,
                "tail": self._tail.decode(errors="replace"),
            }
        self._control.sendall(json.dumps(answer).encode() + b"\n")

    def _drain(self, output: Any) -> None:
        while select.select([output], [], [], 0.0)[0]:
            part = os.read(output.fileno(), 1 << 16)
            if not part:
                return
            self._tail = (self._tail + part)[-TAIL:]

    def end_all(self) -> None:
        """Kill all children, and adopt and kill theirs, until none is left."""
        if self._program is not None and self._program.poll() is None:
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._program.wait(GRACE)  # it may have been told to end
        until = time.monotonic() + AT_MOST
        while time.monotonic() < until:
            for child in children_of(os.getpid()):
                send(child, signal.SIGKILL)
            try:
                while os.waitpid(-1, os.WNOHANG)[0]:
                    pass
            except ChildProcessError:  # /proc may leave one out while another one ends; this not
                return
            time.sleep(0.002)


def _close_all_but(*kept: int) -> None:
    """Close all descriptors but the standard ones and those given."""
    last = 3
    for number in (*sorted(kept), os.sysconf("SC_OPEN_MAX")):
        if number > last:
            os.closerange(last, number)
        last = number + 1
