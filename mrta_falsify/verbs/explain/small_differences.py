"""Copies with small differences: how many of them say on which side of one half a chance lies."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from dataclasses import dataclass

from mrta_falsify.campaigns.journal import RunJournal
from mrta_falsify.campaigns.statistics import failure_probability
from mrta_falsify.core import codec
from mrta_falsify.core.findings import CopyCount
from mrta_falsify.core.inevitability import EVEN
from mrta_falsify.core.probability import Probability
from mrta_falsify.trial import Job, judge, of_copy
from mrta_falsify.verbs.explain.continuing import Failure, go_on, run_until
from mrta_falsify.verbs.explain.run_count import RunCount
from mrta_falsify.verbs.explain.whole_runs import looking_for
from scenic_worlds.variation import jittered_worlds
from simulator_interface.continuation import Running
from simulator_interface.watched_copy import CopyFailed

ALIKE = 2  # copies that settle on which side a time lies, for now
FEW, MANY = 6, 12  # copies whose interval is looked at, at least and at most


@dataclass(slots=True)
class Tally:
    """Copies that failed, and that got by."""

    failed: int = 0
    passed: int = 0
    unknown: int = 0  #: could not be judged

    def add(self, *, failed: bool, answered: bool = True) -> None:
        """Count a copy."""
        self.failed += answered and failed
        self.passed += answered and not failed
        self.unknown += not answered

    @property
    def chance(self) -> Probability:
        """How probably a copy fails."""
        return failure_probability(self.failed, self.failed + self.passed, undecided=self.unknown)

    @property
    def is_enough(self) -> bool:
        """Whether copies say on which side of one half the chance lies, for now."""
        told = self.failed + self.passed
        is_alike = told >= ALIKE and not (self.failed and self.passed)
        return is_alike or told >= FEW or self.unknown >= ALIKE

    @property
    def is_settled(self) -> bool:
        """Whether the interval of the chance leaves one half out, or copies tell nothing."""
        if self.failed + self.passed < FEW:
            return self.unknown > ALIKE
        return self.chance.low > EVEN or self.chance.high < EVEN


@dataclass(frozen=True, slots=True, kw_only=True)
class CopyRun:
    """What the run of a copy with small differences gave."""

    failed: bool


def copies_of(
    job: Job, failure: Failure, count: RunCount, journal: RunJournal[CopyRun]
) -> CopyCount:
    """Run copies of the whole world until they say whether most of them fail.

    Args:
        job: that fails.
        failure: its.
        count: of all runs.
        journal: of finished copies.
    """
    tally = Tally()
    for run in count.each(_runs(job, failure, count.left, journal)):
        tally.add(failed=run.failed)
        if tally.is_settled:
            break
    return CopyCount(runs=tally.failed + tally.passed, failed=tally.failed)


def _runs(job: Job, failure: Failure, most: int, journal: RunJournal[CopyRun]) -> Iterator[CopyRun]:
    for world in jittered_worlds(job.world, max(0, min(MANY, most))):
        copy = dataclasses.replace(job, world=world)
        key = codec.digest([world, job.config, job.specifications, failure.verdict])
        known = journal.answers.get(key)
        yield known or journal.keep(key, CopyRun(failed=_fails(copy, failure)))


def _fails(copy: Job, failure: Failure) -> bool:
    if copy.config.stack is not None or copy.scene is not None:  # no copy of it may go on
        alone = of_copy(looking_for(copy, failure.verdict))
        verdicts = judge(alone, keep_trace=False).verdicts
        return any(v.violated and v.spec == failure.verdict.spec for v in verdicts)
    try:
        with run_until(copy, failure, 0.0) as running:
            return running.in_a_copy(
                lambda: CopyRun(failed=_goes_on(running, failure)), CopyRun
            ).failed
    except CopyFailed:
        return True


def _goes_on(running: Running, failure: Failure) -> bool:
    return bool(go_on(running, failure).failed)
