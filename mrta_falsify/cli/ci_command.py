"""The command ``ci``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from mrta_falsify.cli import output
from mrta_falsify.cli.exits import ExitCode
from mrta_falsify.cli.group import main
from mrta_falsify.cli.options import (
    FILE,
    format_option,
    output_option,
    trust_option,
    workers_option,
)


@main.command("ci")
@click.argument("project", type=FILE, default="mrta-falsify.yaml")
@click.option(
    "--all",
    "everything",
    is_flag=True,
    help="Run unchanged scenarios, corpora and stacks as well.",
)
@click.option(
    "--fail-on",
    type=click.Choice(["any", "new"]),
    default="any",
    show_default=True,
    help="Failures that give exit code 1: `any` that fails now, or only `new` ones.",
)
@output_option(
    "FILE.html", ("Path of the report page; default: report.html in the project's own folder.")
)
@click.option(
    "--junit", type=FILE, metavar="FILE.xml", help="Path of a JUnit XML file to write as well."
)
@click.option(
    "--markdown", type=FILE, metavar="FILE.md", help="Path of a Markdown file to write as well."
)
@click.option("--open", "opens", is_flag=True, help="Open the page in the browser.")
@workers_option
@trust_option
@format_option
def ci_command(project: Path, fail_on: str, opens: bool, style: str, **options: Any) -> int:
    """Run everything that changed since the last run of PROJECT; list new and resolved failures.

    PROJECT is a file with scenarios, stacks and a corpus (default: mrta-falsify.yaml). Unchanged
    parts are not run. Exit code 1 if something fails.
    """
    from mrta_falsify.commands.ci.command import PAGE_NAME, ci
    from mrta_falsify.commands.ci.project import read_project
    from mrta_falsify.commands.ci.reporting import command_of, done_text, headline_of
    from mrta_falsify.core import codec

    read = read_project(project)
    result = ci(project, on_cell=lambda cell: output.say(_beginning(cell)), **options)
    page = options["output"] or read.kept / PAGE_NAME
    if style == "json":
        counts = {kind: result.count(kind) for kind in ("new", "ongoing", "flaky", "resolved")}
        output.print_json({**counts, **codec.encode(result), "page": page})
    else:
        out = output.stdout()
        for cell in result.cells:
            out.print(f"{cell.name}: {done_text(cell)}")
        for change in result.changes:
            back = " (came back)" if change.came_back else ""
            out.print(f"{change.kind}{back}: {change.cell}: {change.sentence}")
            if change.kind != "resolved":
                out.print(f"    {command_of(read, change)}")
        out.print(headline_of(result))
        out.print(f"report  {page}")
    if opens:
        click.launch(str(page))
    fails = result.fails if fail_on == "any" else bool(result.count("new"))
    return ExitCode.VIOLATED if fails else ExitCode.DONE


def _beginning(cell: Any) -> str:
    if not cell.changed:
        return f"{cell.name}: nothing has changed"
    return f"{cell.name}: runs (changed: {', '.join(cell.changed)})"
