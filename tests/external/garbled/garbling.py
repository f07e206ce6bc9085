"""Messages that break the protocol, or come close to it: drawn from right ones, by a seed."""

from __future__ import annotations

import json
import struct
from collections.abc import Callable
from typing import Any, NamedTuple

import msgpack
import numpy as np

Message = dict[str, Any]
LENGTH = struct.Struct("<I")
MAX_BYTES = 64 << 20  # of one message, as docs/door.md says

#: values of every type that an encoding has, and the ends of their ranges
ODD: tuple[Any, ...] = (
    None, True, False, 0, -1, 1, 7, 99, 2**31, 2**63 - 1, -(2**63), 1e308, -1e308, 1e17, 5e-324,
    float("nan"), float("inf"), float("-inf"), "", "x", "type", "nan", "\x00", "é" * 40,
    "x" * 3000, "robot1", [], [[]], [None], [1, "a"], [[1.0, 2.0, 3.0]], [float("nan")] * 6,
    {}, {"kind": 1}, {"kind": "picked-up", "robot": -2}, {"kind": "granted", "resource": {}},
    {"": ""}, list(range(300)), [[0, [[0, 0]]]], [[0, "robot1"], [0, "robot2"]],
)  # fmt: skip
ONLY_BINARY = (
    b"", b"\x00" * 7, b"\xff" * 48, b"\x7f" * 48, b"\x00" * 32, b"\x00" * 48, b"\x00" * 4096,
    msgpack.ExtType(5, b"abc"), msgpack.Timestamp(1, 2), 2**64 - 1,
)  # fmt: skip
ONLY_JSON = (10**400, -(10**400), "\ud800", "a\udfffb", {"\udc00": 1})
DEPTHS = (8, 40, 200, 600, 900, 1100, 5000, 100_000)  # of lists and maps in each other


class Garbled(NamedTuple):
    """A message as it goes over the socket."""

    how: str  #: it was made
    frame: bytes  #: length and body

    @property
    def body(self) -> bytes:
        return self.frame[LENGTH.size :]


def packed(message: Any, *, binary: bool) -> bytes:
    return msgpack.packb(message) if binary else json.dumps(message).encode()


def framed(body: bytes) -> bytes:
    return LENGTH.pack(len(body)) + body


def garbled(message: Message, random: np.random.Generator, *, binary: bool) -> Garbled:
    """Garble a right message in one way."""
    name = str(random.choice(list(WAYS)))
    made = WAYS[name](message, random, binary)
    return Garbled(name, made if name in FRAMED else framed(made))


def odd_value(random: np.random.Generator, binary: bool) -> Any:
    values = ODD + (ONLY_BINARY if binary else ONLY_JSON)
    return values[random.integers(len(values))]


# --- ways that keep the encoding -----------------------------------------------------------


def _places(value: Any, so_far: tuple = ()) -> list[tuple]:
    """List the ways to all parts of a message."""
    parts: Any = ()
    if isinstance(value, dict):
        parts = value.items()
    elif isinstance(value, list):
        parts = enumerate(value)
    found = []
    for key, part in parts:
        found += [(*so_far, key), *_places(part, (*so_far, key))]
    return found


def _changed(message: Message, place: tuple, change: Callable[[Any, Any], None]) -> Message:
    """Change a copy of a message at one place."""
    copy = msgpack.unpackb(msgpack.packb(message), strict_map_key=False)
    part = copy
    for key in place[:-1]:
        part = part[key]
    change(part, place[-1])
    return copy


def _chosen(message: Message, random: np.random.Generator) -> tuple:
    places = _places(message)
    return places[random.integers(len(places))] if places else ("type",)


def replace(message: Message, random: np.random.Generator, binary: bool) -> bytes:
    value = odd_value(random, binary)
    changed = _changed(message, _chosen(message, random), lambda part, key: _put(part, key, value))
    return packed(changed, binary=binary)


def _put(part: Any, key: Any, value: Any) -> None:
    part[key] = value


def remove(message: Message, random: np.random.Generator, binary: bool) -> bytes:
    place = _chosen(message, random)
    return packed(_changed(message, place, lambda part, key: part.pop(key)), binary=binary)


def add(message: Message, random: np.random.Generator, binary: bool) -> bytes:
    names = ("twists", "x_own", "", "tick ", "Type", "goal\n", "twist", "name" * 200)
    name = names[random.integers(len(names))]
    return packed({**message, name: odd_value(random, binary)}, binary=binary)


