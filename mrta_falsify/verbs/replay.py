"""Run a stored trial again, and compare it with its record."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from mrta_falsify.campaigns.code_digest import code_digest
from mrta_falsify.campaigns.finding_files import write_finding
from mrta_falsify.campaigns.journal import RunJournal, resumable
from mrta_falsify.campaigns.rules import JUDGED_SINCE
from mrta_falsify.campaigns.store import OTHER, Campaign, format_version, trial_folder
from mrta_falsify.core import codec
from mrta_falsify.core.difference import Difference, first_difference
from mrta_falsify.core.findings import ReplayCheck
from mrta_falsify.core.record import TrialRecord, versions
from mrta_falsify.core.trace import read_trace
from mrta_falsify.core.world import World
from mrta_falsify.verbs.folders import Place
from mrta_falsify.verbs.stored_trials import of_other_stack, stored_world
from mrta_falsify.verbs.trust import Trust, open_to_run, permit_runs
from mrta_falsify.worker import rerun, specifications_of
from simulator_interface.external.transcript import TRANSCRIPT_NAME, read_transcript
from simulator_interface.guard import guarded

PACKAGE = "mrta-falsify"  # key of our own version in a record
JOURNAL_NAME = "verify.journal.jsonl"  # beside the trial, until all its runs are finished


@dataclass(frozen=True, slots=True, kw_only=True)
class ReplayRun:
    """What one run of a stored trial gave."""

    trace_digest: str
    violations: dict[str, float | None]  #: time [s] by specification that is violated
    difference: Difference | None = None  #: from the kept trace, if it is another one

    @property
    def failed(self) -> bool:
        """Whether a specification is violated."""
        return bool(self.violations)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Replay:
    """Runs of one stored trial, compared with its record."""

    record: TrialRecord
    runs: tuple[ReplayRun, ...]
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

    A stack in a process of its own is not asked again: its stored answers are told.

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
    trials = campaign.settings.trials
    code = code_digest(trials.stack, specifications_of(trials))
    journal = RunJournal(ReplayRun, campaign.make_folder(record) / JOURNAL_NAME, code=code)
    with resumable(f"replay {record.id}", journal):
        result = replay_trial(campaign, record, times=verify, live=live, journal=journal)
        store_replay(campaign, result)
    journal.discard()
    return result


@guarded()
def replay_trial(
    campaign: Campaign,
    record: TrialRecord,
    *,
    times: int = 1,
    live: bool = False,
    journal: RunJournal[ReplayRun] | None = None,
) -> Replay:
    """Run a stored trial again ``times`` times, but for the runs in ``journal``.

    Args:
        campaign: that has it.
        record: of the trial.
        times: how often.
        live: ask a stack in a process of its own again, instead of telling its stored answers.
        journal: keeps finished runs.

    Raises:
        InputError: the trial has no world, or the campaign's files have changed.
    """
    world = stored_world(campaign, record)
    journal = journal or RunJournal(ReplayRun, None)
    runs = []
    for number in range(times):
        key = codec.digest([record, campaign.settings.trials, number, live])
        known = journal.answers.get(key)
        runs.append(known or journal.keep(key, _run(campaign, record, world, live=live)))
    wanted = {v.spec: v.violated_at for v in record.verdicts if v.violated}
    same_version = _is_same_version(campaign, record)
    differences = [run.difference for run in runs if run.trace_digest != record.trace_digest]
    return Replay(
        record=record,
        runs=tuple(runs),
        same_digest=sum(run.trace_digest == record.trace_digest for run in runs),
        same_verdicts=sum(
            run.violations == wanted if same_version else run.violations.keys() == wanted.keys()
            for run in runs
        ),
        same_version=same_version,
        same_machine=record.origin.versions == versions(),
        difference=differences[0] if differences else None,
    )


def _has_answers(campaign: Campaign, record: TrialRecord) -> bool:
    """Whether a stack's answers were kept; who made the folder has not been asked yet."""
    own = trial_folder(campaign.directory, record.number)
    beside = Path(record.trace_file).parent.name == OTHER
    return ((own / OTHER if beside else own) / TRANSCRIPT_NAME).is_file()


def _run(campaign: Campaign, record: TrialRecord, world: World, *, live: bool) -> ReplayRun:
    """Run a stored trial once and compare it with its trace, if that was kept."""
    path = campaign.folder(record) / TRANSCRIPT_NAME
    told = read_transcript(path) if path.is_file() and not live else None
    judged = rerun(campaign.settings.trials, record, world, told)
    trace = judged.outcome.trace
    stored: Path = campaign.folder(record) / "trace.zip"
    difference = None
    if trace.digest != record.trace_digest and stored.is_file():
        difference = first_difference(read_trace(stored), trace)
    return ReplayRun(
        trace_digest=trace.digest,
        violations={v.spec: v.violated_at for v in judged.verdicts if v.violated},
        difference=difference,
    )


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
    runs: int
    identical: int
    same_verdicts: int
    same_version: bool
    same_machine: bool
    first_difference: Difference | None
    trace_digest: str
    trace_digests: tuple[str, ...]
    failed: tuple[bool, ...]
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
        trace_digests=tuple(run.trace_digest for run in result.runs),
        failed=tuple(run.failed for run in result.runs),
        signature=result.record.signature,
    )
