"""Who holds up whom: continuations of a deadlock, each without one of its robots."""

from __future__ import annotations

import contextlib
import dataclasses
from collections.abc import Iterator
from functools import partial

from mrta_falsify.analysis.explain.case import Case
from mrta_falsify.core import codec
from mrta_falsify.core.findings import Explanation, Removal
from mrta_falsify.core.fleet import Frame
from mrta_falsify.core.stack_failure import StackFailed
from mrta_falsify.core.trace import Trace
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.core.wait_account import wait_account
from mrta_falsify.core.words import listed
from mrta_falsify.core.world import World
from mrta_falsify.lab import Lab, experiment_of_job
from mrta_falsify.process.ending import Ending
from mrta_falsify.specs.deadlock.blocked_by import look_stride
from mrta_falsify.specs.deadlock.counterfactual import LOOK_AHEAD
from mrta_falsify.specs.deadlock.progress_clock import ProgressClock
from mrta_falsify.specs.deadlock.watches import CounterfactualWatch, Question
from mrta_falsify.trial import Job
from simulator_interface.continuation import Running, run_to


class Removals:
    """Each robot of a deadlock taken away when it is found: who goes on then?"""

    least = 0  #: few runs, and what they cost is told by the number of robots

    def applies(self, case: Case) -> bool:
        """See :class:`.case.Question`."""
        del case
        return True

    def ask(self, case: Case, found: Explanation, runs: int) -> Explanation:
        """See :class:`.case.Question`."""
        told = []
        for removal in removals_of(case.job, case.verdict, case.trace, runs, case.lab):
            case.lab.count()
            told.append(removal)
        return dataclasses.replace(found, removals=tuple(told))


def removals_of(
    job: Job, verdict: Verdict, trace: Trace, max_runs: int, lab: Lab
) -> Iterator[Removal]:
    """Take away each robot of a deadlock when it is found: members, victims, whom they wait for.

    Nothing new comes from outside then. A robot goes on if it reaches its next stop.

    Args:
        job: that fails.
        verdict: the violated one that explains the failure.
        trace: of the run.
        max_runs: runs at most; the run up to that moment counts as one.
        lab: whose journal keeps finished continuations; those in it are not run again.
    """
    journal = lab.journal_of(Removal, experiment=experiment_of_job(job))
    numbers = {robot.name: i for i, robot in enumerate(job.world.robots)}
    account = wait_account(verdict, trace)
    names = [name for name in numbers if name in account.robots] if account.members else []
    found = verdict.violated_at
    if len(names) < 2 or found is None:
        return
    asked = [job.world, job.config, job.specifications, verdict]
    missing = {codec.digest([asked, names, n]): n for n in names[: max(0, max_runs - 1)]}
    yield from journal.known_first(missing)
    if not missing:
        return
    with run_to(job.world, job.config, (), found) as running:
        if not (running.episode.can_remove and running.episode.can_copy):
            return
        for key, name in missing.items():
            others = {
                other: numbers[other] for other in names if other not in (name, *account.blockers)
            }
            removed = partial(_removal, running, job.world, name, numbers[name], others)
            with contextlib.suppress(Ending):  # the stack fails without it: it tells nothing
                yield journal.keep(key, running.in_a_copy(removed, Removal))


def _removal(
    running: Running, world: World, name: str, robot: int, others: dict[str, int]
) -> Removal:
    """Take a robot away, and look who of the others goes on."""
    time = running.last.sensed.time
    question = Question(frozenset(others.values()), frozenset(), time, time, time + LOOK_AHEAD)
    clock = ProgressClock(world)
    watch = CounterfactualWatch(clock, question, stride=look_stride(running.episode.dt))
    watch.take_run(running.episode)
    watch.update(running.last)
    running.episode.forget_events()
    running.episode.remove(robot)
    for frame in _until_it_fails(running.frames):
        if watch.update(frame):
            break
    freed = watch.freed
    return Removal(
        robot=name,
        time=time,
        go_on=tuple(other for other, i in others.items() if i in freed),
        stay=tuple(other for other, i in others.items() if i not in freed),
    )


def _until_it_fails(frames: Iterator[Frame]) -> Iterator[Frame]:
    """Yield frames until the stack fails to answer."""
    with contextlib.suppress(StackFailed):
        yield from frames


def removal_text(removal: Removal) -> str:
    """Put a removal in words."""
    parts = []
    for names, one, many in (
        (removal.go_on, "goes on", "go on"),
        (removal.stay, "stays", "stay"),
    ):
        if names:
            parts.append(f"{listed(names)} {one if len(names) == 1 else many}")
    return f"without {removal.robot} from {removal.time:.1f} s on, {', '.join(parts)}"
