"""Run a stored trial again, and compare it with its record."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path

from mrta_falsify.campaigns.finding_files import write_finding
from mrta_falsify.campaigns.rules import JUDGED_SINCE
from mrta_falsify.campaigns.store import OTHER, Campaign, format_version, trial_folder
from mrta_falsify.commands.folders import Place
from mrta_falsify.commands.stored_trials import of_other_stack
from mrta_falsify.commands.trust import Trust, open_to_run, permit_runs
from mrta_falsify.core.difference import Difference
from mrta_falsify.core.findings import ReplayCheck
from mrta_falsify.core.record import TrialRecord, versions
from mrta_falsify.lab import Experiment, KeptTrace, Lab, RunResult, certain, experiment_of_record
from mrta_falsify.lab.stored import TRACE_NAME, stored_world
from simulator_interface.external.transcript import TRANSCRIPT_NAME, read_transcript

PACKAGE = "mrta-falsify"  # key of our own version in a record
JOURNAL_NAME = "verify.journal.jsonl"  # beside the trial, until all its runs are finished


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Replay:
    """Runs of one stored trial, compared with its record."""

    record: TrialRecord
    runs: tuple[RunResult, ...]
    same_digest: int  #: runs with the recorded trace digest
    #: runs that violate the same specifications; at the same times, too, if the version is the same
    same_verdicts: int
    same_version: bool  #: of the toolkit, and of the format of the campaign
    same_machine: bool  #: versions and machine type are those of the record
    difference: Difference | None  #: of the first other run from the kept trace, if it is kept

    @property
    def identical(self) -> bool:
        """Whether every run is bit-equal to the record."""
        return self.same_digest == len(self.runs)

    @property
    def agrees(self) -> bool:
        """Whether the runs are what the record promises.

        Another version of the toolkit promises its verdicts, not its digests.
        """
        agreeing = self.same_digest if self.same_version else self.same_verdicts
        return agreeing == len(self.runs)


def replay(
    directory: Place,
    id: str | int,
    verify: int = 1,
    live: bool = False,
    *,
    against: bool = False,
    trust: Trust = False,
) -> Replay:
    """Run a stored trial again, and keep what that shows beside it, for the report.

    A foreign stack does not run again: its stored answers are used.

    Args:
        directory: of the campaign.
        id: of the trial.
        verify: how often to run it.
        live: ask the stack again.
        against: the run of the other stack, of a campaign that compares two.
        trust: run what is not ours, though somebody else has made the campaign.

    Raises:
        InputError: the trial has no world, or the campaign's files have changed.
        Interrupted: Ctrl-C; finished runs are kept for the next call, and nothing is stored.
    """
    campaign = open_to_run(directory, trust)
    record = campaign.record(str(id))
    if against:
        campaign, record = of_other_stack(campaign, record)
    permit_runs(campaign, (record,), trust, told=not live and _has_answers(campaign, record))
    journal = campaign.make_folder(record) / JOURNAL_NAME
    with Lab(journal, what=f"replay {record.id}") as lab:
        result = replay_trial(campaign, record, times=verify, live=live, lab=lab)
        store_replay(campaign, result)
    lab.journal.discard()
    return result


def replay_trial(
    campaign: Campaign,
    record: TrialRecord,
    *,
    times: int = 1,
    live: bool = False,
    lab: Lab | None = None,
) -> Replay:
    """Run a stored trial again ``times`` times, but for the runs that a lab has kept.

    Args:
        campaign: that has it.
        record: of the trial.
        times: how often.
        live: run a foreign stack again, instead of using its stored answers.
        lab: that runs it, and keeps finished runs.

    Raises:
        InputError: the trial has no world, or the campaign's files have changed.
    """
    own = _experiment(campaign, record, live=live)
    with lab or Lab() as opened:
        repeats = [dataclasses.replace(own, repeat=number) for number in range(times)]
        runs = tuple(map(certain, opened.map(repeats)))
    wanted = {v.spec: v.violated_at for v in record.verdicts if v.violated}
    found = [{v.spec: v.violated_at for v in run.verdicts if v.violated} for run in runs]
    same_version = _is_same_version(campaign, record)
    differences = [run.difference for run in runs if run.trace != record.trace_digest]
    return Replay(
        record=record,
        runs=runs,
        same_digest=sum(run.trace == record.trace_digest for run in runs),
        same_verdicts=sum(
            violations == wanted if same_version else violations.keys() == wanted.keys()
            for violations in found
        ),
        same_version=same_version,
        same_machine=_is_same_machine(record),
        difference=differences[0] if differences else None,
    )


def _has_answers(campaign: Campaign, record: TrialRecord) -> bool:
    """Whether a stack's answers were kept; who made the folder has not been asked yet."""
    own = trial_folder(campaign.directory, record.number)
    beside = Path(record.trace_file).parent.name == OTHER
    return ((own / OTHER if beside else own) / TRANSCRIPT_NAME).is_file()


