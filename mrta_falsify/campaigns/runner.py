"""The search loop: ask, run, store, tell.

Proposal n is asked for once results 0 to n - window are told, whatever the budget, the number
of workers or the order in which trials end. A campaign is therefore a function of its
settings. To resume one, what is stored is asked and told again, and the rest is run.
"""

from __future__ import annotations

import dataclasses
import hashlib
import shlex
import time
from collections import Counter
from collections.abc import Callable, Collection
from dataclasses import dataclass, field
from typing import Any, Literal, Protocol

import numpy as np

from mrta_falsify.campaigns.executors import Finished, Job
from mrta_falsify.campaigns.settings import CampaignSettings, Limits
from mrta_falsify.campaigns.stats import CampaignStats
from mrta_falsify.campaigns.store import Store, StoreError, decode_record
from mrta_falsify.core import codec, registry
from mrta_falsify.core.arrays import Array
from mrta_falsify.core.candidate import Proposal
from mrta_falsify.core.config import Choice
from mrta_falsify.core.errors import HarnessError, InputError, PlaceError
from mrta_falsify.core.feedback import Cube, Feedback
from mrta_falsify.core.protocols import Preflight, PreflightSampler, Sampler, SkippingSampler
from mrta_falsify.core.record import TrialRecord
from mrta_falsify.core.renamed import renamed_attribute
from mrta_falsify.specs.causes import secondary
from mrta_falsify.specs.objectives import differing

COMPARED = 16  # stored proposals at either end that a resumed campaign compares at least
COLLECT_TIMEOUT = 1.0  # s between two looks at overdue workers
ROBUST_SHARE = 0.5  # of copies; a failure is robust if more of them fail
REPEATS = 2  # of a trial that is lost, before the campaign stops
Ended = Literal["budget", "clock", "stop-after", "saturated"]


class Executor(Protocol):
    """Runs jobs somewhere."""

    def submit(self, job: Job) -> None:
        """Take a job."""

    def collect(self, timeout: float) -> tuple[Finished, ...]:
        """Collect the jobs that have ended, after at most about ``timeout`` [s]."""


@dataclass(slots=True)
class Progress(CampaignStats):
    """Counts over the told results of a campaign, hence the same for any worker count."""

    limits: Limits = field(kw_only=True)
    rejected_in_a_row: int = 0  #: impossible ones included

    def __getattr__(self, name: str) -> Any:
        return renamed_attribute(self, name, {"wanted": "robust"})

    @property
    def told(self) -> int:
        """Proposals whose results the sampler knows."""
        return self.records

    @property
    def is_saturated(self) -> bool:
        """Whether ``until_saturated`` is reached."""
        limit = self.limits.until_saturated
        return limit > 0.0 and self.saturation.unseen().high < limit

    @property
    def has_enough(self) -> bool:
        """Whether ``stop_after`` is reached."""
        return 0 < self.limits.stop_after <= self.robust

    def take(self, record: TrialRecord) -> None:
        """Count a told record."""
        CampaignStats.take(self, record)  # super() does not know classes with slots
        self.rejected_in_a_row = 0 if record.was_run else self.rejected_in_a_row + 1


def point_digest(u: Array) -> str:
    """Compute a short digest of a point of the cube, equal only for bit-equal points."""
    data = np.ascontiguousarray(u, dtype=np.float64) + 0.0
    return hashlib.sha256(data.tobytes()).hexdigest()[:16]


def build_sampler(settings: CampaignSettings) -> Sampler:
    """Build the campaign's sampler, before its first proposal.

    Raises:
        InputError: unknown name or option.
    """
    choice = Choice(settings.sampler.name, sampler_options(settings))
    sampler: Sampler = registry.build("sampler", choice, where="campaign")
    return sampler


def sampler_options(settings: CampaignSettings) -> dict[str, Any]:
    """Complete the options of the campaign's sampler: the user's, and what the campaign knows.

    Raises:
        InputError: unknown sampler.
    """
    known = registry.load("sampler", settings.sampler.name, where="campaign").Options
    options: dict[str, Any] = {
        **settings.sampler.options,
        "cube": codec.encode(settings.cube),
        "seed": settings.trials.seed,
    }
    if any(field.name == "robust" for field in dataclasses.fields(known)):
        options.setdefault("robust", settings.trials.jittered > 0)
    return options


