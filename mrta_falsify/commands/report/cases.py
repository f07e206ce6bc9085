"""What a report says of one failure: from its stored files to contents."""

from __future__ import annotations

import dataclasses
import shlex
from collections.abc import Sequence
from pathlib import Path

from mrta_falsify.analysis.certify.sentences import claim_sentences
from mrta_falsify.analysis.explain import NO_LAYER, decided_sentences, needs_sentences, removal_text
from mrta_falsify.analysis.minimize.sentences import minimal_text
from mrta_falsify.campaigns.settings import COMPARISON_RUNS, CampaignSettings
from mrta_falsify.commands.report.parameters import neighbour_of
from mrta_falsify.commands.report.reading import StoredFailure
from mrta_falsify.commands.stored_trials import compared_sentences
from mrta_falsify.core.claims import KIND_TEXT
from mrta_falsify.core.findings import Explanation, Minimisation, ReplayCheck
from mrta_falsify.core.record import TrialRecord
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.core.world import World
from mrta_falsify.specs.attribution import WHOLE, WORLD, guess
from mrta_falsify.specs.causes import by_cause, kind_of
from reports.contents import CaseContents
from reports.sentences import coupling_facts, guess_text

Commands = tuple[tuple[str, str], ...]


def tell_case(directory: Path, settings: CampaignSettings, failure: StoredFailure) -> CaseContents:
    """Tell a failure as the report shows it.

    Args:
        directory: of its campaign.
        settings: of its campaign.
        failure: as it was read.
    """
    record, near, check = failure.record, failure.near, failure.check
    trials, beside = settings.trials, ["mrta-falsify", "report", str(directory), "--beside"]
    case = dataclasses.replace(
        failure.run,
        facts=_facts(directory, settings, record),
        commands=commands_of(directory, failure.folder, record),
        layer=record.layer,
        layer_evidence=_evidence_of_trace(failure),
        identical=(check.identical, check.runs) if check is not None else None,
        parts=_parting(check),
        jittered=(record.vote.failed, record.vote.runs) if record.vote else None,
        confirmed=record.confirmation,
        repeated=str(record.repeats) if record.repeats else "",
        certified=claim_sentences(failure.certificate) if failure.certificate is not None else (),
        compared=compared_sentences(record.vote, record.other, trials.jittered),
        other=failure.other,
        neighbour=neighbour_of(settings, record, near, shlex.join(beside))
        if near is not None
        else None,
        passing=failure.passing,
    )
    if failure.explanation is not None:
        case = _with_explanation(case, failure.explanation)
    if failure.minimisation is not None and failure.smallest is not None:
        case = _with_minimised(case, failure, failure.minimisation, failure.smallest)
    return case


def _facts(
    directory: Path, settings: CampaignSettings, record: TrialRecord
) -> tuple[tuple[str, str], ...]:
    kind = kind_of(record.verdicts)
    return (
        ("trial", f"{record.id} of {directory}"),
        ("engine", record.engine),
        ("campaign seed", str(settings.trials.seed)),
        ("candidate seed", str(record.candidate.seed)),
        ("world digest", record.world_digest),
        ("trace digest", record.trace_digest),
        *((("kind", KIND_TEXT[kind]),) if kind else ()),
        ("simulated", f"{record.sim_time:.1f} s, ended: {record.ended}"),
        ("scenes tried", str(record.origin.attempts)),
        *coupling_facts(record.result.coupling if record.result else None),
        *sorted(record.origin.versions.items()),
    )


# --- what other commands have found --------------------------------------------------------


def _evidence_of_trace(failure: StoredFailure) -> str:
    """Say what in the trace made the rules name a layer, or none."""
    layer, run = failure.record.layer, failure.run
    found = guess(run.verdicts, run.trace, whole=failure.config.stack is not None)
    asked = "The command explain tests it by runs with one layer changed."
    if layer != found.layer:
        return f"A guess by rules of an older version. {asked}"
    text = guess_text(found, run.verdicts[0], run.trace)
    return " ".join([text, *([asked] if layer != WORLD else [])])


