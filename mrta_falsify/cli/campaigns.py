"""The commands around campaigns, from `campaign` to `report`."""

from __future__ import annotations

import csv
import shlex
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import click
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.table import Table

from mrta_falsify.cli import output
from mrta_falsify.cli.commands import main
from mrta_falsify.cli.door import ExitCode
from mrta_falsify.cli.options import (
    FILE,
    FiniteRange,
    count_option,
    format_option,
    param_option,
    spec_option,
    stack_options,
    trial_arguments,
)

if TYPE_CHECKING:
    from mrta_falsify.campaign.runner import Progress as Counts
    from mrta_falsify.campaign.settings import CampaignSettings
    from mrta_falsify.campaigns import Replay, Result
    from mrta_falsify.core.record import TrialRecord


@main.command()
@click.argument("scenario", required=False)
@click.option("-o", "--output", "directory", type=FILE, metavar="DIR", help="A new directory.")
@click.option("--resume", type=FILE, metavar="DIR", help="Go on with this campaign.")
@click.option(
    "--budget",
    type=click.IntRange(min=1),
    default=100,
    show_default=True,
    help="Simulated candidates, those already stored included.",
)
@click.option("--sampler", metavar="NAME", help="See `mrta-falsify plugins`.")
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True)
@click.option(
    "--workers",
    type=click.IntRange(1, 512),
    help="Processes; default: one per core. Changes no result.",
)
@click.option("--executor", metavar="NAME", help="Instead of local processes.")
@stack_options
@spec_option
@param_option
@click.option("--stop-after", type=click.IntRange(min=1), metavar="K", help="Failures to stop at.")
@click.option(
    "--screen", is_flag=True, help="Kinematic engine first; physics only confirms what fails there."
)
@click.option(
    "--mode",
    type=click.Choice(("repair", "exact")),
    default="repair",
    show_default=True,
    help="repair mends rejected scenes; exact keeps Scenic's distribution.",
)
@click.option(
    "--time-limit",
    type=FiniteRange(min=1.0),
    default=300.0,
    show_default=True,
    metavar="SECONDS",
    help="Wall clock of one trial, after which it is killed.",
)
@click.option("--dry-run", is_flag=True, help="Run two trials, store nothing, say what it costs.")
@format_option
def campaign(
    scenario: str | None,
    directory: Path | None,
    resume: Path | None,
    budget: int,
    sampler: str | None,
    seed: int,
    workers: int | None,
    executor: str | None,
    stack: Path | None,
    settings: tuple[str, ...],
    specs: tuple[str, ...],
    params: tuple[str, ...],
    stop_after: int | None,
    screen: bool,
    mode: Literal["repair", "exact"],
    time_limit: float,
    dry_run: bool,
    style: str,
) -> int:
    """Search a Scenic program for worlds in which the stack violates a specification.

    SCENARIO is a Scenic program (.scenic) or the name of a shipped one. Everything found is
    kept in DIR and survives Ctrl-C and kill -9; --resume goes on where it stopped.
    """
    _check_usage(scenario, directory, resume, dry_run=dry_run)
    from mrta_falsify import app, campaigns  # noqa: PLC0415 - loads the whole stack
    from mrta_falsify.campaign.settings import Limits  # noqa: PLC0415
    from mrta_falsify.campaign.store import Store  # noqa: PLC0415
    from mrta_falsify.core.config import Choice  # noqa: PLC0415

    limits = Limits(budget=budget, stop_after=stop_after or 0)
    where = campaigns.chosen_executor(executor, workers)
    if resume is not None:
        _refuse_with_resume(click.get_current_context())
        store = Store.resume(resume)
    else:
        assert scenario is not None
        output.say(f"compiling {scenario}")
        chosen = campaigns.new_settings(
            scenario,
            directory=directory or Path(),
            config=app.load_stack(stack, settings),
            params=campaigns.parse_params(params),
            sampler=Choice(sampler) if sampler else None,
            seed=seed,
            specifications=specs,
            mode=mode,
            screen=screen,
            time_limit=time_limit,
        )
        if dry_run:
            return _dry_run(chosen, budget, workers, style)
        assert directory is not None
        store = Store.create(directory, chosen)
    with store, live(store.directory, budget) as (on_record, on_told):
        result = campaigns.run(store, limits, where, on_record=on_record, on_told=on_told)
    data = campaigns.summary(result)
    if style == "json":
        output.print_json(app.finite(data))
    else:
        print_summary(data)
    return _exit_code(result)


