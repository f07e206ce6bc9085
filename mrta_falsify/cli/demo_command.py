"""The command ``demo``."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING

import click

from mrta_falsify.cli import output
from mrta_falsify.cli.campaign_output import CampaignWatch, print_campaign, say_interrupted
from mrta_falsify.cli.exits import ExitCode
from mrta_falsify.cli.group import main
from mrta_falsify.cli.options import output_option, seed_option, stack_options
from mrta_falsify.cli.run_commands import print_run

if TYPE_CHECKING:
    from mrta_falsify.core.config import StackConfig


@main.command("demo")
@seed_option("Seed of the day and of both campaigns.")
@stack_options
@output_option("DIR", "Directory of the day and both campaigns.", default=Path("demo-run"))
def demo_command(seed: int, stack: str | None, settings: tuple[str, ...], **options: Path) -> int:
    """Show the main job in miniature on the AWS hospital; the last line is the report's path.

    First, one day in PyBullet: six robots, eight people, the stream testcase_6agents_3_3, with
    verdicts and a picture. Second, a short campaign on sampled days up to its first violation.
    Third, labelled as such, an example that deadlocks: robots meet head-on under a controller in
    which each takes half of every evasion. The report shows the campaign if it found a violation,
    else the example.
    """
    from mrta_falsify.commands import demo
    from mrta_falsify.commands.folders import make_directory
    from mrta_falsify.commands.stacks import load_stack

    config = load_stack(stack, settings)
    folder = make_directory(options["output"])
    click.echo(f"1. One day in PyBullet ({demo.DEMO_WORLD}, seed {seed})")
    _show_day(seed, config, folder / "day")
    titles = {
        demo.SAMPLED_DAYS: "2. A campaign on sampled days",
        demo.EXAMPLE: "3. An example that deadlocks",
    }
    results = []
    for search, title in titles.items():
        click.echo()
        what = ", ".join((*search.settings, search.scenario, f"seed {seed}"))
        click.echo(f"{title} ({what}, at most {search.trials} trials)")
        with CampaignWatch(folder / search.name) as watch:
            result = demo.run_search(
                search,
                seed,
                config,
                folder,
                on_record=watch.on_record,
                on_feedback=watch.on_feedback,
            )
        if result.ended == "interrupted":
            say_interrupted(result)
            return ExitCode.INTERRUPTED
        print_campaign(result)
        results.append(result)
    page = demo.write_failure_report(results, folder)
    found = "campaign" if results[0].progress.failed else "example"
    click.echo()
    click.echo(f"Report of the {found}, with what failed and why:")
    click.echo(str(page))
    return ExitCode.DONE


def _show_day(seed: int, config: StackConfig, directory: Path) -> None:
    """Run the day and print it."""
    from mrta_falsify.commands import demo
    from mrta_falsify.commands.run import summarise_run
    from mrta_falsify.commands.worlds import find_world

    world = find_world(demo.DEMO_WORLD, seed=seed)
    click.echo(f"{len(world.robots)} robots, {len(world.humans)} people, {len(world.tasks)} tasks")
    output.say("warming up: the first run ever compiles code, which takes minutes")
    seconds = demo.load_compiled_code(world, config)
    click.echo(f"warm-up  {seconds:.1f} s for compiled code and {demo.WARM_UP:g} s of simulation")
    click.echo("The time below is of the run alone.")
    with output.progress(world.name, world.horizon, "s simulated") as on_progress:
        day = demo.run_day(world, config, directory, on_progress=on_progress)
    print_run(summarise_run(day.outcome))
    click.echo(f"picture  {day.files.picture}")
    replay = ["mrta-falsify", "run", str(day.files.world), "--stack", str(day.files.stack)]
    click.echo(f"replay   {shlex.join(replay)}")
