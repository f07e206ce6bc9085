"""Files that are there whole or not at all, and errors of the places where they should be.

Every file of a result is written here. An error of the place (a full disk, a removed folder, a
folder that is not ours) is a :class:`~mrta_falsify.core.errors.PlaceError` that names the file, and
leaves no half file behind.
"""

from __future__ import annotations

import contextlib
import errno
import io
import os
import shutil
from collections.abc import Iterator, Sequence
from io import FileIO
from pathlib import Path
from typing import BinaryIO

from mrta_falsify.core.errors import PlaceError

STAGE = ".part"  # folder in which files wait until all of them are written
PART = ".part"  # ending of a file that is being written

#: no room left: EFBIG is the limit of ``ulimit -f``
FULL = frozenset((errno.ENOSPC, errno.EDQUOT, errno.EFBIG))
#: the place is not ours to write to
CLOSED = frozenset((errno.EACCES, errno.EPERM, errno.EROFS))
#: the disk, whoever writes to it
DISK = FULL | {errno.EIO, errno.ESTALE}


# --- errors ------------------------------------------------------------------------------


def place_error(path: Path | str, error: OSError) -> PlaceError:
    """Say which file cannot be written, why, and what to do about that."""
    remedy = "name another place"
    if error.errno in FULL:
        remedy = "make room"
    elif error.errno in CLOSED:
        remedy = "make it writable"
    elif error.errno == errno.ENOENT:
        remedy = "make its folder"
    elif error.errno in DISK:
        remedy = "mend the disk"
    reason = error.strerror or " ".join(str(error).split()) or type(error).__name__
    return PlaceError(f"{path}: cannot be written: {reason}; {remedy}")


@contextlib.contextmanager
def naming(path: Path | str) -> Iterator[None]:
    """Let an OSError inside say that ``path`` cannot be written.

    Raises:
        PlaceError: in place of any OSError.
    """
    try:
        yield
    except OSError as error:
        raise place_error(path, error) from error


def place_error_in(error: BaseException | None) -> PlaceError | None:
    """Find what an exception says about a place, though others may have wrapped it.

    Args:
        error: of a library or a stack, whatever its type.

    Returns:
        The PlaceError in it, or one made of a full or broken disk; None: it is about no place.
    """
    seen: set[int] = set()
    while error is not None and id(error) not in seen:
        seen.add(id(error))
        if isinstance(error, PlaceError):
            return error
        if isinstance(error, OSError) and error.errno in DISK:
            return place_error(os.fsdecode(error.filename or "a file of the run"), error)
        error = error.__cause__ or (None if error.__suppress_context__ else error.__context__)
    return None


# --- files -------------------------------------------------------------------------------


def write_atomically(path: Path, data: bytes) -> None:
    """Write a file so that it is there whole or not at all, also after a power cut.

    What is not a regular file, as ``/dev/stdout``, is written to as it is.

    Raises:
        PlaceError: it cannot be written; what was there before still is.
    """
    with replacing(path) as file:
        file.write(data)


@contextlib.contextmanager
def replacing(path: Path) -> Iterator[BinaryIO]:
    """Open a file that takes the place of ``path`` once the block has written it whole.

    Raises:
        PlaceError: in place of an OSError inside; what was there before still is.
    """
    with naming(path):
        is_special = path.exists() and not path.is_file()
        part = path if is_special else path.with_name(path.name + PART)
        raw = FileIO(part, "w")
        file = io.BufferedWriter(raw)
        try:
            try:
                yield file
                file.flush()
                if not is_special:
                    os.fsync(raw.fileno())
            finally:
                raw.close()  # first: what could not be written is not tried again
            if not is_special:
                os.replace(part, path)
        except BaseException:
            if not is_special:
                with contextlib.suppress(OSError):
                    part.unlink()
            raise
        if not is_special:
            sync_directory(path.parent)


def append(handle: int, data: bytes) -> None:
    """Append to an open file, all of ``data`` or nothing; it is durable on return.

    Raises:
        OSError: the disk is full or broken.
    """
    before = os.lseek(handle, 0, os.SEEK_END)
    try:
        done = 0
        while done < len(data):
            done += os.write(handle, data[done:])
        os.fsync(handle)
    except BaseException:  # an interruption leaves no half line either
        with contextlib.suppress(OSError):
            os.ftruncate(handle, before)
        raise


# --- folders -----------------------------------------------------------------------------


def make_folder(folder: Path) -> Path:
    """Make a folder that survives a power cut, with those that it is in; return it.

    Raises:
        PlaceError: it cannot be made.
    """
    with naming(folder):
        missing = [folder]
        while not missing[-1].exists() and missing[-1] != missing[-1].parent:
            missing.append(missing[-1].parent)
        for each in reversed(missing):
            if not each.is_dir():
                each.mkdir(exist_ok=True)  # another worker may make it as well
                sync_directory(each.parent)
    return folder


@contextlib.contextmanager
def staged(folder: Path, *, mark: str, others: Sequence[str] = ()) -> Iterator[Path]:
    """Write several files that belong together, in place of those of an earlier call.

    The earlier files stay until all new ones are written; then they go, and the new ones come.
    A crash in between leaves files without the mark, which are no result.

    Args:
        folder: for the files.
        mark: name of the file that makes them a result; it goes first and comes last.
        others: names of the other files, of which some may be missing.

    Yields:
        A folder to write to; what is in it when an exception passes is lost.

    Raises:
        PlaceError: a file cannot be written.
    """
    stage = folder / STAGE
    shutil.rmtree(stage, ignore_errors=True)
    try:
        with naming(folder):
            stage.mkdir()
        yield stage
        with naming(folder):
            (folder / mark).unlink(missing_ok=True)
            sync_directory(folder)
            for name in others:
                (folder / name).unlink(missing_ok=True)
            for name in others:
                if (stage / name).exists():
                    os.replace(stage / name, folder / name)
            sync_directory(folder)
            if (stage / mark).exists():
                os.replace(stage / mark, folder / mark)
            sync_directory(folder)
    finally:
        shutil.rmtree(stage, ignore_errors=True)


def sync_directory(directory: Path) -> None:
    """Make renames and new files in ``directory`` durable.

    Raises:
        OSError: the disk is broken, or the folder was removed.
    """
    handle = os.open(directory, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
