"""Commands on one stored failure: look at it, run it again, explain it, make it smaller."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING

from rich.table import Table

from mrta_falsify.cli import output
from mrta_falsify.cli.door import ExitCode
from mrta_falsify.cli.options import count_option, format_option, trial_arguments, workers_option
from mrta_falsify.cli.run_commands import main

if TYPE_CHECKING:
    from mrta_falsify.verbs.campaign import Replay


@main.command()
@trial_arguments
@format_option
def show(directory: Path, name: str, style: str) -> int:
    """Show one trial: verdicts, evidence, digests, how to replay it."""
    from mrta_falsify.verbs import campaign as campaigns

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
    if record.jittered:
        out.print(f"           {record.jittered}")
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
    """Run a stored trial again and compare digests. Exit code 1: they differ.

    Where they do, says whether the verdicts are the same all the same, and names the first tick
    that differs from the stored trace.
    """
    from mrta_falsify.core import codec
    from mrta_falsify.verbs import campaign as campaigns

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
                "first_difference": codec.encode(result.difference),
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
    if result.difference is not None:
        out.print(f"first differs {result.difference}")
    if not result.same_machine:
        out.print("the record comes from other versions or another kind of machine (see `show`)")


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
    from mrta_falsify.core import codec
    from mrta_falsify.verbs import campaign as campaigns
    from mrta_falsify.verbs import explain as explaining

    opened = campaigns.open_campaign(directory)
    record = opened.record(name)
    with output.progress(f"explain {record.id}", max_runs, "runs") as report_progress:
        found = explaining.explain(
            opened,
            record,
            max_runs=max_runs,
            on_done=lambda done, total: report_progress(done),
        )
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
    for removal in found.removals:
        out.print(explaining.removal_text(removal))
    if found.jittered.runs:
        out.print(
            f"with small differences it fails in {found.jittered.failed} of "
            f"{found.jittered.runs} runs"
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
@workers_option
@format_option
def minimize(directory: Path, name: str, max_runs: int, workers: int | None, style: str) -> int:
    """Find the smallest world that fails in the same way.

    Removes people, furniture, events, robots and tasks, shortens the run and moves values to
    nominal, as long as the failure keeps its signature. Writes world.min.json, the same as a
    Scenic program world.min.scenic, and trace.min.zip beside the trial; `report` shows them
    beside the original.
    """
    from mrta_falsify.core.findings import finding_data
    from mrta_falsify.verbs import campaign as campaigns
    from mrta_falsify.verbs import minimize as minimising

    opened = campaigns.open_campaign(directory)
    record = opened.record(name)
    with output.progress(f"minimize {record.id}", max_runs, "runs") as report_progress:
        found = minimising.minimize(
            opened,
            record,
            max_runs=max_runs,
            workers=campaigns.cores(workers),
            on_run=lambda runs, text: report_progress(runs),
        )
    if style == "json":
        output.print_json({"id": record.id, **finding_data(found)})
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
