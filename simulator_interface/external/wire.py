"""One conversation with a stack's process: messages in its encoding, within time limits.

A limit counts what the processes of the stack work and sleep. Of a stack that was not started here
they are not known: it has wall-clock time, and a run in which it is late is lost, never judged.
"""

from __future__ import annotations

import contextlib
import functools
import json
import socket
import time
from collections.abc import Callable, Iterator
from typing import Any, TypeVar

import msgpack

from mrta_falsify.core.errors import HarnessError
from mrta_falsify.process.usage import ProcessClock, WallClock
from simulator_interface.clients.mrta_stack import Closed, Connection
from simulator_interface.external.messages import Message, plain

__all__ = ["Closed", "Late", "LateByWallClock", "Unreadable", "Wire"]

T = TypeVar("T")

MAX_HEARD = 16 << 20  # bytes of a message; each may become 64 bytes of empty lists in memory
LEAST = 1e-3  # s; a socket takes 0 for "do not wait at all"
LOOK_EVERY = 0.1  # s of waiting between two looks at the stack; the first one begins to count
SOONEST = 0.01  # s until the next look, however little of a limit is left
FAREWELL = 0.1  # s of wall clock that a stack has to read the last message


class Late(Exception):  # noqa: N818 - says what happened to the stack
    """The stack has not answered within its limit."""


class LateByWallClock(HarnessError):  # noqa: N818 - says what happened to the stack
    """A stack that was not started here has not answered within its limit of wall-clock time."""


class Unreadable(Exception):  # noqa: N818
    """What came is no message of the protocol; the text says why."""


class _Timed(Connection):
    """A connection whose messages must be complete within a limit."""

    most = MAX_HEARD

    def __init__(self, link: socket.socket, clock: ProcessClock | WallClock) -> None:
        super().__init__(link)
        self.look: Callable[[], None] = lambda: None  #: called now and then while it waits
        self.clock = clock  #: that limits are measured by
        self._limit = 0.0  # s
        self._waited = 0.0  # since the last look at the clock [s]

    def allow(self, limit: float) -> None:
        """Begin a limit [s] for all that is said and heard from now on."""
        self._limit, self._waited = limit, 0.0
        self.clock.restart()

    def wait(self, link: socket.socket, attempt: Callable[[], T]) -> T:
        """Do what waits for the stack, again and again until it is done.

        Args:
            link: that it uses.
            attempt: raises TimeoutError once the timeout of ``link`` is over.

        Raises:
            TimeoutError: the limit is over.
        """
        while True:
            left = max(SOONEST, self._limit - self.clock.spent)
            link.settimeout(max(min(left, LOOK_EVERY) - self._waited, LEAST))
            began = time.monotonic()
            try:
                return attempt()
            except TimeoutError:
                pass
            finally:
                self._waited += time.monotonic() - began
            self.look()
            waited, self._waited = self._waited, 0.0
            if self.clock.look(waited) >= self._limit:
                raise TimeoutError

    def _put(self, data: bytes) -> None:
        rest = memoryview(data)
        while rest:
            rest = rest[self.wait(self._link, functools.partial(self._link.send, rest)) :]

    def _chunk(self, most: int) -> bytes:
        return self.wait(self._link, functools.partial(super()._chunk, most))


class Wire:
    """Messages to and from a stack.

    Args:
        link: connected socket.
        root: process that was started here, which is the stack or has started it; None: the stack
            runs already.
    """

    def __init__(self, link: socket.socket, root: int | None) -> None:
        clock = WallClock() if root is None else ProcessClock(root, counts_stops=True)
        self._connection = _Timed(link, clock)
        self._limit = 0.0
        self.is_binary = False  #: msgpack; the handshake is JSON

    def look_at_stack(self, look: Callable[[], None]) -> None:
        """Have ``look`` called now and then while an answer is waited for; it may raise."""
        self._connection.look = look

    def allow(self, limit: float) -> None:
        """Begin a limit [s]: all that is said and heard from now on must be done within it."""
        self._limit = limit
        self._connection.allow(limit)

    @contextlib.contextmanager
    def _within_limit(self) -> Iterator[None]:
        try:
            yield
        except TimeoutError:
            if isinstance(self._connection.clock, ProcessClock):
                raise Late from None
            raise LateByWallClock(
                f"the stack did not answer within {self._limit:g} s of wall-clock time; it was not "
                "started here, so whether it waited for a processor is not known"
            ) from None

    def send(self, message: Message) -> bytes:
        """Send a message; give the bytes that were sent.

        Raises:
            Closed: the stack has closed the connection.
            Late: it does not read.
            LateByWallClock: as ``Late``, of a stack that runs already.
        """
        shaped = plain(message, binary=self.is_binary)
        body = msgpack.packb(shaped) if self.is_binary else json.dumps(shaped).encode()
        self.send_bytes(body)
        return body

    def send_bytes(self, body: bytes) -> None:
        """Send the bytes of a message; see :meth:`send`."""
        with self._within_limit():
            self._connection.send(body)

    def receive_bytes(self) -> bytes:
        """Receive the bytes of a message.

        Raises:
            Closed: the stack has closed the connection.
            Late: no whole message came within the limit.
            LateByWallClock: as ``Late``, of a stack that runs already.
            Unreadable: too long a message is announced.
        """
        try:
            with self._within_limit():
                return self._connection.receive()
        except ValueError as error:
            raise Unreadable(f"{error}; is something printing to the connection?") from None

    def accept(self, door: socket.socket) -> socket.socket:
        """Accept a connection of a copy of the stack; errors as in :meth:`receive_bytes`."""
        with self._within_limit():
            return self._connection.wait(door, door.accept)[0]

    def say_bye(self) -> None:
        """Tell the stack that it may end, if it listens."""
        self._connection.clock = WallClock()
        self.allow(FAREWELL)
        with contextlib.suppress(Closed, LateByWallClock, OSError):
            self.send({"type": "bye"})

    def read(self, body: bytes) -> Message:
        """Decode a message; see :meth:`decoded`."""
        return self.decoded(body, is_binary=self.is_binary)

    @staticmethod
    def decoded(body: bytes, *, is_binary: bool) -> Message:
        """Decode a message.

        Raises:
            Unreadable: it is none.
        """
        try:
            message: Any = msgpack.unpackb(body) if is_binary else _from_json(body)
        except (ValueError, TypeError, RecursionError, msgpack.UnpackException) as error:
            kind = "msgpack" if is_binary else "JSON"
            raise Unreadable(f"a message is not {kind}: {error}") from None
        if not isinstance(message, dict) or not isinstance(message.get("type"), str):
            raise Unreadable("a message is not a map with a field `type`")
        return message

    def receive(self) -> Message:
        """Receive a message; see :meth:`receive_bytes` and :meth:`read`."""
        return self.read(self.receive_bytes())

    def close(self) -> None:
        """Close the connection."""
        self._connection.close()


def _from_json(body: bytes) -> Any:
    """Decode what msgpack could say as well: whole numbers of 64 bits, text of Unicode."""
    message = json.loads(body, parse_int=_whole)
    if b"\\u" in body:
        json.dumps(message, ensure_ascii=False).encode()  # raises for half a surrogate pair
    return message


def _whole(digits: str) -> int:
    number = int(digits)
    if abs(number) >= 1 << 64:
        raise ValueError(f"a whole number of {len(digits)} digits")
    return number
