"""Put your own stack on trial: copy this file beside it. It needs numpy and msgpack.

    import numpy as np
    from mrta_stack import serve

    class MyStack:
        def __init__(self, world, harness):
            self.robots = world["robots"]

        def step(self, tick):
            twist = np.zeros((len(self.robots), 3))  # forward, left [m/s], turn rate [rad/s]
            return {"twist": twist}

    serve(MyStack, name="my stack")

The harness starts this program once per episode, with a socket in the environment variable
MRTA_STACK_FD. Simulated time stands while ``step`` works. All arrays are float64 in metres, radians
and seconds in the map frame (REP-103). docs/door.md of mrta-falsify has every message and field.
"""

from __future__ import annotations

import json
import os
import signal
import socket
import struct
import sys
from collections.abc import Callable
from typing import Any

import msgpack
import numpy as np

PROTOCOL = (1, 0)  #: major and minor version that this file speaks
MOST_BYTES = 64 << 20  #: of one message
_LENGTH = struct.Struct("<I")

#: shapes of the arrays of a `tick`; -1: any. Obstacle points become one row per robot.
SHAPES = {
    "pose": (-1, 3),
    "velocity": (-1, 3),
    "human_position": (-1, 2),
    "human_velocity": (-1, 2),
    "human_radius": (-1,),
    "parked_for": (-1,),
    "obstacle_points": (-1, 2),
}


class Closed(Exception):  # noqa: N818 - is no error
    """The other side has closed the connection."""


class Connection:
    """Messages over a stream socket: a length (u32, little-endian), then that many bytes.

    Args:
        link: a connected stream socket; it is closed with the connection.
    """

    def __init__(self, link: socket.socket) -> None:
        self._link = link
        self._rest = b""

    def send(self, body: bytes) -> None:
        """Send one message.

        Raises:
            Closed: the other side is gone.
        """
        try:
            self._link.sendall(_LENGTH.pack(len(body)) + body)
        except (BrokenPipeError, ConnectionResetError):
            raise Closed from None

    def receive(self) -> bytes:
        """Receive one message.

        Raises:
            Closed: the other side is gone.
            ValueError: a message longer than ``MOST_BYTES`` is announced.
            TimeoutError: it took longer than the socket's timeout.
        """
        while len(self._rest) < _LENGTH.size:
            self._rest += self._chunk(1 << 16)
        (length,) = _LENGTH.unpack_from(self._rest)
        if length > MOST_BYTES:
            raise ValueError(f"a message of {length} bytes is announced")
        end = _LENGTH.size + length
        if len(self._rest) < end:
            parts, have = [self._rest], len(self._rest)
            while have < end:
                parts.append(self._chunk(max(1 << 16, min(end - have, 1 << 20))))
                have += len(parts[-1])
            self._rest = b"".join(parts)
        body, self._rest = self._rest[_LENGTH.size : end], self._rest[end:]
        return body

    def close(self) -> None:
        """Close the socket."""
        self._link.close()

    def _chunk(self, most: int) -> bytes:
        try:
            part = self._link.recv(most)
        except ConnectionResetError:
            raise Closed from None
        if not part:
            raise Closed
        return part


