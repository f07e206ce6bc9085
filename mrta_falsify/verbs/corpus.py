"""All stored failures on a changed stack: fixed, still failing, flaky, timed out or not judged.

Each run is a job of a worker process, as a trial of a campaign is, so that a run that exceeds
its time limit can be killed.
"""

from __future__ import annotations

import collections
import contextlib
import dataclasses
from collections.abc import Callable, Collection, Generator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, NamedTuple, TypeAlias, get_args

from mrta_falsify.campaigns.code_digest import code_digest
from mrta_falsify.campaigns.executors import Finished
from mrta_falsify.campaigns.journal import RunJournal, resumable
from mrta_falsify.campaigns.made_here import follow_links
from mrta_falsify.campaigns.rules import JUDGED_SINCE, signed
from mrta_falsify.campaigns.runner import REPEATS
from mrta_falsify.campaigns.settings import CampaignSettings, TrialSettings
from mrta_falsify.campaigns.signature import signature, signature_before
from mrta_falsify.campaigns.store import Campaign
from mrta_falsify.core import codec
from mrta_falsify.core.codec import later
from mrta_falsify.core.config import StackConfig
from mrta_falsify.core.errors import HarnessError, InputError, PlaceError, WorldError
from mrta_falsify.core.findings import Recheck, RecheckFate
from mrta_falsify.core.record import TrialRecord
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.process.budget import credit
from mrta_falsify.specs.causes import kind_of, leading
from mrta_falsify.verbs.stored_trials import stored_world
from mrta_falsify.verbs.workers import local_workers, open_executor
from mrta_falsify.worker import rerun, specifications_of
from reports.run_view import RunView
from reports.sentences import violation_sentence
from scenic_worlds.variation import perturb_world
from simulator_interface.guard import Guard, guarded

#: no place: the copy has no place for its robots; refused: the world cannot be run
RunFate: TypeAlias = Literal["ran", "timeout", "no place", "refused"]

WAIT = 1.0  # s between two looks at overdue workers
STORED = -1  # number of the stored world among its jittered copies
JOURNAL_NAME = "corpus.journal.jsonl"  # in the campaign, until all rows are finished


# --- the changed stack ---------------------------------------------------------------------


def names_engine(path: Path | None, settings: Sequence[str]) -> bool:
    """Whether a stack file or a ``--set`` text names an engine.

    Args:
        path: of the YAML file, if one was given.
        settings: ``--set`` texts.
    """
    data = codec.read_yaml(path) if path is not None else None
    layers = [text.partition("=")[0].strip().partition(".")[0] for text in settings]
    return "engine" in layers or (isinstance(data, dict) and "engine" in data)


def on_recorded_engine(campaign: Campaign, config: StackConfig) -> StackConfig:
    """Put a changed stack on the engine that the campaign ran on."""
    return dataclasses.replace(config, engine=campaign.settings.trials.stack.engine)


# --- all failures --------------------------------------------------------------------------


def recheck(
    campaign: Campaign,
    *,
    config: StackConfig | None = None,
    jittered: int = 2,
    workers: int = 1,
    time_limit: float | None = None,
    only: Collection[str] = (),
    pictures: Path | None = None,
    on_done: Callable[[Recheck], None] = lambda row: None,
) -> tuple[Recheck, ...]:
    """Run all stored failures again.

    Args:
        campaign: whose failures.
        config: the changed stack; the campaign's own if None.
        jittered: copies of each world with small differences (see ``perturb_world``).
        workers: processes at a time; they change no result.
        time_limit: what one run may work and sleep [s]; the campaign's own limit if None.
        only: ids of the failures to run; all if empty.
        pictures: directory for a picture of each run that fails; none are drawn if None.
        on_done: called after each failure, in the order in which they end.

    Returns:
        One row per failure, in the order of the trials.

    Raises:
        InputError: a stored world is missing or damaged.
        HarnessError: a run crashed.
        Interrupted: Ctrl-C; finished runs are kept for the next call.
    """
    failures = [r for r in campaign.records if r.failed and (not only or r.id in only)]
    settings = _settings(campaign, config, time_limit)
    trials = settings.trials
    code = code_digest(trials.stack, specifications_of(trials))
    journal = RunJournal(RecheckRun, campaign.directory / JOURNAL_NAME, code=code)
    found = _Collected(copies=1 + jittered, rules=campaign.settings.rules, on_done=on_done)
    reruns = [_Rerun(record, copy) for record in failures for copy in (STORED, *range(jittered))]
    with resumable(f"corpus of {len(failures)} failures", journal):
        digest = codec.digest(settings)
        places = [_picture_of(one, pictures) for one in reruns]
        keys = [
            codec.digest([digest, one.record, one.copy, *([place] if place else [])])
            for one, place in zip(reruns, places, strict=True)
        ]
        missing: dict[_Rerun, str] = {}
        for one, key in zip(reruns, keys, strict=True):
            if key in journal.answers:
                found.take(one, journal.answers[key])
            else:
                missing[one] = key
        left = tuple(missing)
        jobs = [
            {
                "record": codec.encode(one.record),
                "copy": one.copy,
                "picture": _picture_of(one, pictures),
            }
            for one in left
        ]
        with contextlib.closing(finished_jobs(settings, jobs, workers)) as finished:
            for job in finished:
                one = left[job.number]
                run = run_of(job, f"trial {one.record.id}")
                found.take(one, journal.keep(missing[one], run))
    journal.discard()
    return tuple(found.rows[record.id] for record in failures)


