"""The files of a rosbag2 recording, read as far as they go.

A recorder that was killed leaves no ``metadata.yaml``, an MCAP file without its end, or a database
whose last pages are in a journal beside it. So every storage file is read for itself, and one that
``rosbags`` refuses record by record. Files compressed as a whole (``.zstd``), chunks and messages
are unpacked. The files of several bags are merged by time.

Reference: https://mcap.dev/spec, https://github.com/ros2/rosbag2 (storage plug-ins).
"""

from __future__ import annotations

import heapq
import io
import shutil
import sqlite3
import struct
import zlib
from collections.abc import Collection, Iterator
from contextlib import ExitStack, closing
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, BinaryIO, NamedTuple

import yaml

from mrta_falsify.core import codec
from mrta_falsify.core.errors import FormatError

STORED = (".mcap", ".db3")
PACKED = (".zstd", ".zst")  # after one of those
METADATA = "metadata.yaml"
JOURNALS = ("-wal", "-journal")  # after the name of a database
ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"
MAX_BYTES = 64 * 2**30  # of one file, unpacked
MAX_CHUNK = 2**30  # bytes of one chunk, unpacked
PIECE = 2**16  # bytes unpacked at a time
APART = 600.0  # s between bags that are hardly of one run
_MCAP_MAGIC = 8  # bytes
_SCHEMA, _CHANNEL, _MESSAGE, _CHUNK = 3, 4, 5, 6  # kinds of records


class Recorded(NamedTuple):
    """A message as it was stored."""

    stamp: int  #: when it was recorded [ns]
    topic: str
    kind: str  #: as ``nav_msgs/msg/Odometry``
    raw: bytes  #: CDR


@dataclass(slots=True)
class Recording:
    """What the files tell beside the messages that were wanted."""

    begin: int | None = None  #: of all topics [ns]
    end: int | None = None
    definitions: dict[str, str] = field(default_factory=dict)  #: of message types, as .msg text
    notes: list[str] = field(default_factory=list)  #: what could not be read, in words
    is_cut: bool = False  #: something could not be read
    refused: list[str] = field(default_factory=list)  #: why files gave nothing at all

    def covers(self, stamp: int) -> None:
        """Take note of when something was recorded [ns]."""
        self.begin = stamp if self.begin is None else min(self.begin, stamp)
        self.end = stamp if self.end is None else max(self.end, stamp)


def is_stored(path: Path) -> bool:
    """Whether a path is named as a storage file is, packed or not."""
    ending = path.suffix.lower()
    inner = Path(path.stem).suffix.lower() if ending in PACKED else ending
    return inner in STORED


def files_of(path: Path) -> list[Path]:
    """List the storage files of a bag, or of the bags in a folder; empty: there are none."""
    if not path.is_dir():
        return [path]
    found = [file for file in sorted(path.iterdir()) if file.is_file() and is_stored(file)]
    for folder in sorted(path.iterdir()) if not found else ():
        if folder.is_dir() and not (folder / "trace.zip").exists():
            found += [file for file in sorted(folder.iterdir()) if is_stored(file)]
    return found


def messages_of(path: Path, kinds: Collection[str], recording: Recording) -> Iterator[Recorded]:
    """Read the messages of some types, in the order of their time.

    Args:
        path: a storage file, a bag's folder, or a folder of bags of one run.
        kinds: types that are wanted.
        recording: is filled on the way.
    """
    files = files_of(path)
    for folder in sorted({file.parent for file in files}) if path.is_dir() else ():
        _check_listed(folder, files, recording)
    with ExitStack() as stack:
        folder = Path(stack.enter_context(TemporaryDirectory(prefix="mrta_falsify_bag_")))
        spans: list[Recording] = []
        streams = []
        for number, file in enumerate(files):
            own = Recording(definitions=recording.definitions)
            spans.append(own)
            streams.append(_messages(file, kinds, own, folder / str(number)))
        yield from heapq.merge(*streams, key=lambda row: row.stamp)
    for own in spans:
        for stamp in (own.begin, own.end):
            if stamp is not None:
                recording.covers(stamp)
        recording.notes += own.notes
        recording.refused += own.refused
        recording.is_cut |= own.is_cut
    _check_gaps(spans, recording)


def _check_listed(folder: Path, files: list[Path], recording: Recording) -> None:
    """Say which files the metadata lists that are not there; metadata is not needed otherwise."""
    try:
        data = codec.read_yaml(folder / METADATA, doubled="last")
        listed = data["rosbag2_bagfile_information"]["relative_file_paths"]
        names = [Path(str(name)).name for name in listed]
    except (FormatError, KeyError, TypeError, yaml.YAMLError):
        return
    missing = [name for name in names if folder / name not in files]
    if missing:
        recording.is_cut = True
        recording.notes.append(f"{folder.name}: {', '.join(missing)} of its metadata is not there")


