"""What a stack in another process answers, checked field by field.

A field that the protocol does not know is refused by name, unless it begins with ``x_``.
"""

from __future__ import annotations

import functools
import math
import reprlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np

from mrta_falsify.core import codec
from mrta_falsify.core.arrays import Array, IntArray
from mrta_falsify.core.codec import FieldError, Rule, later
from mrta_falsify.core.errors import ConfigError
from mrta_falsify.core.external import Coupling
from mrta_falsify.core.fleet import Phase, StackEvent
from mrta_falsify.core.spelling import did_you_mean
from simulator_interface.external.messages import PROTOCOL, Message

READY_FIELDS = ("type", "protocol", "encoding", "name", "version", "says", "can", "coupling")
SAYS = ("deliveries", "goals", "paths")
CAN = ("branch",)
LONGEST_PATH = 100_000  # points
MAX_TOOK = 600.0  # s of simulated time that one answer may be held back
MAX_EVENTS = 10_000  # in one answer
MAX_SIGNALS = 100
MAX_PEOPLE = 1 << 20  # an event may name a person by number
MAX_TEXT = 500  # characters
FARTHEST = 1e6  # m, m/s, rad/s: nothing in a building is larger
EVENT_FIELDS = ("kind", "robot", "task", "resource", "other", "detail")
#: fields of a command that become fields of an ``Intent``
FIELDS = {
    "stops_left": "tasks_left",
    "phase": "phase",
    "waypoint": "waypoint",
    "cluster": "cluster",
    "leader": "leader",
    "slack": "slack",
    "queue": "queue",
}
#: whole numbers, one per robot: from, and below; 0: the number of robots
NUMBERS = {
    "stops_left": (0, 1 << 31),
    "phase": (0, len(Phase)),
    "cluster": (0, 0),
    "leader": (0, 0),
    "queue": (-1, 1 << 31),
}
FREE_PREFIX = "x_"  # begins fields that are the stack's own


def shown(value: Any) -> str:
    """Write what a stack has said into a sentence, in one line and cut short."""
    return reprlib.repr(value)[:60]


class Wrong(Exception):  # noqa: N818 - says what is wrong with an answer
    """An answer breaks the protocol.

    Args:
        field: of the message.
        text: what is wrong with it.
    """

    def __init__(self, field: str, text: str) -> None:
        super().__init__(f"{field} {text}")
        self.field, self.text = field, text


@dataclass(frozen=True, slots=True, kw_only=True)
class Ready:
    """Who the stack is, and what it says and can."""

    name: str
    version: str
    encoding: Literal["msgpack", "json"]
    says: tuple[str, ...]
    can: tuple[str, ...]
    minor: int  #: version of the protocol
    coupling: Coupling = later("stepped")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Answer:
    """A checked `command`; N robots."""

    twist: Array | None  #: (N, 3), None: not said
    follow: frozenset[int] | None  #: robots that the harness is to drive, None: not said
    goal: Array | None  #: (N, 2), None: not said
    paths: dict[int, Array]  #: those that changed, (L, 2)
    intent: dict[str, Array | IntArray]  #: other fields of an ``Intent`` that were said
    waits_for: dict[int, str] | None  #: robot -> whom or what; None: not said
    events: tuple[StackEvent, ...]
    took: float  #: [s] of simulated time
    signals: dict[str, float]


def read_ready(message: Message) -> Ready:
    """Read the answer to `hello`.

    Raises:
        ConfigError: it is none, or the stack speaks another version.
    """
    where = "the stack's `ready`"
    if message.get("type") != "ready":
        raise ConfigError(f"{where}: its type is {shown(message.get('type'))}")
    try:
        _refuse_unknown(message, READY_FIELDS)
        major, minor = _pair(message.get("protocol"))
        if major != PROTOCOL[0]:
            raise Wrong("protocol", f"speaks version {major}; this harness speaks {PROTOCOL[0]}")
        encoding = message.get("encoding", "msgpack")
        if encoding not in ("msgpack", "json"):
            raise Wrong("encoding", f"is {shown(encoding)}; it must be msgpack or json")
        return Ready(
            name=_text("name", message.get("name", ""))[:100] or "unnamed",
            version=_text("version", message.get("version", ""))[:100],
            encoding=encoding,
            says=_names("says", message.get("says", ()), SAYS),
            can=_names("can", message.get("can", ()), CAN),
            minor=minor,
            coupling=_coupling(message.get("coupling", "stepped")),
        )
    except Wrong as wrong:
        raise ConfigError(f"{where}: {wrong}") from None


