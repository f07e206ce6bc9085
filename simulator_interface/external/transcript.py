"""All that a stack in another process has said in a run, so that it can be told again without it.

Copies of the run talked to copies of the stack. What the specifications saw there is kept as well,
in the order in which they asked. So is what copies of the stack answered when they were asked
again.
"""

from __future__ import annotations

import io
import json
import struct
import zipfile
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from mrta_falsify.core import codec
from mrta_falsify.core.archives import DAMAGE, read_json_member, read_member
from mrta_falsify.core.durable import write_atomically
from mrta_falsify.core.errors import FormatError
from mrta_falsify.core.stack_failure import DeterminismCheck, StackFailure
from simulator_interface.clients.mrta_stack import MOST_BYTES
from simulator_interface.external.answers import Ready

TRANSCRIPT_NAME = "answers.zip"
#: version of what specifications ask of copies of a run; answers to earlier questions answer no
#: others, so that a run told again by them is judged without
QUESTIONS = 2
BLOCK = 1 << 18  # bytes that are deflated at once
MAX_PACKED = 2**30  # bytes of all answers of a run, deflated
MAX_UNPACKED = 8 * 2**30  # bytes of them as they were said
_LENGTH = struct.Struct("<I")
_HEAD, _BODY = "told.json", "answers"


@dataclass(frozen=True, slots=True, kw_only=True)
class Transcript:
    """What a stack has said."""

    ready: Ready
    packed: bytes  #: the answers, each behind its length (u32), deflated
    forecasts: tuple[dict[str, Any] | None, ...]
    failure: StackFailure | None  #: how it ended, if it failed
    #: what came of asking it again, in the order of the questions; None: nothing
    again: tuple[DeterminismCheck | None, ...] = ()
    questions: int = QUESTIONS  #: version of what ``forecasts`` answer

    def answers(self) -> Iterator[bytes]:
        """Give the answers to the ticks, from the first on."""
        unpacker, rest, total = zlib.decompressobj(), b"", 0
        for at in range(0, len(self.packed), 1 << 16):
            try:
                more = unpacker.decompress(self.packed[at : at + (1 << 16)])
            except zlib.error as error:
                raise FormatError(f"{TRANSCRIPT_NAME}: the answers are damaged: {error}") from None
            rest, total, start = rest + more, total + len(more), 0
            if total > MAX_UNPACKED:
                raise FormatError(
                    f"{TRANSCRIPT_NAME}: answers of over {MAX_UNPACKED / 2**30:.0f} GB"
                )
            while len(rest) >= start + _LENGTH.size:
                (length,) = _LENGTH.unpack_from(rest, start)
                end = start + _LENGTH.size + length
                if not 0 < length <= MOST_BYTES:
                    raise FormatError(f"{TRANSCRIPT_NAME}: an answer of {length} bytes")
                if len(rest) < end:
                    break
                yield rest[start + _LENGTH.size : end]
                start = end
            rest = rest[start:]


@dataclass(slots=True)
class TranscriptRecorder:
    """Collects what a stack says.

    Args:
        ready: who it is.
    """

    ready: Ready
    forecasts: list[dict[str, Any] | None] = field(default_factory=list)
    failure: StackFailure | None = None
    again: list[DeterminismCheck | None] = field(default_factory=list)
    _packer: Any = field(default_factory=lambda: zlib.compressobj(1))
    _parts: list[bytes] = field(default_factory=list)
    _fresh: list[bytes] = field(default_factory=list)  # not deflated yet: one by one is slow
    _size: int = 0  # of them
    _packed: int = 0  # bytes of the others

    @property
    def size(self) -> int:
        """Bytes that it keeps."""
        return self._packed + self._size

    def add(self, body: bytes) -> None:
        """Take in the answer to a tick."""
        self._fresh += (_LENGTH.pack(len(body)), body)
        self._size += len(body)
        if self._size > BLOCK:
            self._deflate()

    def _deflate(self) -> None:
        self._parts.append(self._packer.compress(b"".join(self._fresh)))
        self._packed += len(self._parts[-1])
        self._fresh, self._size = [], 0

    def finish(self) -> Transcript:
        """Give all; nothing may be added afterwards."""
        self._deflate()
        self._parts.append(self._packer.flush())
        return Transcript(
            ready=self.ready,
            packed=b"".join(self._parts),
            forecasts=tuple(self.forecasts),
            failure=self.failure,
            again=tuple(self.again),
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Head:
    """What stands in the file beside the answers."""

    ready: Ready
    forecasts: tuple[dict[str, Any] | None, ...] = ()
    questions: int = 1
    failure: StackFailure | None = None
    again: tuple[DeterminismCheck | None, ...] = ()


def write_transcript(transcript: Transcript, path: Path) -> None:
    """Write what a stack has said; the file is there whole or not at all."""
    head = {
        "ready": codec.encode(transcript.ready),
        "forecasts": list(transcript.forecasts),
        "questions": transcript.questions,
        "failure": codec.encode(transcript.failure),
        "again": codec.encode(transcript.again),
    }
    made = io.BytesIO()
    with zipfile.ZipFile(made, "w") as archive:
        archive.writestr(zipfile.ZipInfo(_HEAD), json.dumps(head))
        archive.writestr(zipfile.ZipInfo(_BODY), transcript.packed)
    write_atomically(path, made.getvalue())


def read_transcript(path: Path) -> Transcript:
    """Read what a stack has said.

    Raises:
        FormatError: the file is damaged.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            head = codec.decode(_Head, read_json_member(archive, _HEAD), where=f"{path}: {_HEAD}")
            packed = read_member(archive, _BODY, MAX_PACKED)
    except DAMAGE as error:
        raise FormatError(f"{path}: cannot be read: {error}") from None
    return Transcript(
        ready=head.ready,
        packed=packed,
        forecasts=head.forecasts,
        questions=head.questions,
        failure=head.failure,
        again=head.again,
    )