def twice(message: Message, random: np.random.Generator, binary: bool) -> bytes:
    """Give a field two values; the encodings allow it."""
    key = list(message)[random.integers(len(message))]
    value = odd_value(random, binary)
    if not binary:
        whole = packed(message, binary=False)[:-1]
        return whole + b"," + json.dumps(key).encode() + b":" + json.dumps(value).encode() + b"}"
    packer = msgpack.Packer()
    pairs = [*message.items(), (key, value)]
    parts = [packer.pack_map_header(len(pairs))]
    parts += [packer.pack(part) for pair in pairs for part in pair]
    return b"".join(parts)


def nest(message: Message, random: np.random.Generator, binary: bool) -> bytes:
    depth = int(random.choice(DEPTHS))
    key = list(message)[random.integers(len(message))]
    is_map = bool(random.integers(2))
    mark = f"@{key}@"
    body = packed({**message, key: mark}, binary=binary)
    if binary:
        inner = (b"\x81\xa1a" if is_map else b"\x91") * depth + b"\xc0"
    else:
        inner = (b'{"a":' if is_map else b"[") * depth + b"0" + (b"}" if is_map else b"]") * depth
    return body.replace(packed(mark, binary=binary), inner)


def type_alone(message: Message, random: np.random.Generator, binary: bool) -> bytes:
    del random
    return packed({"type": message["type"]}, binary=binary)


def other_type(message: Message, random: np.random.Generator, binary: bool) -> bytes:
    types = ("tick", "command", "ready", "plan", "map", "visible", "travel_time", "hello", "bye?")
    return packed({**message, "type": types[random.integers(len(types))]}, binary=binary)


def no_map(message: Message, random: np.random.Generator, binary: bool) -> bytes:
    del message
    return packed(odd_value(random, binary), binary=binary)


# --- ways that break it ----------------------------------------------------------------------


def flip(message: Message, random: np.random.Generator, binary: bool) -> bytes:
    body = bytearray(packed(message, binary=binary))
    for _ in range(int(random.integers(1, 9))):
        body[random.integers(len(body))] = random.integers(256)
    return bytes(body)


def cut(message: Message, random: np.random.Generator, binary: bool) -> bytes:
    body = packed(message, binary=binary)
    return body[: random.integers(len(body))]


def trail(message: Message, random: np.random.Generator, binary: bool) -> bytes:
    return packed(message, binary=binary) + random.bytes(int(random.integers(1, 50)))


def noise(message: Message, random: np.random.Generator, binary: bool) -> bytes:
    del message, binary
    return random.bytes(int(random.integers(300)))


def large_header(message: Message, random: np.random.Generator, binary: bool) -> bytes:
    """Announce more bytes, entries or pairs than there are."""
    del binary
    tags = (b"\xc6", b"\xdb", b"\xdd", b"\xdf", b"\xc9")
    tag = tags[random.integers(len(tags))]
    start = msgpack.packb(message)[: random.integers(len(message) * 4)]
    return start + tag + struct.pack(">I", int(random.integers(1 << 31, 1 << 32)))


def other_encoding(message: Message, random: np.random.Generator, binary: bool) -> bytes:
    del random
    if binary:
        return json.dumps(message, default=lambda blob: blob.hex()).encode()
    return packed(message, binary=True)


# --- ways that break the frame --------------------------------------------------------------


def long_frame(message: Message, random: np.random.Generator, binary: bool) -> bytes:
    length = int(random.integers(MAX_BYTES + 1, 1 << 32))
    return LENGTH.pack(length) + packed(message, binary=binary)


def short_frame(message: Message, random: np.random.Generator, binary: bool) -> bytes:
    body = packed(message, binary=binary)
    return LENGTH.pack(int(random.integers(len(body)))) + body


def unfinished_frame(message: Message, random: np.random.Generator, binary: bool) -> bytes:
    frame = framed(packed(message, binary=binary))
    return frame[: random.integers(1, len(frame))]


def print_in_frame(message: Message, random: np.random.Generator, binary: bool) -> bytes:
    del random
    return b"hello, I print where I should not\n" + framed(packed(message, binary=binary))


Way = Callable[[Message, np.random.Generator, bool], bytes]
FRAMED: dict[str, Way] = {
    way.__name__: way for way in (long_frame, short_frame, unfinished_frame, print_in_frame)
}
_IN_BODY: tuple[Way, ...] = (
    replace, remove, add, twice, nest, type_alone, other_type, no_map, flip, cut, trail, noise,
    large_header, other_encoding,
)  # fmt: skip
WAYS: dict[str, Way] = {**{way.__name__: way for way in _IN_BODY}, **FRAMED}