class _Rerun(NamedTuple):
    """A run of a stored failure, or of a copy of it."""

    record: TrialRecord
    copy: int  #: seed of the copy; ``STORED`` for the world itself


def _picture_of(one: _Rerun, pictures: Path | None) -> str:
    """Name the file for a picture of a run; empty where none is asked for."""
    if pictures is None:
        return ""
    copy = "" if one.copy == STORED else f".copy{one.copy}"
    return str(pictures.resolve() / f"{one.record.id}{copy}.png")


def finished_jobs(
    settings: CampaignSettings, jobs: Sequence[dict[str, Any]], workers: int
) -> Generator[Finished, None, None]:
    """Run jobs in workers, and yield what became of them in the order in which they end.

    A job that is lost with its worker is run again, as a trial of a campaign.

    Args:
        settings: whose target the workers open.
        jobs: without their numbers, which are their places.
        workers: processes at a time.
    """
    if not jobs:
        return
    with open_executor(settings, local_workers(min(workers, len(jobs)))) as opened:
        for number, job in enumerate(jobs):
            opened.submit({"number": number, **job})
        left, lost = len(jobs), collections.Counter[int]()
        while left:
            for finished in opened.collect(WAIT):
                number = finished.number
                if finished.fate in ("crashed", "timeout") and lost[number] < REPEATS:
                    lost[number] += 1
                    opened.submit({"number": number, **jobs[number]})
                    continue
                left -= 1
                yield finished


@dataclass(frozen=True, slots=True)
class _Collected:
    """The runs of all failures, and the rows of those whose runs are complete."""

    copies: int  #: runs of each failure
    rules: int  #: of the campaign
    on_done: Callable[[Recheck], None]
    rows: dict[str, Recheck] = field(default_factory=dict)  #: by trial
    _runs: dict[str, dict[int, RecheckRun]] = field(default_factory=dict)

    def take(self, one: _Rerun, run: RecheckRun) -> None:
        record = one.record
        runs = self._runs.setdefault(record.id, {})
        runs[one.copy] = run
        if len(runs) == self.copies:
            self.rows[record.id] = _row(record, runs, self.rules)
            self.on_done(self.rows[record.id])


def counts_by_fate(rows: Sequence[Recheck]) -> dict[RecheckFate, int]:
    """Count rows by what became of them."""
    fates: tuple[RecheckFate, ...] = get_args(RecheckFate)
    return {fate: sum(row.fate == fate for row in rows) for fate in fates}


def _settings(
    campaign: Campaign, config: StackConfig | None, time_limit: float | None
) -> CampaignSettings:
    """Settings that make workers run rechecks instead of trials."""
    trials = dataclasses.replace(
        campaign.settings.trials,
        stack=config or campaign.settings.trials.stack,
        directory=str(campaign.directory.resolve()),
    )
    return CampaignSettings(
        trials=trials,
        target=f"{__name__}:{open_rechecks.__name__}",
        time_limit=time_limit or campaign.settings.time_limit,
    )


def run_of(finished: Finished, what: str) -> RecheckRun:
    """Read what a worker answered about the world of ``what``.

    Raises:
        InputError: the world cannot be run.
        PlaceError: a file of it cannot be written.
        HarnessError: the run crashed.
    """
    if finished.fate == "unwritable":
        raise PlaceError(finished.error)
    if finished.fate == "timeout":
        return RecheckRun(fate="timeout")
    if finished.record is None:
        reason = (finished.error.strip().splitlines() or ["no reason given"])[-1]
        raise HarnessError(f"the re-run of {what} crashed: {reason}")
    run = codec.decode(RecheckRun, finished.record, where="recheck")
    if run.fate == "refused":
        raise InputError(run.error)
    return run


