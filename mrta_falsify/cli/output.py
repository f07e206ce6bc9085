"""What commands print: text or one JSON object on stdout, progress on stderr."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from mrta_falsify.core import registry
from mrta_falsify.core.defects import DEFECTS

if TYPE_CHECKING:
    from mrta_falsify.verbs.doctor import Check

FORMATS = ("text", "json")


def print_json(data: Any) -> None:
    """One JSON object on stdout; strict JSON, so NaN and infinity are refused."""
    click.echo(json.dumps(data, allow_nan=False))


def stdout() -> Console:
    """Console of stdout; no markup, so that names in brackets print as they are."""
    return Console(highlight=False, markup=False, emoji=False, soft_wrap=True)


def say(text: str) -> None:
    """A line of progress on stderr."""
    click.echo(text, err=True)


@contextlib.contextmanager
def progress(what: str, total: float, unit: str) -> Iterator[Callable[[float], None]]:
    """Progress bar on stderr; silent where stderr is no terminal.

    Yields:
        A function that takes how far the work is, in ``unit``.
    """
    console = Console(stderr=True)
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn(f"{{task.completed:.0f}}/{{task.total:.0f}} {unit}"),
        TimeElapsedColumn(),
    )
    with Progress(
        *columns, console=console, transient=True, disable=not console.is_terminal
    ) as bar:
        task = bar.add_task(what, total=total)
        yield lambda done: bar.update(task, completed=done)


def print_summary(data: dict[str, Any]) -> None:
    """The result of a run as text."""
    out = stdout()
    tasks = data["tasks"]
    contacts = ", ".join(
        f"{count} {kind.replace('_', '-')}" for kind, count in data["contacts"].items() if count
    )
    out.print(
        f"tasks      {tasks['completed']} of {tasks['total']} done, {tasks['late']} late or missing"
    )
    out.print(f"robots     {data['robots_finished']} of {data['robots']} finished their work")
    out.print(f"contacts   {contacts or 'none'}")
    out.print(
        f"time       {data['sim_time_s']:.1f} s simulated in {data['wall_s']:.1f} s "
        f"({data['real_time_factor']:.1f}x real time), ended: {data['ended']}"
    )
    out.print(f"digests    world {data['world_digest'][:16]}  trace {data['trace_digest'][:16]}")
    out.print()
    table = Table(box=None, pad_edge=False, show_edge=False, header_style="bold")
    table.add_column("specification")
    table.add_column("verdict")
    table.add_column("robustness", justify="right")
    table.add_column("at", justify="right")
    table.add_column("who")
    for verdict in data["verdicts"]:
        broken = verdict["violated"]
        rho, at = verdict["robustness"], verdict["violated_at_s"]
        table.add_row(
            verdict["spec"],
            "violated" if broken else "holds",
            "unbounded" if rho is None else f"{rho:+.3g}",
            "" if at is None else f"{at:.2f} s",
            ", ".join(verdict["who"]),
            style="red" if broken else None,
        )
    out.print(table)


def print_files(directory: Path) -> None:
    """The files of an output directory, on stderr."""
    for path in sorted(directory.iterdir()):
        say(f"wrote {path}")


def print_plugins() -> None:
    """Every extension point with its components, and the planted defects."""
    out = stdout()
    for point in registry.EXTENSION_POINTS:
        out.print(f"{point:20} {', '.join(registry.names(point)) or '(none)'}")
    out.print()
    out.print("planted defects, switched on by --set defects=[name]:")
    for name, defect in sorted(DEFECTS.items()):
        out.print(f"  {name:30} {defect.layer}: {defect.what}")


def print_checks(checks: Sequence[Check]) -> None:
    """One line per check of ``doctor``."""
    out = stdout()
    for check in checks:
        style = {"ok": "green", "missing": "yellow", "failed": "red"}[check.state]
        out.print(f"{check.state:8} {check.name:24} {check.detail}", style=style)


def print_bench(data: dict[str, Any], indent: str = "") -> None:
    """Measured figures, one a line."""
    for name, value in data.items():
        if isinstance(value, dict):
            click.echo(f"{indent}{name}")
            print_bench(value, indent + "  ")
        else:
            click.echo(f"{indent}{name:22} {value}")
