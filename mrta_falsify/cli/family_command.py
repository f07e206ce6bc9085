"""The command `family`."""

from __future__ import annotations

import shlex
from pathlib import Path

import click

from mrta_falsify.cli import output
from mrta_falsify.cli.door import ExitCode
from mrta_falsify.cli.options import FILE, count_option, format_option, trial_arguments
from mrta_falsify.cli.run_commands import main


@main.command()
@trial_arguments
@count_option(
    "--max-runs",
    10,
    10000,
    default=300,
    text="Simulations at most, fresh samples and those of earlier calls included.",
)
@count_option(
    "--fresh",
    1,
    10000,
    default=100,
    text="Samples on which the rule is tested; at most half of --max-runs.",
)
@click.option(
    "-o",
    "--output",
    "path",
    type=FILE,
    metavar="FILE.scenic",
    help="The program of the family; default: family.scenic beside the trial.",
)
@format_option
def family(
    directory: Path, name: str, max_runs: int, fresh: int, path: Path | None, style: str
) -> int:
    """Find the rule behind a failure: which dimensions matter, and how far they may move.

    Prints the rule in the program's units with its precision on fresh samples, and writes it
    as a Scenic program that samples inside the family. Kept beside the trial; `report` shows it.
    A call that was interrupted goes on when it is given again.
    """
    if path is not None and path.suffix != ".scenic":
        raise click.UsageError(f"-o {path}: a Scenic program's name ends with .scenic")
    from mrta_falsify.core.findings import finding_data
    from mrta_falsify.verbs import campaign as campaigns
    from mrta_falsify.verbs import family as families

    opened = campaigns.open_campaign(directory)
    record = opened.record(name)
    with output.progress(f"family {record.id}", max_runs, "runs") as report_progress:
        found = families.find_family(
            opened, record, max_runs=max_runs, fresh=fresh, path=path, on_run=report_progress
        )
    if style == "json":
        output.print_json({"id": record.id, **finding_data(found)})
        return ExitCode.DONE
    out = output.stdout()
    out.print(f"failure    {found.signature}")
    out.print("rule       it fails like this when")
    for line in found.rule:
        out.print(f"             {line}")
    out.print(f"precision  {found.sentence}")
    runs = found.learning_runs + found.precision.trials
    out.print(f"runs       {runs}, {found.learning_runs} of them to learn the rule")
    out.print(f"program    {found.program}")
    again = shlex.join(["mrta-falsify", "sample", found.program, "-o", "family_samples"])
    out.print(f"see it     {again}")
    return ExitCode.DONE