def _row(record: TrialRecord, runs: dict[int, RecheckRun], rules: int) -> Recheck:
    """Judge a failure by the runs of its world and of its copies, in the form of its rules."""
    stored = runs[STORED]
    copies = [run for number, run in sorted(runs.items()) if number != STORED]
    copies = [run for run in copies if run.fate == "ran"]
    failures = sum(run.failed for run in copies)
    told = next((run for run in (stored, *copies) if run.failed), stored)
    fate: RecheckFate = "fixed"
    if stored.failed:
        fate = "still failing"
    elif failures:
        fate = "flaky"
    elif any(run.fate == "timeout" for run in runs.values()):
        fate = "timeout"
    elif {v.spec for v in record.verdicts if v.violated} & set(stored.not_judged):
        fate = "not judged"
    return Recheck(
        id=record.id,
        fate=fate,
        # recomputed: another version may have written the stored one in other words
        signature=signed(record.verdicts, rules),
        violated=stored.violated,
        signature_now=stored.signed(rules),
        jittered_failures=failures,
        jittered=len(copies),
        sentence=told.sentence,
        copy_signatures=tuple(run.signed(rules) for run in copies if run.failed),
        picture=told.picture,
        kind_now=stored.kind,
        forms_now=(stored.signature, stored.signature_before),
    )


# --- in a worker ---------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, kw_only=True)
class RecheckRun:
    """What one run of a stored failure gave."""

    fate: RunFate
    violated: tuple[str, ...] = ()  #: specifications
    not_judged: tuple[str, ...] = ()  #: specifications that the changed stack tells too little for
    signature: str = ""
    sentence: str = ""  #: about the violation that came first
    error: str = ""  #: why it was refused
    picture: str = later("")  #: file
    signature_before: str = later("")  #: in the form of rules 1
    kind: str = later("")  #: deadlock, stuck or shut; empty: none of them

    def signed(self, rules: int) -> str:
        """Give the signature in the form of a campaign's rules."""
        return self.signature_before if rules < JUDGED_SINCE else self.signature

    @property
    def failed(self) -> bool:
        """Whether a specification is violated."""
        return bool(self.violated)


def open_rechecks(settings: TrialSettings) -> Callable[[dict[str, Any]], dict[str, Any]]:
    """Open a campaign for rechecks; the result runs one job after the other.

    Args:
        settings: of the campaign, with the changed stack and the present directory.

    Returns:
        A function from ``{"number": n, "record": {...}, "copy": k, "picture": path}`` to an
        encoded :class:`RecheckRun`.
    """
    follow_links(Path(settings.directory))  # who started this worker has asked the user

    def run(job: dict[str, Any]) -> RecheckRun:
        record = codec.decode(TrialRecord, job["record"], where="recheck")
        return run_again(settings, record, job["copy"], picture=job["picture"])

    return answering(run)


def answering(
    run: Callable[[dict[str, Any]], RecheckRun],
) -> Callable[[dict[str, Any]], dict[str, Any]]:
    """Make what a worker opens of a function from a job to its run: guarded, encoded."""
    guard = Guard(on_lost=credit)

    def answer(job: dict[str, Any]) -> dict[str, Any]:
        try:
            with guarded(guard):
                found = run(job)
        except InputError as error:
            found = RecheckRun(fate="refused", error=str(error))
        data: dict[str, Any] = codec.encode(found)
        return data

    return answer


def run_again(
    settings: TrialSettings, record: TrialRecord, copy: int, *, picture: str = ""
) -> RecheckRun:
    """Run the world of a stored failure, or a jittered copy of it.

    Args:
        settings: of the campaign, with the changed stack and the present directory.
        record: of the failure.
        copy: seed of the copy; ``STORED`` for the world itself.
        picture: file for a picture of the run if it fails; empty: none.

    Raises:
        InputError: the stored world is missing or damaged, or cannot be run.
    """
    campaign = Campaign(
        directory=Path(settings.directory),
        settings=CampaignSettings(trials=settings),
        records=(record,),
    )
    world = stored_world(campaign, record)
    if copy != STORED:
        try:
            world = perturb_world(world, copy)
        except WorldError:
            return RecheckRun(fate="no place")
    # A changed stack is judged by physics if that is its engine, whatever found the failure.
    assert record.result is not None, "a failure was run"
    here = dataclasses.replace(record.result, engine=settings.stack.engine.name)
    judged = rerun(settings, dataclasses.replace(record, result=here), world)
    run = judged_run(judged.verdicts)
    if not picture or not run.failed:
        return run
    from reports.run_picture import write_picture  # noqa: PLC0415 - matplotlib loads slowly

    view = RunView(world=world, trace=judged.outcome.trace, verdicts=judged.verdicts)
    write_picture(view, Path(picture))
    return dataclasses.replace(run, picture=picture)


def judged_run(verdicts: Sequence[Verdict]) -> RecheckRun:
    """Say what a run gave, by its verdicts."""
    first = leading(verdicts)
    return RecheckRun(
        fate="ran",
        violated=tuple(verdict.spec for verdict in verdicts if verdict.violated),
        not_judged=tuple(verdict.spec for verdict in verdicts if verdict.not_judged),
        signature=signature(verdicts),
        signature_before=signature_before(verdicts),
        kind=kind_of(verdicts),
        sentence=violation_sentence(first) if first is not None else "",
    )
