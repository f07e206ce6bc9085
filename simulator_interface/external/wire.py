"""One conversation with a stack's process: messages in its encoding, each within a time limit."""

from __future__ import annotations

import json
import socket
import time
from collections.abc import Callable
from typing import Any

import msgpack

from simulator_interface.clients.mrta_stack import Closed, Connection
from simulator_interface.external.messages import Message, plain

__all__ = ["Closed", "Late", "Unreadable", "Wire"]

MOST_HEARD = 16 << 20  # bytes of a message; each may become 64 bytes of empty lists in memory
LEAST = 1e-3  # s; a socket takes 0 for "do not wait at all"
LOOK_EVERY = 0.1  # s of waiting between two looks at the stack


class Late(Exception):  # noqa: N818 - says what happened to the stack
    """The stack has not answered within its limit."""


class Unreadable(Exception):  # noqa: N818
    """What came is no message of the protocol; the text says why."""


class _Timed(Connection):
    """A connection whose messages must be complete at a given time."""

    most = MOST_HEARD

    def __init__(self, link: socket.socket) -> None:
        super().__init__(link)
        self.until = 0.0  #: s of ``time.monotonic``
        self.look: Callable[[], None] = lambda: None  #: called now and then while it waits

    def _chunk(self, most: int) -> bytes:
        while True:
            left = self.until - time.monotonic()
            if left <= 0.0:
                raise TimeoutError
            self._link.settimeout(min(left, LOOK_EVERY))
            try:
                return super()._chunk(most)
            except TimeoutError:
                self.look()


class Wire:
    """Messages to and from a stack.

    Args:
        link: connected socket.
    """

    def __init__(self, link: socket.socket) -> None:
        self._link = link
        self._connection = _Timed(link)
        self.is_binary = False  #: msgpack; the handshake is JSON

    def look_at_stack(self, look: Callable[[], None]) -> None:
        """Have ``look`` called now and then while an answer is waited for; it may raise."""
        self._connection.look = look

    def send(self, message: Message, limit: float) -> bytes:
        """Send a message; give the bytes that were sent.

        Args:
            message: to send.
            limit: [s] of wall-clock time.

        Raises:
            Closed: the stack has closed the connection.
            Late: it does not read.
        """
        shaped = plain(message, binary=self.is_binary)
        body = msgpack.packb(shaped) if self.is_binary else json.dumps(shaped).encode()
        self.send_bytes(body, limit)
        return body

    def send_bytes(self, body: bytes, limit: float) -> None:
        """Send the bytes of a message; see :meth:`send`."""
        self._link.settimeout(max(limit, LEAST))
        try:
            self._connection.send(body)
        except TimeoutError:
            raise Late from None

    def receive_bytes(self, limit: float) -> bytes:
        """Receive the bytes of a message.

        Args:
            limit: [s] of wall-clock time.

        Raises:
            Closed: the stack has closed the connection.
            Late: no whole message came within the limit.
            Unreadable: too long a message is announced.
        """
        self._connection.until = time.monotonic() + limit
        try:
            return self._connection.receive()
        except TimeoutError:
            raise Late from None
        except ValueError as error:
            raise Unreadable(f"{error}; is something printing to the connection?") from None

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

    def receive(self, limit: float) -> Message:
        """Receive a message; see :meth:`receive_bytes` and :meth:`read`."""
        return self.read(self.receive_bytes(limit))

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
