"""The commands that drive worlds: run, travel-times."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from mrta_falsify.campaigns.settings import TrialSettings
from mrta_falsify.cli import output
from mrta_falsify.cli.exits import ExitCode
from mrta_falsify.cli.group import main
from mrta_falsify.cli.names import WORLD
from mrta_falsify.cli.options import (
    FILE,
    WholeRange,
    format_option,
    output_option,
    seed_option,
    setting_option,
    spec_option,
    stack_options,
)

if TYPE_CHECKING:
    from mrta_falsify.commands.run import RunSummary

STYLES = {"violated": "red", "not_judged": "yellow"}  # of a verdict's row, by its outcome
WORLD_HELP = (
    "WORLD is a world file (.json), a Scenic program (.scenic), a shipped name of either, or a "
    "scene of the zoo (zoo/NAME)."
)


@main.command("run", epilog=WORLD_HELP)
@click.argument("world", type=WORLD)
@click.option(
    "--seed",
    type=WholeRange(min=0),
    metavar="N",
    help=(
        "Seed that varies a fixed world (starts within 0.2 m, people's phase and pace, sensor "
        "noise) or samples a program. By default a fixed world runs exactly as written, and a "
        "program is sampled with 0."
    ),
)
@stack_options
@click.option(
    "--tasks",
    type=FILE,
    metavar="FILE",
    help="Task stream in place of the world's: MRTA-Sim's testcase JSON.",
)
@click.option(
    "--robots",
    type=FILE,
    metavar="FILE",
    help="Robot starts in place of the world's: YAML or JSON with `agents:`.",
)
@click.option(
    "--humans",
    type=FILE,
    metavar="FILE",
    help="People's routes in place of the world's: YAML with waypoints.",
)
@spec_option
@setting_option(TrialSettings, "tick_limit")
@setting_option(TrialSettings, "memory_limit")
@output_option(
    "DIR",
    (
        "Directory for world.json, stack.yaml, trace.zip, verdicts.json, picture.png and "
        "report.html."
    ),
)
@click.option("--gui", is_flag=True, help="Show the window of the physics engine.")
@click.option("--gif", is_flag=True, help="Write run.gif as well.")
@click.option("--mp4", is_flag=True, help="Write run.mp4 as well (needs the extra `video`).")
@format_option
def run_command(
    world: str,
    seed: int | None,
    stack: str | None,
    settings: tuple[str, ...],
    tasks: Path | None,
    robots: Path | None,
    humans: Path | None,
    style: str,
    **options: Any,
) -> int:
    """Run the full stack in one world and judge it."""
    directory = options["output"]
    if (options["gif"] or options["mp4"]) and directory is None:
        raise click.UsageError("--gif and --mp4 need -o DIR")
    from mrta_falsify.commands import run as running
    from mrta_falsify.commands.crowd_cost import cost_of
    from mrta_falsify.commands.stacks import load_stack
    from mrta_falsify.commands.worlds import find_world_and_scene
    from mrta_falsify.trial import refuse_unjudgeable

    chosen = (*settings, running.SHOW_WINDOW) if options["gui"] else settings
    config = load_stack(stack, chosen)
    found = find_world_and_scene(world, seed=seed, tasks=tasks, robots=robots, humans=humans)
    cost = cost_of(found.world, config)
    if cost.is_crowd:
        output.say(str(cost))
    with output.progress(found.world.name, found.world.horizon, "s simulated") as on_progress:
        outcome = running.run(found, config, on_progress=on_progress, **options)
    summary = running.summarise_run(
        outcome, world=found.world, config=config, seed=seed, output=directory
    )
    if style == "json":
        output.print_json(summary)
    else:
        print_run(summary)
    if directory is not None:
        output.print_files(directory)
    refuse_unjudgeable(outcome.verdicts)
    broken = any(verdict.violated for verdict in outcome.verdicts)
    return ExitCode.VIOLATED if broken else ExitCode.DONE


AT_REST = "robot_human_at_rest"  # episodes that no robot is blamed for


def print_run(summary: RunSummary) -> None:
    """Print the result of a run as text."""
    out = output.stdout()
    tasks = summary.tasks
    contacts = ", ".join(
        f"{count} {kind.replace('_', '-')}" for kind, count in summary.contacts.items() if count
    )
    if tasks.told:
        done = f"{tasks.completed} of {tasks.total} done"
        out.print(f"tasks      {done}, {tasks.late} late or missing")
        out.print(f"robots     {summary.robots_finished} of {summary.robots} finished their work")
    else:
        out.print(f"tasks      {tasks.total}; what became of them the stack does not tell")
    told = ", a person who walked into a robot that stood" if summary.contacts.get(AT_REST) else ""
    out.print(f"contacts   {contacts or 'none'}{told}")
    out.print(
        f"time       {summary.sim_time_s:.1f} s simulated in {summary.wall_s:.1f} s "
        f"({summary.real_time_factor:.1f}x real time), ended: {summary.ended}"
    )
    out.print(f"digests    world {summary.world_digest[:16]}  trace {summary.trace_digest[:16]}")
    if summary.impossible:
        out.print(f"impossible {summary.impossible}")
    for note in summary.notes:
        out.print(f"note       {note}")
    out.print()
    table = output.new_table(
        "specification", "verdict", "robustness", "at", "who", right=("robustness", "at")
    )
    for verdict in summary.verdicts:
        rho, at = verdict.robustness, verdict.violated_at_s
        table.add_row(
            verdict.spec,
            verdict.outcome.replace("_", " "),
            "" if verdict.not_judged else "unbounded" if rho is None else f"{rho:+.3g}",
            "" if at is None else f"{at:.2f} s",
            verdict.not_judged or ", ".join(verdict.who),
            style=STYLES.get(verdict.outcome),
        )
    output.print_table(table)
    if summary.stack_failure:
        out.print()
        out.print(summary.stack_failure, markup=False, highlight=False)


@main.command("travel-times", epilog=WORLD_HELP)
@click.argument("world", type=WORLD)
@click.option(
    "--iterations",
    type=WholeRange(1, 1000),
    default=3,
    show_default=True,
    metavar="N",
    help="Number of trips of each pair of rooms.",
)
@click.option(
    "--statistic",
    type=click.Choice(("max", "mean", "p95")),
    default="max",
    show_default=True,
    help="Statistic over the trips of a pair that a JSON file holds.",
)
@seed_option("Seed of the start offsets.")
@stack_options
@output_option(
    "FILE",
    "File to write: FILE.csv for the raw samples, FILE.json for the matrix that "
    "`allocate` reads. An interrupted measurement continues.",
    required=True,
)
def travel_times_command(
    world: str, stack: str | None, settings: tuple[str, ...], **options: Any
) -> int:
    """Drive one robot between all pairs of rooms and write how long it takes."""
    path: Path = options["output"]
    if path.suffix not in (".csv", ".json"):
        raise click.UsageError(f"-o {path}: the file must end in .csv or .json")
    from mrta_falsify.commands.stacks import load_stack
    from mrta_falsify.commands.travel_times import write_travel_times
    from mrta_falsify.commands.worlds import find_world

    config, found = load_stack(stack, settings), find_world(world)
    pairs = len(found.rooms) * (len(found.rooms) - 1)
    with output.progress(found.name, pairs, "pairs of rooms") as on_progress:
        times = write_travel_times(found, stack=config, on_progress=on_progress, **options)
    for start, end in times.missing():
        output.say(f"no way from room {start} to room {end}: left empty")
    output.say(f"wrote {path}")
    return ExitCode.DONE
