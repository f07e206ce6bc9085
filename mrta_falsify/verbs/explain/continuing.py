"""A failing run goes on in a copy with something changed, until it is known whether it fails.

A copy is not asked for more than that:

- It fails when the same specification is violated. Robots that stand with all that they wait for
  for 30 s are in a deadlock there: no continuation is run to confirm what one has confirmed of the
  run itself. Only a stack in a process of its own is asked, since it may not tell its goals.
- It gets by when all tasks are done, or when the robots and tasks that the violation names have
  got further than they were when it was found, at that time at the earliest, or 45 s after it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import NamedTuple

from mrta_falsify.core.protocols import Specification
from mrta_falsify.core.stack_failure import StackFailed
from mrta_falsify.core.trace import Trace
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.specs.books import STOP_KINDS, Ledger, confirmed
from mrta_falsify.trial import Job, judges_of
from mrta_falsify.verbs.explain.whole_runs import AFTER, looking_for
from simulator_interface.continuation import Running, run_to

LOOK_STRIDE = 10  # ticks between two looks at whether a copy is decided


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Failure:
    """The violation that copies are asked about."""

    verdict: Verdict
    found: float  #: when it was found [s]
    stops: dict[int, int]  #: stops that each robot it names had done by then
    tasks: frozenset[int] = frozenset()  #: that it names

    @property
    def until(self) -> float:
        """How long a copy goes on at most [s]."""
        return self.found + AFTER

    def has_been_passed(self, ledger: Ledger, without: int | None = None) -> bool:
        """Whether the robots and tasks that it names have got further than when it was found.

        Args:
            ledger: of a copy.
            without: robot that is gone.
        """
        robots = [robot for robot in self.stops if robot != without]
        further = all(stops_of(ledger, robot) > self.stops[robot] for robot in robots)
        return bool(robots or self.tasks) and further and self.tasks <= ledger.delivered.keys()


def failure_of(job: Job, verdict: Verdict, trace: Trace) -> Failure:
    """Describe the failure of a job for its copies.

    Args:
        job: that fails.
        verdict: the violated one that explains the failure.
        trace: of the run.
    """
    found = verdict.violated_at if verdict.violated_at is not None else job.world.horizon
    numbers = {robot.name: i for i, robot in enumerate(job.world.robots)}
    events = confirmed(trace, job.world).events
    done = Counter(e.robot for e in events if e.kind in STOP_KINDS and e.time <= found)
    named = [numbers[name] for name in verdict.who if name in numbers]
    tasks = (i for i in range(len(job.world.tasks)) if f"task{i}" in verdict.who)
    return Failure(
        verdict=verdict,
        found=found,
        stops={robot: done[robot] for robot in named},
        tasks=frozenset(tasks),
    )


def stops_of(ledger: Ledger, robot: int) -> int:
    """Count the stops that a robot has done."""
    done = (*ledger.picked, *ledger.delivered)
    return sum(ledger.by.get(task) == robot for task in done)


def run_until(job: Job, failure: Failure, time: float) -> AbstractContextManager[Running]:
    """Run a job to ``time`` [s] under the specification that fails, for copies to begin there."""
    judges = judges_of(looking_for(job, failure.verdict))
    return run_to(job.world, job.config, judges, time, forecasts=job.config.stack is not None)


class Ended(NamedTuple):
    """How a continuation ended."""

    failed: tuple[Verdict, ...]  #: of the same specification: violated, or suspected
    detail: str
    unjudged: str  #: why it could not be judged; empty if it was


def go_on(
    running: Running,
    failure: Failure,
    change: Callable[[], None] = lambda: None,
    *,
    without: int | None = None,
) -> Ended:
    """Go on with something changed until it is known whether the same specification is violated.

    Args:
        running: where the continuation begins, in a copy of the process.
        failure: what is looked for.
        change: makes the change.
        without: robot that the change takes away.
    """
    own = [s for s in running.specifications if s.verdict().spec == failure.verdict.spec]
    stopped: tuple[Verdict, ...] = ()
    try:
        change()
        detail = _watched(running, own, failure, without)
    except StackFailed as error:
        # A change that makes the stack fail cures nothing.
        stopped, detail = (failure.verdict,), f"the stack failed at {error.failure.time:.1f} s"
    verdicts = [s.verdict() for s in own]
    failed = (*stopped, *_failing(verdicts))
    missing = (v.not_judged for v in verdicts if v.not_judged and not is_suspected(v))
    return Ended(failed, detail, next(missing, ""))


def _watched(
    running: Running, own: Sequence[Specification], failure: Failure, without: int | None
) -> str:
    """Go on until the answer is known; say how that ended."""
    until = min(failure.until, running.episode.world.horizon)
    for frame in running.frames:
        for specification in own:
            specification.update(frame)
        time, ledger = frame.sensed.time, running.episode.books
        if frame.sensed.tick % LOOK_STRIDE == 0:
            if _failing([s.verdict() for s in own]):
                return f"violated again at {time:.1f} s"
            if time >= failure.found and failure.has_been_passed(ledger, without):
                return f"got past it by {time:.1f} s"
        if ledger.due and ledger.closed:
            return f"all tasks done at {time:.1f} s"
        if time >= until:
            return f"nothing violated until {time:.1f} s"
    return "the time looked at was over"


def is_suspected(verdict: Verdict) -> bool:
    """Whether robots are suspected of a violation that only a continuation could confirm."""
    return bool(verdict.not_judged and verdict.who)


def _failing(verdicts: Collection[Verdict]) -> tuple[Verdict, ...]:
    return tuple(v for v in verdicts if v.violated or is_suspected(v))
