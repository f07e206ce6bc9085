"""Members of zip archives, bounded before they are read: bytes, JSON, and arrays without pickle."""

from __future__ import annotations

import io
import math
import shutil
import tempfile
import tokenize
import zipfile
import zlib
from typing import Any

import numpy as np

from mrta_falsify.core.errors import FormatError
from mrta_falsify.core.parsing import MAX_FILE_BYTES, parse_json

#: what reading a damaged archive raises; RuntimeError: a flag or method that was never written
DAMAGE = (
    *(OSError, EOFError, KeyError, RuntimeError, ValueError, ArithmeticError, TypeError),
    *(IndexError, zipfile.BadZipFile, zlib.error, tokenize.TokenError, SyntaxError),
)
LARGE = 64 * 2**20  # bytes of an array that is not read into memory
MAX_ARRAYS = 16 * 2**30  # bytes of the arrays of one archive; a shift of 8 h has some 3 GB
LEAST_OF_VALUE = 4  # bytes of a value in a list that holds any news
MAX_HEADER = 1 << 16  # bytes of an array's header


def read_member(archive: zipfile.ZipFile, name: str, most: int = MAX_FILE_BYTES) -> bytes:
    """Read a member of at most ``most`` bytes.

    Raises:
        FormatError: it is larger.
        KeyError: there is none, and other errors of ``DAMAGE``.
    """
    member = archive.getinfo(name)
    if member.file_size > most:
        raise FormatError(
            f"{archive.filename}: {name} has {member.file_size / 2**20:.0f} MB; at most "
            f"{most / 2**20:.0f} MB"
        )
    return archive.read(member)


def read_json_member(archive: zipfile.ZipFile, name: str, most: int = MAX_FILE_BYTES) -> Any:
    """Read a JSON member; errors as of :func:`read_member`, and FormatError if it is none."""
    text = read_member(archive, name, most)
    return parse_json(text, f"{archive.filename}: {name}", most=most // LEAST_OF_VALUE)


def read_array(archive: zipfile.ZipFile, name: str) -> np.ndarray:
    """Read an array of numbers from ``name.npy``; a large one is mapped from a file.

    Raises:
        FormatError: its header announces another size than it has, or what is no number.
        KeyError: there is none, and other errors of ``DAMAGE``.
    """
    member = archive.getinfo(f"{name}.npy")
    where = f"{archive.filename}: {name}.npy"
    with archive.open(member) as source:
        head = io.BytesIO(source.read(MAX_HEADER))
    version = np.lib.format.read_magic(head)
    if version not in ((1, 0), (2, 0)):
        raise FormatError(f"{where}: is an array of version {version}; this reads 1.0 and 2.0")
    read = np.lib.format.read_array_header_1_0
    read = np.lib.format.read_array_header_2_0 if version == (2, 0) else read
    shape, _, dtype = read(head)
    if dtype.kind not in "fiub" or not dtype.isnative:
        raise FormatError(f"{where}: has values of type {dtype}; they must be numbers")
    size = math.prod(shape) * dtype.itemsize
    if min(shape, default=0) < 0 or size != member.file_size - head.tell():
        raise FormatError(
            f"{where}: announces shape {shape} of {dtype}, and has "
            f"{member.file_size - head.tell()} bytes"
        )
    if size > MAX_ARRAYS:
        raise FormatError(
            f"{where}: has {size / 2**30:.0f} GB; at most {MAX_ARRAYS / 2**30:.0f} GB"
        )
    if size < LARGE:
        return np.lib.format.read_array(io.BytesIO(archive.read(member)), allow_pickle=False)
    with tempfile.NamedTemporaryFile(prefix="mrta-falsify-trace-") as file:
        with archive.open(member) as source:
            shutil.copyfileobj(source, file)
        file.flush()
        column: np.ndarray = np.load(file.name, mmap_mode="r", allow_pickle=False)
    return column
