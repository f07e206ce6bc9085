"""The programs with the user's nodes: started for one episode, and ended with it."""

from __future__ import annotations

import shlex
import socket
import time
from collections.abc import Mapping, Sequence

from mrta_falsify.process.ending import name_of_ending
from mrta_falsify.process.program import Program

PATIENCE = 2.0  # s between asking a program to end and ending it
LOOK_EVERY = 0.02  # s between two looks at whether it has ended


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
        self._running: list[tuple[str, Program]] = []
        for command in commands:
            program = Program(command, ".", env, hold, is_quiet=False)
            self._running.append((shlex.join(command), program))
            if error := program.error():
                self.end()
                raise NodeEnded(f"{shlex.join(command)}: cannot be started: {error}")

    def look(self) -> None:
        """See whether all run.

        Raises:
            NodeEnded: one does not.
        """
        for label, program in self._running:
            if program.has_ended():
                state = program.state()
                code = -9 if state is None or state.code is None else state.code
                raise NodeEnded(f"{label} ended by {name_of_ending(code)}")

    def end(self) -> None:
        """End them and what they have started; may be called twice."""
        for _, program in self._running:
            program.ask_to_end()
        until = time.monotonic() + PATIENCE
        for _, program in self._running:
            while not program.has_ended() and time.monotonic() < until:
                time.sleep(LOOK_EVERY)
            program.close()
        self._running = []
