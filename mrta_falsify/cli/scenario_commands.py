"""The commands about Scenic programs: check, sample."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from mrta_falsify.cli import output
from mrta_falsify.cli.door import ExitCode
from mrta_falsify.cli.options import FILE, count_option, format_option, param_option, stack_options
from mrta_falsify.cli.run_commands import main
from mrta_falsify.core.errors import InputError

if TYPE_CHECKING:
    from mrta_falsify.verbs.check import Check, Mode

SHOWN_REJECTERS = 10

_SCENARIO_HELP = "SCENARIO is a Scenic program (.scenic) or the name of a shipped one."


def _mode_option(command: Any) -> Any:
    return click.option(
        "--mode",
        type=click.Choice(("repair", "exact")),
        default="repair",
        show_default=True,
        help="repair redraws only what is to blame for a rejected scene; exact rejects whole "
        "scenes and so keeps Scenic's distribution.",
    )(command)


def _attempts_option(command: Any) -> Any:
    return count_option(
        "--max-attempts", 1, 1_000_000, default=3000, text="Scenes to try for each candidate."
    )(command)


@main.command(epilog=_SCENARIO_HELP)
@click.argument("names", nargs=-1, metavar="SCENARIO...")
@click.option("--all", "everything", is_flag=True, help="All shipped programs.")
@click.option(
    "--count", type=click.IntRange(1, 100_000), default=20, show_default=True, help="Scenes."
)
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True)
@param_option
@_mode_option
@_attempts_option
@click.option(
    "-o",
    "--output",
    "directory",
    type=FILE,
    metavar="DIR",
    help="Write check.json and contact_sheet.png (of several programs: in a directory each).",
)
@format_option
def check(
    names: tuple[str, ...],
    everything: bool,
    count: int,
    seed: int,
    params: tuple[str, ...],
    mode: Mode,
    max_attempts: int,
    directory: Path | None,
    style: str,
) -> int:
    """Compile and sample Scenic programs: dimensions, speed, who rejects, lint.

    Of one program everything is told, of several (or --all) a table. The scenes are the
    first candidates of a random campaign with the same seed.
    """
    if bool(names) == everything:
        raise click.UsageError("give a SCENARIO or several, or --all")
    from mrta_falsify.verbs import run as app
    from scenic_worlds.shipped import scenario_names

    chosen = scenario_names() if everything else names
    overrides = _params(params)
    if directory is not None:
        app.make_directory(directory)
    options: dict[str, Any] = {
        "count": count,
        "seed": seed,
        "params": overrides,
        "mode": mode,
        "max_attempts": max_attempts,
    }
    if len(chosen) == 1 and not everything:
        return _check_one(chosen[0], options, directory, style)
    return _check_many(chosen, options, directory, style)


def _params(texts: tuple[str, ...]) -> dict[str, Any]:
    from mrta_falsify.verbs import campaign as campaigns

    return campaigns.parse_params(texts)


def _check_one(name: str, options: dict[str, Any], directory: Path | None, style: str) -> int:
    from mrta_falsify.verbs import check as scenarios
    from mrta_falsify.verbs import run as app

    with output.progress(name, options["count"], "scenes") as report_progress:
        done = scenarios.check(name, on_progress=report_progress, **options)
    data = app.finite(scenarios.check_summary(done))
    written = scenarios.write_check(done, directory) if directory is not None else []
    if style == "json":
        output.print_json(data)
    else:
        _print_check(done, data)
    for path in written:
        output.say(f"wrote {path}")
    return ExitCode.DONE


def _check_many(
    names: tuple[str, ...], options: dict[str, Any], directory: Path | None, style: str
) -> int:
    """Check one program after the other; one that fails does not keep the others from it."""
    from mrta_falsify.verbs import check as scenarios
    from mrta_falsify.verbs import run as app

    rows: list[dict[str, Any]] = []
    with output.progress("check", len(names), "programs") as report_progress:
        for name in names:
            try:
                done = scenarios.check(name, **options)
            except InputError as error:
                rows.append({"scenario": name, "error": str(error)})
            else:
                rows.append(app.finite(scenarios.check_summary(done)))
                if directory is not None:
                    for path in scenarios.write_check(done, directory / done.scenario):
                        output.say(f"wrote {path}")
            report_progress(len(rows))
    if style == "json":
        output.print_json({"programs": rows})
    else:
        _print_table(rows)
    failed = [row for row in rows if "error" in row]
    for row in failed:
        output.say(f"error: {' '.join(row['error'].split())}")
    return ExitCode.BAD_INPUT if failed else ExitCode.DONE


# --- text ----------------------------------------------------------------------------------------


class _Columns:
    """Text in columns, never cut: lines may be longer than the terminal is wide.

    Args:
        columns: heading, and whether it holds numbers.
    """

    def __init__(self, *columns: tuple[str, bool]) -> None:
        self._is_number = [is_number for _, is_number in columns]
        self._rows: list[tuple[tuple[str, ...], str | None]] = []
        self.add_row(*(heading for heading, _ in columns), style="bold")

    def add_row(self, *cells: str, style: str | None = None) -> None:
        self._rows.append((cells, style))

    def print(self) -> None:
        out = output.stdout()
        widths = [max(map(len, column)) for column in zip(*(r for r, _ in self._rows), strict=True)]
        for cells, style in self._rows:
            parts = [
                cell.rjust(width) if is_number else cell.ljust(width)
                for cell, width, is_number in zip(cells, widths, self._is_number, strict=True)
            ]
            out.print("  ".join(parts).rstrip(), style=style)


def _print_table(rows: list[dict[str, Any]]) -> None:
    table = _Columns(
        ("program", False),
        ("k", True),
        ("opaque", True),
        ("compile s", True),
        ("scenes", True),
        ("median ms", True),
        ("p90 ms", True),
        ("accepted", True),
        ("lint", True),
        ("rejects most", False),
    )
    for row in rows:
        if "error" in row:
            table.add_row(row["scenario"], *[""] * 8, "error, see below", style="red")
            continue
        worst = row["rejections"][0]["who"] if row["rejections"] else ""
        table.add_row(
            row["scenario"],
            str(row["k"]),
            str(len(row["opaque"])),
            f"{row['compile_s']:.2f}",
            str(row["scenes"]),
            f"{row['scene_ms']['median']:.1f}",
            f"{row['scene_ms']['p90']:.1f}",
            f"{100 * row['acceptance']:.3g} %",
            str(len(row["lint"])),
            worst,
        )
    table.print()


def _print_check(done: Check, data: dict[str, Any]) -> None:
    out = output.stdout()
    times = data["scene_ms"]
    out.print(f"program     {done.path}")
    out.print(f"compiled    in {data['compile_s']:.2f} s, {_kinds(data)}")
    lost = f", {data['failed']} candidates without any valid scene" if data["failed"] else ""
    out.print(f"sampled     {data['scenes']} scenes in mode {done.mode}{lost}")
    out.print(f"per scene   median {times['median']:.1f} ms, p90 {times['p90']:.1f} ms")
    out.print(
        f"accepted    {100 * data['acceptance']:.3g} % of uniform samples as they are; "
        f"{data['attempts'] / len(done.drawn):.3g} attempts per candidate"
    )
    if data["rejections"]:
        out.print()
        table = _Columns(("rejected", True), ("by", False))
        for entry in data["rejections"][:SHOWN_REJECTERS]:
            table.add_row(str(entry["count"]), entry["who"])
        more = data["rejections"][SHOWN_REJECTERS:]
        if more:
            total = sum(entry["count"] for entry in more)
            table.add_row(str(total), f"{len(more)} others")
        table.print()
    out.print()
    table = _Columns(("dimension", False), ("kind", False), ("values", False))
    for dimension in data["dimensions"]:
        table.add_row(dimension["name"], dimension["kind"], _values(dimension))
    table.print()
    out.print()
    if not data["lint"]:
        out.print("lint: nothing found")
    for finding in data["lint"]:
        out.print(f"{finding['where']}: {finding['code']}: {finding['message']}")


def _kinds(data: dict[str, Any]) -> str:
    counts: dict[str, int] = {}
    for dimension in data["dimensions"]:
        counts[dimension["kind"]] = counts.get(dimension["kind"], 0) + 1
    listing = ", ".join(f"{count} {kind}" for kind, count in sorted(counts.items()))
    return f"{data['k']} dimensions" + (f" ({listing})" if listing else "")


def _values(dimension: dict[str, Any]) -> str:
    low, high = dimension["low"], dimension["high"]
    if dimension["kind"] == "choice" and dimension["choices"]:
        return f"{dimension['choices']} options"
    if low is None and high is None:
        return ""
    parts = ["" if bound is None else f"{bound:.4g}" for bound in (low, high)]
    return f"{parts[0]} to {parts[1]}".strip()


# --- sample --------------------------------------------------------------------------------------


@main.command(epilog=_SCENARIO_HELP)
@click.argument("scenario")
@click.option(
    "--count", type=click.IntRange(1, 100_000), default=10, show_default=True, help="Worlds."
)
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True)
@param_option
@_mode_option
@_attempts_option
@stack_options
@click.option(
    "-o",
    "--output",
    "directory",
    type=FILE,
    required=True,
    metavar="DIR",
    help="Gets world_NNN.json with a picture (.png) and a Nav2 map (.yaml, .pgm) each, "
    "contact_sheet.png and samples.json.",
)
def sample(
    scenario: str,
    count: int,
    seed: int,
    params: tuple[str, ...],
    mode: Mode,
    max_attempts: int,
    stack: Path | None,
    settings: tuple[str, ...],
    directory: Path,
) -> int:
    """Write worlds sampled from a Scenic program: JSON, picture and Nav2 map of each.

    They are the first candidates of a random campaign with the same seed. The stack's
    costmap options make the maps.
    """
    from mrta_falsify.verbs import check as scenarios
    from mrta_falsify.verbs import run as app

    config = app.load_stack(stack, settings)
    with output.progress(scenario, count, "worlds") as report_progress:
        samples = scenarios.sample(
            scenario,
            directory,
            count=count,
            seed=seed,
            params=_params(params),
            mode=mode,
            max_attempts=max_attempts,
            config=config,
            on_progress=report_progress,
        )
    for path in samples.worlds:
        click.echo(str(path))
    output.say(f"wrote {samples.sheet}")
    output.say(f"wrote {samples.index}")
    if samples.rejected:
        output.say(f"{samples.rejected} of {count} candidates had no valid scene; see the index")
    return ExitCode.DONE
