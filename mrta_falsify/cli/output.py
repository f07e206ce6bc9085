"""What commands print: text or one JSON object on stdout, progress on stderr."""

from __future__ import annotations

import contextlib
import itertools
import json
import os
import sys
import time
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import click

from mrta_falsify.core import codec
from mrta_falsify.core.interruption import Interrupted

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

FIRST_LINE = 10.0  # s of work before a pipe gets its first line of progress
NEXT_LINE = 30.0  # s between two such lines
LONG = 1000  # rows of a table from which on its columns are not fitted
UNBOUNDED = 100_000  # columns, more than any table has
LEAST_DONE = 0.01  # of all, after which the rate to date says how long the rest takes


def print_json(value: Any) -> None:
    """Print a value as one JSON object; NaN and infinity, which JSON cannot say, become null."""
    click.echo(json.dumps(codec.finite(codec.encode(value)), allow_nan=False))


@dataclass(frozen=True, slots=True, kw_only=True)
class InterruptionData:
    """What ``--format json`` prints of a command that was interrupted."""

    interrupted: bool
    kept: str  #: in words
    missing: str  #: in words, with how to go on


def interruption_data(error: KeyboardInterrupt) -> InterruptionData:
    """Describe an interruption."""
    if isinstance(error, Interrupted):
        return InterruptionData(interrupted=True, kept=error.kept, missing=error.missing)
    return InterruptionData(interrupted=True, kept="", missing="")


def stdout() -> Console:
    """Open a console on stdout; no markup, so that names in brackets print as they are."""
    from rich.console import Console

    return Console(highlight=False, markup=False, emoji=False, soft_wrap=True)


def say(text: str) -> None:
    """Print a line of progress on stderr."""
    click.echo(text, err=True)


# --- tables ----------------------------------------------------------------------------------


def new_table(
    *columns: str,
    right: Collection[str] = (),
    whole: Collection[str] = (),
    headings: bool = True,
) -> Table:
    """Make a table without lines; text that is too long for its column goes on below.

    Args:
        columns: headings.
        right: those of columns of numbers, which are never broken.
        whole: those of other columns that are never broken.
        headings: whether to print them.
    """
    from rich.table import Table

    table = Table(
        box=None, pad_edge=False, show_edge=False, header_style="bold", show_header=headings
    )
    for name in columns:
        table.add_column(
            name,
            justify="right" if name in right else "left",
            no_wrap=name in whole or name in right,
            overflow="fold",
        )
    return table


def print_table(table: Table) -> None:
    """Print a table on stdout, as wide as the terminal or COLUMNS; in a pipe as wide as it is.

    A long one is as wide as it is everywhere: to fit its columns takes milliseconds a row.
    """
    from rich.console import Console

    console = Console(highlight=False, markup=False, emoji=False)
    if table.row_count > LONG:
        for line, style in _plain_lines(table):
            click.echo(click.style(line, fg=style))
        return
    if not console.is_terminal and "COLUMNS" not in os.environ:
        unbounded = console.options.update(max_width=UNBOUNDED)
        console.width = console.measure(table, options=unbounded).maximum
    console.print(table)


def _plain_lines(table: Table) -> Iterator[tuple[str, str | None]]:
    """Yield the lines of a table, each with its colour; no cell is broken."""
    from rich.cells import cell_len
    from rich.control import strip_control_codes

    columns = [
        [strip_control_codes(" ".join(str(cell).split("\n"))) for cell in column.cells]
        for column in table.columns
    ]
    headings = [str(column.header) for column in table.columns]
    widths = [
        max(map(cell_len, (name, *cells))) for name, cells in zip(headings, columns, strict=True)
    ]
    is_right = [column.justify == "right" for column in table.columns]
    styles = [None, *(row.style for row in table.rows)]
    rows = zip((headings, *zip(*columns, strict=True)), styles, strict=True)
    for cells, style in itertools.islice(rows, 0 if table.show_header else 1, None):
        parts = []
        for cell, width, right in zip(cells, widths, is_right, strict=True):
            pad = " " * (width - cell_len(cell))
            parts.append(pad + cell if right else cell + pad)
        yield " ".join(parts).rstrip(), str(style) if style else None


