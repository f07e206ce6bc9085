"""The counts of a campaign, brought up to date record by record.

Whatever tells a number about a campaign reads it here: the progress line, the summary, the report,
``list``, the pytest plug-in and Python. So all of them tell the same.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field

from mrta_falsify.campaigns.saturation import Saturation, Unseen
from mrta_falsify.campaigns.settings import CampaignSettings
from mrta_falsify.core.claims import KINDS
from mrta_falsify.core.codec import later
from mrta_falsify.core.probability import Probability, failure_probability
from mrta_falsify.core.record import TrialRecord
from mrta_falsify.core.tight_ways import TightCount, TightWay, counted
from mrta_falsify.specs.causes import DEADLOCK, group_of, kind_of, leading

OTHER = "other"  #: kind of the failures that are neither deadlock nor stuck nor shut


@dataclass(frozen=True, slots=True, kw_only=True)
class FailureMode:
    """Failures with one signature."""

    signature: str
    count: int  #: number of failures
    ids: tuple[str, ...]  #: trials, knife edges last
    is_afterthought: bool = later(False)  #: fails in secondary specifications only
    kind: str = later("")  #: deadlock, stuck or shut; empty: none of them


@dataclass(frozen=True, slots=True, kw_only=True)
class ScreeningAgreement:
    """How many failures of the quick engine physics confirmed."""

    failed_in_screening: int
    confirmed: int


@dataclass(frozen=True, slots=True, kw_only=True)
class EngineAgreement:
    """How many robust failures are failures on another engine, too."""

    engine: str
    asked: int  #: robust failures run on it
    fails: int  #: those that fail in most runs


@dataclass(frozen=True, slots=True, kw_only=True)
class RepeatCounts:
    """Failures that were run again, nothing changed, by how often they came again."""

    always: int
    sometimes: int
    never: int


@dataclass(frozen=True, slots=True, kw_only=True)
class StackComparison:
    """What became of failures on the other stack."""

    found: int  #: failures that the other stack passes, as most perturbed runs on both confirm
    knife_edges: int  #: failures that it passes, which perturbed runs do not confirm
    on_both: int  #: failures of both stacks
    not_judged: int  #: failures that the other stack reports too little to judge
    runs: int  #: runs of the other stack, perturbed ones included; no part of the budget
    wall_s: float  #: wall-clock time of these runs


@dataclass(frozen=True, slots=True)
class FirstFailure:
    """How much a campaign had done when it found its first failure, that trial included."""

    ran: int  #: trials that were run
    judged: int  #: of them, those that ended without an error
    computed_s: float  #: [s]


@dataclass(slots=True)
class UniformTrials:
    """Trials that were drawn evenly, whatever had been found: the base of a probability."""

    drawn: int = 0  #: all of them, rejected ones included
    judged: int = 0  #: that failed, or in which every specification was judged
    failed: int = 0  #: of these, in what the campaign looks for first
    undecided: int = 0  #: that ended in an error, or passed with a specification not judged

    def take(self, record: TrialRecord) -> None:
        """Count a record."""
        self.drawn += 1
        if not record.was_run:
            return
        failed = record.is_primary
        if record.status == "ok" and (failed or not any(v.not_judged for v in record.verdicts)):
            self.judged += 1
            self.failed += failed
        else:
            self.undecided += 1

    def probability(self) -> Probability:
        """Estimate the probability of a violation, with an exact interval."""
        return failure_probability(self.failed, self.judged, undecided=self.undecided)


@dataclass(slots=True)
class _ModeCount:
    """The trials of one failure mode so far; the first robust one, or the first, says its kind."""

    is_afterthought: bool = False
    kind: str = ""
    robust: list[str] = field(default_factory=list)
    others: list[str] = field(default_factory=list)
    primary: int = 0

    def take(self, record: TrialRecord) -> None:
        if not self.robust and (record.is_robust or not self.others):
            cause = leading(record.verdicts)
            is_claim = cause is not None and cause.spec == DEADLOCK
            self.kind = kind_of(record.verdicts) if is_claim else ""
            self.is_afterthought = group_of(record.result) == "secondary"
        self.primary += record.is_primary
        (self.robust if record.is_robust else self.others).append(record.id)


@dataclass(slots=True)
class CampaignStats:
    """Counts over records of a campaign, taken in the order of their numbers."""

    settings: CampaignSettings = field(compare=False, repr=False)
    records: int = 0
    ran: int = 0  #: simulated candidates, those that ended in an error included
    judged: int = 0  #: of them, those that ended without one
    rejected: int = 0
    impossible: int = 0  #: worlds that no stack can do, set apart
    errors: int = 0  #: that older versions stored for trials that were lost
    failed: int = 0
    robust: int = 0  #: of the failures, those that count for ``stop_after``
    primary: int = 0  #: of the failures, those of primary specifications
    afterthoughts: int = 0  #: of the failures, those only of secondary specifications
    #: of the other failures, by ``group_of``: deadlock, stuck, shut (by the world), and other
    kinds: dict[str, int] = field(default_factory=lambda: dict.fromkeys((*KINDS, OTHER), 0))
    #: the same of those failures that the other stack does not share, where there is one
    reported_kinds: dict[str, int] = field(
        default_factory=lambda: dict.fromkeys((*KINDS, OTHER), 0)
    )
    on_both: int = 0  #: of the failures, those that the other stack shares, where there is one
    first_primary: FirstFailure | None = None
    first_robust: FirstFailure | None = None
    first_own_failure: str | None = None  #: id of the first of :attr:`own_failures`
    best: float = math.inf  #: smallest score
    by_specification: dict[str, int] = field(default_factory=dict)  #: violations
    not_judged: dict[str, int] = field(default_factory=dict)  #: trials, by specification
    why_not_judged: dict[str, str] = field(default_factory=dict)
    sim_time: float = 0.0  #: simulated [s]
    computed_s: float = 0.0  #: scenes, runs and judging [s]
    accepted: int = 0  #: proposals that the scenario took
    accepted_at_once: int = 0  #: of them, those that it took as they were
    uniform: UniformTrials = field(default_factory=UniformTrials)
    saturation: Saturation = field(default_factory=Saturation)  #: of the uniform trials
    _modes: dict[str, _ModeCount] = field(default_factory=dict)
    _shut: list[tuple[TightWay, ...]] = field(default_factory=list)
    _screened: Counter[bool] = field(default_factory=Counter)  #: by whether physics confirmed
    _engines: dict[str, Counter[bool]] = field(default_factory=dict)  #: by whether it fails there
    _repeats: Counter[str] = field(default_factory=Counter)  #: fields of RepeatCounts
    _other: Counter[str] = field(default_factory=Counter)  #: fields of StackComparison
    _other_wall_s: float = 0.0

    def __repr__(self) -> str:
        """Write it in one line."""
        rest = f"{self.rejected} rejected, {self.impossible} impossible"
        found = f"{self.failed} failed in {len(self.modes)} modes"
        return f"<CampaignStats: {self.ran} trials run, {found}; {rest}>"

    def take(self, record: TrialRecord) -> None:
        """Count a record."""
        self.records += 1
        self.computed_s += record.origin.scene_s + record.wall_s
        self.accepted += record.origin.attempts > 0
        self.accepted_at_once += record.origin.attempts == 1
        if record.origin.shut:
            self._shut.append(record.origin.shut)
        if is_uniform(record, self.settings):
            self.uniform.take(record)
        if not record.was_run:
            self.rejected += record.status == "rejected"
            self.impossible += record.status == "impossible"
            return
        self.ran += 1
        self.sim_time += record.sim_time
        if record.status != "ok":
            self.errors += 1
            return
        self._take_judged(record)

    def take_all(self, records: Iterable[TrialRecord]) -> None:
        """Count several records."""
        for record in records:
            self.take(record)

    def _take_judged(self, record: TrialRecord) -> None:
        self.judged += 1
        self.best = min(self.best, record.score)
        if record.origin.uniform:
            self.saturation.take(record.search.situations)
        if record.origin.screening is not None:
            self._screened[record.failed] += 1
        for verdict in record.verdicts:
            if verdict.violated:
                _count(self.by_specification, verdict.spec)
            elif verdict.not_judged:
                _count(self.not_judged, verdict.spec)
                self.why_not_judged[verdict.spec] = verdict.not_judged
        if record.failed:
            self._take_failure(record)

    def _take_failure(self, record: TrialRecord) -> None:
        self.failed += 1
        self.primary += record.is_primary
        self.robust += record.is_robust
        is_reported, group = record.rank != "none", group_of(record.result)
        self.on_both += record.other is not None and record.other.fate == "fails"
        self.afterthoughts += group == "secondary"
        if group != "secondary":
            self.kinds[group] += 1
            self.reported_kinds[group] += is_reported
        now = FirstFailure(self.ran, self.judged, self.computed_s)
        if record.is_primary and self.first_primary is None:
            self.first_primary = now
        if record.is_robust and self.first_robust is None:
            self.first_robust = now
        if self.own_failures and self.first_own_failure is None:
            self.first_own_failure = record.id
        if is_reported:
            self._modes.setdefault(record.signature, _ModeCount()).take(record)
        for name, run in record.engines.items():
            self._engines.setdefault(name, Counter())[run.total.robust] += 1
        if record.repeats is not None:
            same, runs = record.repeats.same.failures, record.repeats.runs
            self._repeats["always" if same == runs else "sometimes" if same else "never"] += 1
        if record.other is not None:
            passes = "found" if record.is_robust else "knife_edges"
            fates = {"passes": passes, "fails": "on_both", "not judged": "not_judged"}
            self._other[fates[record.other.fate]] += 1
            self._other["runs"] += record.other.runs
            self._other_wall_s += record.other.wall_s

    @property
    def first_failure(self) -> int | None:
        """Simulated candidates until a primary failure, itself included; None: there is none."""
        return self.first_primary.ran if self.first_primary is not None else None

    @property
    def sought(self) -> int:
        """Failures of primary specifications, those that the other stack shares included."""
        return self.failed - self.afterthoughts - self.kinds["shut"]

    @property
    def own_failures(self) -> int:
        """Failures for which a campaign ends with exit code 1.

        Where two stacks are compared, only those that the other stack does not share.
        """
        return self.robust if self.settings.trials.against is not None else self.failed

    @property
    def modes(self) -> tuple[FailureMode, ...]:
        """Failures by signature: deadlocks, stuck, others, shut, then secondary ones.

        Each with the most frequent first. Failures that the other stack does not pass, where there
        is one, are only counted (:attr:`comparison`).
        """
        found = [
            FailureMode(
                signature=signature,
                count=len(trials.robust) + len(trials.others),
                ids=(*trials.robust, *trials.others),
                is_afterthought=trials.is_afterthought,
                kind=trials.kind,
            )
            for signature, trials in self._modes.items()
        ]
        return tuple(sorted(found, key=_rank))

    @property
    def primary_modes(self) -> int:
        """How many modes are of primary specifications; a place that the world shut is none."""
        return sum(not mode.is_afterthought and mode.kind != "shut" for mode in self.modes)

    def signatures(self, *, knife_edges: bool) -> tuple[str, ...]:
        """Signatures of primary failures, sorted; of robust ones alone without ``knife_edges``."""
        modes = self._modes.items()
        return tuple(sorted(n for n, m in modes if (m.primary if knife_edges else m.robust)))

    @property
    def unseen(self) -> Unseen | None:
        """Which part of what can happen has not been seen; None without uniform trials."""
        found = self.saturation.unseen()
        return found if found.trials else None

    @property
    def shut(self) -> tuple[TightCount, ...]:
        """In how many worlds no robot fits to which room."""
        return counted(self._shut)

    @property
    def screening(self) -> ScreeningAgreement | None:
        """How many failures of the quick engine physics confirmed; None without screening."""
        if not self.settings.trials.screen:
            return None
        return ScreeningAgreement(
            failed_in_screening=self._screened.total(), confirmed=self._screened[True]
        )

    @property
    def engines(self) -> tuple[EngineAgreement, ...]:
        """How many robust failures other engines share, in the order they were asked for."""
        return tuple(
            EngineAgreement(engine=name, asked=fails.total(), fails=fails[True])
            for name, fails in self._engines.items()
        )

    @property
    def repeats(self) -> RepeatCounts | None:
        """Failures by how often they came again; None if none was run again."""
        if not self._repeats:
            return None
        names = ("always", "sometimes", "never")
        return RepeatCounts(**{name: self._repeats[name] for name in names})

    @property
    def comparison(self) -> StackComparison | None:
        """What became of failures on the other stack; None if no other one is compared."""
        if self.settings.trials.against is None:
            return None
        names = ("found", "knife_edges", "on_both", "not_judged", "runs")
        counts = {name: self._other[name] for name in names}
        return StackComparison(**counts, wall_s=round(self._other_wall_s, 3))


def draws_evenly(settings: CampaignSettings) -> bool:
    """Whether all trials of a campaign are drawn evenly; older versions did not mark them."""
    return settings.sampler.name == "random"


def is_uniform(record: TrialRecord, settings: CampaignSettings) -> bool:
    """Whether a trial was drawn evenly, whatever had been found."""
    return record.origin.uniform or draws_evenly(settings)


def _count(counts: dict[str, int], name: str) -> None:
    counts[name] = counts.get(name, 0) + 1


def _rank(mode: FailureMode) -> tuple[bool, int, int, str]:
    place = ("deadlock", "stuck", "", "shut").index(mode.kind)
    return mode.is_afterthought, place, -mode.count, mode.signature
