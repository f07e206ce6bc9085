"""The commands; each parses, calls the Python face and prints."""

from __future__ import annotations

from pathlib import Path

import click

from mrta_falsify.cli import output
from mrta_falsify.cli.door import Door, ExitCode
from mrta_falsify.cli.options import (
    FILE,
    FiniteRange,
    format_option,
    spec_option,
    stack_options,
)
from mrta_falsify.core import registry
from mrta_falsify.core.defects import DEFECTS

_WORLD_HELP = (
    "WORLD is a world file (.json), a Scenic program (.scenic), or a shipped name of either."
)


@click.group("mrta-falsify", cls=Door, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="mrta-falsify", message="mrta-falsify %(version)s")
def main() -> None:
    """Find, explain and reproduce deadlocks in multi-robot task-allocation stacks.

    Exit codes: 0 nothing violated, 1 violations found, 2 bad input, 3 the toolkit itself
    failed, 130 interrupted.
    """


# --- run --------------------------------------------------------------------------------


@main.command(epilog=_WORLD_HELP)
@click.argument("world_name", metavar="WORLD")
@click.option(
    "--seed",
    type=click.IntRange(min=0),
    help="Vary a fixed world (starts within 0.2 m, people's phase and pace, sensor noise), or "
    "sample a program. Without it a fixed world runs exactly as written.",
)
@stack_options
@click.option("--tasks", type=FILE, metavar="FILE", help="Task stream (MRTA-Sim testcase JSON).")
@click.option("--robots", type=FILE, metavar="FILE", help="Robot starts (`agents:` YAML or JSON).")
@click.option("--humans", type=FILE, metavar="FILE", help="People's routes (waypoint YAML).")
@spec_option
@click.option(
    "-o",
    "--output",
    "directory",
    type=FILE,
    metavar="DIR",
    help="Write world.json, stack.yaml, trace.zip, verdicts.json, picture.png, report.html.",
)
@click.option("--gui", is_flag=True, help="Show the physics engine's window.")
@click.option("--gif", is_flag=True, help="Also write run.gif.")
@click.option("--mp4", is_flag=True, help="Also write run.mp4 (needs the extra `video`).")
@format_option
def run(
    world_name: str,
    seed: int | None,
    stack: Path | None,
    settings: tuple[str, ...],
    tasks: Path | None,
    robots: Path | None,
    humans: Path | None,
    specs: tuple[str, ...],
    directory: Path | None,
    gui: bool,
    gif: bool,
    mp4: bool,
    style: str,
) -> int:
    """Run the full stack in one world and judge it."""
    if (gif or mp4) and directory is None:
        raise click.UsageError("--gif and --mp4 need -o DIR")
    from mrta_falsify.verbs import run as app

    config = app.load_stack(stack, (*settings, "engine.gui=true") if gui else settings)
    start = app.find_start(world_name, seed=seed, tasks=tasks, robots=robots, humans=humans)
    world = start.world
    if directory is not None:
        app.make_directory(directory)
    with output.progress(world.name, world.horizon, "s simulated") as report_progress:
        outcome = app.run(
            world, config, specifications=specs, on_progress=report_progress, scene=start.scene
        )
    data = {**app.summary(outcome), "seed": seed, "stack_digest": config.digest()}
    if directory is not None:
        app.write_run(outcome, world, directory, config=config, gif=gif, mp4=mp4)
        data["output"] = str(directory)
    if style == "json":
        output.print_json(app.finite(data))
    else:
        output.print_summary(data)
    if directory is not None:
        output.print_files(directory)
    if outcome.ended == "interrupted":
        return ExitCode.INTERRUPTED
    broken = any(verdict.violated for verdict in outcome.verdicts)
    return ExitCode.VIOLATED if broken else ExitCode.DONE


# --- other verbs ---------------------------------------------------------------------------


