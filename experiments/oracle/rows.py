"""Rows of results in a file that is appended to, and the workers that make them."""

from __future__ import annotations

import json
import multiprocessing
import resource
import signal
import sys
import time as clock
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

Row = dict[str, Any]


def read_rows(path: Path) -> dict[str, Row]:
    """Read the rows of a file by their case; a line cut short by a kill is cut off.

    Args:
        path: of the file; none yet: no rows.
    """
    if not path.exists():
        return {}
    text = path.read_text()
    whole, newline, torn = text.rpartition("\n")
    if torn:
        path.write_text(whole + newline)
    rows = (json.loads(line) for line in whole.splitlines())
    return {row["case"]: row for row in rows}


def append_rows(
    path: Path, make: Callable[[str], Row], names: Sequence[str], workers: int
) -> dict[str, Row]:
    """Make the rows that a file does not have yet, and append each once it is complete.

    Args:
        path: of the file.
        make: row of a case by its name; a function of a module.
        names: of the cases.
        workers: processes.

    Returns:
        All rows of ``names``.

    Raises:
        KeyboardInterrupt: the rows made so far are kept; the next call goes on.
    """
    rows = read_rows(path)
    todo = [name for name in names if name not in rows]
    began = clock.monotonic()
    with path.open("a") as file:
        for done, row in enumerate(_made(make, todo, workers), start=1):
            rows[row["case"]] = row
            file.write(json.dumps(row) + "\n")
            file.flush()
            rest = (clock.monotonic() - began) / done * (len(todo) - done)
            text = f"[{done}/{len(todo)}] {row['case']}: {row['cpu_s']:.0f} s of CPU"
            print(f"{text}, {rest / 60.0:.0f} min left", file=sys.stderr, flush=True)
    return {name: rows[name] for name in names}


def run_command(
    path: Path,
    make: Callable[[str], Row],
    names: Sequence[str],
    workers: int,
    summary: Callable[[list[Row]], Row],
) -> int:
    """Make the rows of a command, print what they come to as JSON, and give its exit code.

    Args:
        path: as of :func:`append_rows`, like ``make``, ``names`` and ``workers``.
        make: row of a case by its name.
        names: of the cases.
        workers: processes.
        summary: of all rows of ``names``.
    """
    try:
        rows = append_rows(path, make, names, workers)
    except KeyboardInterrupt:
        print("interrupted; the same call goes on with the rest", file=sys.stderr)
        return 130
    print(json.dumps(summary(list(rows.values())), indent=2))
    return 0


def _made(make: Callable[[str], Row], todo: Sequence[str], workers: int) -> Iterator[Row]:
    if workers <= 1:
        yield from map(make, todo)
        return
    context = multiprocessing.get_context("spawn")
    with context.Pool(workers, initializer=_leave_interrupts_to_the_parent) as pool:
        yield from pool.imap_unordered(make, todo)


def _leave_interrupts_to_the_parent() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def cpu_seconds() -> float:
    """CPU time of this process and of its forks that have ended [s]."""
    spent = [resource.getrusage(w) for w in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(usage.ru_utime + usage.ru_stime for usage in spent)
