"""The keeper of a stack's process: a process that outlives neither the stack nor its owner.

A stack may start processes of its own, and may be killed, as may the process that asks it. The
keeper is their parent, and adopts what they leave behind (``PR_SET_CHILD_SUBREAPER``). When its
owner ends, or says so, it kills all of them. It reads what they print and keeps the last of it.
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
from typing import Any, NoReturn

from mrta_falsify.core.interruption import signals_held
from mrta_falsify.core.process_clock import children_of, descendants
from simulator_interface.forking import PARENT_DEATH_SIGNAL

CHILD_SUBREAPER = 36  # of prctl(2), Linux
TAIL = 1 << 14  # bytes of output that are kept
PATIENCE = 5.0  # s that the keeper has for an answer
GRACE = 0.2  # s between bye and the end by force
AT_MOST = 60.0  # s in which what was killed ends, on however busy a machine

_libc = ctypes.CDLL(None) if sys.platform == "linux" else None


class Keeper:
    """Starts a program and keeps it; one object per process.

    Args:
        command: program and arguments.
        folder: where it runs.
        environment: all of it.
        link: socket that the program inherits under the same number.
    """

    def __init__(
        self,
        command: Sequence[str],
        folder: str,
        environment: Mapping[str, str],
        link: socket.socket,
    ) -> None:
        self._ours, theirs = socket.socketpair()
        self._ours.settimeout(PATIENCE)
        self._owner = os.getpid()
        sys.stdout.flush()
        sys.stderr.flush()
        with signals_held():
            self.process = os.fork()  #: of the keeper, the parent of all that it keeps
            if self.process == 0:
                _keep(theirs, command, folder, environment, link)
        theirs.close()

    def begun(self) -> str:
        """Wait until the program has begun; why it could not, empty: it could."""
        return str(self._ask("begun").get("error", ""))

    def state(self) -> dict[str, Any]:
        """Tell ``exit`` (code, None: it runs) and ``tail`` (of its output)."""
        return self._ask("state")

    def kept(self) -> list[int]:
        """List the numbers of all processes that the program has started, itself among them."""
        return descendants(self.process)

    def close(self) -> None:
        """Kill all that the program has started; may be called twice, not by copies."""
        if self.process < 0 or os.getpid() != self._owner:
            return
        with contextlib.suppress(OSError):  # the keeper has been killed
            self._ours.shutdown(socket.SHUT_RDWR)  # copies of this process may hold it open
        self._ours.close()
        with contextlib.suppress(ChildProcessError):
            os.waitpid(self.process, 0)
        self.process = -1

    def _ask(self, question: str) -> dict[str, Any]:
        try:
            self._ours.sendall(question.encode() + b"\n")
            answer = b""
            while not answer.endswith(b"\n"):
                part = self._ours.recv(1 << 16)
                if not part:
                    return {}
                answer += part
            found: dict[str, Any] = json.loads(answer)
        except OSError:
            return {}  # somebody has killed the keeper
        return found


# --- in the keeper's process -----------------------------------------------------------------


def _keep(
    control: socket.socket,
    command: Sequence[str],
    folder: str,
    environment: Mapping[str, str],
    link: socket.socket,
) -> NoReturn:
    try:
        os.setsid()  # Ctrl-C in the terminal is the owner's business
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        signal.set_wakeup_fd(-1)
        signal.pthread_sigmask(signal.SIG_SETMASK, [])
        _close_all_but(control.fileno(), link.fileno())
        if _libc is not None:
            _libc.prctl(CHILD_SUBREAPER, 1)
        _Kept(control, command, folder, environment, link).serve()
    except Exception:
        traceback.print_exc()
    finally:
        os._exit(0)


class _Kept:
    def __init__(
        self,
        control: socket.socket,
        command: Sequence[str],
        folder: str,
        environment: Mapping[str, str],
        link: socket.socket,
    ) -> None:
        self._control = control
        self._tail = b""
        self._error = ""
        self._program: subprocess.Popen[bytes] | None = None
        os.set_inheritable(link.fileno(), True)
        try:
            self._program = subprocess.Popen(
                command,
                cwd=folder,
                env=dict(environment),
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                pass_fds=(link.fileno(),),
                preexec_fn=_die_with_parent,  # noqa: PLW1509 - this process has one thread
            )
        except OSError as error:
            self._error = f"{command[0]}: {error.strerror}"
        link.close()

    def serve(self) -> None:
        """Answer the owner until it is gone; then leave nothing behind."""
        output = self._program.stdout if self._program and self._program.stdout else None
        question = b""
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
                question += part
                if question.endswith(b"\n"):
                    self._answer(question.decode().strip(), output)
                    question = b""
        self._end_all()

    def _answer(self, question: str, output: Any) -> None:
        answer: dict[str, Any] = {"error": self._error}
        if question == "state" and self._program is not None:
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

    def _end_all(self) -> None:
        """Kill all children, and adopt and kill theirs, until none is left."""
        if self._program is not None and self._program.poll() is None:
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._program.wait(GRACE)  # it may have been told to end
        until = time.monotonic() + AT_MOST
        while time.monotonic() < until:
            for child in children_of(os.getpid()):
                with contextlib.suppress(ProcessLookupError, PermissionError):
                    os.kill(child, signal.SIGKILL)
            try:
                while os.waitpid(-1, os.WNOHANG)[0]:
                    pass
            except ChildProcessError:  # /proc may leave one out while another one ends; this not
                return
            time.sleep(0.002)


def _die_with_parent() -> None:
    if _libc is not None:
        _libc.prctl(PARENT_DEATH_SIGNAL, signal.SIGKILL)


def _close_all_but(*kept: int) -> None:
    """Close all descriptors but the standard ones and those given."""
    last = 3
    for number in (*sorted(kept), os.sysconf("SC_OPEN_MAX")):
        if number > last:
            os.closerange(last, number)
        last = number + 1
