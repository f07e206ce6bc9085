"""The command ``compare``."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import click

from mrta_falsify.campaigns.settings import Limits, TrialSettings
from mrta_falsify.cli import output
from mrta_falsify.cli.exits import ExitCode
from mrta_falsify.cli.group import main
from mrta_falsify.cli.names import SCENARIO
from mrta_falsify.cli.options import (
    Listing,
    WholeRange,
    format_option,
    output_option,
    param_option,
    seed_option,
    setting_option,
    spec_option,
    stack_options,
    workers_option,
)

if TYPE_CHECKING:
    from mrta_falsify.commands.search_outcomes import SamplerRow


@main.command("compare")
@click.argument("scenario", type=SCENARIO)
@click.option(
    "--samplers",
    type=Listing(str, "names of samplers, as random,auto"),
    default="random,auto",
    show_default=True,
    metavar="A,B,...",
    help="Samplers to compare, for example random,auto; the first one is the reference.",
)
@click.option(
    "--repeats",
    type=WholeRange(min=1),
    default=10,
    show_default=True,
    metavar="N",
    help="Number of searches of each sampler.",
)
@setting_option(Limits, "budget", text="Number of simulations of each search.")
@seed_option("Seed of the first repeat; repeats use consecutive seeds.")
@click.option(
    "--all-failures",
    is_flag=True,
    help=(
        "Run each search to the end of its budget and count failure modes, instead of "
        "stopping at the first failure."
    ),
)
@setting_option(
    TrialSettings,
    "jittered",
    text=(
        "Number of perturbed runs (small differences) of each failing world; a failure counts "
        "if most of them fail."
    ),
)
@workers_option
@stack_options
@spec_option
@param_option
@output_option("DIR", "Directory of the searches and the comparison.", required=True)
@click.option("--resume", is_flag=True, help="Continue the comparison in the output directory.")
@format_option
def compare_command(scenario: str, style: str, **options: Any) -> int:
    """Compare samplers: falsification rate, simulations to the first failure, failure modes."""
    from mrta_falsify.commands.compare import compare

    found = compare(
        scenario,
        **options,
        on_search=lambda done, total, text: output.say(f"{done}/{total} {text}"),
    )
    if style == "json":
        output.print_json(found)
    else:
        _print_samplers(found.samplers)
        output.say(f"picture    {found.picture}")
    return ExitCode.DONE


def _print_samplers(rows: tuple[SamplerRow, ...]) -> None:
    numbers = (
        "found",
        "runs to\nfailure",
        "median",
        "per\nfailure",
        "time\n[s]",
        "p",
        "modes\nper\n1000",
    )
    table = output.new_table("sampler", *numbers, right=numbers, whole=("sampler",))
    for row in rows:
        rate, mean = row.falsification_rate, row.simulations_to_failure.restricted_mean
        found = round(rate.value * row.searches)
        table.add_row(
            row.sampler,
            f"{found} of {row.searches}\n[{rate.low:.0%}, {rate.high:.0%}]",
            f"{mean.value:.1f}\n[{mean.low:.0f}, {mean.high:.0f}]",
            _number(row.simulations_to_failure.median),
            _number(row.simulations_per_failure.value),
            f"{row.seconds_to_failure:.0f}",
            f"{row.log_rank_p:.2g}",
            f"{row.modes_per_1000:.1f}",
        )
    output.print_table(table)


def _number(value: float) -> str:
    return f"{value:.0f}" if math.isfinite(value) else "> budget"
