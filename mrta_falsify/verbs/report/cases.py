"""The failures of a campaign that a report shows in full, from their stored files."""

from __future__ import annotations

import dataclasses
import shlex
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from mrta_falsify.campaigns.finding_files import read_finding
from mrta_falsify.campaigns.store import Campaign
from mrta_falsify.core.claims import KIND_TEXT
from mrta_falsify.core.errors import InputError
from mrta_falsify.core.findings import Explanation, Minimisation, ReplayCheck
from mrta_falsify.core.record import OtherRun, TrialRecord
from mrta_falsify.core.trace import Trace
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.core.world import World
from mrta_falsify.lab import stack_of
from mrta_falsify.lab.stored import other_stack_of
from mrta_falsify.specs.attribution import WHOLE, WORLD, guess
from mrta_falsify.specs.causes import by_cause, kind_of
from mrta_falsify.verbs.certify.sentences import claim_sentences, read_certificate
from mrta_falsify.verbs.explain import NO_LAYER, decided_sentences, needs_sentences, removal_text
from mrta_falsify.verbs.minimize.sentences import minimal_text
from mrta_falsify.verbs.report.commands import commands_of, minimised_commands
from mrta_falsify.verbs.report.neighbours import neighbour_of
from mrta_falsify.verbs.stored_trials import compared_sentences, of_other_stack, read_run
from mrta_falsify.verbs.trust import map_of
from reports.contents import CaseContents, Neighbour
from reports.sentences import guess_text
from reports.stack_sentences import coupling_facts

if TYPE_CHECKING:
    from mrta_falsify.core.config import StackConfig

MAX_LOST = 20  # failures with missing files after which the others are not read
MAX_HELD = 100_000_000  # bytes of traces that are held at once
LOST_TOLD = 5  # of them, each of which gets a sentence


def readable_cases(campaign: Campaign, most: int) -> tuple[list[CaseContents], list[str]]:
    """Read the cases to show, and say which failures have missing or damaged files.

    Args:
        campaign: whose failures.
        most: cases to show; fewer where their traces take up much memory.
    """
    cases: list[CaseContents] = []
    lost: list[str] = []
    held = 0
    for record in in_turn(campaign):
        if len(cases) >= most or len(lost) >= MAX_LOST or held > MAX_HELD:
            break
        held += sum(column.nbytes for column in cases[-1].trace.columns.values()) if cases else 0
        try:
            cases.append(case_of(campaign, record))
        except InputError as error:
            again = shlex.join(["mrta-falsify", "replay", str(campaign.directory), record.id])
            lost.append(
                f"Trial {record.id} is not shown in full: {str(error).rstrip('.')}. It can still "
                f"be run again: {again}"
            )
    if len(lost) > LOST_TOLD:
        further = f"{len(lost) - LOST_TOLD} further failures have damaged or missing files, too"
        more = "; others were not looked at" if len(lost) >= MAX_LOST else ""
        lost = [*lost[:LOST_TOLD], f"{further}{more}."]
    return cases, lost


def in_turn(campaign: Campaign) -> Iterator[TrialRecord]:
    """Yield failures whose runs were kept: the first of each mode, then the second of each."""
    by_id = {record.id: record for record in campaign.records if record.trace_file}
    queues = [[by_id[i] for i in mode.ids if i in by_id] for mode in campaign.stats().modes]
    for turn in range(max(map(len, queues), default=0)):
        for queue in queues:
            if turn < len(queue):
                yield queue[turn]


def case_of(campaign: Campaign, record: TrialRecord) -> CaseContents:
    """Read a stored failure as the report shows it.

    Raises:
        InputError: one of its files is missing or damaged.
    """
    folder = campaign.folder(record)
    config = stack_of(campaign.settings.trials, record)
    world, trace = read_run(folder / "world.json", folder / "trace.zip")
    verdicts = by_cause(record.verdicts)
    explanation = read_finding(folder, Explanation)
    check = read_finding(folder, ReplayCheck)
    certificate = read_certificate(folder)
    near = neighbour_of(campaign, record)
    case = CaseContents(
        id=record.id,
        signature=record.signature,
        world=world,
        trace=trace,
        verdicts=verdicts,
        costmap=map_of(world, config),
        facts=_facts(campaign, record),
        commands=commands_of(campaign, record),
        layer=record.layer,
        layer_evidence=_evidence_of_trace(record.layer, verdicts, trace, config),
        identical=(check.identical, check.runs) if check is not None else None,
        parts=_parting(check),
        jittered=(record.vote.failed, record.vote.runs) if record.vote else None,
        confirmed=record.confirmation,
        repeated=str(record.repeats) if record.repeats else "",
        certified=claim_sentences(certificate) if certificate is not None else (),
        compared=compared_sentences(record.vote, record.other, campaign.settings.trials.jittered),
        other=_of_other_stack(campaign, record),
        neighbour=near,
        passing=_passing(campaign, near) if near is not None and record.other is None else None,
    )
    if explanation is not None:
        case = _with_explanation(case, explanation)
    minimisation = read_finding(folder, Minimisation)
    if minimisation is not None and (folder / "world.min.json").is_file():
        theirs = other_stack_of(campaign, record)
        case = _with_minimised(case, minimisation, folder, config, theirs)
    return case