def feedback_of(record: TrialRecord, cube: Cube, then: Collection[str] = ()) -> Feedback:
    """Build what the sampler is told about a record; errors look like rejected scenes to it.

    A secondary specification (``then``) is no objective to it; a failure only of that is none. Nor
    is a place that the world shut, or a failure that the other stack shares where two are
    compared. Of a failure with copies it is told the margins to expect: a knife edge looks like the
    passing worlds around it, and its score is not below 0. Its signature differs from that of a
    robust failure, so a sampler that looks for other kinds of failure leaves knife edges.
    """
    judged = record.status == "ok"
    last = secondary(record.verdicts, then)
    return Feedback(
        number=record.number,
        u=record.candidate.u,
        fate="judged" if judged else "rejected",
        score=record.score if record.vote is None else ROBUST_SHARE + record.score,
        objectives={n: told for n, told in _margins_of(record).items() if n not in last},
        descriptors=record.search.descriptors,
        failed=record.is_primary,
        signature=_kind(record) if record.is_primary else "",
        mode=record.signature if record.is_primary else "",
        blamed=cube.blocks_of(record.search.blamed),
    )


def _margins_of(record: TrialRecord) -> dict[str, float]:
    if record.vote is not None:
        return record.search.expected
    margins = record.result.margins if record.result is not None else {}
    other = record.other
    if other is None:
        return margins
    return {name: differing(margin, other.score) for name, margin in margins.items()}


def _kind(record: TrialRecord) -> str:
    copies = record.vote
    if copies is None or record.is_robust:
        return record.signature
    if copies.robust and record.other is not None and record.other.jittered is not None:
        theirs = record.other.jittered
        return f"{theirs.failed} of {theirs.runs} copies on the other stack: {record.signature}"
    return f"{copies.failed} of {copies.runs} copies: {record.signature}"


def run_campaign(
    store: Store,
    limits: Limits,
    executor: Executor,
    *,
    on_record: Callable[[TrialRecord, bool], None] = lambda record, is_new: None,
    on_feedback: Callable[[TrialRecord, Progress], None] = lambda record, progress: None,
    on_note: Callable[[str], None] = lambda text: None,
    preflight: Preflight | None = None,
) -> tuple[Progress, Ended]:
    """Run a campaign, or what is missing of it, within limits.

    A trial that is lost by no fault of the stack is run again at once, twice at most.

    Args:
        store: open; may hold records.
        limits: how much to run.
        executor: open for ``store.settings``.
        on_record: called when a record is durable, with whether it is new.
        on_feedback: called when the sampler knows a record, in number order.
        on_note: called when a trial was lost and is run again, with why.
        preflight: by which samplers may look at scenes before they propose one.

    Returns:
        Counts over all told records and why it ended.

    Raises:
        StoreError: what is stored does not belong to these settings, or was changed meanwhile.
        PlaceError: a file of a trial, or its record, cannot be written; nothing of it is stored.
        InputError: no proposal is accepted any more, or a trial cannot be run as the user asks.
        HarnessError: a trial was lost each time; nothing of it is stored.
        KeyboardInterrupt: Ctrl-C; all finished trials are in the store.
    """
    loop = _Loop(store, limits, executor, on_record, on_feedback, on_note, preflight)
    return loop.progress, loop.run()


def stored_progress(store: Store, limits: Limits) -> Progress:
    """Count all that is stored, whether or not the sampler has been told."""
    progress = Progress(store.settings, limits=limits)
    progress.take_all(store.finished[number] for number in sorted(store.finished))
    return progress


