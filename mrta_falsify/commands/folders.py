"""Places that a user names: directories to write to, and what an error is about."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path

from mrta_falsify.core.durable import DISK, make_folder
from mrta_falsify.core.errors import FormatError, InputError, PlaceError

Place = str | Path  #: a file or directory, as users name it


def make_directory(directory: Path) -> Path:
    """Make ``directory`` if it is missing, and return it.

    Raises:
        FormatError: it cannot be made, or is a file.
        PlaceError: the disk is full or broken.
    """
    try:
        return make_folder(directory)
    except PlaceError as error:
        cause = error.__cause__
        if not isinstance(cause, OSError) or cause.errno in DISK:
            raise
        reason = cause.strerror or str(cause)
        raise FormatError(f"{directory}: cannot be used as a directory: {reason}") from None


@contextlib.contextmanager
def located(where: str) -> Iterator[None]:
    """Name the file or option that an input error raised inside comes from."""
    try:
        yield
    except InputError as error:
        text = str(error)
        if not text.startswith(where):
            error.args = (f"{where}: {text}",)
        raise
