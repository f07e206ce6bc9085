"""Files of JSON rows that outlive the process, and journals of finished runs in such files.

A row is on disc when :func:`append_row` returns. A crash during a write loses that row and no
other: :func:`read_rows` leaves it out, and the next row begins on a line of its own.
"""

from __future__ import annotations

import contextlib
import json
import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Generic, TypeVar

from mrta_falsify.core import codec
from mrta_falsify.core.durable import CLOSED, append, place_error, sync_directory
from mrta_falsify.core.errors import FormatError, InputError, PlaceError
from mrta_falsify.core.interruption import describe_interrupt
from mrta_falsify.core.parsing import parse_json

A = TypeVar("A")

#: of the rows of a journal. Rows of version 1, which have no number, are not believed: they may
#: hold answers of runs that were interrupted.
JOURNAL_VERSION = 2


class RunJournal(Generic[A]):
    """Answers of finished runs by key, each on disc before it is used.

    A command that was stopped early goes on from its journal when it is called again, and comes
    to the same result. Only complete answers are kept, and only those of the same code are read.
    """

    def __init__(self, kind: type[A], path: Path | None, *, code: str = "") -> None:
        """Read the answers of earlier calls.

        Args:
            kind: of the answers, a dataclass.
            path: of the file, which journals of other kinds may share; None keeps nothing. A
                damaged row costs one run.
            code: digest of the code that the answers come from; rows of other code are left out.
        """
        self.answers: dict[str, A] = {}
        self._path = path
        self._head = {"version": JOURNAL_VERSION, "kind": kind.__name__, "code": code}
        for row in read_rows(path) if path is not None else ():
            if any(row.get(name) != value for name, value in self._head.items()):
                continue
            with contextlib.suppress(InputError):
                run = codec.decode(str, row.get("run"), where=str(path), path="run")
                self.answers[run] = codec.decode(kind, row.get("answer"), where=str(path))

    def keep(self, key: str, answer: A) -> A:
        """Keep the answer of a run, and return it.

        Where the folder is not ours to write to, it is kept for this process only.

        Raises:
            PlaceError: the disk is full, or the folder was removed.
        """
        self.answers[key] = answer
        if self._path is not None:
            try:
                append_row(self._path, {**self._head, "run": key, "answer": codec.encode(answer)})
            except OSError as error:
                if error.errno not in CLOSED:
                    raise place_error(self._path, error) from error
                self._path = None
        return answer

    def known_first(self, wanted: dict[str, Any]) -> Iterator[A]:
        """Yield the answers of the first of ``wanted``, by key, that are known; they are taken out.

        It ends at the first that is not known: what follows is run in its order.
        """
        for key in list(wanted):
            if key not in self.answers:
                return
            del wanted[key]
            yield self.answers[key]

    def discard(self) -> None:
        """Delete the file, once what it was kept for has its result."""
        if self._path is not None:
            with contextlib.suppress(OSError):
                self._path.unlink(missing_ok=True)

    @property
    def is_kept(self) -> bool:
        """Whether answers outlive this process."""
        return self._path is not None


@contextlib.contextmanager
def resumable(what: str, journals: Sequence[RunJournal[Any]]) -> Iterator[None]:
    """Let an interruption, or a full disk, inside say which finished runs are kept.

    Args:
        what: has no result yet.
        journals: that hold its runs; more may join them.

    Raises:
        Interrupted: in place of KeyboardInterrupt.
        PlaceError: with how to go on.
    """

    def state() -> tuple[str, str]:
        count = sum(len(journal.answers) for journal in journals if journal.is_kept)
        kept = f"{count} finished run{'' if count == 1 else 's'}" if count else "nothing"
        then = "goes on" if count else "begins anew"
        return kept, f"{what} has no result; the same command {then}"

    try:
        with describe_interrupt(state):
            yield
    except PlaceError as error:
        kept, _ = state()
        error.then = error.then or f"call again ({what} has no result; kept: {kept})"
        raise


def read_rows(path: Path) -> Iterator[dict[str, Any]]:
    """Read the rows of a file, none if it does not exist; leave out what is not a JSON object."""
    if not path.is_file():
        return
    for line in path.read_text(encoding="utf-8", errors="replace").splitlines():
        try:
            row = parse_json(line, str(path))
        except FormatError:
            continue
        if isinstance(row, dict):
            yield row


def append_row(path: Path, row: dict[str, Any]) -> None:
    """Add a row; it is on disc when this returns.

    Raises:
        OSError: the file cannot be written; its rows are as before.
    """
    line = json.dumps(row).encode() + b"\n"
    handle = os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND | os.O_CLOEXEC, 0o644)
    try:
        size = os.fstat(handle).st_size
        is_torn = size > 0 and os.pread(handle, 1, size - 1) != b"\n"
        append(handle, b"\n" + line if is_torn else line)
        if not size:
            sync_directory(path.parent)
    except OSError:
        if not size:
            with contextlib.suppress(OSError):
                path.unlink()
        raise
    finally:
        os.close(handle)