def _check_gaps(spans: list[Recording], recording: Recording) -> None:
    """Say if the files are hardly of one run."""
    times = sorted((s.begin, s.end) for s in spans if s.begin is not None and s.end is not None)
    reached = times[0][1] if times else 0
    for begin, end in times[1:]:
        if 1e-9 * (begin - reached) > APART:
            recording.notes.append(
                f"the bags are {1e-9 * (begin - reached):.0f} s apart; they are taken for one run"
            )
            return
        reached = max(reached, end)


# --- one file --------------------------------------------------------------------------------


def _messages(
    file: Path, kinds: Collection[str], recording: Recording, folder: Path
) -> Iterator[Recorded]:
    """Read a file by ``rosbags``, and what that refuses record by record."""
    from rosbags.rosbag2 import Reader  # noqa: PLC0415 - an extra

    stored, last, seen = file, -1, 0
    try:
        stored = _unpacked(file, recording, folder)
        with Reader(stored) as bag:
            wanted = [c for c in bag.connections if c.msgtype in kinds]
            for connection in wanted:
                if connection.msgdef.format.name == "MSG":
                    recording.definitions.setdefault(connection.msgtype, connection.msgdef.data)
            if bag.message_count:
                recording.covers(bag.start_time)
                recording.covers(bag.end_time - 1)
            for connection, stamp, raw in bag.messages(wanted) if wanted else ():
                last, seen = stamp, seen + 1
                yield Recorded(stamp, connection.topic, connection.msgtype, _plain(raw))
        return
    except Exception as error:
        said = str(error).splitlines() or [type(error).__name__]
        reason = said[0][:200]
    rows = _salvaged(stored, kinds, recording)
    recording.is_cut = True
    if recording.end is None:
        recording.refused.append(f"{file}: is damaged, or no log of ROS 2: {reason}")
        return
    rest = sorted((row for row in rows if row.stamp > last), key=lambda row: row.stamp)
    yield from rest
    recording.notes.append(
        f"{file.name} is damaged, or its recorder was killed: what could be read is used, "
        f"{seen + len(rest)} messages"
    )


def _plain(raw: bytes) -> bytes:
    """Unpack a message that was compressed for itself; CDR begins otherwise."""
    if bytes(raw[:4]) != ZSTD_MAGIC:
        return raw
    return b"".join(_pieces(io.BytesIO(raw), "zstd"))


def _unpacked(file: Path, recording: Recording, folder: Path) -> Path:
    """Unpack a file that is compressed as a whole, and settle a database with its journal."""
    stored = file
    if file.suffix.lower() in PACKED:
        folder.mkdir()
        stored = folder / file.stem
        size = 0
        with file.open("rb") as packed, stored.open("wb") as out:
            for piece in _pieces(packed, "zstd"):
                size += out.write(piece)
                if size > MAX_BYTES:
                    raise FormatError(f"{file}: unpacks to more than {MAX_BYTES} bytes")
    journals = [Path(f"{file}{ending}") for ending in JOURNALS]
    journals = [path for path in journals if path.is_file() and path.stat().st_size]
    if stored.suffix.lower() == ".db3" and journals:
        folder.mkdir(exist_ok=True)
        copy = folder / stored.name
        for path in (stored, *journals):
            shutil.copyfile(path, folder / path.name)
        with closing(sqlite3.connect(copy)) as database:
            database.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchall()
            database.execute("PRAGMA journal_mode=DELETE").fetchall()
        recording.notes.append(f"{file.name} was not closed: its journal was read, too")
        return copy
    return stored


def _pieces(stream: BinaryIO, packing: str) -> Iterator[bytes]:
    """Unpack a stream piece by piece, as far as it goes."""
    unpack: Any
    if packing == "zstd":
        import zstandard  # noqa: PLC0415 - an extra

        unpack = zstandard.ZstdDecompressor().decompressobj()
    else:
        import lz4.frame  # noqa: PLC0415 - an extra

        unpack = lz4.frame.LZ4FrameDecompressor()
    while piece := stream.read(PIECE):
        try:
            yield unpack.decompress(piece)
        except Exception:
            return


# --- record by record ------------------------------------------------------------------------


