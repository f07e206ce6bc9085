"""The commands on stored failures: explain, certify, minimize, corpus."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from mrta_falsify.campaigns.settings import TrialSettings
from mrta_falsify.cli import output
from mrta_falsify.cli.exits import ExitCode
from mrta_falsify.cli.group import main
from mrta_falsify.cli.options import (
    FILE,
    FiniteRange,
    count_option,
    format_option,
    removed_option,
    run_option,
    setting_option,
    stack_options,
    trial_arguments,
    trust_option,
    workers_option,
)

if TYPE_CHECKING:
    from mrta_falsify.campaigns.foreign import Trust
    from mrta_falsify.commands.zoo import SceneCheck
    from mrta_falsify.core.findings import Explanation, Recheck


@main.command("explain")
@trial_arguments
@count_option(
    "--max-runs",
    1,
    1000,
    default=120,
    text=(
        "Largest number of runs: six for the stack as it is and six for each exchanged layer; "
        "for a foreign stack, also runs under other schedules and without "
        "single things."
    ),
)
@workers_option
@count_option(
    "--rewinds",
    0,
    10000,
    default=80,
    text=(
        "Largest number of further runs that repeat the failure from earlier and earlier "
        "moments, to find when it was decided; 0: none."
    ),
)
@click.option(
    "--keep",
    is_flag=True,
    help=(
        "Write a run of each exchange that removes the failure, and one of the stack as it "
        "is, beside the trial."
    ),
)
@trust_option
@format_option
def explain_command(
    directory: Path,
    id: str,
    max_runs: int,
    workers: int | None,
    rewinds: int,
    keep: bool,
    trust: Trust,
    style: str,
) -> int:
    """Find the layer that a failure belongs to, by runs with one layer exchanged before its onset.

    Then find the moment at which it was decided, by repeating the run from earlier and earlier
    moments.

    The answer is kept beside the trial and shown by `report`.
    """
    from mrta_falsify.commands.explain import explain_trial
    from mrta_falsify.commands.stored_trials import what_happened
    from mrta_falsify.commands.trust import open_to_run, permit_runs

    campaign = open_to_run(directory, trust)
    record = campaign.record(id)
    permit_runs(campaign, (record,), trust)  # before anything is told of what it costs
    runs = max_runs + rewinds
    is_foreign = campaign.settings.trials.stack.stack is not None  # it runs whole worlds
    if record.failed:
        output.say_cost(runs, record.wall_s, copies=not is_foreign)
    with output.progress(
        f"explain {record.id}", runs, "runs", is_most=True, first_apart=True
    ) as on_progress:
        found = explain_trial(
            directory,
            id,
            max_runs,
            rewinds=rewinds,
            keep=keep,
            workers=workers,
            trust=trust,
            on_done=on_progress,
        )
    if style == "json":
        output.print_json(found)
    else:
        for text in what_happened(campaign, record):
            output.stdout().print(text)
        _print_explanation(found)
        kept = sorted((campaign.folder(record) / "explain").glob("*/report.html")) if keep else []
        for page in kept:
            output.stdout().print(f"a run of it: {page}")
    return ExitCode.DONE


def _print_explanation(found: Explanation) -> None:
    from mrta_falsify.analysis.explain import decided_sentences, needs_sentences, removal_text

    out = output.stdout()
    out.print(f"suspected layer: {found.layer or 'none'} ({found.reason})")
    if found.guess != found.layer:
        out.print(f"the trace alone points to: {found.guess or 'none'}")
    table = output.new_table("from", "exchanged", "fails in", "beside these")
    for row in found.rows:
        table.add_row(f"{row.at:.1f} s", row.change, f"{row.failed} of {row.runs}", row.beside)
    output.print_table(table)
    for removal in found.removals:
        out.print(removal_text(removal))
    for text in (*needs_sentences(found), *decided_sentences(found.inevitability, found.layer)):
        out.print(text)
    out.print(f"{found.runs} runs spent")


@main.command("certify")
@click.argument("directory", type=FILE)
@click.argument("id", metavar="[ID]", required=False)
@run_option("Run trials again whose worlds or traces were not kept.")
@trust_option
@format_option
def certify_command(directory: Path, id: str | None, run: bool, trust: Trust, style: str) -> int:
    """Prove deadlocks from world and trace, and write certificate.json beside their trials.

    Without an ID, all trials with a confirmed deadlock. An independent program of 150 lines
    checks a certificate: python -m mrta_falsify.analysis.certify.checker FOLDER.
    """
    from mrta_falsify.analysis.certify.sentences import claim_sentences
    from mrta_falsify.commands.certificates import certify_trials
    from mrta_falsify.core import codec

    found = certify_trials(directory, id, run=run, trust=trust)
    certified = sum(trial.certificate is not None for trial in found)
    if style == "json":
        counts = {"deadlocks": len(found), "certified": certified}
        output.print_json({**counts, "trials": codec.encode(found)})
    else:
        out = output.stdout()
        for trial in found:
            claim = claim_sentences(trial.certificate) if trial.certificate is not None else ()
            first, *rest = claim or (f"No certificate: {trial.missing}.",)
            out.print(f"{trial.id}  {first}")
            for text in rest:
                out.print(f"      {text}")
        out.print(f"{certified} of {len(found)} trials with robots that stand certified")
    return ExitCode.DONE if certified == len(found) else ExitCode.VIOLATED


@main.command("minimize")
@trial_arguments
@count_option(
    "--max-runs",
    1,
    10000,
    default=200,
    text=(
        "Largest number of simulations, beside ten of the result; a second call with more "
        "continues."
    ),
)
@workers_option
@trust_option
@format_option
def minimize_command(
    directory: Path, id: str, max_runs: int, workers: int | None, trust: Trust, style: str
) -> int:
    """Find the smallest world that fails in the same way.

    Removes people, furniture, events, robots and tasks, one by one and then in pairs, shortens the
    run and moves values to nominal, as long as the world fails by the same mechanism: the same
    specification, causes of waiting and kind of place. Perturbed runs count how often the result
    fails. In a campaign with --against the other stack must still pass. Writes world.min.json,
    the same world as a Scenic program (world.min.scenic), and trace.min.zip beside the trial;
    `report` shows them beside the original.
    """
    from mrta_falsify.analysis.minimize.minimising import expected_runs
    from mrta_falsify.analysis.minimize.reruns import PERTURBED
    from mrta_falsify.analysis.minimize.sentences import minimal_text
    from mrta_falsify.commands.minimize import minimize_trial
    from mrta_falsify.commands.stored_trials import compared_sentences
    from mrta_falsify.commands.trust import open_to_run, permit_runs
    from mrta_falsify.core.findings import finding_data

    campaign = open_to_run(directory, trust)
    record = campaign.record(id)
    permit_runs(campaign, (record,), trust, with_other=record.other is not None)
    most = max_runs + PERTURBED
    if record.failed:
        expected = expected_runs(campaign, record)
        output.say_cost(most, record.wall_s, expected=expected, at_end=PERTURBED)
    with output.progress(f"minimize {record.id}", most, "runs", is_most=True) as on_progress:
        found = minimize_trial(
            directory,
            id,
            max_runs,
            workers=workers,
            trust=trust,
            on_run=lambda runs, text: on_progress(runs),
        )
    if style == "json":
        output.print_json({"id": record.id, **finding_data(found)})
        return ExitCode.DONE
    out = output.stdout()
    out.print(f"failure    {found.signature}")
    for group, (before, after) in found.counts.items():
        if before:
            out.print(f"{group:10} {before} -> {after}")
    out.print(f"runs       {found.runs}")
    out.print(f"tried      {minimal_text(found)}")
    for text in compared_sentences(found.jittered, found.other):
        out.print(f"           {text}")
    folder = campaign.folder(record)
    world, program = folder / "world.min.json", folder / "world.min.scenic"
    out.print(f"world      {world}")
    if program.is_file():
        out.print(f"program    {program}")
    stack = folder / "stack.yaml"
    again = shlex.join(["mrta-falsify", "run", str(world), "--stack", str(stack)])
    out.print(f"run it     {again}")
    return ExitCode.DONE


@main.command("corpus")
@click.argument("directory", metavar="DIR|zoo")
@stack_options
@setting_option(
    TrialSettings,
    "jittered",
    default=2,
    text="Number of perturbed runs of each failure: starts, pace and times a little different.",
)
@workers_option
@click.option(
    "--time-limit",
    type=FiniteRange(min=0.0, min_open=True),
    metavar="S",
    help=(
        "Longest time of one run [s], CPU time and sleep; default: the campaign's own limit, "
        "or 60 (zoo)."
    ),
)
@click.option(
    "--only",
    multiple=True,
    metavar="ID",
    help="Trial to run, for example 0007; default: all failures. Repeatable.",
)
@removed_option("--build", "the script that `git bisect run` calls builds (docs/every-day.md)")
@removed_option(
    "--bisect", "`git bisect run` calls `mrta-falsify corpus DIR --only ID` (docs/every-day.md)"
)
@click.option(
    "--pictures", type=FILE, metavar="DIR", help="Directory for a picture of each run that fails."
)
@run_option("Sample worlds again that were not kept.")
@trust_option
@format_option
def corpus_command(directory: str, style: str, **options: Any) -> int:
    """Run all stored failures of a campaign on a changed stack, or the scenes of the zoo.

    Each failure is fixed, still failing, flaky (only perturbed runs fail) or a timeout. Without
    --stack and --set the campaign's own stack runs. The recorded engine is kept unless --stack
    or --set names one.

    `corpus zoo` runs shipped scenes with a known answer, `corpus zoo/NAME` one of them, by
    default on the kinematic engine. A directory of that name is ./zoo.
    """
    from mrta_falsify.commands.zoo import is_zoo

    if is_zoo(directory):
        about_stored = [options.pop(name) for name in ("only", "pictures", "run", "trust")]
        if any(about_stored):
            raise click.UsageError(
                "--only, --pictures, --run and --trust are about stored failures"
            )
        return _zoo(directory, style, options)
    return _corpus(Path(directory), style, options)


def _corpus(directory: Path, style: str, options: dict[str, Any]) -> int:
    from mrta_falsify.commands.corpus import counts_by_fate, keeps_engine, recheck_corpus
    from mrta_falsify.commands.trust import open_to_run
    from mrta_falsify.core import codec

    campaign = open_to_run(directory, options["trust"])
    if (options["stack"] or options["settings"]) and keeps_engine(
        options["stack"], options["settings"]
    ):
        engine = campaign.settings.trials.stack.engine.name
        output.say(f"engine {engine}, as recorded: the changed stack names none")
    done: list[str] = []
    total = len(options["only"]) or campaign.stats().failed
    with output.progress("corpus", total, "failures") as on_progress:

        def on_done(row: Recheck) -> None:
            done.append(row.id)
            on_progress(len(done))

        rows = recheck_corpus(directory, on_done=on_done, **options)
    counts = counts_by_fate(rows)
    if style == "json":
        output.print_json({**counts, "failures": codec.encode(rows)})
    else:
        _print_rechecks(rows)
        output.stdout().print(", ".join(f"{count} {fate}" for fate, count in counts.items()))
    return ExitCode.DONE if counts["fixed"] == len(rows) else ExitCode.VIOLATED


def _print_rechecks(rows: tuple[Recheck, ...]) -> None:
    table = output.new_table("id", "fate", "was", "now", "perturbed")
    for row in rows:
        failing = f"{row.jittered_failures} of {row.jittered} fail"
        style = None if row.fate == "fixed" else "red"
        table.add_row(row.id, row.fate, row.signature, row.signature_now, failing, style=style)
    output.print_table(table)


def _zoo(name: str, style: str, options: dict[str, Any]) -> int:
    from mrta_falsify.commands.zoo import counts_of_scenes, run_zoo, scenes_named
    from mrta_falsify.core import codec

    done: list[SceneCheck] = []
    with output.progress(name, len(scenes_named(name)), "scenes") as on_progress:

        def on_done(row: SceneCheck) -> None:
            done.append(row)
            on_progress(len(done))

        rows = run_zoo(name, on_done=on_done, **options)
    counts, known = counts_of_scenes(rows), [row.is_as_known for row in rows]
    if style == "json":
        scenes = [
            {**codec.encode(row), "is_as_known": right}
            for row, right in zip(rows, known, strict=True)
        ]
        output.print_json({**counts, "scenes": scenes})
    else:
        _print_scenes(rows)
        told = ", ".join(f"{count} {fate}" for fate, count in counts.items())
        output.stdout().print(f"{told}; {sum(known)} of {len(rows)} as known")
    return ExitCode.DONE if all(known) else ExitCode.VIOLATED


def _print_scenes(rows: tuple[SceneCheck, ...]) -> None:
    table = output.new_table("scene", "known", "this stack", "perturbed", "what happened")
    for row in rows:
        failing = f"{row.jittered_failures} of {row.jittered} fail"
        style = None if row.is_as_known else "red"
        table.add_row(row.name, row.answer, row.fate, failing, row.sentence, style=style)
    output.print_table(table)