class _Loop:
    def __init__(
        self,
        store: Store,
        limits: Limits,
        executor: Executor,
        on_record: Callable[[TrialRecord, bool], None],
        on_feedback: Callable[[TrialRecord, Progress], None],
        on_note: Callable[[str], None],
        preflight: Preflight | None,
    ) -> None:
        self.progress = Progress(store.settings, limits=limits)
        self._store = store
        self._limits = limits
        self._executor = executor
        self._on_record = on_record
        self._on_feedback = on_feedback
        self._on_note = on_note
        self._sampler = build_sampler(store.settings)
        if preflight is not None and isinstance(self._sampler, PreflightSampler):
            self._sampler.rehearse_by(preflight)
        self._proposals: dict[int, Array] = {}
        self._uniform: set[int] = set()  # proposals that were drawn evenly
        self._asked = 0
        self._submitted = 0
        self._lost: Counter[int] = Counter()  # how often, by trial
        self._began = time.monotonic()
        self._is_late = False  # a trial was not begun, since the time was over
        # The first and the last stored proposals are asked for again and compared.
        between = sorted(store.finished)[COMPARED:-COMPARED]
        skips = isinstance(self._sampler, SkippingSampler)
        self._skipped = frozenset(between if skips else ())
        self._last_stored = max(store.finished, default=-1)

    def run(self) -> Ended:
        ended = self._run()
        self._store.begin()
        self._store.check()
        return ended

    def _run(self) -> Ended:
        while True:
            self._ask()
            self._submit()
            progress = self.progress
            if progress.told == self._submitted:
                return "clock" if self._is_late else "budget"
            record = self._store.finished.get(progress.told)
            if record is None:
                ended = self._executor.collect(COLLECT_TIMEOUT)
                for finished in sorted(ended, key=lambda one: one.record is None):
                    self._take(finished)  # what has a record first: the others may end all
                continue
            self._tell(record)
            if progress.has_enough:
                return "stop-after"
            if record.origin.uniform and progress.is_saturated:
                return "saturated"
            if progress.rejected_in_a_row >= self._limits.rejected_in_a_row:
                none = "valid scene" if record.status == "rejected" else "feasible world"
                raise InputError(
                    f"{self._store.settings.trials.scenario}: the last "
                    f"{progress.rejected_in_a_row} proposals gave no {none}; "
                    f"the last one: {record.error}"
                )

    def _ask(self) -> None:
        while self._asked < self.progress.told + self._store.settings.window:
            if self._asked in self._skipped:
                assert isinstance(self._sampler, SkippingSampler)
                self._sampler.skip()
                self._asked += 1
                continue
            proposal = self._sampler.ask()
            if proposal.number != self._asked:
                raise AssertionError(f"proposal {proposal.number} instead of {self._asked}")
            self._compare(proposal)
            self._proposals[proposal.number] = proposal.u
            if proposal.uniform:
                self._uniform.add(proposal.number)
            self._asked += 1
            self._submit()  # the next one may take a second to choose

    def _submit(self) -> None:
        progress = self.progress
        while self._submitted < self._asked:
            flying = self._submitted - progress.told
            if progress.ran + flying >= self._limits.budget:
                return
            number = self._submitted
            stored = self._store.finished.get(number)
            if stored is None and self._asked <= self._last_stored and progress.told < number:
                return  # a stored proposal may still turn out to be of another campaign
            if stored is None and self._time_is_over():
                self._is_late = True
                return
            self._submitted += 1
            if stored is None:
                self._store.begin()
                self._executor.submit({"number": number, "u": self._proposals[number].tolist()})
                continue
            self._on_record(stored, False)

    def _compare(self, proposal: Proposal) -> None:
        """Refuse a stored trial that was proposed at another point; nothing was written yet."""
        stored = self._store.finished.get(proposal.number)
        if stored is not None and stored.origin.proposal != point_digest(proposal.u):
            raise StoreError(
                f"{self._store.directory}: trial {stored.id} was proposed at another point than "
                "these settings and this version propose, so the campaign cannot be resumed, only "
                "read. Begin one in another directory, or delete this one"
            )

    def _time_is_over(self) -> bool:
        limit = self._limits.wall_clock
        return limit > 0.0 and time.monotonic() - self._began >= limit

    def _take(self, finished: Finished) -> None:
        number = finished.number
        if finished.fate == "unwritable":
            raise self._store.without(number, PlaceError(finished.error))
        if finished.record is None:
            self._lose(finished)
            self._executor.submit({"number": number, "u": self._proposals[number].tolist()})
            return
        record = decode_record(finished.record, where=f"trial {number}")
        origin = dataclasses.replace(record.origin, uniform=number in self._uniform)
        record = dataclasses.replace(record, origin=origin)
        self._store.add(record)
        self._on_record(record, True)

    def _lose(self, finished: Finished) -> None:
        """Take note that a trial was lost; raise if it is not to be run again."""
        number = finished.number
        self._lost[number] += 1
        reason = (finished.error.strip().splitlines() or ["no reason given"])[-1]
        if self._lost[number] <= REPEATS:
            self._on_note(f"trial {number:04d} was lost ({reason}); it is run again")
            return
        resume = f"mrta-falsify campaign --resume {shlex.quote(str(self._store.directory))}"
        hint = f"continue with: {resume}"
        if finished.fate == "timeout":
            most = self._store.settings.time_limit
            hint = f"give it more than {most:g} s: {resume} --time-limit {2.0 * most:g}"
        text = (
            f"trial {number:04d} was lost {self._lost[number]} times ({reason}); "
            f"nothing of it is stored; {hint}"
        )
        if finished.fate == "refused":
            raise InputError(text)
        error = HarnessError(text)
        error.add_note(finished.error)
        raise error

    def _tell(self, record: TrialRecord) -> None:
        settings = self._store.settings
        self._sampler.tell(feedback_of(record, settings.cube, settings.trials.then))
        self._proposals.pop(record.number, None)
        self.progress.take(record)
        self._on_feedback(record, self.progress)