def _passing(campaign: Campaign, near: Neighbour) -> CaseContents | None:
    """Read the run of the nearest passing trial, if it was kept."""
    record = campaign.record(near.id)
    folder = campaign.folder(record)
    if not (folder / "trace.zip").is_file():
        return None
    world, trace = read_run(folder / "world.json", folder / "trace.zip")
    config = stack_of(campaign.settings.trials, record)
    return _bare_case(near.id, "", world, trace, record.verdicts, config)


def _of_other_stack(campaign: Campaign, record: TrialRecord) -> CaseContents | None:
    """Read what the other stack did in the world of a failure, where two are compared."""
    if record.other is None or not record.other.trace_file:
        return None
    theirs, seen = of_other_stack(campaign, record)
    folder = theirs.folder(seen)
    world, trace = read_run(folder / "world.json", folder / "trace.zip")
    config = stack_of(theirs.settings.trials, seen)
    return _other_case(f"{record.id}, the other stack", world, trace, record.other, config)


def _bare_case(
    name: str,
    signature: str,
    world: World,
    trace: Trace,
    verdicts: Sequence[Verdict],
    config: StackConfig,
) -> CaseContents:
    """Show a run that stands beside another one: what happened, and nothing about it."""
    return CaseContents(
        id=name,
        signature=signature,
        world=world,
        trace=trace,
        verdicts=tuple(verdicts),
        costmap=map_of(world, config),
        facts=(),
        commands=(),
    )


def _other_case(
    name: str, world: World, trace: Trace, other: OtherRun, config: StackConfig
) -> CaseContents:
    return _bare_case(name, other.signature, world, trace, by_cause(other.verdicts), config)


# --- what other commands have found --------------------------------------------------------


def _evidence_of_trace(
    layer: str, verdicts: Sequence[Verdict], trace: Trace, config: StackConfig
) -> str:
    """Say what in the trace made the rules name a layer, or none."""
    found = guess(verdicts, trace, whole=config.stack is not None)
    asked = "The command explain tests it by runs with one layer changed."
    if layer != found.layer:
        return f"A guess by rules of an older version. {asked}"
    return " ".join([guess_text(found, verdicts[0], trace), *([asked] if layer != WORLD else [])])


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


def _without_cut_off(
    verdicts: Sequence[Verdict], world: World, before: World
) -> tuple[Verdict, ...]:
    """Leave out tasks that are undone only because a smaller world ends sooner."""
    first, *others = by_cause(verdicts)
    ends_sooner = world.horizon < before.horizon
    return (first, *(v for v in others if not (ends_sooner and v.spec == "all_tasks_done")))


def _with_minimised(
    case: CaseContents,
    found: Minimisation,
    folder: Path,
    config: StackConfig,
    other: StackConfig | None,
) -> CaseContents:
    world, trace = read_run(folder / "world.min.json", folder / "trace.min.zip")
    minimised = CaseContents(
        id=f"{case.id}, minimised",
        signature=found.signature,
        world=world,
        trace=trace,
        verdicts=_without_cut_off(found.verdicts, world, case.world),
        costmap=map_of(world, config),
        facts=(("world digest", world.digest()[:16]), ("runs used", str(found.runs))),
        commands=minimised_commands(folder),
        compared=compared_sentences(found.jittered, found.other),
        other=_minimised_on_other(case, found, folder, other),
    )
    counts = tuple((name, *pair) for name, pair in found.counts.items() if pair[0])
    return dataclasses.replace(
        case,
        removed=found.removed,
        tried=minimal_text(found),
        counts=counts,
        minimised=minimised,
    )


def _minimised_on_other(
    case: CaseContents, found: Minimisation, folder: Path, config: StackConfig | None
) -> CaseContents | None:
    """Read what the other stack did in the smallest world, where two are compared."""
    if found.other is None or config is None:
        return None
    world, trace = read_run(folder / "world.min.json", folder / "trace.min.other.zip")
    return _other_case(f"{case.id}, minimised, the other stack", world, trace, found.other, config)


def _facts(campaign: Campaign, record: TrialRecord) -> tuple[tuple[str, str], ...]:
    kind = kind_of(record.verdicts)
    return (
        ("trial", f"{record.id} of {campaign.directory}"),
        ("engine", record.engine),
        ("campaign seed", str(campaign.settings.trials.seed)),
        ("candidate seed", str(record.candidate.seed)),
        ("world digest", record.world_digest),
        ("trace digest", record.trace_digest),
        *((("kind", KIND_TEXT[kind]),) if kind else ()),
        ("simulated", f"{record.sim_time:.1f} s, ended: {record.ended}"),
        ("scenes tried", str(record.origin.attempts)),
        *coupling_facts(record.result.coupling if record.result else None),
        *sorted(record.origin.versions.items()),
    )
