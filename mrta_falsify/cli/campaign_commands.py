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
from mrta_falsify.cli.door import ExitCode
from mrta_falsify.cli.options import (
    FILE,
    FiniteRange,
    format_option,
    jittered_option,
    param_option,
    spec_option,
    stack_options,
    workers_option,
)
from mrta_falsify.cli.run_commands import main

if TYPE_CHECKING:
    from mrta_falsify.campaigns.runner import Progress as Counts
    from mrta_falsify.campaigns.settings import CampaignSettings
    from mrta_falsify.core.record import TrialRecord
    from mrta_falsify.verbs.campaign import Result


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
@workers_option
@click.option("--executor", metavar="NAME", help="Instead of local processes.")
@stack_options
@spec_option
@param_option
@click.option("--stop-after", type=click.IntRange(min=1), metavar="K", help="Failures to stop at.")
@click.option(
    "--screen", is_flag=True, help="Kinematic engine first; physics only confirms what fails there."
)
@jittered_option(
    0,
    "Runs of each failing world with small differences; then the search goes for failures that "
    "most of them share, and only these count for --stop-after.",
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
    help="Wall clock of one trial, its copies included, after which it is killed.",
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
    jittered: int,
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
    from mrta_falsify.campaigns.settings import Limits
    from mrta_falsify.campaigns.store import Store
    from mrta_falsify.core.config import Choice
    from mrta_falsify.verbs import campaign as campaigns
    from mrta_falsify.verbs import run as app

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
            jittered=jittered,
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
    from mrta_falsify.core import codec
    from mrta_falsify.verbs import init as beginning

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
    from mrta_falsify.verbs import init as beginning

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
        "jittered",
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
    told: set[str] = set()

    def on_record(record: TrialRecord, is_new: bool) -> None:
        if record.failed and "failure" not in told and (record.wanted or not told):
            kind = "failure" if record.wanted else "knife edge"
            told.add(kind)
            copies = f" ({record.jittered})" if record.jittered else ""
            console.print(f"first {kind}: trial {record.id}, {record.signature}{copies}")
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
    if data["robust"] is not None:
        out.print(
            f"with small differences most copies fail too: {data['robust']} of {data['failed']} "
            "failures"
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
        estimate = "unknown" if chance["estimate"] is None else f"{chance['estimate']:.3g}"
        out.print(
            f"probability of a violation: {estimate}, "
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
    from mrta_falsify.verbs import campaign as campaigns
    from mrta_falsify.verbs import run as app

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
        with_copies = any(row["jittered"] for row in found)
        if with_copies:
            table.add_column("copies that fail")
        for row in found:
            copies = f"{row['jittered_failures']} of {row['jittered']}" if row["jittered"] else ""
            score = f"{row['score']:+.3f}" if row["status"] == "ok" else ""
            table.add_row(
                row["id"],
                row["status"],
                score,
                row["signature"],
                row["layer"],
                f"{row['sim_time_s']:.1f} s",
                *([copies] if with_copies else []),
                style="red" if row["failed"] else None,
            )
        output.stdout().print(table)
    return ExitCode.DONE
