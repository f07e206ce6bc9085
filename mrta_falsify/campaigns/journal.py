"""Files of JSON rows that outlive the process, and caches of answers kept in such files.

A row is on disc when :func:`append_row` returns. A crash during a write loses that row and no
other: :func:`read_rows` leaves it out, and the next row begins on a line of its own.
"""

from __future__ import annotations

import contextlib
import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Generic, TypeVar

from mrta_falsify.core import codec
from mrta_falsify.core.errors import InputError

A = TypeVar("A")


class AnswerCache(Generic[A]):
    """Answers of runs by key, each on disc before it is used, so that a second call goes on."""

    def __init__(self, kind: type[A], path: Path | None) -> None:
        """Read the answers of earlier calls.

        Args:
            kind: of the answers, a dataclass; its fields are the columns of a row.
            path: of the file; None keeps nothing. A damaged row costs one run.
        """
        self.answers: dict[str, A] = {}
        self._path = path
        for row in read_rows(path) if path is not None else ():
            with contextlib.suppress(InputError, KeyError):
                key = str(row.pop("run"))
                self.answers[key] = codec.decode(kind, row, where=str(path))

    def keep(self, key: str, answer: A) -> None:
        """Remember the answer of a run."""
        if self._path is not None:
            append_row(self._path, {"run": key, **codec.encode(answer)})
        self.answers[key] = answer


def read_rows(path: Path) -> Iterator[dict[str, Any]]:
    """Read the rows of a file, none if it does not exist; leave out what is not a JSON object."""
    if not path.is_file():
        return
    for line in path.read_text(encoding="utf-8", errors="replace").splitlines():
        try:
            row = json.loads(line)
        except ValueError:
            continue
        if isinstance(row, dict):
            yield row


def append_row(path: Path, row: dict[str, Any]) -> None:
    """Add a row; it is on disc when this returns.

    Raises:
        OSError: the file cannot be written.
    """
    with path.open("ab+") as file:
        size = file.seek(0, os.SEEK_END)
        if size:
            file.seek(size - 1)
            if file.read(1) != b"\n":
                file.write(b"\n")
        file.write(json.dumps(row).encode() + b"\n")
        file.flush()
        os.fsync(file.fileno())
