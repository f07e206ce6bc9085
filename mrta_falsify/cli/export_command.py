"""The command that writes worlds and runs for other systems."""

from __future__ import annotations

from pathlib import Path

import click

from mrta_falsify.cli import output
from mrta_falsify.cli.door import ExitCode
from mrta_falsify.cli.options import FILE, stack_options
from mrta_falsify.cli.run_commands import main

KINDS = ("nav2", "sdf", "mrta-sim", "mcap", "gif", "mp4")


@main.command()
@click.argument("target", metavar="WORLD|DIR")
@click.argument("name", metavar="[ID]", required=False)
@click.option("--format", "kind", type=click.Choice(KINDS), required=True)
@stack_options
@click.option(
    "-o",
    "--output",
    "path",
    type=FILE,
    required=True,
    metavar="PATH",
    help="nav2: NAME.yaml, or a directory; mrta-sim: a directory; the others: a file.",
)
def export(
    target: str,
    name: str | None,
    kind: str,
    stack: Path | None,
    settings: tuple[str, ...],
    path: Path,
) -> int:
    """Write a world, or a trial of a campaign, for another system.

    nav2 is the costmap as Nav2 map, sdf a Gazebo world, mrta-sim all of MRTA-Sim's input files,
    mcap a run with ROS 2 messages for Foxglove, gif and mp4 an animation. A WORLD is run first
    where a run is asked for.
    """
    from mrta_falsify.verbs import export as exporting
    from mrta_falsify.verbs import run as app

    if name is not None:
        if stack or settings:
            raise click.UsageError("--stack and --set belong to a WORLD; a trial has its own stack")
        subject = exporting.subject_of_trial(
            Path(target), name, with_trace=kind in exporting.OF_RUNS
        )
    else:
        subject = exporting.subject_of_world(target, app.load_stack(stack, settings))
        if kind in exporting.OF_RUNS:
            output.say(f"running {subject.world.name}")
    for written in exporting.export(subject, kind, path):
        click.echo(str(written))
    return ExitCode.DONE