def _experiment(campaign: Campaign, record: TrialRecord, *, live: bool) -> Experiment:
    """Describe the run of a stored trial, to be compared with its trace if that was kept."""
    folder = campaign.folder(record)
    answers, trace = folder / TRANSCRIPT_NAME, folder / TRACE_NAME
    own = experiment_of_record(campaign.settings.trials, record, stored_world(campaign, record))
    return dataclasses.replace(
        own,
        transcript=read_transcript(answers) if answers.is_file() and not live else None,
        compared_with=KeptTrace(file=str(trace), digest=record.trace_digest)
        if trace.is_file()
        else None,
    )


def _is_same_machine(record: TrialRecord) -> bool:
    """Whether all versions that a record tells, and the machine type, are those of today."""
    recorded = record.origin.versions
    return bool(recorded) and recorded.items() <= versions().items()


def _is_same_version(campaign: Campaign, record: TrialRecord) -> bool:
    recorded_by = record.origin.versions.get(PACKAGE, versions()[PACKAGE])
    is_same_format = format_version(campaign.directory) > 1
    has_same_rules = campaign.settings.rules >= JUDGED_SINCE
    return is_same_format and has_same_rules and recorded_by == versions()[PACKAGE]


def store_replay(campaign: Campaign, result: Replay) -> ReplayCheck:
    """Keep what replays have shown beside the trial, for the report."""
    check = ReplayCheck(
        runs=len(result.runs),
        identical=result.same_digest,
        same_verdicts=result.same_verdicts,
        same_machine=result.same_machine,
        first_difference=result.difference,
    )
    write_finding(campaign.make_folder(result.record), check)
    return check


@dataclass(frozen=True, slots=True, kw_only=True)
class ReplaySummary:
    """What ``replay --format json`` prints."""

    id: str
    runs: int  #: number of repeats
    identical: int  #: repeats with the stored trace digest
    same_verdicts: int  #: repeats with the stored verdicts
    same_version: bool  #: recorded by this version
    same_machine: bool  #: recorded on a machine of this type
    first_difference: Difference | None  #: where a repeat departs from the stored trace
    trace_digest: str  #: stored
    trace_digests: tuple[str, ...]  #: of the repeats
    failed: tuple[bool, ...]  #: one for each repeat
    signature: str


def summarise_replay(result: Replay) -> ReplaySummary:
    """Sum replays up."""
    return ReplaySummary(
        id=result.record.id,
        runs=len(result.runs),
        identical=result.same_digest,
        same_verdicts=result.same_verdicts,
        same_version=result.same_version,
        same_machine=result.same_machine,
        first_difference=result.difference,
        trace_digest=result.record.trace_digest,
        trace_digests=tuple(run.trace for run in result.runs),
        failed=tuple(bool(run.violated) for run in result.runs),
        signature=result.record.signature,
    )
