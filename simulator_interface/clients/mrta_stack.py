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

import contextlib
import json
import os
import signal
import socket
import struct
import sys
from collections.abc import Callable, Iterator
from typing import Any, TypeVar

import msgpack
import numpy as np

PROTOCOL = (1, 1)  #: major and minor version that this file speaks
MOST_BYTES = 64 << 20  #: of one message
_LENGTH = struct.Struct("<I")
_T = TypeVar("_T")

_Types = dict[str, type | tuple[type, ...]]
_NUMBER = (int, float)
_WORLD: _Types = {
    **dict.fromkeys(("dt", "horizon"), _NUMBER),
    **dict.fromkeys(("bounds", "robots", "humans", "rooms", "lanes", "resources"), list),
    **dict.fromkeys(("walls", "furniture", "parking", "travel_times"), list),
    **{"name": str, "seed": int, "map": dict, "params": dict},
}
_TICK: _Types = {"tick": int, "time": _NUMBER, "tasks": list, "refused": list, "closed": bool}
_TASK: _Types = {
    **dict.fromkeys(("task", "start", "end"), int),
    **dict.fromkeys(("deadline", "pickup_time", "dropoff_time"), _NUMBER),
    "robot": str,
}


class Garbled(Exception):  # noqa: N818 - is no error of the stack's
    """What the other side has said is no message of the protocol."""


class Closed(Exception):  # noqa: N818 - is no error
    """The other side has closed the connection."""


class Connection:
    """Messages over a stream socket: a length (u32, little-endian), then that many bytes.

    Args:
        link: a connected stream socket; it is closed with the connection.
    """

    most = MOST_BYTES  #: of one message that is received

    def __init__(self, link: socket.socket) -> None:
        self._link = link
        self._rest = b""

    def send(self, body: bytes) -> None:
        """Send one message.

        Raises:
            Closed: the other side is gone.
        """
        try:
            self._put(_LENGTH.pack(len(body)) + body)
        except (BrokenPipeError, ConnectionResetError):
            raise Closed from None

    def receive(self) -> bytes:
        """Receive one message.

        Raises:
            Closed: the other side is gone.
            ValueError: a message longer than ``most`` is announced.
            TimeoutError: it took longer than the socket's timeout.
        """
        while len(self._rest) < _LENGTH.size:
            self._rest += self._chunk(1 << 16)
        (length,) = _LENGTH.unpack_from(self._rest)
        if length > self.most:
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

    def _put(self, data: bytes) -> None:
        self._link.sendall(data)

    def _chunk(self, most: int) -> bytes:
        try:
            part = self._link.recv(most)
        except ConnectionResetError:
            raise Closed from None
        if not part:
            raise Closed
        return part


class Harness:
    """Questions that a stack may ask while it works on a tick; simulated time stands still."""

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
        return _read(answer, "points", lambda points: np.frombuffer(points).reshape(-1, 2))

    def travel_time(self, start: Any, goal: Any, robot: int = 0) -> float:
        """Estimate the time [s] that a robot needs between two points; inf: there is no way."""
        answer = self._ask("travel_time", start=_flat(start), goal=_flat(goal), robot=robot)
        return _read(answer, "seconds", float)

    def visible(self, start: Any, goal: Any) -> bool:
        """Tell whether no wall or furniture stands between two points ``(2,)``."""
        return _read(self._ask("visible", start=_flat(start), goal=_flat(goal)), "visible", bool)

    def map(self, parked: Any = ()) -> dict[str, Any]:
        """Give the costmap of the moment, with robots parked at ``parked`` ``(P, 2)`` [m].

        Returns:
            ``cost`` ``(rows, cols)`` Nav2 bytes, south first; ``resolution`` [m], ``origin`` [m],
            ``number``, which changes with the map. The same object while nothing has changed.
        """
        points = [_flat(point) for point in parked]
        answer = self._ask("map", avoid=points, known=self._map.get("number", -1))
        if "cost" in answer:
            cost = _read(answer, "cost", lambda cost: np.frombuffer(cost, dtype=np.uint8))
            shape = [_read(answer, name, int) for name in ("rows", "cols")]
            self._map = {**answer, "cost": cost.reshape(shape)}
        return self._map

    def _ask(self, question: str, **more: Any) -> dict[str, Any]:
        self._connection.send(msgpack.packb({"type": question, **more}))
        return _heard(self._connection)


