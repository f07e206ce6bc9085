"""Files that are there whole or not at all."""

from __future__ import annotations

import contextlib
import os
import shutil
from collections.abc import Iterator, Sequence
from pathlib import Path

STAGE = ".part"  # folder in which files wait until all of them are written


def write_atomically(path: Path, data: bytes) -> None:
    """Write a file so that it is there whole or not at all, also after a power cut.

    What is not a regular file, as ``/dev/stdout``, is written to as it is.
    """
    if path.exists() and not path.is_file():
        path.write_bytes(data)
        return
    temporary = path.with_name(path.name + ".part")
    try:
        with temporary.open("wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        os.replace(temporary, path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise
    sync_directory(path.parent)


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
    """
    stage = folder / STAGE
    shutil.rmtree(stage, ignore_errors=True)
    stage.mkdir()
    try:
        yield stage
        for name in (mark, *others):
            (folder / name).unlink(missing_ok=True)
        for name in (*others, mark):
            if (stage / name).exists():
                os.replace(stage / name, folder / name)
        sync_directory(folder)
    finally:
        shutil.rmtree(stage, ignore_errors=True)


def sync_directory(directory: Path) -> None:
    """Make renames and new files in ``directory`` durable."""
    handle = os.open(directory, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
