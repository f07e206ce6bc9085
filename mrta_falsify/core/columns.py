"""Columns of a trace as they grow: in memory, or in files where a run is long.

A shift of hours does not fit into memory. So rows are collected up to ``BLOCK`` bytes and then
appended to one file per column. The files have no name: they are gone with the last process that
holds them, however that ends. They are written at offsets of our own, so a copy of the process that
went on and was taken back leaves nothing behind that counts.
"""

from __future__ import annotations

import math
import mmap
import os
import tempfile
import weakref
from collections.abc import Iterator, Mapping, Sequence
from multiprocessing.reduction import DupFd  # how processes hand each other open files
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from mrta_falsify.core.durable import naming

BLOCK = 32 * 2**20  # bytes of rows that are kept in memory


class ScratchFile:
    """A file without a name; it is gone with the last process that holds it.

    Args:
        descriptor: of the open file; closed with this object.
    """

    def __init__(self, descriptor: int) -> None:
        self.descriptor = descriptor
        weakref.finalize(self, os.close, descriptor)

    @classmethod
    def new(cls) -> ScratchFile:
        """Make an empty one in the folder for temporary files.

        Raises:
            PlaceError: that folder cannot be written.
        """
        with (
            naming(tempfile.gettempdir()),
            tempfile.TemporaryFile(prefix="mrta-falsify-trace-") as file,
        ):
            return cls(os.dup(file.fileno()))

    def write(self, values: bytes, start: int) -> None:
        """Write ``values`` from byte ``start`` on.

        Raises:
            PlaceError: the disk is full.
        """
        rest = memoryview(values)
        with naming(tempfile.gettempdir()):
            while rest:
                written = os.pwrite(self.descriptor, rest, start)
                rest, start = rest[written:], start + written


class ColumnFile(NamedTuple):
    """One column in a file."""

    file: ScratchFile
    dtype: np.dtype[Any]
    shape: tuple[int, ...]  #: ticks first

    def read(self) -> np.ndarray:
        """Map the values into memory; they cannot be changed."""
        if 0 in self.shape:
            return np.empty(self.shape, self.dtype)
        mapped = mmap.mmap(self.file.descriptor, 0, access=mmap.ACCESS_READ)
        # A copy that was taken back may have written on behind the last value.
        values = np.frombuffer(mapped, self.dtype, count=math.prod(self.shape))
        return values.reshape(self.shape)


class FileColumns(Mapping[str, np.ndarray]):
    """Columns in files, mapped into memory whenever one is asked for.

    Another process of this machine gets the same files.
    """

    def __init__(self, files: Mapping[str, ColumnFile]) -> None:
        self._files = dict(files)

    def __getitem__(self, name: str) -> np.ndarray:
        """Map the column ``name``."""
        return self._files[name].read()

    def __iter__(self) -> Iterator[str]:
        """List the names."""
        return iter(self._files)

    def __len__(self) -> int:
        """Count the columns."""
        return len(self._files)

    def __reduce__(self) -> tuple[Any, ...]:
        """Hand the open files to another process."""
        parts = [
            (name, DupFd(file.descriptor), dtype, shape)
            for name, (file, dtype, shape) in self._files.items()
        ]
        return _received, (parts,)


def _received(parts: Sequence[tuple[str, Any, Any, Any]]) -> FileColumns:
    return FileColumns(
        {
            name: ColumnFile(ScratchFile(handle.detach()), dtype, shape)
            for name, handle, dtype, shape in parts
        }
    )


class ColumnStore:
    """Takes in rows, and gives their columns.

    Args:
        layout: of a row.
        block: bytes of rows that are kept in memory; ``BLOCK`` if 0.
        kept_as: types of columns that are kept with fewer digits than a row has.
    """

    def __init__(
        self,
        layout: np.dtype[np.void],
        block: int = 0,
        *,
        kept_as: Mapping[str, np.dtype[Any]] = MappingProxyType({}),
    ) -> None:
        self._layout = layout
        self._kept_as = kept_as
        self._block = block or BLOCK
        self._rows = bytearray()
        self._files: dict[str, ScratchFile] = {}
        self._ticks = 0  #: in the files

    def add(self, row: bytes) -> None:
        """Take in a row."""
        self._rows += row
        if len(self._rows) >= self._block:
            self._append()

    def columns(self) -> Mapping[str, np.ndarray]:
        """Give what was taken in, ``(K, ...)`` each; the store must not be used afterwards."""
        if not self._files:
            return dict(self._in_memory())
        self._append()
        return FileColumns(
            {
                name: ColumnFile(file, dtype, (self._ticks, *shape))
                for (name, dtype, shape), file in zip(
                    self._kept(), self._files.values(), strict=True
                )
            }
        )

    def _kept(self) -> Iterator[tuple[str, np.dtype[Any], tuple[int, ...]]]:
        """Tell of each column its name, and type and shape of a tick's values."""
        for name in self._layout.names or ():
            given, shape = self._layout[name].base, self._layout[name].shape
            yield name, self._kept_as.get(name, given), shape

    def _in_memory(self) -> Iterator[tuple[str, np.ndarray]]:
        table = np.frombuffer(self._rows, dtype=self._layout)
        for name, dtype, _ in self._kept():
            yield name, np.ascontiguousarray(table[name], dtype=dtype)

    def _append(self) -> None:
        """Move the rows to the files."""
        ticks = len(self._rows) // self._layout.itemsize
        for (name, values), (_, dtype, shape) in zip(
            list(self._in_memory()), self._kept(), strict=True
        ):
            if name not in self._files:
                self._files[name] = ScratchFile.new()
            start = self._ticks * dtype.itemsize * math.prod(shape)
            self._files[name].write(values.tobytes(), start)
        self._ticks += ticks
        self._rows = bytearray()