@main.command("travel-times", epilog=_WORLD_HELP)
@click.argument("world_name", metavar="WORLD")
@click.option("--iterations", type=click.IntRange(1, 1000), default=3, show_default=True)
@click.option(
    "--statistic",
    type=click.Choice(("max", "mean", "p95")),
    default="max",
    show_default=True,
    help="What a JSON file holds per pair.",
)
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True)
@stack_options
@click.option(
    "-o",
    "--output",
    "path",
    type=FILE,
    required=True,
    metavar="FILE",
    help="FILE.csv gets the raw samples, FILE.json the matrix that `allocate` reads. An "
    "interrupted measurement goes on where it stopped.",
)
def travel_times(
    world_name: str,
    iterations: int,
    statistic: str,
    seed: int,
    stack: Path | None,
    settings: tuple[str, ...],
    path: Path,
) -> int:
    """Drive one robot between all pairs of rooms and write how long it takes."""
    if path.suffix not in (".csv", ".json"):
        raise click.UsageError(f"-o {path}: the file must end in .csv or .json")
    from mrta_falsify.verbs import run as app
    from mrta_falsify.verbs import travel_times

    config = app.load_stack(stack, settings)
    world = app.find_world(world_name)
    app.make_directory(path.parent)
    pairs = len(world.rooms) * (len(world.rooms) - 1)
    with output.progress(world.name, pairs, "pairs of rooms") as report_progress:
        times = travel_times.measure_travel_times(
            world,
            config,
            iterations=iterations,
            seed=seed,
            samples_file=travel_times.samples_file(path),
            on_progress=report_progress,
        )
    if path.suffix == ".json":
        travel_times.write_matrix(times, path, statistic)
    for start, end in times.missing():
        output.say(f"no way from room {start} to room {end}: left empty")
    output.say(f"wrote {path}")
    return ExitCode.DONE


@main.command()
@click.option(
    "--robots",
    "fleets",
    default="2,4,6,12,24",
    show_default=True,
    metavar="N,N,...",
    help="Fleet sizes to run.",
)
@click.option(
    "--seconds",
    type=FiniteRange(min=10.0),
    default=60.0,
    show_default=True,
    help="Simulated seconds per fleet size.",
)
@stack_options
@format_option
def bench(
    fleets: str, seconds: float, stack: Path | None, settings: tuple[str, ...], style: str
) -> int:
    """Measure the speed of every layer on this machine, on one core."""
    sizes = _fleet_sizes(fleets)
    from mrta_falsify.verbs import bench as benchmarking
    from mrta_falsify.verbs import run as app

    config = app.load_stack(stack, settings)
    with output.progress("bench", benchmarking.step_count(sizes), "steps") as report_progress:
        data = benchmarking.bench(
            config, fleets=sizes, seconds=seconds, on_progress=report_progress
        )
    if style == "json":
        output.print_json(app.finite(data))
    else:
        output.print_bench(data)
    return ExitCode.DONE


def _fleet_sizes(text: str) -> tuple[int, ...]:
    try:
        sizes = tuple(int(part) for part in text.split(","))
    except ValueError:
        sizes = ()
    if not sizes or not all(1 <= size <= 200 for size in sizes):
        raise click.UsageError(f"--robots is {text!r}; it must be numbers from 1 to 200, as 2,4,6")
    return sizes


@main.command()
@format_option
def plugins(style: str) -> int:
    """List the components of every extension point, and the planted defects."""
    if style == "json":
        table = {point: list(registry.names(point)) for point in registry.EXTENSION_POINTS}
        output.print_json({**table, "defects": sorted(DEFECTS)})
    else:
        output.print_plugins()
    return ExitCode.DONE


@main.command()
@format_option
def doctor(style: str) -> int:
    """Check this machine: Python, libraries, compiled-code cache, determinism, extras."""
    from mrta_falsify.verbs import doctor as health

    checks = health.doctor()
    if style == "json":
        output.print_json({"ok": health.is_healthy(checks), "checks": health.as_rows(checks)})
    else:
        output.print_checks(checks)
    return ExitCode.DONE if health.is_healthy(checks) else ExitCode.HARNESS
