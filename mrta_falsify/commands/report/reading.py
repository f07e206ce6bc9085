"""What a report is made from: a campaign with its counts, and failures with their files.

All files of a report are read here. The modules beside this one turn what was read into contents,
and :mod:`reports` turns contents into pages.
"""

from __future__ import annotations

import contextlib
import shlex
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from mrta_falsify.analysis.certify.sentences import read_certificate
from mrta_falsify.campaigns.finding_files import read_finding
from mrta_falsify.campaigns.settings import CampaignSettings
from mrta_falsify.campaigns.stats import CampaignStats, FailureMode
from mrta_falsify.campaigns.store import Campaign, owner_of
from mrta_falsify.commands.campaign_summary import NoProbability, probability_of
from mrta_falsify.commands.report.parameters import (
    PassingTrials,
    Ranking,
    nearest_passing,
    passing_trials,
    rank_dimensions,
)
from mrta_falsify.commands.stored_trials import (
    layer_of,
    of_other_stack,
    read_run,
)
from mrta_falsify.commands.trust import map_of
from mrta_falsify.core.config import StackConfig
from mrta_falsify.core.errors import InputError
from mrta_falsify.core.findings import Certificate, Explanation, Minimisation, ReplayCheck
from mrta_falsify.core.probability import Probability
from mrta_falsify.core.record import TrialRecord
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.core.world import World, read_world
from mrta_falsify.lab import stack_of
from mrta_falsify.lab.stored import TRACE_NAME, WORLD_NAME, other_stack_of
from mrta_falsify.specs.causes import by_cause
from reports.contents import CaseContents

MAX_LOST = 20  # failures with missing files after which the others are not read
MAX_HELD = 100_000_000  # bytes of traces that are held at once
LOST_TOLD = 5  # of them, each of which gets a sentence


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CampaignView:
    """A campaign as a report tells it: what was stored, counted and found so far."""

    directory: Path
    settings: CampaignSettings
    records: tuple[TrialRecord, ...]
    judged: tuple[TrialRecord, ...]  #: of them
    stats: CampaignStats
    chance: Probability | NoProbability  #: of a violation
    ranking: Ranking  #: of the search dimensions
    passing: PassingTrials
    layers: Mapping[str, str]  #: suspected, by id of a failing trial; empty: none
    owner: str  #: who runs the campaign now; empty: nobody


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StoredFailure:
    """A failure as its files have it."""

    record: TrialRecord
    folder: Path
    files: frozenset[str]  #: names of what lies in it
    config: StackConfig  #: that ran it
    run: CaseContents  #: world, trace and verdicts; nothing about them
    explanation: Explanation | None
    check: ReplayCheck | None
    certificate: Certificate | None  #: None: there is none that the checker accepts
    minimisation: Minimisation | None
    smallest: CaseContents | None  #: the minimised world's run
    smallest_on_other: CaseContents | None  #: on the other stack, where two are compared
    other: CaseContents | None  #: the other stack's run
    near: TrialRecord | None  #: the nearest passing trial
    passing: CaseContents | None  #: its run, where it was kept


def view_of(campaign: Campaign, layers: Mapping[str, str] | None = None) -> CampaignView:
    """Count a campaign, and look at what else is known of it.

    Args:
        campaign: as stored.
        layers: suspected layers, if they are known already.
    """
    stats, settings = campaign.stats(), campaign.settings
    judged = tuple(record for record in campaign.records if record.status == "ok")
    if layers is None:
        layers = {record.id: layer_of(campaign, record) for record in judged if record.failed}
    return CampaignView(
        directory=campaign.directory,
        settings=settings,
        records=campaign.records,
        judged=judged,
        stats=stats,
        chance=probability_of(campaign, stats),
        ranking=rank_dimensions(settings, judged),
        passing=passing_trials(judged, settings.cube.dimensions),
        layers=layers,
        owner=owner_of(campaign.directory),
    )


def any_world(campaign: Campaign, judged: Sequence[TrialRecord]) -> World | None:
    """Read the first world that was kept; None: there is none."""
    for record in judged:
        path = campaign.folder(record) / WORLD_NAME
        if path.is_file():
            with contextlib.suppress(InputError):  # the case says what is wrong with it
                return read_world(path)
    return None