def _dry_run(chosen: CampaignSettings, budget: int, workers: int | None, style: str) -> int:
    from mrta_falsify import beginning  # noqa: PLC0415
    from mrta_falsify.core import codec  # noqa: PLC0415

    found = beginning.estimate(chosen, budget, workers=workers)
    if style == "json":
        output.print_json({"budget": budget, **codec.encode(found)})
        return ExitCode.DONE
    click.echo(
        f"{budget} trials over {found.dimensions} dimensions: about {found.hours:.2f} h "
        f"({found.trial_s:.1f} s each) and {found.megabytes:.0f} MB; nothing was stored"
    )
    return ExitCode.DONE


@main.command()
@click.argument("directory", type=FILE, default=Path())
def init(directory: Path) -> int:
    """Write a scenario and a stack file to begin with into DIRECTORY (default: here)."""
    from mrta_falsify import beginning  # noqa: PLC0415

    for path in beginning.write_start(directory):
        click.echo(str(path))
    scenario = directory / "my_scenario.scenic"
    stack = directory / "stack.yaml"
    output.say(f"try: mrta-falsify check {shlex.quote(str(scenario))}")
    output.say(
        f"then: mrta-falsify campaign {shlex.quote(str(scenario))} --stack "
        f"{shlex.quote(str(stack))} -o runs/first"
    )
    return ExitCode.DONE


def _check_usage(
    scenario: str | None, directory: Path | None, resume: Path | None, *, dry_run: bool
) -> None:
    if resume is not None and (scenario or directory):
        raise click.UsageError("--resume DIR takes neither SCENARIO nor -o")
    if resume is not None and dry_run:
        raise click.UsageError("--dry-run is about a new campaign; give a SCENARIO, not --resume")
    if resume is None and scenario is None:
        raise click.UsageError("give a SCENARIO with -o DIR, or --resume DIR")
    if resume is None and directory is None and not dry_run:
        raise click.UsageError("-o DIR is missing: where to keep what is found")


def _refuse_with_resume(context: click.Context) -> None:
    fixed = (
        "sampler",
        "seed",
        "stack",
        "settings",
        "specs",
        "params",
        "screen",
        "mode",
        "time_limit",
    )
    for name in fixed:
        given = context.get_parameter_source(name)
        if given is click.core.ParameterSource.COMMANDLINE:
            option = {"settings": "set", "specs": "spec", "params": "param"}.get(name, name)
            raise click.UsageError(
                f"--{option.replace('_', '-')} cannot be changed by --resume: it belongs to the "
                "campaign"
            )


def _exit_code(result: Result) -> int:
    if result.ended == "interrupted":
        return ExitCode.INTERRUPTED
    progress = result.progress
    if progress.failed:
        return ExitCode.VIOLATED
    return (
        ExitCode.HARNESS if progress.errors and progress.errors == progress.ran else ExitCode.DONE
    )


