"""The command ``issue``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from mrta_falsify.cli import output as printing
from mrta_falsify.cli.exits import ExitCode
from mrta_falsify.cli.group import main
from mrta_falsify.cli.options import (
    format_option,
    output_option,
    run_option,
    trial_arguments,
    trust_option,
)

if TYPE_CHECKING:
    from mrta_falsify.campaigns.foreign import Trust


@main.command("issue")
@trial_arguments
@output_option("DIR", "Directory for the issue and its files; default: `issue` beside the trial.")
@run_option("Run the trial again if its world or trace was not kept, and keep it.")
@trust_option
@format_option
def issue_command(
    directory: Path, id: str, output: Path | None, run: bool, trust: Trust, style: str
) -> int:
    """Write a failure as an issue for a tracker, in Markdown, with world, pictures and commands.

    What happened in two sentences, the world (the smallest one after `minimize`), commands,
    versions, a picture and a GIF; the scene for Nav2, MRTA-Sim and Open-RMF.
    """
    from mrta_falsify.commands.issue import issue

    found = issue(directory, id, output, run=run, trust=trust)
    if style == "json":
        printing.print_json(found)
        return ExitCode.DONE
    for path in found.files:
        printing.say(f"wrote {path}")
    click.echo(str(found.text))
    return ExitCode.DONE