def _with_explanation(case: CaseContents, found: Explanation) -> CaseContents:
    """Show what re-runs say in place of what the trace alone says."""
    evidence = f"Runs that differ in one layer from {found.changed_at:.1f} s on: {found.reason}."
    if len(found.rows) == 1:  # the stack as it is: nothing else was run
        evidence = f"No layer was exchanged: {found.reason.removeprefix(NO_LAYER)}."
    if found.layer == WHOLE:
        evidence = f"{found.runs} runs with one thing changed: {found.reason}."
    if found.guess and found.guess != found.layer:
        evidence += f" The trace alone, which is a guess, points to {found.guess}."
    copies = found.jittered
    return dataclasses.replace(
        case,
        layer=found.layer,
        layer_evidence=evidence,
        counterfactuals=found.counterfactuals,
        rows=found.rows,
        removals=tuple(map(removal_text, found.removals)),
        needs=needs_sentences(found),
        inevitability=found.inevitability,
        decided=decided_sentences(found.inevitability, found.layer),
        jittered=(copies.failed, copies.runs) if copies.runs else case.jittered,
    )


def _parting(check: ReplayCheck | None) -> str:
    """Say where the first replay that differs parts from the stored trace."""
    if check is None or check.first_difference is None:
        return ""
    return f"first differs {check.first_difference}"


def _with_minimised(
    case: CaseContents, failure: StoredFailure, found: Minimisation, smallest: CaseContents
) -> CaseContents:
    world = smallest.world
    minimised = dataclasses.replace(
        smallest,
        verdicts=_without_cut_off(smallest.verdicts, world, case.world),
        facts=(("world digest", world.digest()[:16]), ("runs used", str(found.runs))),
        commands=minimised_commands(failure),
        compared=compared_sentences(found.jittered, found.other, COMPARISON_RUNS),
        other=failure.smallest_on_other,
    )
    counts = tuple((name, *pair) for name, pair in found.counts.items() if pair[0])
    return dataclasses.replace(
        case,
        removed=found.removed,
        tried=minimal_text(found),
        counts=counts,
        minimised=minimised,
    )


def _without_cut_off(
    verdicts: Sequence[Verdict], world: World, before: World
) -> tuple[Verdict, ...]:
    """Leave out tasks that are undone only because a smaller world ends sooner."""
    first, *others = by_cause(verdicts)
    ends_sooner = world.horizon < before.horizon
    return (first, *(v for v in others if not (ends_sooner and v.spec == "all_tasks_done")))


# --- what to type --------------------------------------------------------------------------


def commands_of(directory: Path, folder: Path, record: TrialRecord) -> Commands:
    """List the commands that run, check and explain a failure: what each does, and what to type.

    Args:
        directory: of the campaign.
        folder: of the trial.
        record: of the trial.
    """
    where = [str(directory), record.id]
    theirs = _command("Run the other stack in its world again", "replay", *where, "--against")
    return (
        _command("Run the trial again and compare digests", "replay", *where, "--verify", "3"),
        *((theirs,) if record.other is not None else ()),
        _command("Ask which layer is to blame", "explain", *where),
        _command("Find the smallest world that fails in the same way", "minimize", *where),
        _command(
            "Run its world on its own, with your stack",
            *("run", str(folder / "world.json"), "--stack", "my_stack.yaml"),
        ),
    )


def minimised_commands(failure: StoredFailure) -> Commands:
    """List the commands that run a minimised world on the stack it fails on, and the other."""
    folder, files = failure.folder, failure.files
    runs = [
        ("Run it", "world.min.json", "stack.yaml"),
        ("Run it from its Scenic program", "world.min.scenic", "stack.yaml"),
    ]
    if "stack.other.yaml" in files:
        runs.append(("Run it on the other stack", "world.min.json", "stack.other.yaml"))
    return tuple(
        _command(
            what,
            *("run", str(folder / world)),
            *(("--stack", str(folder / stack)) if stack in files else ()),
        )
        for what, world, stack in runs
        if world in files
    )


def _command(what: str, *words: str) -> tuple[str, str]:
    return what, shlex.join(["mrta-falsify", *words])