@contextmanager
def live(
    directory: Path, budget: int
) -> Iterator[tuple[Callable[[TrialRecord, bool], None], Callable[[TrialRecord, Counts], None]]]:
    """Progress on stderr: a bar on terminals, a line now and then elsewhere."""
    console = Console(stderr=True, markup=False, highlight=False, emoji=False)
    columns = (
        TextColumn("{task.completed:.0f}/{task.total:.0f} trials"),
        BarColumn(bar_width=20),
        TextColumn("{task.fields[counts]}"),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
    )
    first: list[str] = []

    def on_record(record: TrialRecord, is_new: bool) -> None:
        if record.failed and not first:
            first.append(record.id)
            console.print(f"first failure: trial {record.id}, {record.signature}")
            console.print(
                f"  replay it by: mrta-falsify replay {shlex.quote(str(directory))} {record.id}"
            )
        if is_new and record.status in ("crashed", "timeout"):
            reason = record.error.strip().splitlines()[-1]
            console.print(f"trial {record.id} is an error, not a verdict: {reason}")

    with Progress(
        *columns, console=console, transient=True, disable=not console.is_terminal
    ) as bar:
        task = bar.add_task("campaign", total=budget, counts="")
        step = max(1, budget // 10)

        def on_told(record: TrialRecord, counts: Counts) -> None:
            text = _counts(counts)
            bar.update(task, completed=counts.ran, counts=text)
            if not console.is_terminal and counts.ran % step == 0 and record.status != "rejected":
                console.print(f"{counts.ran}/{budget} trials, {text}")

        yield on_record, on_told


def _counts(counts: Counts) -> str:
    failures = ", ".join(f"{n} {name}" for name, n in sorted(counts.by_specification.items()))
    best = f"best score {counts.best:+.3f}" if counts.best < float("inf") else "no score yet"
    parts = [f"{counts.failed} failed" + (f" ({failures})" if failures else ""), best]
    if counts.rejected:
        parts.append(f"{counts.rejected} rejected")
    if counts.errors:
        parts.append(f"{counts.errors} errors")
    return ", ".join(parts)


def print_summary(data: dict[str, Any]) -> None:
    """What a campaign found, as text."""
    out = output.stdout()
    out.print(
        f"{data['ran']} trials ({data['sim_hours']:.2f} h simulated in {data['wall_s']:.0f} s), "
        f"{data['failed']} failed, {data['rejected']} scenes rejected, {data['errors']} errors; "
        f"ended: {data['ended']}"
    )
    if data["screening"]:
        agreed = data["screening"]
        out.print(
            f"screening: physics confirmed {agreed['confirmed']} of "
            f"{agreed['failed_in_screening']} failures of the kinematic engine"
        )
    if data["modes"]:
        table = Table(box=None, pad_edge=False, show_edge=False, header_style="bold")
        table.add_column("failure mode")
        table.add_column("trials", justify="right")
        table.add_column("ids")
        for mode in data["modes"]:
            shown = ", ".join(mode["ids"][:6]) + (" ..." if len(mode["ids"]) > 6 else "")
            table.add_row(mode["signature"], str(mode["count"]), shown)
        out.print(table)
        first = data["modes"][0]["ids"][0]
        out.print(f"replay: mrta-falsify replay {shlex.quote(data['directory'])} {first}")
    elif data["best_score"] is not None:
        out.print(f"no violation found; closest call: score {data['best_score']:+.3f}")
    chance = data["probability"]
    if "why_not" not in chance and chance["trials"]:
        out.print(
            f"probability of a violation: {chance['estimate']:.3g}, "
            f"{chance['level']:.0%} interval [{chance['low']:.3g}, {chance['high']:.3g}] "
            f"({chance['method']})"
        )
        if chance["note"]:
            out.print(f"  {chance['note']}")
    out.print(f"campaign: {data['directory']}")


# --- reading -------------------------------------------------------------------------------


@main.command("list")
@click.argument("directory", type=FILE)
@click.option("--failed", is_flag=True, help="Only trials that violate a specification.")
@click.option(
    "--format",
    "style",
    type=click.Choice(("table", "json", "csv")),
    default="table",
    show_default=True,
)
def list_(directory: Path, failed: bool, style: str) -> int:
    """List the trials of a campaign."""
    from mrta_falsify import app, campaigns  # noqa: PLC0415

    found = campaigns.rows(campaigns.open_campaign(directory), failed_only=failed)
    if style == "json":
        output.print_json(app.finite(found))
    elif style == "csv":
        names = list(found[0]) if found else ["id", "status", "score", "signature", "failed"]
        writer = csv.DictWriter(sys.stdout, names)
        writer.writeheader()
        for row in found:
            writer.writerow({**row, "violated": " ".join(row["violated"])})
    else:
        table = Table(box=None, pad_edge=False, show_edge=False, header_style="bold")
        for name in ("id", "status", "score", "signature", "layer", "simulated"):
            table.add_column(name, justify="right" if name in ("score", "simulated") else "left")
        for row in found:
            score = f"{row['score']:+.3f}" if row["status"] == "ok" else ""
            table.add_row(
                row["id"],
                row["status"],
                score,
                row["signature"],
                row["layer"],
                f"{row['sim_time_s']:.1f} s",
                style="red" if row["failed"] else None,
            )
        output.stdout().print(table)
    return ExitCode.DONE


@main.command()
@trial_arguments
@format_option
def show(directory: Path, name: str, style: str) -> int:
    """Show one trial: verdicts, evidence, digests, how to replay it."""
    from mrta_falsify import campaigns  # noqa: PLC0415

    opened = campaigns.open_campaign(directory)
    record = opened.record(name)
    data = campaigns.shown(record)
    if style == "json":
        output.print_json(data)
        return ExitCode.DONE
    out = output.stdout()
    out.print(f"trial      {record.id}, {record.status}, engine {record.engine or 'none'}")
    out.print(f"score      {record.score:+.4f}")
    if record.signature:
        out.print(f"failure    {record.signature}")
    if record.error:
        out.print(f"error      {record.error.strip().splitlines()[-1]}")
    for verdict in record.verdicts:
        state = "violated" if verdict.violated else "holds"
        at = "" if verdict.violated_at is None else f" at {verdict.violated_at:.2f} s"
        who = f" by {', '.join(verdict.who)}" if verdict.who else ""
        out.print(f"  {verdict.spec:24} {state}{at}{who}, robustness {verdict.robustness:+.3g}")
    out.print(f"digests    world {record.world_digest[:16]}  trace {record.trace_digest[:16]}")
    out.print(f"time       {record.sim_time:.1f} s simulated, ended: {record.ended}")
    if record.trace_file:
        out.print(f"files      {opened.folder(record)}")
    out.print(f"replay     mrta-falsify replay {shlex.quote(str(directory))} {record.id}")
    return ExitCode.DONE


@main.command()
@trial_arguments
@count_option("--verify", 1, 1000, default=1, text="Run it so many times.")
@format_option
def replay(directory: Path, name: str, verify: int, style: str) -> int:
    """Run a stored trial again and compare digests. Exit code 1: they differ."""
    from mrta_falsify import campaigns  # noqa: PLC0415

    opened = campaigns.open_campaign(directory)
    result = campaigns.replay(opened, opened.record(name), times=verify)
    campaigns.store_replay(opened, result)
    if style == "json":
        output.print_json(
            {
                "id": result.record.id,
                "runs": len(result.runs),
                "identical": result.same_digest,
                "same_verdicts": result.same_verdicts,
                "same_machine": result.same_machine,
                "trace_digest": result.record.trace_digest,
                "trace_digests": [run.outcome.trace.digest for run in result.runs],
                "failed": [run.failed for run in result.runs],
                "signature": result.record.signature,
            }
        )
    else:
        _print_replay(result)
    return ExitCode.DONE if result.identical else ExitCode.VIOLATED


def _print_replay(result: Replay) -> None:
    out = output.stdout()
    record, runs = result.record, len(result.runs)
    out.print(f"{result.same_digest} of {runs} identical to trial {record.id} (trace digest)")
    if record.signature:
        out.print(f"failure    {record.signature}")
    if result.identical:
        return
    out.print(f"{result.same_verdicts} of {runs} have the same violations at the same times")
    if not result.same_machine:
        out.print("the record comes from other versions or another kind of machine (see `show`)")


# --- a changed stack, other samplers --------------------------------------------------------


@main.command()
@click.argument("directory", type=FILE)
@stack_options
@count_option(
    "--jittered",
    0,
    100,
    default=2,
    text="Runs beside each failure with starts, pace and times a little different.",
)
@format_option
def corpus(
    directory: Path, stack: Path | None, settings: tuple[str, ...], jittered: int, style: str
) -> int:
    """Run all stored failures of a campaign on a changed stack: fixed, still failing, flaky.

    Exit code 0 if all are fixed, 1 otherwise. Without --stack and --set the campaign's own
    stack is run.
    """
    from mrta_falsify import app, campaigns  # noqa: PLC0415
    from mrta_falsify import corpus as corpora  # noqa: PLC0415

    opened = campaigns.open_campaign(directory)
    config = app.load_stack(stack, settings) if stack or settings else None
    total = sum(record.failed for record in opened.records)
    done: list[str] = []
    with output.progress("corpus", total, "failures") as report_progress:

        def on_done(row: Any) -> None:
            done.append(row.id)
            report_progress(len(done))

        rows = corpora.recheck(opened, config=config, jittered=jittered, on_done=on_done)
    data = corpora.summary(rows)
    if style == "json":
        output.print_json(data)
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
        out.print(", ".join(f"{data[fate]} {fate}" for fate in ("fixed", "still failing", "flaky")))
    all_fixed = data["fixed"] == len(rows)
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
@click.option("--workers", type=click.IntRange(1, 512))
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
    from mrta_falsify import app, campaigns, comparison  # noqa: PLC0415
    from mrta_falsify.core import registry  # noqa: PLC0415
    from reports.figure_searches import write_searches  # noqa: PLC0415

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
            f"{half:.0f}" if half < float("inf") else "more than the budget",
            f"{row['seconds_to_failure']:.0f}",
            f"{row['log_rank_p']:.3g}",
            f"{row['modes_per_1000']:.1f}",
        )
    output.stdout().print(table)


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
    from mrta_falsify import app, campaigns, reporting  # noqa: PLC0415

    opened = campaigns.open_campaign(directory)
    other = campaigns.open_campaign(against) if against is not None else None
    target = path or directory / "report.html"
    for file in (target, junit, markdown):
        if file is not None:
            app.make_directory(file.parent)
    written = [reporting.write(opened, target, against=other, cases=cases)]
    if junit is not None:
        junit.write_text(reporting.junit(opened), encoding="utf-8")
        written.append(junit)
    if markdown is not None:
        markdown.write_text(reporting.markdown(opened, against=other), encoding="utf-8")
        written.append(markdown)
    for file in written:
        click.echo(str(file))
    return ExitCode.DONE


