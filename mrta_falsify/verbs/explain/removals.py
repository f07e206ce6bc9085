"""Who holds up whom: continuations of a deadlock, each without one of its robots."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from functools import partial

import numpy as np

from mrta_falsify.campaigns.journal import RunJournal
from mrta_falsify.core import codec
from mrta_falsify.core.findings import Removal
from mrta_falsify.core.fleet import Frame
from mrta_falsify.core.stack_failure import StackFailed
from mrta_falsify.core.trace import Trace
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.core.wait_account import wait_account
from mrta_falsify.trial import Job, judges_of
from mrta_falsify.verbs.explain.changed_runs import AFTER
from reports.sentences import listed
from simulator_interface.continuation import Running, run_to
from simulator_interface.watched_copy import CopyFailed

GOES_ON = 1.0  # m from where it stood: a robot goes on


def removals_of(
    job: Job,
    verdict: Verdict,
    trace: Trace,
    max_runs: int,
    journal: RunJournal[Removal] | None = None,
) -> Iterator[Removal]:
    """Take away each robot of a deadlock at its onset: members, victims, and whom they wait for.

    Args:
        job: that fails.
        verdict: the violated one that explains the failure.
        trace: of the run.
        max_runs: runs at most; the run up to the onset counts as one.
        journal: of finished continuations; those in it are not run again.
    """
    journal = journal or RunJournal(Removal, None)
    numbers = {robot.name: i for i, robot in enumerate(job.world.robots)}
    account = wait_account(verdict, trace)
    names = [name for name in numbers if name in account.robots] if account.members else []
    onset = account.onset
    if len(names) < 2 or onset is None:
        return
    asked = [job.world, job.config, job.specifications, verdict, onset]
    missing = {codec.digest([asked, names, n]): n for n in names[: max(0, max_runs - 1)]}
    yield from journal.known_first(missing)
    if not missing:
        return
    with run_to(job.world, job.config, judges_of(job), onset) as running:
        if not running.episode.can_remove:
            return
        for key, name in missing.items():
            others = {other: numbers[other] for other in names if other != name}
            removed = partial(_removal, running, name, numbers[name], others)
            with contextlib.suppress(CopyFailed):  # the stack fails without it: it tells nothing
                yield journal.keep(key, running.in_a_copy(removed, Removal))


def _removal(running: Running, name: str, robot: int, others: dict[str, int]) -> Removal:
    """Take a robot away, and look who of the others goes on."""
    start, time = running.last.sensed.pose, running.last.sensed.time
    running.episode.remove(robot)
    go_on: set[str] = set()
    for frame in _until_it_fails(running.frames):
        moved = np.linalg.norm((frame.sensed.pose - start)[:, :2], axis=1)
        go_on |= {other for other, i in others.items() if moved[i] >= GOES_ON}
        if len(go_on) == len(others) or frame.sensed.time >= time + AFTER:
            break
    return Removal(
        robot=name,
        time=time,
        go_on=tuple(other for other in others if other in go_on),
        stay=tuple(other for other in others if other not in go_on),
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
