"""Does any message, in either direction, end in anything but a sentence?

    python -m tests.external.garbled.fuzz --messages 10000

Messages that the protocol allows are garbled by a seed. The harness gets garbled answers: most are
read in this process as a conversation reads them, some are told to whole episodes, and some come
from processes of a stack. The clients get a garbled harness: the Python one in this process and as
processes, the C++ one as processes, with the sanitizers of the compiler.

A defect is an exception that is no refusal, a refusal that is no sentence, a hang, a process that
is left, or a client that ends otherwise than in peace or by a sentence and exit code 1.
"""

from __future__ import annotations

import argparse
import functools
import json
import socket
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import msgpack

from mrta_falsify.core import registry
from mrta_falsify.core.config import StackConfig
from mrta_falsify.core.seeding import stream
from simulator_interface.external.answers import Reader, read_ready
from simulator_interface.external.messages import plain
from simulator_interface.external.services import Services
from simulator_interface.external.wire import Unreadable, Wire
from tests.external.garbled import garbled_clients, garbled_stacks
from tests.external.garbled.garbling import MAX_BYTES, Garbled, garbled
from tests.external.garbled.rightful import (
    ROBOTS,
    TASKS,
    Message,
    command_message,
    hall,
    question_messages,
    ready_message,
)
from tests.external.garbled.tally import Tally

SMALL = 100_000  # bytes that a socket takes without a reader
LIMIT = 10.0  # s for a message that has been sent already
KINDS = ("ready", "command", "command", "question", "branched")

Part = Callable[[int, int, Path], Tally]


def answers_read(count: int, seed: int, folder: Path) -> Tally:
    """Read garbled answers as a conversation does."""
    del folder
    tally, random, readers = Tally(), stream(seed, "fuzz/harness"), readers_of()
    for question in question_messages():  # kernels are compiled before anything is timed
        readers[question["type"]](question)
    for number in range(count):
        kind = KINDS[number % len(KINDS)]
        binary = kind != "ready" and bool(random.integers(2))
        messages = {
            "ready": ready_message(),
            "command": command_message(random, binary=binary),
            "question": question_messages()[random.integers(4)],
            "branched": {"type": "branched"},
        }
        made = garbled(messages[kind], random, binary=binary)
        tally.take(made, functools.partial(read, made, kind, binary, readers))
    return tally


def read(made: Garbled, kind: str, binary: bool, readers: dict[str, Callable]) -> str:
    heard = received(made, binary)
    readers[heard["type"] if heard["type"] in readers and kind != "ready" else kind](heard)
    return "taken"


def readers_of() -> dict[str, Callable[[Message], object]]:
    """Make what reads each type of message."""
    world, config = hall(), StackConfig()
    services = Services(world, config, registry.build("costmap", config.costmap).bind(world))
    reader = Reader(ROBOTS, TASKS)

    def answer(question: Message) -> None:
        said = services.answer(question, 0.0)
        msgpack.packb(plain(said, binary=True))
        json.dumps(plain(said, binary=False))

    def branched(heard: Message) -> None:
        if heard["type"] != "branched":
            raise Unreadable(f"`branch` was answered by {heard['type']!r:.50}")

    def command(heard: Message) -> None:
        reader.read(heard, 3, 0.15)

    questions = dict.fromkeys(services.known, answer)
    return {"ready": read_ready, "command": command, "branched": branched, **questions,
            "question": command}  # fmt: skip


def received(made: Garbled, binary: bool) -> Message:
    """Receive a frame over a socket whose other end says no more; a large one by its body."""
    if len(made.frame) > SMALL:
        if len(made.body) > MAX_BYTES:
            raise Unreadable("too long")
        return Wire.decoded(made.body, is_binary=binary)
    ours, theirs = socket.socketpair()
    wire = Wire(ours, None)
    wire.is_binary = binary
    try:
        theirs.sendall(made.frame)
        theirs.close()
        wire.allow(LIMIT)
        return wire.receive()
    finally:
        wire.close()


#: by name: share of the messages, by what one costs, and what garbles them
PARTS: dict[str, tuple[float, Part]] = {
    "answers read": (0.60, answers_read),
    "episodes told garbled answers": (0.06, garbled_stacks.told_episodes),
    "stacks that send them": (0.02, garbled_stacks.as_processes),
    "Python client in process": (0.25, garbled_clients.in_process),
    "Python client": (0.02, functools.partial(garbled_clients.as_processes, "python")),
    "C++ client": (0.05, functools.partial(garbled_clients.as_processes, "cpp")),
}


def fuzz(messages: int, seed: int, folder: Path) -> dict[str, Tally]:
    """Garble ``messages`` in both directions."""
    found = {}
    for name, (share, part) in PARTS.items():
        began = time.monotonic()
        found[name] = part(max(1, round(share * messages)), seed, folder)
        took = time.monotonic() - began
        print(f"{name}: {found[name].messages} in {took:.0f} s", file=sys.stderr, flush=True)
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--messages", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        found = fuzz(arguments.messages, arguments.seed, Path(folder))
    print("| | Messages | Outcomes | Defects |\n|---|---|---|---|")
    for name, tally in found.items():
        outcomes = ", ".join(f"{count} {what}" for what, count in tally.outcomes.most_common())
        print(f"| {name} | {tally.messages} | {outcomes} | {len(tally.defects)} |")
    defects = [defect for tally in found.values() for defect in tally.defects]
    print(*defects[:20], sep="\n\n")
    sys.exit(bool(defects))


if __name__ == "__main__":
    main()