@main.command()
@trial_arguments
@count_option(
    "--max-runs",
    1,
    1000,
    default=40,
    text="Re-runs at most: one per changed layer, the rest with small differences.",
)
@format_option
def explain(directory: Path, name: str, max_runs: int, style: str) -> int:
    """Ask which layer a failure belongs to, by re-runs with one thing changed before its onset.

    The answer is kept beside the trial and shown by `report`.
    """
    from mrta_falsify import campaigns, explaining  # noqa: PLC0415
    from mrta_falsify.core import codec  # noqa: PLC0415

    opened = campaigns.open_campaign(directory)
    found = explaining.explain(opened, opened.record(name), max_runs=max_runs, on_done=output.say)
    if style == "json":
        output.print_json(codec.encode(found))
        return ExitCode.DONE
    out = output.stdout()
    out.print(f"suspected layer: {found.layer or 'none'} ({found.reason})")
    if found.guess != found.layer:
        out.print(f"the trace alone points to: {found.guess or 'none'}")
    table = Table(box=None, pad_edge=False, show_edge=False, header_style="bold")
    for column in (f"changed at {found.changed_at:.1f} s", "failure", "then"):
        table.add_column(column)
    for row in found.counterfactuals:
        table.add_row(row.change, "gone" if row.failure_gone else "stays", row.detail)
    out.print(table)
    if found.jittered["runs"]:
        out.print(
            f"with small differences it fails in {found.jittered['failed']} of "
            f"{found.jittered['runs']} runs"
        )
    return ExitCode.DONE