class Harness:
    """What a stack may ask in the middle of a tick; simulated time stands meanwhile."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection
        self._map: dict[str, Any] = {}

    def plan(self, start: Any, goal: Any, avoid: Any = ()) -> np.ndarray:
        """Plan a path ``(L, 2)`` [m] between two points ``(2,)``; empty: there is none.

        Args:
            start: [m].
            goal: [m].
            avoid: places ``(P, 2)`` [m] at which robots stand.
        """
        places = [_flat(place) for place in avoid]
        answer = self._ask("plan", start=_flat(start), goal=_flat(goal), avoid=places)
        return np.frombuffer(answer["points"]).reshape(-1, 2)

    def travel_time(self, start: Any, goal: Any, robot: int = 0) -> float:
        """Estimate the time [s] that a robot needs between two points; inf: there is no way."""
        answer = self._ask("travel_time", start=_flat(start), goal=_flat(goal), robot=robot)
        return float(answer["seconds"])

    def visible(self, start: Any, goal: Any) -> bool:
        """Tell whether no wall or furniture stands between two points ``(2,)``."""
        return bool(self._ask("visible", start=_flat(start), goal=_flat(goal))["visible"])

    def map(self, parked: Any = ()) -> dict[str, Any]:
        """Give the costmap of the moment, with robots parked at ``parked`` ``(P, 2)`` [m].

        Returns:
            ``cost`` ``(rows, cols)`` Nav2 bytes, south first; ``resolution`` [m], ``origin`` [m],
            ``number``, which changes with the map. The same object while nothing has changed.
        """
        points = [_flat(point) for point in parked]
        answer = self._ask("map", avoid=points, known=self._map.get("number", -1))
        if "cost" in answer:
            cost = np.frombuffer(answer["cost"], dtype=np.uint8)
            self._map = {**answer, "cost": cost.reshape(answer["rows"], answer["cols"])}
        return self._map

    def _ask(self, question: str, **more: Any) -> dict[str, Any]:
        self._connection.send(msgpack.packb({"type": question, **more}))
        answer: dict[str, Any] = msgpack.unpackb(self._connection.receive())
        return answer


def serve(
    stack: Callable[[dict[str, Any], Harness], Any],
    *,
    name: str,
    version: str = "",
    says: tuple[str, ...] = (),
    can: tuple[str, ...] = ("branch",),
    listen: str = "",
) -> None:
    """Answer the harness until it says bye.

    Args:
        stack: called with the world and the harness; gives an object with ``step(tick) -> dict``.
        name: of the stack, for reports.
        version: of the stack.
        says: what it tells beside twists: ``deliveries``, ``goals``, ``paths``.
        can: ``branch`` if the process may be copied by fork, which threads do not survive.
        listen: for ``--stack connect:ADDRESS``: a path for a Unix socket, or ``127.0.0.1:PORT``.
            The program then waits there for episodes, each in a process of its own, without end.
    """
    connection = _accepted(listen) if listen else _connect()
    running: Any = None
    while True:
        try:
            # The handshake is JSON; nothing in it needs to be read.
            body = connection.receive()
            message = {"type": "hello"} if body[:1] == b"{" else msgpack.unpackb(body)
        except Closed:
            return
        kind = message["type"]
        if kind == "tick":
            connection.send(msgpack.packb(_answer(running, message)))
        elif kind == "hello":
            connection.send(_ready(name, version, says, can))
        elif kind == "world":
            running = stack(message, Harness(connection))
            connection.send(msgpack.packb({"type": "ready"}))
        elif kind == "branch":
            _branch(connection, message["address"])
        elif kind == "bye":
            return


def serve_layer(
    answer: Callable[[dict[str, Any]], dict[str, Any]], *, name: str, version: str = ""
) -> None:
    """Answer as one layer of the shipped stack, for ``--set allocator=exec:CMD``.

    Args:
        answer: called with each message; gives the fields of the answer. It must be a function of
            the message alone: nothing may be remembered that decides.
        name: of the layer, for reports.
        version: of it.
    """
    connection = _connect()
    while True:
        try:
            body = connection.receive()
        except Closed:
            return
        if body[:1] == b"{":
            connection.send(_ready(name, version, (), ()))
            continue
        message = msgpack.unpackb(body)
        if message["type"] == "bye":
            return
        fields = {key: _wired(value) for key, value in answer(message).items()}
        connection.send(msgpack.packb({"type": message["type"], **fields}))


def _connect() -> Connection:
    number = os.environ.get("MRTA_STACK_FD")
    if number is None:
        sys.exit("this program is a stack for mrta-falsify: run it by --stack 'exec:...'")
    return Connection(socket.socket(fileno=int(number)))


def _accepted(address: str) -> Connection:
    """Wait for connections; return in a process of its own for each."""
    host, colon, port = address.rpartition(":")
    if colon and "/" not in address:
        door = socket.create_server((host, int(port)))
    else:
        if os.path.exists(address):
            os.unlink(address)
        door = socket.socket(socket.AF_UNIX)
        door.bind(address)
        door.listen()
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)  # nobody waits for the processes
    while True:
        link, _ = door.accept()
        if os.fork() == 0:
            door.close()
            signal.signal(signal.SIGCHLD, signal.SIG_DFL)
            return Connection(link)
        link.close()


def _ready(name: str, version: str, says: tuple[str, ...], can: tuple[str, ...]) -> bytes:
    ready = {"type": "ready", "protocol": PROTOCOL, "encoding": "msgpack", "name": name}
    return json.dumps({**ready, "version": version, "says": says, "can": can}).encode()


def _answer(running: Any, tick: dict[str, Any]) -> dict[str, Any]:
    for key, shape in SHAPES.items():
        tick[key] = np.frombuffer(tick[key]).reshape(shape)
    points, robots = tick["obstacle_points"], len(tick["pose"])
    tick["obstacle_points"] = points.reshape(robots, len(points) // max(robots, 1), 2)
    answer: dict[str, Any] = running.step(tick)
    return {"type": "command", "tick": tick["tick"], **{k: _wired(v) for k, v in answer.items()}}


def _wired(value: Any) -> Any:
    """Write numpy values as the protocol has them: arrays as bytes, numbers as numbers."""
    if isinstance(value, np.ndarray):
        return np.ascontiguousarray(value, dtype="<f8").tobytes()
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, (list, tuple)):
        return [_wired(item) for item in value]
    return value


def _flat(point: Any) -> list[float]:
    return [float(number) for number in point]


def _branch(connection: Connection, address: str) -> None:
    """Go on in a copy of this process, on a socket of its own; the original waits for more."""
    sys.stdout.flush()
    sys.stderr.flush()
    child = os.fork()
    if child:
        os.waitpid(child, 0)
        connection.send(msgpack.packb({"type": "branched"}))
        return
    if os.fork():  # whom nobody has to wait for
        os._exit(0)
    link = socket.socket(socket.AF_UNIX)
    link.connect(address)
    connection._link.close()
    connection._link, connection._rest = link, b""
