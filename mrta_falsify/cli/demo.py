"""The main job in miniature."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from mrta_falsify.cli import campaign_commands, output
from mrta_falsify.cli.door import ExitCode
from mrta_falsify.cli.options import FILE, stack_options
from mrta_falsify.cli.run_commands import main

if TYPE_CHECKING:
    from mrta_falsify.verbs.campaign import Result

FIXED_WORLD = "aws_hospital_day"
SCENARIO = "hospital_day"
#: a fault of a published system, switched on, in a scenario that brings it out
PLANTED, PLANTED_SCENARIO = "same_room_twice_stalls", "burst_of_tasks"
TRIALS = 8  # of the default stack
PLANTED_TRIALS = 12  # at most


@main.command()
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True)
@stack_options
@click.option(
    "-o",
    "--output",
    "directory",
    type=FILE,
    metavar="DIR",
    default=Path("demo-run"),
    show_default=True,
)
def demo(seed: int, stack: Path | None, settings: tuple[str, ...], directory: Path) -> int:
    """The main job in miniature on the AWS hospital; the last line is the report's path.

    First one day in PyBullet: six robots, eight people, the stream testcase_6agents_3_3, with
    verdicts and a picture. Then a short campaign on sampled days: it shows the first violation
    found, or says that none was. Last, labelled as such, the same search on a stack with a planted
    fault.
    """
    from mrta_falsify.verbs import report as reporting
    from mrta_falsify.verbs import run as app

    config = app.load_stack(stack, settings)
    app.make_directory(directory)
    click.echo(f"1. One day in PyBullet ({FIXED_WORLD}, seed {seed})")
    if not _one_day(seed, config, directory / "day"):
        return ExitCode.INTERRUPTED
    click.echo()
    click.echo(f"2. A campaign on sampled days ({SCENARIO}, seed {seed}, {TRIALS} trials)")
    result = _search(SCENARIO, seed, config, directory / "campaign", TRIALS)
    if result is None:
        return ExitCode.INTERRUPTED
    report = reporting.write_report(result.campaign, directory / "report.html")
    click.echo()
    click.echo(f"3. An example with a planted fault ({PLANTED}, {PLANTED_SCENARIO}, seed {seed})")
    faulty = app.load_stack(stack, (*settings, f"defects=[{PLANTED}]"))
    planted = _search(
        PLANTED_SCENARIO, seed, faulty, directory / "planted", PLANTED_TRIALS, stop_after=1
    )
    if planted is None:
        return ExitCode.INTERRUPTED
    page = reporting.write_report(planted.campaign, directory / "planted.html")
    click.echo()
    click.echo(f"report of the planted example: {page.resolve()}")
    click.echo("report of the campaign:")
    click.echo(str(report.resolve()))
    return ExitCode.DONE


def _one_day(seed: int, config: Any, directory: Path) -> bool:
    from mrta_falsify.verbs import run as app

    world = app.find_world(FIXED_WORLD, seed=seed)
    click.echo(f"{len(world.robots)} robots, {len(world.humans)} people, {len(world.tasks)} tasks")
    with output.progress(world.name, world.horizon, "s simulated") as report_progress:
        outcome = app.run(world, config, on_progress=report_progress)
    output.print_summary(app.summary(outcome))
    files = app.write_run(outcome, world, directory, config=config)
    click.echo(f"picture  {files.picture}")
    replay = ["mrta-falsify", "run", str(files.world), "--stack", str(files.stack)]
    click.echo(f"replay   {shlex.join(replay)}")
    return outcome.ended != "interrupted"


def _search(
    scenario: str,
    seed: int,
    config: Any,
    directory: Path,
    budget: int,
    *,
    stop_after: int = 0,
) -> Result | None:
    """A campaign, begun or gone on with; None after Ctrl-C."""
    from mrta_falsify.campaigns.settings import Limits
    from mrta_falsify.verbs import campaign as campaigns

    chosen = campaigns.new_settings(
        scenario, directory=directory, config=config, seed=seed, screen=True
    )
    with campaigns.open_store(directory, chosen) as store:
        limits = Limits(budget=budget, stop_after=stop_after)
        with campaign_commands.live(directory, budget) as (on_record, on_told):
            result = campaigns.run(
                store, limits, campaigns.local_workers(2), on_record=on_record, on_told=on_told
            )
    if result.ended == "interrupted":
        return None
    campaign_commands.print_summary(campaigns.summary(result))
    return result