def _salvaged(file: Path, kinds: Collection[str], recording: Recording) -> list[Recorded]:
    """Read what a damaged file still tells, whatever its order."""
    try:
        if file.suffix.lower() == ".db3":
            return list(_rows_of_database(file, kinds, recording))
        with file.open("rb") as stream:
            stream.seek(_MCAP_MAGIC)
            return list(_Scan(kinds, recording).messages(stream, file.stat().st_size))
    except (OSError, sqlite3.Error):
        return []


def _rows_of_database(
    file: Path, kinds: Collection[str], recording: Recording
) -> Iterator[Recorded]:
    """Read a damaged database from both ends, as far as its pages hold."""
    with closing(sqlite3.connect(f"file:{file.resolve()}?immutable=1", uri=True)) as database:
        database.text_factory = lambda text: text.decode(errors="replace")
        database.execute("PRAGMA writable_schema=ON")  # else one that is too short is not opened
        topics = {row[0]: row[1:] for row in database.execute("SELECT id, name, type FROM topics")}
        last, order = -1, "ASC"
        for _ in range(2):
            try:
                rows = database.execute(
                    "SELECT id, topic_id, timestamp, data FROM messages WHERE id > ? "
                    f"ORDER BY id {order}",
                    (last,),
                )
                for number, topic, stamp, raw in rows:
                    last = number if order == "ASC" else last
                    if topic in topics and isinstance(stamp, int) and isinstance(raw, bytes):
                        recording.covers(stamp)
                        if topics[topic][1] in kinds:
                            name, kind = topics[topic]
                            yield Recorded(stamp, name, kind, _plain(raw))
            except sqlite3.Error:
                order = "DESC"
                continue
            return


class _Scan:
    """Reads an MCAP file from its begin, without the index at its end."""

    def __init__(self, kinds: Collection[str], recording: Recording) -> None:
        self._kinds, self._recording = kinds, recording
        self._schemas: dict[int, str] = {}
        self._channels: dict[int, tuple[str, str]] = {}  #: topic and type

    def messages(self, stream: BinaryIO, size: int) -> Iterator[Recorded]:
        for kind, body, is_whole in _records(stream, size):
            try:
                if kind == _CHUNK:
                    inner = _chunk(body, is_whole=is_whole)
                    yield from self.messages(io.BytesIO(inner), len(inner))
                elif is_whole:
                    yield from self._record(kind, body)
            except (struct.error, ValueError, IndexError):
                continue  # this record is damaged; the next one may be whole

    def _record(self, kind: int, body: bytes) -> Iterator[Recorded]:
        if kind == _SCHEMA:
            (number,), rest = struct.unpack_from("<H", body), body[2:]
            name, rest = _text(rest)
            encoding, rest = _text(rest)
            self._schemas[number] = name
            if encoding == "ros2msg" and name in self._kinds:
                self._recording.definitions.setdefault(name, _text(rest)[0])
        elif kind == _CHANNEL:
            number, schema = struct.unpack_from("<HH", body)
            self._channels[number] = _text(body[4:])[0], self._schemas.get(schema, "")
        elif kind == _MESSAGE:
            number, _, stamp, _ = struct.unpack_from("<HIQQ", body)
            if number not in self._channels:
                return
            self._recording.covers(stamp)
            topic, name = self._channels[number]
            if name in self._kinds:
                yield Recorded(stamp, topic, name, body[22:])


def _records(stream: BinaryIO, size: int) -> Iterator[tuple[int, bytes, bool]]:
    """Yield kind, content and whether it is whole of every record; the last may be cut."""
    while len(head := stream.read(9)) == 9:
        kind, length = struct.unpack("<BQ", head)
        body = stream.read(min(length, max(size - stream.tell(), 0)))
        yield kind, body, len(body) == length
        if len(body) < length:
            return


def _chunk(body: bytes, *, is_whole: bool) -> bytes:
    """Unpack a chunk as far as it goes; empty if it is whole and its checksum is not right."""
    _, _, _, checksum = struct.unpack_from("<QQQI", body)
    packing, rest = _text(body[28:])
    packed = rest[8:]
    if packing:
        found = io.BytesIO()
        for piece in _pieces(io.BytesIO(packed), packing):
            found.write(piece)
            if found.tell() > MAX_CHUNK:
                return b""
        packed = found.getvalue()
    is_right = not is_whole or not checksum or zlib.crc32(packed) == checksum
    return packed if is_right else b""


def _text(body: bytes) -> tuple[str, bytes]:
    """Read a text and what follows it."""
    (length,) = struct.unpack_from("<I", body)
    return body[4 : 4 + length].decode(), body[4 + length :]