def _pair(value: Any) -> tuple[int, int]:
    is_pair = isinstance(value, (list, tuple)) and len(value) == 2
    if not is_pair or not all(isinstance(number, int) for number in value):
        raise Wrong("protocol", f"is {shown(value)}; it must be [major, minor]")
    return value[0], value[1]


def _coupling(value: Any) -> Coupling:
    known: tuple[Coupling, ...] = get_args(Coupling)
    for name in known:
        if value == name:
            return name
    raise Wrong("coupling", f"is {shown(value)}; it must be one of {', '.join(known)}")


def _names(field: str, value: Any, known: tuple[str, ...]) -> tuple[str, ...]:
    if not isinstance(value, (list, tuple)):
        raise Wrong(field, f"is {shown(value)}; it must be a list of {', '.join(known)}")
    for name in value:
        if name not in known:
            raise Wrong(field, f"has {shown(name)}; known are {', '.join(known)}")
    return tuple(name for name in known if name in value)


def _text(field: str, value: Any) -> str:
    if not isinstance(value, str):
        raise Wrong(field, f"has {shown(value)}; it must be text")
    return value


def _refuse_unknown(message: Mapping[str, Any], known: tuple[str, ...]) -> None:
    for name in message:
        if name not in known and not str(name).startswith(FREE_PREFIX):
            near = did_you_mean(str(name), known)
            hint = near or f"; known are {', '.join(known)}"
            named = name if str(name).isidentifier() else shown(name)
            raise Wrong(named[:60], f"is no field of the message{hint}")


# --- a command ------------------------------------------------------------------------------


