"""Commands on whole campaigns: report, the same failures on a changed stack, other samplers."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click
from rich.table import Table

from mrta_falsify.cli import output
from mrta_falsify.cli.door import ExitCode
from mrta_falsify.cli.options import (
    FILE,
    FiniteRange,
    count_option,
    format_option,
    jittered_option,
    param_option,
    spec_option,
    stack_options,
    workers_option,
)
from mrta_falsify.cli.run_commands import main


@main.command()
@click.argument("directory", type=FILE)
@stack_options
@jittered_option(2, "Runs beside each failure with starts, pace and times a little different.")
@workers_option
@click.option(
    "--time-limit",
    type=FiniteRange(min=0.0, min_open=True),
    metavar="S",
    help="Wall clock of one run in seconds; default: the campaign's own limit.",
)
@format_option
def corpus(
    directory: Path,
    stack: Path | None,
    settings: tuple[str, ...],
    jittered: int,
    workers: int | None,
    time_limit: float | None,
    style: str,
) -> int:
    """Run all stored failures of a campaign on a changed stack.

    Each is fixed, still failing, flaky (only copies with small differences fail) or a timeout.
    Exit code 0 if all are fixed, 1 otherwise. Without --stack and --set the campaign's own
    stack is run. The recorded engine is kept unless --stack or --set names one.
    """
    from mrta_falsify.core import codec
    from mrta_falsify.verbs import campaign as campaigns
    from mrta_falsify.verbs import corpus as corpora
    from mrta_falsify.verbs import run as app

    opened = campaigns.open_campaign(directory)
    config = app.load_stack(stack, settings) if stack or settings else None
    if config is not None and not corpora.names_engine(stack, settings):
        config = corpora.on_recorded_engine(opened, config)
        output.say(f"engine {config.engine.name}, as recorded: the changed stack names none")
    total = sum(record.failed for record in opened.records)
    done: list[str] = []
    with output.progress("corpus", total, "failures") as report_progress:

        def on_done(row: Any) -> None:
            done.append(row.id)
            report_progress(len(done))

        rows = corpora.recheck(
            opened,
            config=config,
            jittered=jittered,
            workers=campaigns.cores(workers),
            time_limit=time_limit,
            on_done=on_done,
        )
    counts = corpora.counts_by_fate(rows)
    if style == "json":
        output.print_json({**counts, "failures": codec.encode(rows)})
    else:
        table = Table(box=None, pad_edge=False, show_edge=False, header_style="bold")
        for name in ("id", "fate", "was", "now", "jittered"):
            table.add_column(name)
        for row in rows:
            failing = f"{row.jittered_failures} of {row.jittered} fail"
            style_of_row = None if row.fate == "fixed" else "red"
            table.add_row(
                row.id, row.fate, row.signature, row.signature_now, failing, style=style_of_row
            )
        out = output.stdout()
        out.print(table)
        out.print(", ".join(f"{count} {fate}" for fate, count in counts.items()))
    all_fixed = counts["fixed"] == len(rows)
    return ExitCode.DONE if all_fixed else ExitCode.VIOLATED


@main.command()
@click.argument("scenario")
@click.option(
    "--samplers",
    default="random,auto",
    show_default=True,
    metavar="A,B,...",
    help="The first one is what the others are compared with.",
)
@click.option("--repeats", type=click.IntRange(min=1), default=10, show_default=True)
@click.option(
    "--budget",
    type=click.IntRange(min=1),
    default=100,
    show_default=True,
    help="Simulations per search.",
)
@click.option(
    "--seed",
    type=click.IntRange(min=0),
    default=0,
    show_default=True,
    help="Of the first repeat; each repeat has the next one.",
)
@click.option(
    "--all-failures",
    is_flag=True,
    help="Run each budget out, to count failure modes, instead of stopping at the first.",
)
@jittered_option(
    0, "Runs of each failing world with small differences; most must fail for it to count."
)
@workers_option
@stack_options
@spec_option
@param_option
@click.option("-o", "--output", "directory", type=FILE, required=True, metavar="DIR")
@click.option("--resume", is_flag=True, help="Go on with the comparison in DIR.")
@format_option
def compare(
    scenario: str,
    samplers: str,
    repeats: int,
    budget: int,
    seed: int,
    all_failures: bool,
    jittered: int,
    workers: int | None,
    stack: Path | None,
    settings: tuple[str, ...],
    specs: tuple[str, ...],
    params: tuple[str, ...],
    directory: Path,
    resume: bool,
    style: str,
) -> int:
    """Compare samplers: falsification rate, simulations to the first failure, failure modes."""
    from mrta_falsify.core import registry
    from mrta_falsify.verbs import campaign as campaigns
    from mrta_falsify.verbs import compare as comparison
    from mrta_falsify.verbs import run as app
    from reports.figure_searches import write_searches

    names = tuple(name.strip() for name in samplers.split(",") if name.strip())
    for name in names:
        registry.load("sampler", name, where="--samplers")
    if not names:
        raise click.UsageError("--samplers names nobody")
    if len(set(names)) < len(names):
        raise click.UsageError(f"--samplers {samplers}: each may be named once")
    if resume:
        comparison.check_is_comparison(directory)
    elif any(app.make_directory(directory).iterdir()):
        raise click.UsageError(f"-o {directory}: is not empty; go on with it by --resume")
    chosen = campaigns.new_settings(
        scenario,
        directory=directory,
        config=app.load_stack(stack, settings),
        params=campaigns.parse_params(params),
        specifications=specs,
        jittered=jittered,
    )
    plan = comparison.Plan(
        settings=chosen,
        samplers=names,
        repeats=repeats,
        budget=budget,
        first_seed=seed,
        stop_after=0 if all_failures else 1,
    )
    finished = comparison.run(
        plan,
        directory,
        workers=campaigns.cores(workers),
        on_search=lambda done, total, text: output.say(f"{done}/{total} {text}"),
    )
    found = comparison.results(plan, directory)
    rows = comparison.table(found, budget)
    picture = directory / "comparison.png"
    write_searches({Path(scenario).stem: comparison.curves(found)}, budget, picture)
    if style == "json":
        output.print_json(
            {
                "finished": finished,
                "budget": budget,
                "samplers": app.finite(rows),
                "picture": str(picture),
            }
        )
    else:
        _print_comparison(rows)
        output.say(f"picture    {picture}")
    return ExitCode.DONE if finished else ExitCode.INTERRUPTED


def _print_comparison(rows: list[dict[str, Any]]) -> None:
    table = Table(box=None, pad_edge=False, show_edge=False, header_style="bold")
    for name in (
        "sampler",
        "searches",
        "found",
        "simulations to failure",
        "median",
        "per failure",
        "seconds",
        "log-rank p",
        "modes/1000",
    ):
        table.add_column(name, justify="left" if name == "sampler" else "right")
    for row in rows:
        rate, mean = row["falsification_rate"], row["simulations_to_failure"]["restricted_mean"]
        half = row["simulations_to_failure"]["median"]
        table.add_row(
            row["sampler"],
            str(row["searches"]),
            f"{rate['value']:.0%} [{rate['low']:.0%}, {rate['high']:.0%}]",
            f"{mean['value']:.1f} [{mean['low']:.1f}, {mean['high']:.1f}]",
            _number(half),
            _number(row["simulations_per_failure"]["value"]),
            f"{row['seconds_to_failure']:.0f}",
            f"{row['log_rank_p']:.3g}",
            f"{row['modes_per_1000']:.1f}",
        )
    output.stdout().print(table)


def _number(value: float) -> str:
    return f"{value:.0f}" if value < float("inf") else "beyond the budget"


@main.command()
@click.argument("directory", type=FILE)
@click.option(
    "-o", "--output", "path", type=FILE, metavar="FILE.html", help="Default: DIR/report.html."
)
@click.option("--junit", type=FILE, metavar="FILE.xml", help="Also as JUnit XML.")
@click.option("--markdown", type=FILE, metavar="FILE.md", help="Also as Markdown.")
@click.option(
    "--against", type=FILE, metavar="DIR2", help="Compare with a campaign on another stack."
)
@count_option(
    "--cases",
    1,
    1000,
    default=20,
    text="Failures to show in full at most, as far as the page has room.",
)
def report(
    directory: Path,
    path: Path | None,
    junit: Path | None,
    markdown: Path | None,
    against: Path | None,
    cases: int,
) -> int:
    """Write the failure report of a campaign: one HTML file that opens from disk.

    Shows what is stored, also what `replay --verify`, `explain` and `minimize` have found.
    """
    from mrta_falsify.verbs import campaign as campaigns
    from mrta_falsify.verbs import report as reporting
    from mrta_falsify.verbs import run as app

    opened = campaigns.open_campaign(directory)
    other = campaigns.open_campaign(against) if against is not None else None
    target = path or directory / "report.html"
    for file in (target, junit, markdown):
        if file is not None:
            app.make_directory(file.parent)
    written = [reporting.write_report(opened, target, against=other, cases=cases)]
    if junit is not None:
        junit.write_text(reporting.junit_report(opened), encoding="utf-8")
        written.append(junit)
    if markdown is not None:
        markdown.write_text(reporting.markdown_report(opened, against=other), encoding="utf-8")
        written.append(markdown)
    for file in written:
        click.echo(str(file))
    return ExitCode.DONE