# --- progress --------------------------------------------------------------------------------


class OnProgress(Protocol):
    """A function that shows progress."""

    def __call__(self, done: float, total: float | None = None, /) -> None:
        """Take how far work is, and how much there will be if that is known better by now."""


@contextlib.contextmanager
def progress(
    what: str, total: float, unit: str, *, is_most: bool = False, first_apart: bool = False
) -> Iterator[OnProgress]:
    """Show how far work is on stderr: a bar on terminals, a line now and then elsewhere.

    Args:
        what: is done.
        total: of it, in ``unit``.
        unit: of the total.
        is_most: work may well end before the total, so the time left is an upper bound.
        first_apart: what is done first says nothing of how long the rest takes.

    Yields:
        A function that takes how far the work is, in ``unit``.
    """
    if not sys.stderr.isatty():
        yield PipedProgress(what, total, unit, is_most=is_most, first_apart=first_apart).show
        return
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    columns = (
        TextColumn("{task.description}"),
        BarColumn(bar_width=20),
        TextColumn(f"{{task.completed:.0f}}/{{task.total:.0f}} {unit}"),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(what, total=total)
        yield lambda done, total=None: bar.update(task, completed=done, total=total)


class PipedProgress:
    """Lines of progress on a stderr that is not a terminal; none for work that ends soon."""

    def __init__(
        self,
        what: str,
        total: float,
        unit: str,
        *,
        is_most: bool = False,
        first_apart: bool = False,
    ) -> None:
        self._what, self._total, self._unit, self._is_most = what, total, unit, is_most
        self._is_first, self._before = first_apart, 0.0  #: done before the time was taken
        self._begin()

    def _begin(self) -> None:
        self._began = time.monotonic()
        self._next = self._began + FIRST_LINE

    def show(self, done: float, total: float | None = None, /) -> None:
        """Print a line if the last one is long ago."""
        self._total = self._total if total is None else total
        if self._is_first:
            self._is_first, self._before = False, done
            self._begin()
        now = time.monotonic()
        if now < self._next:
            return
        self._next = now + NEXT_LINE
        rest, of_rest = done - self._before, self._total - self._before
        left = time_left(rest, of_rest, now - self._began, is_most=self._is_most)
        say(f"{self._what}: {done:.0f}/{self._total:.0f} {self._unit}{left}")


def time_left(done: float, total: float, spent: float, *, is_most: bool = False) -> str:
    """Say how long work will still take, from the time spent on what is done; empty if unknown."""
    if not LEAST_DONE * total <= done < total or done <= 0.0:
        return ""
    left = time_text(spent * (total - done) / done)
    return f", at most {left} left" if is_most else f", about {left} left"


def time_text(seconds: float) -> str:
    """Say a time in the unit that suits it."""
    if seconds < 90.0:
        return f"{seconds:.0f} s"
    return f"{seconds / 60.0:.0f} min" if seconds < 5400.0 else f"{seconds / 3600.0:.1f} h"


def say_cost(
    runs: int, each: float, *, copies: bool = False, expected: int = 0, at_end: int = 0
) -> None:
    """Say what work may take before it begins; nothing of work that ends soon.

    Args:
        runs: at most.
        each: wall clock of the run that is repeated [s].
        copies: all runs but the first are copies of it, which end once they are decided. Then the
            time of the whole is not known before some have been run.
        expected: runs that it should take; 0: not known.
        at_end: of the runs, those that only judge the result.
    """
    if runs * each <= FIRST_LINE:
        return
    if copies:
        first = f"the trial again, about {time_text(each)}"
        say(
            f"{first}, then at most {runs - 1} further runs; the time left is shown once some have "
            "ended"
        )
        return
    likely = f"about {expected} runs, " if 0 < expected < runs else ""
    time_said = time_text((expected if likely else runs) * each)
    beside = f" ({at_end} of them judge the result)" if at_end else ""
    say(f"{likely}at most {runs}{beside}, of about {each:.1f} s each: {time_said} on one core")


def print_files(directory: Path) -> None:
    """Print the files of an output directory on stderr."""
    for path in sorted(directory.iterdir()):
        say(f"wrote {path}")
