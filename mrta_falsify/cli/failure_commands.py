"""The commands on stored failures: explain, minimize, family, corpus."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from mrta_falsify.campaigns.settings import TrialSettings
from mrta_falsify.cli import output
from mrta_falsify.cli.door import ExitCode
from mrta_falsify.cli.group import main
from mrta_falsify.cli.options import (
    FILE,
    count_option,
    format_option,
    output_option,
    setting_option,
    stack_options,
    trial_arguments,
    workers_option,
)

if TYPE_CHECKING:
    from mrta_falsify.verbs.corpus import Recheck
    from mrta_falsify.verbs.explain import Explanation


@main.command("explain")
@trial_arguments
@count_option(
    "--max-runs",
    1,
    1000,
    default=40,
    text="Re-runs at most: one per changed layer, the rest with small differences.",
)
@format_option
def explain_command(directory: Path, id: str, max_runs: int, style: str) -> int:
    """Ask which layer a failure belongs to, by re-runs with one thing changed before its onset.

    The answer is kept beside the trial and shown by `report`.
    """
    from mrta_falsify.verbs.stored_failures import explain_trial

    found = explain_trial(directory, id, max_runs, on_done=output.say)
    if style == "json":
        output.print_json(found)
    else:
        _print_explanation(found)
    return ExitCode.DONE


def _print_explanation(found: Explanation) -> None:
    from mrta_falsify.verbs.explain import removal_text

    out = output.stdout()
    out.print(f"suspected layer: {found.layer or 'none'} ({found.reason})")
    if found.guess != found.layer:
        out.print(f"the trace alone points to: {found.guess or 'none'}")
    table = output.new_table(f"changed at {found.changed_at:.1f} s", "failure", "then")
    for row in found.counterfactuals:
        table.add_row(row.change, "gone" if row.failure_gone else "stays", row.detail)
    output.print_table(table)
    for removal in found.removals:
        out.print(removal_text(removal))
    if found.jittered["runs"]:
        out.print(
            f"with small differences it fails in {found.jittered['failed']} of "
            f"{found.jittered['runs']} runs"
        )


@main.command("minimize")
@trial_arguments
@count_option(
    "--max-runs",
    1,
    10000,
    default=100,
    text="Simulations at most; a second call with more goes on.",
)
@workers_option
@format_option
def minimize_command(
    directory: Path, id: str, max_runs: int, workers: int | None, style: str
) -> int:
    """Find the smallest world that fails in the same way.

    Removes people, furniture, events, robots and tasks, shortens the run and moves values to
    nominal, as long as the failure keeps its signature. Writes world.min.json, the same as a
    Scenic program world.min.scenic, and trace.min.zip beside the trial; `report` shows them
    beside the original.
    """
    from mrta_falsify.verbs.minimize.minimising import summary
    from mrta_falsify.verbs.stored_failures import minimize_trial
    from mrta_falsify.verbs.stored_trials import open_campaign

    campaign = open_campaign(directory)
    record = campaign.record(id)
    with output.progress(f"minimize {record.id}", max_runs, "runs") as on_progress:
        found = minimize_trial(
            directory,
            id,
            max_runs,
            workers=workers,
            on_run=lambda runs, text: on_progress(runs),
        )
    if style == "json":
        output.print_json({"id": record.id, **summary(found)})
        return ExitCode.DONE
    out = output.stdout()
    out.print(f"failure    {found.signature}")
    for group, (before, after) in found.counts.items():
        if before:
            out.print(f"{group:10} {before} -> {after}")
    state = "1-minimal: nothing single can go" if found.one_minimal else "stopped by --max-runs"
    out.print(f"runs       {found.runs}; {state}")
    folder = campaign.folder(record)
    world, program = folder / "world.min.json", folder / "world.min.scenic"
    out.print(f"world      {world}")
    if program.is_file():
        out.print(f"program    {program}")
    stack = folder / "stack.yaml"
    again = shlex.join(["mrta-falsify", "run", str(world), "--stack", str(stack)])
    out.print(f"run it     {again}")
    return ExitCode.DONE


@main.command("family")
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
@output_option("FILE.scenic", "The program of the family; default: family.scenic beside the trial.")
@format_option
def family_command(directory: Path, id: str, max_runs: int, style: str, **options: Any) -> int:
    """Find the rule behind a failure: which dimensions matter, and how far they may move.

    Prints the rule in the program's units with its precision on fresh samples, and writes it
    as a Scenic program that samples inside the family. Kept beside the trial; `report` shows it.
    A call that was interrupted goes on when it is given again.
    """
    path = options["output"]
    if path is not None and path.suffix != ".scenic":
        raise click.UsageError(f"-o {path}: a Scenic program's name ends with .scenic")
    from mrta_falsify.verbs.family.rule import rule_lines, sentence, summary
    from mrta_falsify.verbs.stored_failures import family_of_trial
    from mrta_falsify.verbs.stored_trials import show_trial

    record = show_trial(directory, id)
    with output.progress(f"family {record.id}", max_runs, "runs") as on_progress:
        found = family_of_trial(directory, id, max_runs, on_run=on_progress, **options)
    if style == "json":
        output.print_json({"id": record.id, **summary(found)})
        return ExitCode.DONE
    out = output.stdout()
    out.print(f"failure    {found.signature}")
    out.print("rule       it fails like this when")
    for line in rule_lines(found):
        out.print(f"             {line}")
    out.print(f"precision  {sentence(found)}")
    runs = found.learning_runs + found.precision.trials
    out.print(f"runs       {runs}, {found.learning_runs} of them to learn the rule")
    out.print(f"program    {found.program}")
    again = shlex.join(["mrta-falsify", "sample", found.program, "-o", "family_samples"])
    out.print(f"see it     {again}")
    return ExitCode.DONE


@main.command("corpus")
@click.argument("directory", type=FILE)
@stack_options
@setting_option(
    TrialSettings,
    "jittered",
    default=2,
    text="Runs beside each failure with starts, pace and times a little different.",
)
@format_option
def corpus_command(directory: Path, style: str, **options: Any) -> int:
    """Run all stored failures of a campaign on a changed stack: fixed, still failing, flaky.

    Exit code 0 if all are fixed, 1 otherwise. Without --stack and --set the campaign's own
    stack is run.
    """
    from mrta_falsify.verbs.corpus import summary
    from mrta_falsify.verbs.stored_failures import recheck_corpus
    from mrta_falsify.verbs.stored_trials import list_trials

    done: list[str] = []
    total = len(list_trials(directory, failed=True))
    with output.progress("corpus", total, "failures") as on_progress:

        def on_done(row: Recheck) -> None:
            done.append(row.id)
            on_progress(len(done))

        rows = recheck_corpus(directory, on_done=on_done, **options)
    data = summary(rows)
    if style == "json":
        output.print_json(data)
    else:
        _print_rechecks(rows)
        output.stdout().print(
            ", ".join(f"{data[fate]} {fate}" for fate in ("fixed", "still failing", "flaky"))
        )
    return ExitCode.DONE if data["fixed"] == len(rows) else ExitCode.VIOLATED


def _print_rechecks(rows: tuple[Recheck, ...]) -> None:
    table = output.new_table("id", "fate", "was", "now", "jittered")
    for row in rows:
        failing = f"{row.jittered_failures} of {row.jittered} fail"
        style = None if row.fate == "fixed" else "red"
        table.add_row(row.id, row.fate, row.signature, row.signature_now, failing, style=style)
    output.print_table(table)
