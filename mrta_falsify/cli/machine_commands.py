"""The commands about this machine and what is installed: bench, plugins, doctor."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from mrta_falsify.cli import output
from mrta_falsify.cli.exits import ExitCode
from mrta_falsify.cli.group import main
from mrta_falsify.cli.names import component
from mrta_falsify.cli.options import (
    FILE,
    Command,
    FiniteRange,
    Listing,
    format_option,
    stack_options,
)

MAX_ROBOTS = 1000  # in a fleet
MAX_WIDE = 22  # columns of the names of figures


def _fleet_size(text: str) -> int:
    size = int(text)
    if not 1 <= size <= MAX_ROBOTS:
        raise ValueError(text)
    return size


def fleets_option(default: str, text: str) -> Callable[[Command], Command]:
    """Add ``--robots N,N,...``, sizes of fleets."""
    return click.option(
        "--robots",
        type=Listing(_fleet_size, f"numbers from 1 to {MAX_ROBOTS}, as 2,4,6"),
        default=default,
        show_default=True,
        metavar="N,N,...",
        help=text,
    )


@main.command("bench")
@fleets_option("6,24,50,100,200", "Sizes of the fleets, for example 6,24.")
@click.option(
    "--seconds",
    type=FiniteRange(min=10.0),
    default=60.0,
    show_default=True,
    metavar="SECONDS",
    help="Simulated time for each fleet [s].",
)
@click.option(
    "--engine",
    "engines",
    type=component("engine"),
    multiple=True,
    default=("bullet", "kinematic"),
    show_default=True,
    metavar="NAME",
    help="Further engine to run the fleets on, beside the stack's own. Repeatable.",
)
@stack_options
@format_option
def bench_command(
    robots: tuple[int, ...],
    seconds: float,
    engines: tuple[str, ...],
    stack: str | None,
    settings: tuple[str, ...],
    style: str,
) -> int:
    """Measure the speed of every layer on this machine, on one core."""
    from mrta_falsify.commands.bench.benchmark import bench, step_count
    from mrta_falsify.commands.stacks import load_stack
    from mrta_falsify.core import codec

    config = load_stack(stack, settings)
    with output.progress("bench", step_count(robots, engines, config), "steps") as on_progress:
        speeds = bench(
            robots=robots,
            seconds=seconds,
            engines=engines,
            stack=config,
            on_progress=on_progress,
        )
    if style == "json":
        output.print_json(speeds)
    else:
        _print_figures(codec.encode(speeds))
    return ExitCode.DONE


def _print_figures(data: dict[str, Any], indent: str = "") -> None:
    """Print measured figures, one a line."""
    for name, value in data.items():
        if isinstance(value, dict):
            click.echo(f"{indent}{name}")
            _print_figures(value, indent + "  ")
        else:
            click.echo(f"{indent}{name:{MAX_WIDE}} {value}")


@main.command("plugins")
@click.option(
    "--schemas",
    type=FILE,
    metavar="DIR",
    help=(
        "Directory for JSON Schemas of stack, project, floor, tasks and world files, with "
        "which editors complete and check them."
    ),
)
@format_option
def plugins_command(schemas: Path | None, style: str) -> int:
    """List the components of every extension point, and the planted defects."""
    from mrta_falsify.commands.plugins import plugins
    from mrta_falsify.core.defects import defect

    found = plugins(schemas)
    written = {"schemas": found.schemas} if found.schemas else {}
    if style == "json":
        output.print_json({**found.components, "defects": found.defects, **written})
        return ExitCode.DONE
    if written:
        click.echo("\n".join(map(str, found.schemas)))
        return ExitCode.DONE
    table = output.new_table("extension point", "components")
    for point, names in found.components.items():
        table.add_row(point, ", ".join(names) or "(none)")
    output.print_table(table)
    click.echo()
    click.echo("planted defects, switched on by --set defects=[name]:")
    table = output.new_table("defect", "what it does", headings=False)
    for name in found.defects:
        planted = defect(name)
        table.add_row(name, f"{planted.layer}: {planted.what}")
    output.print_table(table)
    return ExitCode.DONE


@main.command("doctor")
@format_option
def doctor_command(style: str) -> int:
    """Check this machine: Python, libraries, compiled-code cache, determinism, extras."""
    from mrta_falsify.commands.doctor import doctor, is_healthy

    output.say("looking at libraries and plug-ins; two short runs take a minute or two")
    checks = doctor()
    if style == "json":
        output.print_json({"ok": is_healthy(checks), "checks": checks})
    else:
        styles = {"ok": "green", "missing": "yellow", "failed": "red"}
        table = output.new_table("state", "what", "detail", headings=False)
        for check in checks:
            table.add_row(check.state, check.name, check.detail, style=styles[check.state])
        output.print_table(table)
    return ExitCode.DONE if is_healthy(checks) else ExitCode.HARNESS


@main.command("stack-test")
@click.argument("command", metavar="CMD|FILE")
@fleets_option("6,24,100", "Sizes of the fleets whose ticks are timed, for example 6,24,100.")
@format_option
def stack_test_command(command: str, robots: tuple[int, ...], style: str) -> int:
    """Test a foreign stack: protocol, determinism, copies, speed.

    CMD starts it, as in `--stack 'exec:CMD'`; FILE is a YAML file with `stack:`.
    """
    from mrta_falsify.commands.stack_test.testing import stack_test, steps
    from mrta_falsify.core import codec

    with output.progress("stack-test", steps(robots), "steps") as on_progress:
        report = stack_test(command, robots=robots, on_progress=on_progress)
    if style == "json":
        output.print_json({"passed": report.passed, **codec.encode(report)})
        return ExitCode.DONE if report.passed else ExitCode.VIOLATED
    version = f" {report.version}" if report.version else ""
    says, can = (", ".join(names) or "nothing" for names in (report.says, report.can))
    click.echo(f"{report.name}{version}; says {says}; can {can}")
    styles = {"ok": "green", "skipped": "yellow", "failed": "red"}
    table = output.new_table("outcome", "check", "what was found")
    for check in report.checks:
        table.add_row(check.outcome, check.name, check.text, style=styles[check.outcome])
    output.print_table(table)
    if report.ticks:
        table = output.new_table("robots", "a tick, p50", "p95", "answer")
        for tick in report.ticks:
            p50, p95 = f"{tick.p50_us:.0f} us", f"{tick.p95_us:.0f} us"
            table.add_row(str(tick.robots), p50, p95, f"{tick.message_bytes} bytes")
        output.print_table(table)
    return ExitCode.DONE if report.passed else ExitCode.VIOLATED