class Reader:
    """Reads commands of one episode.

    Args:
        robots: their names.
        tasks: how many there are.
    """

    def __init__(self, robots: tuple[str, ...], tasks: int) -> None:
        self._robots = robots
        self._tasks = tasks
        self._readers: dict[str, Callable[[Any], Any]] = {
            "twist": self._twist,
            "goal": functools.partial(self._points, "goal"),
            "waypoint": functools.partial(self._points, "waypoint"),
            "follow": self._follow,
            "paths": self._paths,
            "waits_for": self._waits,
            "took": lambda value: self._real("took", value, Rule(low=0.0, high=MAX_TOOK)),
            "signals": self._signals,
            "events": lambda value: value,
            **{name: functools.partial(self._numbers, name) for name in NUMBERS},
            "slack": lambda value: self._array("slack", value, (len(robots),)),
        }
        self._known = ("type", "tick", *self._readers)

    def read(self, message: Message, tick: int, time: float) -> Answer:
        """Check a command.

        Args:
            message: as received.
            tick: that was asked.
            time: of the tick [s].

        Raises:
            Wrong: it is none, or a field is not as the protocol says.
        """
        if message["type"] != "command":
            raise Wrong("type", f"is {shown(message['type'])}; a tick is answered by 'command'")
        _refuse_unknown(message, self._known)
        if message.get("tick") != tick:
            raise Wrong("tick", f"is {shown(message.get('tick'))}; the harness sent tick {tick}")
        readers = self._readers
        found = {name: readers[name](message[name]) for name in readers if name in message}
        return Answer(
            twist=found.get("twist"),
            follow=found.get("follow"),
            goal=found.get("goal"),
            paths=found.get("paths", {}),
            intent={FIELDS[name]: found[name] for name in FIELDS if name in found},
            waits_for=found.get("waits_for"),
            events=self._events(found.get("events", ()), time),
            took=found.get("took", 0.0),
            signals=found.get("signals", {}),
        )

    def _twist(self, value: Any) -> Array:
        twist = self._array("twist", value, (len(self._robots), 3))
        near = np.abs(twist) <= FARTHEST
        if not near.all():
            robot = int(np.argmin(near.all(axis=1)))
            numbers = ", ".join(f"{number:g}" for number in twist[robot])
            text = f"it must be finite, and at most {FARTHEST:g}"
            raise Wrong("twist", f"of {self._robots[robot]} is ({numbers}); {text}")
        return twist

    def _numbers(self, field: str, value: Any) -> IntArray:
        rows = self._rows(field, value)
        if len(rows) != len(self._robots):
            raise Wrong(field, f"has {len(rows)} numbers, not {len(self._robots)}")
        low, below = NUMBERS[field]
        below = below or len(self._robots)
        return np.array([self._number(field, n, below, low) for n in rows], dtype=np.int64)

    def _points(self, field: str, value: Any) -> Array:
        """Read a point of each robot ``(N, 2)`` [m]; not finite: none."""
        points = self._array(field, value, (len(self._robots), 2))
        far = np.isfinite(points) & (np.abs(points) > FARTHEST)
        if far.any():
            raise Wrong(field, f"has {points[far][0]:g}; it must be at most {FARTHEST:g} m")
        points[~np.isfinite(points).all(axis=1)] = np.nan  # half a point is none
        return points

    def _follow(self, value: Any) -> frozenset[int]:
        rows, robots = self._rows("follow", value), len(self._robots)
        return frozenset(self._number("follow", row, robots) for row in rows)

    def _paths(self, value: Any) -> dict[int, Array]:
        found = {}
        for row in self._rows("paths", value, 2):
            robot = self._number("paths", row[0], len(self._robots))
            path = self._array("paths", row[1], (-1, 2))
            if len(path) > LONGEST_PATH or not (np.abs(path) <= FARTHEST).all():
                text = f"at most {LONGEST_PATH} points, each finite and at most {FARTHEST:g} m"
                raise Wrong("paths", f"of {self._robots[robot]}: it must have {text}")
            found[robot] = path
        return found

    def _events(self, value: Any, time: float) -> tuple[StackEvent, ...]:
        return tuple(self._event(row, time) for row in self._rows("events", value, most=MAX_EVENTS))

    def _event(self, row: Any, time: float) -> StackEvent:
        if not isinstance(row, dict) or not isinstance(row.get("kind"), str):
            raise Wrong("events", f"has {shown(row)}; each must be a map with a `kind`")
        for name in row:
            if name not in EVENT_FIELDS:
                raise Wrong("events", f"has {shown(name)}; known are {', '.join(EVENT_FIELDS)}")
        return StackEvent(
            time=time,
            kind=row["kind"][:MAX_TEXT],
            robot=self._number("events", row.get("robot", -1), len(self._robots), -1),
            task=self._number("events", row.get("task", -1), self._tasks, -1),
            resource=_text("events", row.get("resource", ""))[:MAX_TEXT],
            other=self._number("events", row.get("other", -1), MAX_PEOPLE, -1),
            detail=_text("events", row.get("detail", ""))[:MAX_TEXT],
        )

    def _waits(self, value: Any) -> dict[int, str]:
        return {
            self._number("waits_for", robot, len(self._robots)): _text("waits_for", what)[:MAX_TEXT]
            for robot, what in self._rows("waits_for", value, 2)
        }

    def _signals(self, value: Any) -> dict[str, float]:
        if not isinstance(value, dict) or len(value) > MAX_SIGNALS:
            raise Wrong("signals", f"must map at most {MAX_SIGNALS} names to numbers")
        return {str(k)[:100]: self._real("signals", v, Rule()) for k, v in value.items()}

    # --- parts ------------------------------------------------------------------------------

    def _rows(self, field: str, value: Any, width: int = 0, most: int = LONGEST_PATH) -> list[Any]:
        if not isinstance(value, (list, tuple)):
            raise Wrong(field, f"is {type(value).__name__}; it must be a list")
        if len(value) > most:
            raise Wrong(field, f"has {len(value)} entries; at most {most}")
        for row in value if width else ():
            if not isinstance(row, (list, tuple)) or len(row) != width:
                raise Wrong(field, f"has {shown(row)}; each entry must be a list of {width}")
        return list(value)

    def _number(self, field: str, value: Any, below: int, low: int = 0) -> int:
        if type(value) is not int or not low <= value < below:
            text = f"it must be a whole number from {low} to {below - 1}"
            raise Wrong(field, f"has {shown(value)}; {text}")
        return value

    def _real(self, field: str, value: Any, rule: Rule) -> float:
        number: float = _decoded(field, float, value, rule)
        return number

    def _array(self, field: str, value: Any, shape: tuple[int, ...]) -> Array:
        """Read an array: bytes, or nested lists with null for nan."""
        if isinstance(value, bytes):
            width = int(np.prod([n for n in shape if n >= 0])) * 8
            fits = len(value) % width == 0 if -1 in shape else len(value) == width
            if not fits:
                raise Wrong(
                    field, f"has {len(value)} bytes; {_words(shape)} float64 are {width} each"
                )
            return np.frombuffer(value, dtype="<f8").reshape(shape).copy()
        named = tuple("L" if n < 0 else n for n in shape)
        rule = Rule(named, farthest=math.inf, allow_infinite=True, allow_missing=True)
        return np.array(_decoded(field, Array, value, rule))


def _decoded(field: str, hint: Any, value: Any, rule: Rule) -> Any:
    """Read a value as files are read."""
    try:
        return codec.decode(hint, value, path=field, rule=rule)
    except FieldError as error:
        part = error.path.removeprefix(field)
        raise Wrong(field, f"{part} {error.problem}".strip()) from None


def _words(shape: tuple[int, ...]) -> str:
    return "(" + ", ".join("L" if n < 0 else str(n) for n in shape) + ")"
