"""Messages within limits that count what the stack does, not how busy the machine is."""

from __future__ import annotations

import os
import socket
import threading
import time
from collections.abc import Iterator

import pytest

from mrta_falsify.process.usage import ProcessClock
from simulator_interface.external.wire import Late, LateByWallClock, Wire

LIMIT = 0.2  # s


class Waiting(ProcessClock):
    """The clock of a stack that waits for a processor for ``seconds`` of wall-clock time."""

    def __init__(self, seconds: float) -> None:
        super().__init__(os.getpid())
        self.left = seconds

    def look(self, waited: float | None = None) -> float:
        assert waited is not None
        self.left -= waited
        self.spent += waited if self.left < 0.0 else 0.0
        return self.spent


@pytest.fixture
def ends() -> Iterator[tuple[socket.socket, socket.socket]]:
    ours, theirs = socket.socketpair()
    with ours, theirs:
        yield ours, theirs


def wired(ours: socket.socket, *, waits: float) -> Wire:
    wire = Wire(ours, os.getpid())
    wire._connection.clock = Waiting(waits)
    wire.allow(LIMIT)
    return wire


def test_a_stack_that_waits_for_a_processor_is_waited_for(ends):
    ours, theirs = ends
    wire = wired(ours, waits=60.0)
    frame = len(b'{"type":"ready"}').to_bytes(4, "little") + b'{"type":"ready"}'
    late = threading.Timer(4.0 * LIMIT, theirs.sendall, (frame,))
    late.start()
    assert wire.receive() == {"type": "ready"}
    late.join()


def test_the_limit_holds_once_it_works_or_sleeps(ends):
    wire = wired(ends[0], waits=2.0 * LIMIT)
    began = time.monotonic()
    with pytest.raises(Late):
        wire.receive()
    assert time.monotonic() - began > 3.0 * LIMIT - 0.11


def test_a_message_that_is_not_read_is_late_too(ends):
    wire = wired(ends[0], waits=0.0)
    with pytest.raises(Late):
        wire.send({"type": "world", "name": "x" * (4 << 20)})


def test_a_large_message_arrives_whole_however_slowly_it_is_read(ends):
    ours, theirs = ends
    wire = wired(ours, waits=60.0)
    read = []

    def slowly() -> None:
        while sum(map(len, read)) < len(sent) + 4:
            read.append(theirs.recv(1 << 20))
            time.sleep(0.01)

    sent = b'{"type": "world", "name": "' + b"x" * (1 << 20) + b'"}'
    reader = threading.Thread(target=slowly)
    reader.start()
    assert wire.send({"type": "world", "name": "x" * (1 << 20)}) == sent
    reader.join()
    assert b"".join(read)[4:] == sent


def test_one_limit_holds_for_all_that_is_said_and_heard_until_the_next_one(ends):
    ours, theirs = ends
    wire = wired(ours, waits=0.0)
    frame = len(b'{"type":"map"}').to_bytes(4, "little") + b'{"type":"map"}'

    over = threading.Event()

    def asks() -> None:
        while not over.wait(LIMIT / 4.0):
            theirs.sendall(frame)

    asking = threading.Thread(target=asks)
    asking.start()
    asked = []
    with pytest.raises(Late):
        asked.extend(wire.receive() for _ in range(100))
    over.set()
    asking.join()
    assert 1 <= len(asked) < 20


def test_a_stack_that_was_not_started_here_has_wall_clock_time_and_is_never_judged(ends):
    wire = Wire(ends[0], None)
    wire.allow(LIMIT)
    with pytest.raises(LateByWallClock, match=r"within 0.2 s of wall-clock time; it was not start"):
        wire.receive()
