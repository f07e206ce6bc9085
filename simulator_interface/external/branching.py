"""How a copy of the run gets a copy of the stack: by its own fork, or by telling all again."""

from __future__ import annotations

import mmap
import os
import shutil
import socket
import struct
import tempfile
from collections.abc import Iterator

from mrta_falsify.core.durable import naming
from simulator_interface.external.answers import shown
from simulator_interface.external.wire import Unreadable, Wire

_SIZES = struct.Struct("<II")
BLOCK = 1 << 20  # bytes that are kept in memory
_PEER = struct.Struct("3i")  # pid, uid, gid


class CannotBranch(Exception):  # noqa: N818 - says what the stack cannot do
    """No copy of the stack can be had."""


class MessageLog:
    """All that was said and heard in an episode, so that a fresh process can be told it.

    The last of it is in memory, the rest in a file without a name. A copy of the run has the
    memory for its own, and reads the file without moving it.

    Args:
        are_kept: whether anything is.
    """

    def __init__(self, *, are_kept: bool) -> None:
        # Not buffered: a copy of this process must not write what the original has not yet.
        with naming(tempfile.gettempdir()):
            self._file = tempfile.TemporaryFile(buffering=0) if are_kept else None  # noqa: SIM115
        self._size = 0  # of what is in the file
        self._rows: list[tuple[bytes, bytes]] = []  # not in the file
        self._waiting = 0  # bytes of them
        self.size = 0  #: of all that was said and heard [bytes]
        self.is_copy = False  #: of the run
        # Copies tell the original by this byte that a copy of the stack by fork hangs.
        self._shared = mmap.mmap(-1, 1)

    def add(self, sent: bytes, received: bytes) -> None:
        """Keep a message of the harness and the stack's answer, which may be a question."""
        if self._file is None:
            return
        self._rows.append((sent, received))
        self.size += len(sent) + len(received)
        self._waiting += len(sent) + len(received)
        if self._waiting > BLOCK and not self.is_copy:
            self._write()

    def _write(self) -> None:
        assert self._file is not None
        parts = [
            _SIZES.pack(len(sent), len(received)) + sent + received for sent, received in self._rows
        ]
        block = b"".join(parts)
        with naming(tempfile.gettempdir()):
            while block:
                written = self._file.write(block)
                self._size, block = self._size + written, block[written:]
        self._rows, self._waiting = [], 0

    def all(self) -> Iterator[tuple[bytes, bytes]]:
        """Give the messages of both sides, from the world on."""
        if self._file is None:
            raise CannotBranch("the messages to the stack are not kept")
        number, at = self._file.fileno(), 0
        while at < self._size:
            sent, received = _SIZES.unpack(_read(number, _SIZES.size, at))
            row = _read(number, sent + received, at + _SIZES.size)
            yield row[:sent], row[sent:]
            at += _SIZES.size + sent + received
        yield from self._rows

    def become_copy(self) -> None:
        """Write no more: this is a copy of the run, and the file is the original's."""
        self.is_copy = True

    def close(self) -> None:
        """Throw the file away; may be called twice."""
        if self._file is not None:
            self._file.close()

    @property
    def forking_failed(self) -> bool:
        """Whether a copy of the stack by fork did not answer, in any copy of the run."""
        return self._shared[0] != 0

    def note_forking_failed(self) -> None:
        """Tell the original and all copies that the stack does not survive a fork."""
        self._shared[0] = 1


def _read(number: int, size: int, at: int) -> bytes:
    parts = []
    while size:
        part = os.pread(number, size, at)
        if not part:
            raise CannotBranch("the kept messages to the stack are cut short")
        parts.append(part)
        size, at = size - len(part), at + len(part)
    return b"".join(parts)


def connect_branch(wire: Wire, limit: float, *, is_kept: bool) -> tuple[Wire, int]:
    """Let a stack fork itself; its copy connects here.

    Args:
        wire: to the stack.
        limit: [s] that it has.
        is_kept: whether the stack was started here.

    Returns:
        The wire to the copy, and its process number.

    Raises:
        Closed: the stack is gone.
        Late: the copy does not come.
        Unreadable: the stack does not say that it has branched.
    """
    with naming(tempfile.gettempdir()):
        folder = tempfile.mkdtemp(prefix="mrta-stack-")  # for this user alone
    address = os.path.join(folder, "branch")
    try:
        with socket.socket(socket.AF_UNIX) as door:
            door.bind(address)
            door.listen(1)
            wire.allow(limit)
            wire.send({"type": "branch", "address": address})
            answer = wire.receive()
            if answer["type"] != "branched":
                raise Unreadable(f"`branch` was answered by {shown(answer['type'])}")
            link = wire.accept(door)
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    peer = link.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _PEER.size)
    process = _PEER.unpack(peer)[0]
    return Wire(link, process if is_kept else None), process
