"""A stack that sends one garbled message; arguments: SEED NUMBER.

Which, and how, is a function of the two numbers. Before and after it answers as the protocol says.
"""

from __future__ import annotations

import json
import os
import socket
import subprocess
import sys

import msgpack
import numpy as np

from simulator_interface.clients.mrta_stack import Closed, Connection
from tests.external.garbled.garbling import Garbled, framed, garbled, packed

SEED, NUMBER = int(sys.argv[1]), int(sys.argv[2])
ROBOTS = 2
WHERE = ("ready", "world", "command", "question", "command", "command", "question")
AT = 3  # tick at which a command, or a question before it, is garbled
READY = {"type": "ready", "protocol": [1, 0], "name": "garbles", "says": ["goals"],
         "can": ["branch"]}  # fmt: skip


class GarblingStack:
    """Answers, and garbles one answer."""

    def __init__(self) -> None:
        self.random = np.random.default_rng([SEED, NUMBER])
        self.where = "branched" if NUMBER % 4 == 3 else WHERE[NUMBER % len(WHERE)]
        self.is_binary = bool(self.random.integers(2))
        self.link = socket.socket(fileno=int(os.environ["MRTA_STACK_FD"]))
        self.connection = Connection(self.link)

    def say(self, message: dict, where: str, *, binary: bool | None = None) -> None:
        binary = self.is_binary if binary is None else binary
        if where != self.where:
            self.link.sendall(framed(packed(message, binary=binary)))
            return
        made: Garbled = garbled(message, self.random, binary=binary)
        self.where = ""
        self.link.sendall(made.frame)

    def serve(self) -> None:
        while True:
            body = self.connection.receive()
            if not body.startswith(b'{"type": "hello"'):
                message = msgpack.unpackb(body) if self.is_binary else json.loads(body)
                self.answer(message)
                continue
            encoding = "msgpack" if self.is_binary else "json"
            self.say({**READY, "encoding": encoding}, "ready", binary=False)

    def answer(self, message: dict) -> None:
        kind = message["type"]
        if kind == "world":
            self.say({"type": "ready"}, "world")
        elif kind == "tick":
            if message["tick"] == AT:
                self.say({"type": "plan", "start": [0.0, 0.0], "goal": [3.0, 2.0]}, "question")
                self.connection.receive()
            twist = np.zeros((ROBOTS, 3))
            where = "command" if message["tick"] == AT else ""
            told = twist.tobytes() if self.is_binary else twist.tolist()
            self.say({"type": "command", "tick": message["tick"], "twist": told}, where)
        elif kind == "branch":
            self.say({"type": "branched"}, "branched")
        elif kind == "bye":
            raise Closed


if __name__ == "__main__":
    if NUMBER % 5 == 0:
        subprocess.Popen(["sleep", "1000"], start_new_session=NUMBER % 10 == 0)
    try:
        GarblingStack().serve()
    except (Closed, BrokenPipeError):
        sys.exit(0)