def in_turn(records: Sequence[TrialRecord], modes: Sequence[FailureMode]) -> Iterator[TrialRecord]:
    """Yield failures whose runs were kept: the first of each mode, then the second of each."""
    by_id = {record.id: record for record in records if record.trace_file}
    queues = [[by_id[i] for i in mode.ids if i in by_id] for mode in modes]
    for turn in range(max(map(len, queues), default=0)):
        for queue in queues:
            if turn < len(queue):
                yield queue[turn]


def readable_failures(
    campaign: Campaign, turn: Iterable[TrialRecord], passing: PassingTrials, most: int
) -> tuple[list[StoredFailure], list[str]]:
    """Read the failures to show, and say which have missing or damaged files.

    Args:
        campaign: whose failures.
        turn: the failures, those to show first first.
        passing: its passing trials.
        most: failures to show; fewer where their traces take up much memory.
    """
    found: list[StoredFailure] = []
    lost: list[str] = []
    held = 0
    for record in turn:
        if len(found) >= most or len(lost) >= MAX_LOST or held > MAX_HELD:
            break
        held += _held(found[-1]) if found else 0
        try:
            found.append(read_failure(campaign, record, passing))
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
    return found, lost


def read_failure(campaign: Campaign, record: TrialRecord, passing: PassingTrials) -> StoredFailure:
    """Read the files of a failure.

    Args:
        campaign: of the failure.
        record: of the failure.
        passing: the campaign's passing trials.

    Raises:
        InputError: one of them is missing or damaged.
    """
    folder, trials = campaign.folder(record), campaign.settings.trials
    config = stack_of(trials, record)
    run = _run(record.id, folder, record.verdicts, config, record.signature)
    near = nearest_passing(campaign.settings, passing, record)
    minimisation = read_finding(folder, Minimisation)
    smallest, smallest_on_other = None, None
    if minimisation is not None and (folder / "world.min.json").is_file():
        name, found = f"{record.id}, minimised", minimisation
        smallest = _run(name, folder, found.verdicts, config, found.signature, ".min")
        theirs = other_stack_of(campaign, record)
        if found.other is not None and theirs is not None:
            smallest_on_other = _run(
                f"{name}, the other stack",
                folder,
                found.other.verdicts,
                theirs,
                found.other.signature,
                ".min",
                ".min.other",
            )
    return StoredFailure(
        record=record,
        folder=folder,
        files=frozenset(path.name for path in folder.iterdir() if path.is_file()),
        config=config,
        run=run,
        explanation=read_finding(folder, Explanation),
        check=read_finding(folder, ReplayCheck),
        certificate=read_certificate(folder),
        minimisation=minimisation,
        smallest=smallest,
        smallest_on_other=smallest_on_other,
        other=_on_other(campaign, record),
        near=near,
        passing=_passing(campaign, near) if near is not None and record.other is None else None,
    )


def _held(failure: StoredFailure) -> int:
    return sum(column.nbytes for column in failure.run.trace.columns.values())


def _passing(campaign: Campaign, near: TrialRecord) -> CaseContents | None:
    """Read the run of a passing trial, if it was kept."""
    folder = campaign.folder(near)
    if not (folder / TRACE_NAME).is_file():
        return None
    return _run(near.id, folder, near.verdicts, stack_of(campaign.settings.trials, near))


def _on_other(campaign: Campaign, record: TrialRecord) -> CaseContents | None:
    """Read what the other stack did in the world of a failure, where two are compared."""
    other = record.other
    if other is None or not other.trace_file:
        return None
    theirs, seen = of_other_stack(campaign, record)
    name, config = f"{record.id}, the other stack", stack_of(theirs.settings.trials, seen)
    return _run(name, theirs.folder(seen), other.verdicts, config, other.signature)


def _run(
    name: str,
    folder: Path,
    verdicts: Sequence[Verdict],
    config: StackConfig,
    signature: str = "",
    of_world: str = "",
    of_trace: str | None = None,
) -> CaseContents:
    """Read a run, its verdicts by cause; ``of_world`` and ``of_trace`` are in its files' names."""
    trace_file = f"trace{of_world if of_trace is None else of_trace}.zip"
    world, trace = read_run(folder / f"world{of_world}.json", folder / trace_file)
    return CaseContents(
        id=name,
        signature=signature,
        world=world,
        trace=trace,
        verdicts=by_cause(verdicts),
        facts=(),
        commands=(),
        costmap=map_of(world, config),
    )
