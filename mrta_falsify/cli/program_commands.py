"""The commands about Scenic programs: check, sample."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from mrta_falsify.campaigns.settings import TrialSettings
from mrta_falsify.cli import output
from mrta_falsify.cli.exits import ExitCode
from mrta_falsify.cli.group import main
from mrta_falsify.cli.names import SCENARIO
from mrta_falsify.cli.options import (
    Command,
    count_option,
    format_option,
    output_option,
    param_option,
    seed_option,
    setting_option,
    stack_options,
)
from mrta_falsify.core.errors import InputError
from mrta_falsify.core.words import listed, number_text

if TYPE_CHECKING:
    from mrta_falsify.commands.check import CheckSummary, ProgramCheck
    from mrta_falsify.core.candidate import Dimension

MAX_LETTERS = 60  # of the options of a choice
SHOWN_REJECTERS = 10

SCENARIO_HELP = "SCENARIO is a Scenic program (.scenic) or the name of a shipped one."

_mode_option = setting_option(TrialSettings, "mode")
_seed_option = seed_option("Seed of the random campaign whose first candidates are drawn.")
_attempts_option = count_option(
    "--max-attempts",
    1,
    1_000_000,
    default=3000,
    text="Largest number of scenes to try for each candidate.",
)


def _count_option(default: int, text: str) -> Callable[[Command], Command]:
    return count_option("--count", 1, 100_000, default=default, text=text)


@main.command("check", epilog=SCENARIO_HELP)
@click.argument("scenarios", nargs=-1, metavar="SCENARIO...", type=SCENARIO)
@click.option("--all", "everything", is_flag=True, help="Check all shipped programs.")
@_count_option(20, "Number of scenes to sample.")
@_seed_option
@param_option
@_mode_option
@_attempts_option
@output_option(
    "DIR",
    ("Directory for check.json and contact_sheet.png (for several programs: a directory each)."),
)
@format_option
def check_command(
    scenarios: tuple[str, ...],
    everything: bool,
    style: str,
    **options: Any,
) -> int:
    """Compile, sample and lint Scenic programs: dimensions, speed, causes of rejection.

    One program is shown in full, several (or --all) as a table. The scenes are the first
    candidates of a random campaign with the same seed.
    """
    if bool(scenarios) == everything:
        raise click.UsageError("give a SCENARIO or several, or --all")
    from mrta_falsify.commands.folders import make_directory
    from scenic_worlds.shipped import scenario_names

    directory = options.pop("output")
    if directory is not None:
        make_directory(directory)
    if len(scenarios) == 1:
        return _check_one(scenarios[0], options, directory, style)
    return _check_many(scenarios or scenario_names(), options, directory, style)


def _check_one(name: str, options: dict[str, Any], directory: Path | None, style: str) -> int:
    from mrta_falsify.commands.check import check, summarise_check

    with output.progress(name, options["count"], "scenes") as on_progress:
        done = check(name, directory, on_progress=on_progress, **options)
    summary = summarise_check(done)
    if style == "json":
        output.print_json(summary)
    else:
        _print_check(done, summary)
    _print_written(directory)
    return ExitCode.DONE


def _check_many(
    names: tuple[str, ...], options: dict[str, Any], directory: Path | None, style: str
) -> int:
    """Check one program after the other, also after one that fails."""
    from mrta_falsify.commands.check import check, summarise_check, write_check

    checked: dict[str, CheckSummary | InputError] = {}
    with output.progress("check", len(names), "programs") as on_progress:
        for name in names:
            try:
                done = check(name, **options)
            except InputError as error:
                checked[name] = error
            else:
                checked[name] = summarise_check(done)
                if directory is not None:
                    write_check(done, directory / done.scenario)
                    _print_written(directory / done.scenario)
            on_progress(len(checked))
    if style == "json":
        rows = [_json_row(name, found) for name, found in checked.items()]
        output.print_json({"programs": rows})
    else:
        _print_programs(checked)
    failed = [found for found in checked.values() if isinstance(found, InputError)]
    for failure in failed:
        output.say(f"error: {' '.join(str(failure).split())}")
    return ExitCode.BAD_INPUT if failed else ExitCode.DONE


def _json_row(name: str, found: CheckSummary | InputError) -> Any:
    return {"scenario": name, "error": str(found)} if isinstance(found, InputError) else found


def _print_written(directory: Path | None) -> None:
    if directory is not None:
        output.print_files(directory)


# --- text ----------------------------------------------------------------------------------------


def _print_programs(checked: dict[str, CheckSummary | InputError]) -> None:
    numbers = ("k", "compile\n[s]", "scene\n[ms]", "accepted", "lint")
    table = output.new_table("program", *numbers, "rejects most", right=numbers, whole=("program",))
    for name, found in checked.items():
        if isinstance(found, InputError):
            table.add_row(Path(name).stem, *[""] * len(numbers), "error, see below", style="red")
            continue
        table.add_row(
            found.scenario,
            str(found.k),
            f"{found.compile_s:.2f}",
            f"{found.scene_ms.median:.1f}",
            f"{found.acceptance:.0%}",
            str(len(found.lint)),
            found.rejections[0].who if found.rejections else "",
        )
    output.print_table(table)


def _print_check(done: ProgramCheck, summary: CheckSummary) -> None:
    out = output.stdout()
    times = summary.scene_ms
    out.print(f"program     {done.path}")
    out.print(f"compiled    in {summary.compile_s:.2f} s, {_kinds(summary)}")
    lost = f", {summary.failed} candidates without any valid scene" if summary.failed else ""
    out.print(f"sampled     {summary.scenes} scenes in mode {done.mode}{lost}")
    out.print(f"per scene   median {times.median:.1f} ms, p90 {times.p90:.1f} ms")
    out.print(
        f"accepted    {100 * summary.acceptance:.3g} % of uniform samples as they are; "
        f"{summary.attempts / len(done.drawn):.3g} attempts per candidate"
    )
    if summary.crowd:
        out.print(f"cost        {summary.crowd}")
    if summary.rejections:
        out.print()
        _print_rejecters(summary)
    if summary.outside:
        out.print()
        _print_outside(summary)
    if summary.impossible:
        out.print()
        first = summary.impossible[0]
        out.print(
            f"impossible  {len(summary.impossible)} of {summary.scenes} worlds, which a campaign "
            f"sets apart; {first.number:03d}: {first.reason}"
        )
    if summary.shut or summary.narrow or summary.stuck_pushes:
        out.print()
        _print_tight_ways(summary)
    out.print()
    if summary.dimensions:
        table = output.new_table("dimension", "kind", "values")
        for dimension in summary.dimensions:
            table.add_row(dimension.name, dimension.kind, _values(dimension))
        output.print_table(table)
        out.print()
    if not summary.lint:
        out.print("lint: nothing found")
    for finding in summary.lint:
        out.print(f"{finding.where}: {finding.code}: {finding.message}")


def _print_tight_ways(summary: CheckSummary) -> None:
    """Print in how many worlds rooms are shut, or narrow, and by what."""
    from mrta_falsify.core.tight_ways import things_text

    out, scenes = output.stdout(), summary.scenes
    for count in summary.shut:
        verb = "shuts" if len(count.by) == 1 else "shut"
        out.print(
            f"shut        in {count.worlds} of {scenes} worlds {things_text(count.by)} {verb} "
            f"{count.room}"
        )
    for count in summary.narrow:
        low, high = (f"{gap:.2f}" for gap in count.gaps)
        width = low if low == high else f"{low} to {high}"
        where = f"beside {things_text(count.by)}" if count.by else "between walls"
        out.print(
            f"narrow      in {count.worlds} of {scenes} worlds only {width} m at {count.room}, "
            f"{where}: less than robots plan for"
        )
    if summary.stuck_pushes:
        worlds, first = {push.number for push in summary.stuck_pushes}, summary.stuck_pushes[0]
        out.print(
            f"pushes      in {len(worlds)} of {scenes} worlds furniture does not fit to where it "
            f"is pushed; {first.number:03d}: {first.text}"
        )


def _print_outside(summary: CheckSummary) -> None:
    """Print in how many draws each thing lies outside its region, and what to change."""
    out = output.stdout()
    for thing in summary.outside[:SHOWN_REJECTERS]:
        at = f" ({thing.where})" if thing.where else ""
        out.print(
            f"outside     {thing.name}{at} in {thing.draws} of {thing.of} draws, not inside "
            f"{thing.region or 'its region'}: {thing.advice}"
        )
    others = len(summary.outside) - SHOWN_REJECTERS
    if others > 0:
        out.print(f"outside     {others} others; --format json lists them")


def _print_rejecters(summary: CheckSummary) -> None:
    table = output.new_table("rejected", "by", right=("rejected",))
    for entry in summary.rejections[:SHOWN_REJECTERS]:
        table.add_row(str(entry.count), entry.who)
    others = summary.rejections[SHOWN_REJECTERS:]
    if others:
        table.add_row(str(sum(entry.count for entry in others)), f"{len(others)} others")
    output.print_table(table)


def _kinds(summary: CheckSummary) -> str:
    counts: dict[str, int] = {}
    for dimension in summary.dimensions:
        counts[dimension.kind] = counts.get(dimension.kind, 0) + 1
    listing = ", ".join(f"{count} {kind}" for kind, count in sorted(counts.items()))
    return f"{summary.k} dimensions" + (f" ({listing})" if listing else "")


def _values(dimension: Dimension) -> str:
    low, high = dimension.low, dimension.high
    if dimension.kind == "choice" and dimension.choices:
        options = [str(dimension.told(number)) for number in range(len(dimension.options))]
        text = listed(options)
        return text if options and len(text) <= MAX_LETTERS else f"{dimension.choices} options"
    if low is None and high is None:
        return "depends on others"
    parts = ["" if bound is None else number_text(bound) for bound in (low, high)]
    return f"{parts[0]} to {parts[1]}".strip()


# --- sample --------------------------------------------------------------------------------------


@main.command("sample", epilog=SCENARIO_HELP)
@click.argument("scenario", type=SCENARIO)
@_count_option(10, "Number of worlds to write.")
@_seed_option
@param_option
@_mode_option
@_attempts_option
@stack_options
@output_option(
    "DIR",
    "Directory for world_NNN.json, each with a picture (.png) and a Nav2 map (.yaml, "
    ".pgm), contact_sheet.png and samples.json.",
    required=True,
)
def sample_command(scenario: str, count: int, **options: Any) -> int:
    """Write worlds sampled from a Scenic program: JSON, picture and Nav2 map of each.

    They are the first candidates of a random campaign with the same seed. The stack's
    costmap options make the maps.
    """
    from mrta_falsify.commands.sample import sample

    with output.progress(scenario, count, "worlds") as on_progress:
        samples = sample(scenario, count=count, on_progress=on_progress, **options)
    for path in samples.worlds:
        click.echo(str(path))
    output.say(f"wrote {samples.sheet}")
    output.say(f"wrote {samples.index}")
    if samples.rejected:
        output.say(f"{samples.rejected} of {count} candidates had no valid scene; see the index")
    if samples.impossible:
        output.say(f"no stack can do {samples.impossible} of the worlds; see the index")
    return ExitCode.DONE
