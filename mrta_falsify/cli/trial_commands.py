"""The commands that read stored trials or run them again: list, show, replay."""

from __future__ import annotations

import csv
import json
import shlex
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from mrta_falsify.cli import output
from mrta_falsify.cli.exits import ExitCode
from mrta_falsify.cli.group import main
from mrta_falsify.cli.options import (
    FILE,
    count_option,
    format_option,
    trial_arguments,
    trust_option,
)
from mrta_falsify.core import codec

if TYPE_CHECKING:
    from mrta_falsify.campaigns.foreign import Trust
    from mrta_falsify.campaigns.trial_index import TrialRow
    from mrta_falsify.commands.replay import Replay
    from mrta_falsify.core.record import TrialRecord
    from mrta_falsify.core.verdict import Verdict

ABOVE_ZERO = "0 or more where only secondary specifications are violated"


@main.command("list")
@click.argument("directory", type=FILE)
@click.option("--failed", is_flag=True, help="List only trials that violate a specification.")
@click.option(
    "--format",
    "style",
    type=click.Choice(("table", "json", "csv")),
    default="table",
    show_default=True,
    help="Form of the list.",
)
def list_command(directory: Path, failed: bool, style: str) -> int:
    """List the trials of a campaign."""
    from mrta_falsify.campaigns.trial_index import TrialRow, rows_data

    found, summary = _listed(directory)
    rows = tuple(row for row in found if row.failed or not failed)
    if style == "json":
        click.echo(json.dumps(rows_data(rows), allow_nan=False))
    elif style == "csv":
        writer = csv.DictWriter(sys.stdout, list(TrialRow.__dataclass_fields__))
        writer.writeheader()
        for row, data in zip(rows, rows_data(rows), strict=True):
            lists = {"violated": " ".join(row.violated), "not_judged": " ".join(row.not_judged)}
            writer.writerow({**data, **lists})
    else:
        _print_trials(rows)
        for text in summary():
            output.stdout().print(text)
    return ExitCode.DONE


def _listed(directory: Path) -> tuple[tuple[TrialRow, ...], Callable[[], tuple[str, ...]]]:
    """Read all rows of a campaign, from its index if that is sound, and how it is summed up."""
    from mrta_falsify.campaigns.trial_index import explained_rows, index_summary, read_index

    index = read_index(directory)
    if index is not None:
        rows = explained_rows(directory, index)
        return rows, lambda: index_summary(index, rows)
    from mrta_falsify.commands.report.build import short_summary
    from mrta_falsify.commands.stored_trials import open_campaign, trial_rows

    campaign = open_campaign(directory)
    rows = trial_rows(campaign)
    return rows, lambda: short_summary(campaign, {row.id: row.layer for row in rows})


def _what_became(status: str, *, failed: bool) -> str:
    """Say what became of a trial, in a word: one that was judged has failed or passed."""
    if status != "ok":
        return status
    return "failed" if failed else "passed"


def _print_trials(rows: tuple[TrialRow, ...]) -> None:
    with_votes = any(row.jittered for row in rows)
    columns = ["id", "status", "score", "kind", "signature", "who", "layer", "simulated"]
    columns += ["perturbed"] if with_votes else []
    with_repeats = any(row.repeats for row in rows)
    columns += ["came again"] if with_repeats else []
    with_engines = any(row.other_engines for row in rows)
    columns += ["other engines"] if with_engines else []
    with_other = any(row.other for row in rows)
    columns += ["other stack"] if with_other else []
    table = output.new_table(*columns, right=("score", "simulated"), whole=("id",))
    for row in rows:
        cells = [
            row.id,
            _what_became(row.status, failed=row.failed),
            f"{row.score:+.3f}" if row.status == "ok" else "",
            row.kind,
            row.signature,
            row.who,
            row.layer,
            f"{row.sim_time_s:.1f} s",
        ]
        if with_votes:
            cells.append(f"{row.jittered_failures} of {row.jittered}" if row.jittered else "")
        if with_repeats:
            cells.append(f"{row.repeats_failed} of {row.repeats}" if row.repeats else "")
        if with_engines:
            cells.append(row.other_engines)
        if with_other:
            copies = f", {row.other_jittered_failures} of {row.other_jittered}"
            cells.append(row.other + copies * bool(row.other_jittered))
        table.add_row(*cells, style="red" if row.failed else None)
    output.print_table(table)
    if any(_fails_above_zero(row) for row in rows):
        output.stdout().print(f"score: {ABOVE_ZERO}")


def _fails_above_zero(trial: TrialRow | TrialRecord) -> bool:
    return trial.failed and trial.status == "ok" and trial.score >= 0.0