@main.command()
@trial_arguments
@count_option(
    "--max-runs",
    1,
    10000,
    default=100,
    text="Simulations at most; a second call with more goes on.",
)
@format_option
def minimize(directory: Path, name: str, max_runs: int, style: str) -> int:
    """Find the smallest world that fails in the same way.

    Removes people, furniture, events, robots and tasks, shortens the run and moves values to
    nominal, as long as the failure keeps its signature. Writes world.min.json, the same as a
    Scenic program world.min.scenic, and trace.min.zip beside the trial; `report` shows them
    beside the original.
    """
    from mrta_falsify import campaigns, minimising  # noqa: PLC0415

    opened = campaigns.open_campaign(directory)
    record = opened.record(name)
    with output.progress(f"minimize {record.id}", max_runs, "runs") as report_progress:
        found = minimising.minimise(
            opened, record, max_runs=max_runs, on_run=lambda runs, text: report_progress(runs)
        )
    data = {"id": record.id, **minimising.summary(found)}
    if style == "json":
        output.print_json(data)
        return ExitCode.DONE
    out = output.stdout()
    out.print(f"failure    {found.signature}")
    for group, (before, after) in found.counts.items():
        if before:
            out.print(f"{group:10} {before} -> {after}")
    state = "1-minimal: nothing single can go" if found.one_minimal else "stopped by --max-runs"
    out.print(f"runs       {found.runs}; {state}")
    world, stack = opened.folder(record) / "world.min.json", opened.folder(record) / "stack.yaml"
    out.print(f"world      {world}")
    program = world.with_suffix(".scenic")
    if program.is_file():
        out.print(f"program    {program}")
    again = shlex.join(["mrta-falsify", "run", str(world), "--stack", str(stack)])
    out.print(f"run it     {again}")
    return ExitCode.DONE