def serve(
    stack: Callable[[dict[str, Any], Harness], Any],
    *,
    name: str,
    version: str = "",
    says: tuple[str, ...] = (),
    can: tuple[str, ...] = ("branch",),
    coupling: str = "",
    listen: str = "",
) -> None:
    """Answer the harness until it says bye.

    Args:
        stack: called with the world and the harness; gives an object with ``step(tick) -> dict``.
        name: of the stack, for reports.
        version: of the stack.
        says: what it tells beside twists: ``deliveries``, ``goals``, ``paths``.
        can: ``branch`` if the process may be copied by fork, which threads do not survive.
        coupling: ``awaited`` or ``paced`` if parts of it run by themselves; docs/door.md.
        listen: for ``--stack connect:ADDRESS``: a path for a Unix socket, or ``127.0.0.1:PORT``.
            The program then waits there for episodes, each in a process of its own, without end.
    """
    with _connected(listen) as connection:
        running = None
        while True:
            message = _heard(connection)
            kind = message["type"]
            if kind == "tick" and running is not None:
                connection.send(msgpack.packb(running.answer(message)))
            elif kind == "hello":
                connection.send(_ready(name, version, says, can, coupling))
            elif kind == "world":
                running = _Running(stack, message, connection)
                connection.send(msgpack.packb({"type": "ready"}))
            elif kind == "branch":
                _branch(connection, _read(message, "address", str))
            elif kind == "bye":
                return
            else:
                raise Garbled(f"a message of type {kind!r:.50}")


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
    with _connected() as connection:
        while True:
            message = _heard(connection)
            kind = message["type"]
            if kind == "bye":
                return
            if kind == "hello":
                connection.send(_ready(name, version, (), ()))
                continue
            fields = {key: _wired(value) for key, value in answer(message).items()}
            connection.send(msgpack.packb({"type": kind, **fields}))


@contextlib.contextmanager
def _connected(listen: str = "") -> Iterator[Connection]:
    """Connect to the harness; end in peace with it, and by a sentence if it talks nonsense."""
    connection = _accepted(listen) if listen else _inherited()
    try:
        yield connection
    except Closed:
        return
    except Garbled as error:
        sys.exit(f"mrta_stack: the harness does not keep to the protocol: {error}")
    finally:
        connection.close()


def _heard(connection: Connection) -> dict[str, Any]:
    try:
        body = connection.receive()
        # The handshake is JSON; nothing in it needs to be read.
        message = {"type": "hello"} if body[:1] == b"{" else msgpack.unpackb(body)
    except (ValueError, TypeError, msgpack.UnpackException) as error:
        raise Garbled(f"a message is not msgpack: {error}") from None
    if not isinstance(message, dict) or not isinstance(message.get("type"), str):
        raise Garbled("a message is not a map with a field `type`")
    return message


def _read(message: dict[str, Any], field: str, read: Callable[[Any], _T]) -> _T:
    try:
        return read(message[field])
    except (KeyError, TypeError, ValueError, OverflowError):
        raise Garbled(f"`{field}` is missing, or not as docs/door.md says") from None


def _check(message: Any, fields: _Types) -> None:
    for field, kind in fields.items():
        if not isinstance(message, dict) or not isinstance(message.get(field), kind):
            raise Garbled(f"`{field}` is missing, or not as docs/door.md says")


def _inherited() -> Connection:
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


def _ready(
    name: str, version: str, says: tuple[str, ...], can: tuple[str, ...], coupling: str = ""
) -> bytes:
    ready = {"type": "ready", "protocol": PROTOCOL, "encoding": "msgpack", "name": name}
    if coupling:  # which harnesses of version 1.0 do not know
        ready["coupling"] = coupling
    return json.dumps({**ready, "version": version, "says": says, "can": can}).encode()


class _Running:
    """A stack that knows its world.

    Args:
        stack: as of :func:`serve`.
        world: message.
        connection: for its questions.
    """

    def __init__(
        self, stack: Callable[..., Any], world: dict[str, Any], connection: Connection
    ) -> None:
        _check(world, _WORLD)
        robots, people = len(world["robots"]), len(world["humans"])
        #: of the arrays of a `tick`
        self._shapes: dict[str, tuple[int, ...]] = {
            "pose": (robots, 3),
            "velocity": (robots, 3),
            "human_position": (people, 2),
            "human_velocity": (people, 2),
            "human_radius": (people,),
            "parked_for": (robots,),
            "obstacle_points": (robots, -1, 2) if robots else (0, 0, 2),
        }
        self._stack = stack(world, Harness(connection))

    def answer(self, tick: dict[str, Any]) -> dict[str, Any]:
        """Let the stack answer a tick."""
        _check(tick, _TICK)
        for task in tick["tasks"]:
            _check(task, _TASK)
        for field, shape in self._shapes.items():
            try:
                tick[field] = np.frombuffer(tick[field]).reshape(shape)
            except (KeyError, TypeError, ValueError):
                raise Garbled(f"`{field}` is missing, or has another shape than {shape}") from None
        answer: dict[str, Any] = self._stack.step(tick)
        said = {key: _wired(value) for key, value in answer.items()}
        return {"type": "command", "tick": tick["tick"], **said}


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
    try:
        link.connect(address)
    except (OSError, ValueError):  # nobody waits for the copy any more
        os._exit(1)
    connection._link.close()
    connection._link, connection._rest = link, b""
