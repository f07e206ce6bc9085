"""The commands that begin: campaign, init."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import click

from mrta_falsify.cli import output
from mrta_falsify.cli.campaign_output import CampaignWatch, print_campaign, say_interrupted
from mrta_falsify.cli.exits import ExitCode
from mrta_falsify.cli.group import main
from mrta_falsify.cli.names import SCENARIO, component
from mrta_falsify.cli.options import (
    FILE,
    RUN_OPTIONS,
    Duration,
    against_option,
    campaign_options,
    confirm_option,
    format_option,
    output_option,
    param_option,
    spec_option,
    stack_options,
    then_option,
    trust_option,
    workers_option,
)

if TYPE_CHECKING:
    from mrta_falsify.commands.campaign import CampaignResult


@main.command("campaign")
@click.argument("scenario", required=False, type=SCENARIO)
@output_option("DIR", "Directory of the new campaign; it must be empty or missing.")
@click.option(
    "--resume",
    type=FILE,
    metavar="DIR",
    help="Directory of a campaign to continue, with its own budget unless --budget is given.",
)
@campaign_options
@click.option(
    "--for",
    "wall_clock",
    type=Duration(),
    default=0.0,
    metavar="TIME",
    help=(
        "Time by the clock after which no trial begins, for example 8h or 30m. With --budget, "
        "the first limit reached ends the search."
    ),
)
@workers_option
@click.option(
    "--executor",
    type=component("executor"),
    metavar="NAME",
    help="Executor of the trials: `processes` (default), `serial` or `dask`. It changes no result.",
)
@stack_options
@against_option
@spec_option
@then_option
@confirm_option
@param_option
@trust_option
@click.option(
    "--dry-run",
    is_flag=True,
    help="Run two trials, store nothing, and estimate the cost of the budget.",
)
@format_option
@click.pass_context
def campaign_command(
    context: click.Context,
    /,
    scenario: str | None,
    resume: Path | None,
    dry_run: bool,
    style: str,
    **options: Any,
) -> int:
    """Search a Scenic program for worlds in which the stack violates a specification.

    SCENARIO is a Scenic program (.scenic) or the name of a shipped one. Everything found is
    kept in DIR and survives Ctrl-C and kill -9; --resume goes on where it stopped.
    """
    directory, trust = options["output"], options.pop("trust")
    if trust and resume is None:
        raise click.UsageError("--trust goes with --resume; what is named here is trusted")
    _check_usage(scenario, directory, resume, dry_run=dry_run)
    if resume is not None:
        result = _resume(resume, context)
    elif dry_run:
        return _dry_run(str(scenario), options, style)
    else:
        from mrta_falsify.commands.campaign import campaign

        if options["wall_clock"] and not _is_given(context, "budget"):
            options["budget"] = None
        output.say(f"compiling {scenario}")
        with CampaignWatch(directory) as watch:
            result = campaign(
                str(scenario),
                **options,
                on_record=watch.on_record,
                on_feedback=watch.on_feedback,
                on_note=watch.say,
            )
    if result.ended == "interrupted":
        say_interrupted(result)
    if style == "json":
        from mrta_falsify.commands.campaign_summary import summarise_campaign

        output.print_json(summarise_campaign(result))
    else:
        print_campaign(result)
    return _exit_code(result)


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
        raise click.UsageError("-o DIR is missing; give the directory that will hold the campaign")


def _resume(directory: Path, context: click.Context) -> CampaignResult:
    """Go on with a campaign; only what says how much of it is run, and on what, may be given."""
    given = {}
    for option in context.command.params:
        name = str(option.name)
        if not _is_given(context, name):
            continue
        if name in RUN_OPTIONS:
            given[name] = context.params[name]
        elif name not in ("resume", "style"):
            raise click.UsageError(
                f"{option.opts[-1]} cannot be changed by --resume: it belongs to the campaign"
            )
    from mrta_falsify.commands.campaign import resume_campaign

    with CampaignWatch(directory) as watch:
        return resume_campaign(
            directory,
            **given,
            on_record=watch.on_record,
            on_feedback=watch.on_feedback,
            on_note=watch.say,
        )


def _is_given(context: click.Context, name: str) -> bool:
    return context.get_parameter_source(name) is click.core.ParameterSource.COMMANDLINE


def _dry_run(scenario: str, options: dict[str, Any], style: str) -> int:
    from mrta_falsify.commands.campaign_settings import new_settings
    from mrta_falsify.commands.estimate import crowd_of, estimate_cost

    output.say(f"compiling {scenario}")
    settled = {name: value for name, value in options.items() if name not in RUN_OPTIONS}
    settings = new_settings(scenario, **{**settled, "output": Path()})
    budget = options["budget"]
    crowd = crowd_of(settings)
    if crowd:
        output.say(f"{crowd}; two such trials are run now")
    found = estimate_cost(settings, budget, workers=options["workers"])
    if style == "json":
        output.print_json(found)
        return ExitCode.DONE
    click.echo(
        f"{budget} trials over {found.dimensions} dimensions: about {found.hours:.2f} h "
        f"({found.trial_s:.1f} s each) and {found.megabytes:.0f} MB; nothing was stored"
    )
    return ExitCode.DONE


def _exit_code(result: CampaignResult) -> int:
    progress = result.progress
    if result.ended == "interrupted":
        return ExitCode.INTERRUPTED
    if progress.own_failures:
        return ExitCode.VIOLATED
    nothing_ran = progress.errors and progress.errors == progress.ran
    return ExitCode.HARNESS if nothing_ran else ExitCode.DONE


@main.command("init")
@click.argument("directory", type=FILE, default=".")
@click.option(
    "--stack",
    type=click.Choice(["python", "cpp"]),
    help="Language of a stack template to write as well.",
)
def init_command(directory: Path, stack: Literal["python", "cpp"] | None) -> int:
    """Write a first scenario and stack file into DIRECTORY (default: here)."""
    from mrta_falsify.commands.init import init

    written = init(directory, stack)
    for path in written:
        click.echo(str(path))
    scenario, config = (shlex.quote(str(path)) for path in written[:2])
    if stack == "cpp":
        folder = shlex.quote(str(directory))
        output.say(f"build: c++ -std=c++17 -O2 -o {folder}/my_stack {folder}/my_stack.cpp")
    output.say(f"try: mrta-falsify check {scenario}")
    output.say(f"then: mrta-falsify campaign {scenario} --stack {config} -o runs/first")
    return ExitCode.DONE
