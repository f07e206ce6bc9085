"""The command ``export``."""

from __future__ import annotations

from typing import Any

import click

from mrta_falsify.cli import output
from mrta_falsify.cli.exits import ExitCode
from mrta_falsify.cli.group import main
from mrta_falsify.cli.names import component
from mrta_falsify.cli.options import output_option, run_option, stack_options, trust_option


@main.command("export")
@click.argument("target", metavar="WORLD|DIR")
@click.argument("id", metavar="[ID]", required=False)
@click.option(
    "--format",
    type=component("exporter"),
    metavar="NAME",
    required=True,
    help="Format to write: nav2, sdf, mrta-sim, open-rmf, mcap, gif, mp4, or another that "
    "`plugins` lists.",
)
@stack_options
@output_option(
    "PATH",
    "Path to write: NAME.yaml or a directory for nav2, a directory for mrta-sim and open-rmf, "
    "a file for the others.",
    required=True,
)
@run_option("Run the trial again if its world or trace was not kept, and keep it.")
@trust_option
def export_command(target: str, id: str | None, **options: Any) -> int:
    """Write a world, or a trial of a campaign, for another system.

    nav2 is the costmap as Nav2 map, sdf a Gazebo world, mrta-sim all of MRTA-Sim's input files,
    open-rmf a building map and a script that dispatches the tasks, mcap a run with ROS 2 messages
    for Foxglove, gif and mp4 an animation. A WORLD is run first where a run is asked for.
    """
    if id is None and (options["run"] or options["trust"]):
        raise click.UsageError("--run and --trust belong to a trial of a campaign")
    if id is not None and (options["stack"] or options["settings"]):
        raise click.UsageError("--stack and --set belong to a WORLD; a trial has its own stack")
    from mrta_falsify.core import registry

    kinds = registry.names("exporter")
    if options["format"] not in kinds and ":" not in options["format"]:
        raise click.UsageError(f"{options['format']!r} is not one of {', '.join(kinds)}")
    from mrta_falsify.commands.export import export, exporter_named

    if id is None and exporter_named(options["format"]).of_run:
        output.say(f"running {target}")
    for written in export(target, id, **options):
        click.echo(str(written))
    return ExitCode.DONE
