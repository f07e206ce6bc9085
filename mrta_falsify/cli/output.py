"""What commands print: text or one JSON object on stdout, progress on stderr."""

from __future__ import annotations

import contextlib
import json
import sys
import time
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from mrta_falsify.core import codec
from mrta_falsify.core.interruption import Interrupted

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

FIRST_LINE = 10.0  # s of work before a pipe gets its first line of progress
NEXT_LINE = 30.0  # s between two such lines
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
    """Print a table on stdout, as wide as the terminal; 80 columns wide in a pipe."""
    from rich.console import Console

    Console(highlight=False, markup=False, emoji=False).print(table)


# --- progress --------------------------------------------------------------------------------


@contextlib.contextmanager
def progress(what: str, total: float, unit: str) -> Iterator[Callable[[float], None]]:
    """Show how far work is on stderr: a bar on terminals, a line now and then elsewhere.

    Yields:
        A function that takes how far the work is, in ``unit``.
    """
    if not sys.stderr.isatty():
        yield PipedProgress(what, total, unit).show
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
        yield lambda done: bar.update(task, completed=done)


class PipedProgress:
    """Lines of progress on a stderr that is not a terminal; none for work that ends soon."""

    def __init__(self, what: str, total: float, unit: str) -> None:
        self._what, self._total, self._unit = what, total, unit
        self._began = time.monotonic()
        self._next = self._began + FIRST_LINE

    def show(self, done: float) -> None:
        """Print a line if the last one is long ago."""
        now = time.monotonic()
        if now < self._next:
            return
        self._next = now + NEXT_LINE
        left = time_left(done, self._total, now - self._began)
        say(f"{self._what}: {done:.0f}/{self._total:.0f} {self._unit}{left}")


def say_cost(what: str, runs: int, each: float) -> None:
    """Say on stderr what work costs at most, before it begins.

    Args:
        what: is done.
        runs: at most.
        each: what the run took that they repeat [s]; 0: that is not known.
    """
    if each <= 0.0:
        say(f"{what}: at most {runs} runs")
        return
    say(
        f"{what}: at most {runs} runs like one of {each:.1f} s, so {_duration(runs * each)} at most"
    )


def time_left(done: float, total: float, spent: float) -> str:
    """Say how long work will still take, from the time spent on what is done; empty if unknown."""
    if not LEAST_DONE * total <= done < total or done <= 0.0:
        return ""
    return f", about {_duration(spent * (total - done) / done)} left"


def _duration(seconds: float) -> str:
    return f"{seconds:.0f} s" if seconds < 90.0 else f"{seconds / 60.0:.0f} min"


def print_files(directory: Path) -> None:
    """Print the files of an output directory on stderr."""
    for path in sorted(directory.iterdir()):
        say(f"wrote {path}")
