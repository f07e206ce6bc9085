"""The programs with the user's nodes: started for one episode, and ended with it."""

from __future__ import annotations

import contextlib
import os
import shlex
import signal
import socket
import subprocess
import time
from collections.abc import Mapping, Sequence

from simulator_interface.forking import ending_of

PATIENCE = 2.0  # s between asking a program to end and ending it


class NodeEnded(Exception):  # noqa: N818 - says what a program did
    """A program that holds nodes has ended before the episode."""


class Nodes:
    """Programs that run.

    Args:
        commands: that start them.
        env: their environment.
        hold: socket that stays reserved while any of them runs.

    Raises:
        NodeEnded: one cannot be started.
    """

    def __init__(
        self, commands: Sequence[Sequence[str]], env: Mapping[str, str], hold: socket.socket
    ) -> None:
        self._running: list[subprocess.Popen[bytes]] = []
        for command in commands:
            try:
                self._running.append(_started(command, env, hold))
            except OSError as error:
                self.end()
                label = shlex.join(command)
                raise NodeEnded(f"{label}: cannot be started: {error.strerror}") from None

    def look(self) -> None:
        """See whether all run.

        Raises:
            NodeEnded: one does not.
        """
        for process in self._running:
            code = process.poll()
            if code is not None:
                label = shlex.join(map(str, process.args))  # type: ignore[arg-type]
                raise NodeEnded(f"{label} ended by {ending_of(code)}")

    def end(self) -> None:
        """End them and what they have started; may be called twice."""
        for process in self._running:
            _send(process, signal.SIGTERM)
        until = time.monotonic() + PATIENCE
        for process in self._running:
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(max(0.0, until - time.monotonic()))
            _send(process, signal.SIGKILL)
            process.wait()
        self._running = []


def _started(
    command: Sequence[str], env: Mapping[str, str], hold: socket.socket
) -> subprocess.Popen[bytes]:
    return subprocess.Popen(
        command,
        env=env,
        stdin=subprocess.DEVNULL,
        pass_fds=(hold.fileno(),),
        start_new_session=True,  # so that what it starts can be ended with it
    )


def _send(process: subprocess.Popen[bytes], number: int) -> None:
    with contextlib.suppress(ProcessLookupError):
        os.killpg(process.pid, number)
