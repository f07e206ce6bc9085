"""The command ``report``."""

from __future__ import annotations

import webbrowser
from pathlib import Path
from typing import Any

import click

from mrta_falsify.cli import output
from mrta_falsify.cli.exits import ExitCode
from mrta_falsify.cli.group import main
from mrta_falsify.cli.options import (
    FILE,
    FiniteRange,
    count_option,
    output_option,
    run_option,
    trust_option,
)


@main.command("report")
@click.argument("directory", type=FILE)
@output_option("FILE.html", "Path of the page; default: DIR/report.html.")
@click.option(
    "--junit", type=FILE, metavar="FILE.xml", help="Path of a JUnit XML file to write as well."
)
@click.option(
    "--markdown", type=FILE, metavar="FILE.md", help="Path of a Markdown file to write as well."
)
@click.option(
    "--against",
    type=FILE,
    metavar="DIR2",
    help="Directory of a campaign on another stack to compare with.",
)
@count_option(
    "--cases",
    1,
    1000,
    default=20,
    text=(
        "Largest number of failures to show in full; those that do not fit on the page become "
        "files beside it."
    ),
)
@click.option(
    "--beside",
    is_flag=True,
    help="Run the nearest passing trial of each mode again and show it beside the failure.",
)
@run_option("Run failures again whose worlds or traces were not kept.")
@trust_option
@click.option(
    "--watch",
    type=FiniteRange(0.5, 3600.0),
    metavar="SECONDS",
    help="Shortest time between rewrites of the page while the campaign runs [s], for example 5.",
)
@click.option("--open", "opens", is_flag=True, help="Open the page in the browser.")
def report_command(directory: Path, watch: float | None, opens: bool, **options: Any) -> int:
    """Write the failure report of a campaign: one HTML file that opens from disk.

    Shows what is stored, also what `replay --verify`, `explain` and `minimize` have found.
    """
    from mrta_falsify.commands.report.writing import watch_reports, write_reports

    written = watch_reports(directory, seconds=watch, **options) if watch else None
    files = next(written) if written else write_reports(directory, **options)
    for file in files:
        click.echo(str(file))
    if opens and not webbrowser.open(files[0].resolve().as_uri()):
        output.say(f"no browser was found; open {files[0]} yourself")
    for _ in written or ():
        output.say(f"written again: {files[0]}")
    return ExitCode.DONE