@main.command("show")
@trial_arguments
@format_option
def show_command(directory: Path, id: str, style: str) -> int:
    """Show one trial: verdicts, evidence, digests, how to replay it."""
    from mrta_falsify.analysis.certify.sentences import claim_sentences, read_certificate
    from mrta_falsify.campaigns.store import read_trial
    from mrta_falsify.commands.stored_trials import (
        compared_sentences,
        explained_reason,
        layer_of,
        what_happened,
    )
    from mrta_falsify.core.claims import KIND_TEXT
    from mrta_falsify.specs.causes import kind_of
    from reports.sentences import beside_sentences, coupling_facts

    campaign = read_trial(directory, id)
    record = campaign.record(id)
    told, kind = what_happened(campaign, record), kind_of(record.verdicts)
    beside = beside_sentences(record.verdicts)
    certificate = read_certificate(campaign.folder(record))
    proved = claim_sentences(certificate) if certificate is not None else ()
    if style == "json":
        data = {"id": record.id, "failed": record.failed, "kind": kind, "happened": told}
        data |= {"certified": proved, "beside": beside}
        output.print_json(data | _record_data(record, campaign.settings.rules))
        return ExitCode.DONE
    out = output.stdout()
    status = _what_became(record.status, failed=record.failed)
    out.print(f"trial      {record.id}, {status}, engine {record.engine or 'none'}")
    why = f" ({ABOVE_ZERO})" if _fails_above_zero(record) else ""
    out.print(f"score      {record.score:+.4f}{why}")
    if record.signature:
        out.print(f"failure    {record.signature}")
    if kind:
        out.print(f"kind       {KIND_TEXT[kind]}")
    for text in told:
        out.print(f"           {text}")
    for text in proved:
        out.print(f"           {text}")
    if record.failed:
        out.print(f"layer      {layer_of(campaign, record) or 'none suspected'}")
        if reason := explained_reason(campaign, record):
            out.print(f"           by explain: {reason}")
    for name, text in coupling_facts(record.result.coupling if record.result else None):
        out.print(f"{name:<11}{text}")
    vote = record.vote if record.other is None else None
    for counted in filter(None, (record.repeats, vote, record.confirmation)):
        out.print(f"           {counted}")
    most = campaign.settings.trials.jittered
    for text in compared_sentences(record.vote, record.other, most):
        out.print(f"           {text}")
    for way in record.origin.shut:
        out.print(f"shut       task{way.task}: {way.is_shut_by}")
    for note in record.origin.notes:
        out.print(f"note       {note}")
    if record.error:
        out.print(f"error      {record.error.strip().splitlines()[-1]}")
    for verdict in record.verdicts:
        out.print(_verdict_line(verdict))
    for text in beside:
        out.print(f"  {text}")
    out.print(f"digests    world {record.world_digest[:16]}  trace {record.trace_digest[:16]}")
    out.print(f"time       {record.sim_time:.1f} s simulated, ended: {record.ended}")
    if record.trace_file:
        out.print(f"files      {campaign.folder(record)}")
    out.print(f"replay     mrta-falsify replay {shlex.quote(str(directory))} {record.id}")
    return ExitCode.DONE


def _record_data(record: TrialRecord, rules: int) -> dict[str, Any]:
    from mrta_falsify.campaigns.record_formats import flat_record

    verdicts = [{**codec.encode(v), "outcome": v.outcome} for v in record.verdicts]
    return {**flat_record(record, rules), "verdicts": verdicts}


def _verdict_line(verdict: Verdict) -> str:
    state = verdict.outcome.replace("_", " ")
    at = "" if verdict.violated_at is None else f" at {verdict.violated_at:.2f} s"
    who = f" by {', '.join(verdict.who)}" if verdict.who else ""
    why = f": {verdict.not_judged}" if verdict.not_judged else ""
    rho = "" if verdict.not_judged else f", robustness {verdict.robustness:+.3g}"
    return f"  {verdict.spec:24} {state}{at}{who}{why}{rho}"


@main.command("replay")
@trial_arguments
@count_option("--verify", 1, 1000, default=1, text="Number of repeats whose digests are compared.")
@click.option(
    "--live",
    is_flag=True,
    help="Run a foreign stack again, instead of using its stored answers.",
)
@click.option(
    "--against",
    is_flag=True,
    help="Replay the run of the other stack, in a campaign with --against.",
)
@trust_option
@format_option
def replay_command(
    directory: Path,
    id: str,
    verify: int,
    live: bool,
    against: bool,
    trust: Trust,
    style: str,
) -> int:
    """Run a stored trial again and compare digests.

    Where they do, says whether the verdicts still agree, and names the first tick that differs
    from the stored trace. For a trial that another version recorded, verdicts count instead of
    digests.
    """
    from mrta_falsify.commands.replay import replay, summarise_replay

    result = replay(directory, id, verify, live, against=against, trust=trust)
    if style == "json":
        output.print_json(summarise_replay(result))
    else:
        _print_replay(result)
    return ExitCode.DONE if result.agrees else ExitCode.VIOLATED


def _print_replay(result: Replay) -> None:
    out = output.stdout()
    record, runs = result.record, len(result.runs)
    if not result.same_version:
        out.print("recorded by another version: verdicts are compared, digests may differ")
    out.print(f"{result.same_digest} of {runs} identical to trial {record.id} (trace digest)")
    if record.signature:
        out.print(f"failure    {record.signature}")
    if result.identical:
        return
    when = " at the same times" if result.same_version else ""
    out.print(f"{result.same_verdicts} of {runs} have the same violations{when}")
    if result.difference is not None:
        out.print(f"first differs {result.difference}")
    if not result.same_machine:
        out.print("the record comes from other versions or another kind of machine (see `show`)")
