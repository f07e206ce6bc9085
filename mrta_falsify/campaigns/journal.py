"""Files of JSON rows that outlive the process: what a cache or a study knew, the next one knows.

A row is on disc when :func:`append_row` returns. One that was cut short by a crash is lost and
nothing else: it is left out by :func:`read_rows`, and the next row begins on a line of its own.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any


def read_rows(path: Path) -> Iterator[dict[str, Any]]:
    """Rows of a file, none if it is not there; what is no JSON object is left out."""
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
