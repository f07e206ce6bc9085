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
@output_option("FILE.html", "Default: DIR/report.html.")
@click.option("--junit", type=FILE, metavar="FILE.xml", help="Also as JUnit XML.")
@click.option("--markdown", type=FILE, metavar="FILE.md", help="Also as Markdown.")
@click.option(
    "--against", type=FILE, metavar="DIR2", help="Compare with a campaign on another stack."
)
@count_option(
    "--cases",
    1,
    1000,
    default=20,
    text="Failures to show in full at most; those without room on the page are files beside it.",
)
@click.option(
    "--beside",
    is_flag=True,
    help="Run the nearest passing trial of each mode again, and show it beside the failure.",
)
@run_option("Make the worlds and traces of failures again that were not kept.")
@trust_option
@click.option(
    "--watch",
    type=FiniteRange(0.5, 3600.0),
    metavar="SECONDS",
    help="Write the page again while the campaign runs, at most this often, as 5.",
)
@click.option("--open", "opens", is_flag=True, help="Open the page in the browser.")
def report_command(directory: Path, watch: float | None, opens: bool, **options: Any) -> int:
    """Write the failure report of a campaign: one HTML file that opens from disk.

    Shows what is stored, also what `replay --verify`, `explain` and `minimize` have found.
    """
    from mrta_falsify.verbs.stored_failures import watch_reports, write_reports

    written = watch_reports(directory, seconds=watch, **options) if watch else None
    files = next(written) if written else write_reports(directory, **options)
    for file in files:
        click.echo(str(file))
    if opens and not webbrowser.open(files[0].resolve().as_uri()):
        output.say(f"no browser was found; open {files[0]} yourself")
    for _ in written or ():
        output.say(f"written again: {files[0]}")
    return ExitCode.DONE
