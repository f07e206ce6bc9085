"""Find the commit of a stack's repository that brought a stored failure.

Each commit is checked out into a temporary worktree, and built there if need be. A process of its
own runs the failure there, so that modules are those of the commit. A commit counts as bad if the
number of its runs that fail is nearer to that of BAD than to that of GOOD; one whose stack is not
built or does not start tells nothing.
"""

from __future__ import annotations

import json
import os
import shutil
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from mrta_falsify.campaigns.code_digest import code_digest
from mrta_falsify.campaigns.foreign import of_judging, of_stack
from mrta_falsify.campaigns.journal import RunJournal, going_on
from mrta_falsify.campaigns.store import Campaign
from mrta_falsify.core import codec
from mrta_falsify.core.config import StackConfig
from mrta_falsify.core.durable import tells_of_full_disk, write_atomically
from mrta_falsify.core.errors import HarnessError, InputError, PlaceError
from mrta_falsify.core.external import split_command
from mrta_falsify.core.modules import python_command
from mrta_falsify.core.record import TrialRecord
from mrta_falsify.specs.causes import leading
from mrta_falsify.verbs.bisect.moved_stack import moved, repository_of
from mrta_falsify.verbs.bisect.processes import failed_build, folder_as_of, run_to_end
from mrta_falsify.verbs.bisect.repository import Repository
from mrta_falsify.verbs.campaign_summary import modes
from mrta_falsify.verbs.corpus import on_recorded_engine
from mrta_falsify.verbs.folders import Place
from mrta_falsify.verbs.stacks import Stack, load_stack
from mrta_falsify.verbs.stored_failures import failures_named, keeps_engine
from mrta_falsify.verbs.trust import Trust, open_to_run, permit_rechecks
from mrta_falsify.worker import specifications_of

JOURNAL_NAME = "bisect.journal.jsonl"  # in the campaign
WORKTREES = "bisect.worktrees"  # folder in the campaign
BAD_INPUT = 2  # exit code of a command
STACK_RUNS = "stack_runs"  # specification: the stack did not crash


@dataclass(frozen=True, slots=True, kw_only=True)
class CommitRuns:
    """What a stored failure did at a commit."""

    failed: int = 0  #: of the runs, first in the specification that the failure violates first
    runs: int = 0  #: of the world and its copies; 0: the stack did not start
    why: str = ""  #: it tells nothing, in words


@dataclass(frozen=True, slots=True, kw_only=True)
class Bisected:
    """The commit that brought a failure."""

    id: str  #: of the failure
    signature: str
    commit: str  #: the first bad one; empty: it is one of ``candidates``
    subject: str
    candidates: tuple[str, ...]  #: commits that cannot be told apart, since some tell nothing
    failed_at_good: str  #: as ``0 of 3``
    failed_at_bad: str
    tried: int  #: commits, GOOD and BAD included
    skipped: int  #: of them, those that tell nothing
    runs: int  #: simulations in all, those of an earlier call included


OnCommit = Callable[[str, CommitRuns], None]


def bisect_failures(
    directory: Place,
    span: str,
    *,
    build: str | None = None,
    stack: Stack | None = None,
    settings: Sequence[str] = (),
    jittered: int = 2,
    only: Sequence[str] = (),
    workers: int | None = None,
    time_limit: float | None = None,
    trust: Trust = False,
    on_commit: OnCommit = lambda commit, runs: None,
) -> tuple[Bisected, ...]:
    """Find the commit that brought a failure, for the first failure of each mode.

    Args:
        directory: of the campaign.
        span: ``GOOD..BAD``, commits of the repository that holds the stack.
        build: command that builds the stack, as a shell would split it. It runs before the runs of
            each commit, in the folder of its worktree that is ours in the repository.
        stack: the stack, or its YAML file; the campaign's own if None. Its files are taken from
            each commit.
        settings: ``--set`` texts applied to the stack.
        jittered: copies with small differences, so many runs of each commit beside the world's.
        only: ids of the failures; the first of each mode if empty.
        workers: processes; one per core if None.
        time_limit: what one run may work and sleep [s]; the campaign's own limit if None.
        trust: run what is not ours, though somebody else has made the campaign.
        on_commit: called with each commit and what it gave.

    Raises:
        InputError: no such commits, BAD fails no more often than GOOD, the stack is in no
            repository, or ``build`` is no command.
        HarnessError: a run crashed.
        Interrupted: Ctrl-C; finished commits are kept for the next call.
    """
    words = split_command(build, where="--build") if build is not None else ()
    campaign = open_to_run(directory, trust)
    is_own = stack is None and not settings
    config = campaign.settings.trials.stack if is_own else load_stack(stack, settings)
    if not is_own and keeps_engine(stack, settings):
        config = on_recorded_engine(campaign, config)
    named = None if is_own else on_recorded_engine(campaign, StackConfig())
    chosen = failures_named(campaign, only)
    permit_rechecks(campaign, named, trust, only=chosen)
    specifications = specifications_of(campaign.settings.trials)
    repository = repository_of(config, specifications, is_built=bool(words))
    good, bad = _ends(repository, span)
    names = chosen or tuple(mode.ids[0] for mode in modes(campaign))
    journal = RunJournal(
        CommitRuns,
        campaign.directory / JOURNAL_NAME,
        code=code_digest(StackConfig(), ()),
    )
    trial = _Trial(
        campaign=campaign,
        repository=repository,
        config=config,
        build=words,
        options=(*_options(jittered, workers, time_limit), *_trusted(campaign)),
        jittered=jittered,
        journal=journal,
        on_commit=on_commit,
    )
    with going_on(f"bisection of {span}", journal):
        try:
            found = tuple(_bisect(trial, campaign.record(name), good, bad) for name in names)
        finally:
            shutil.rmtree(campaign.directory / WORKTREES, ignore_errors=True)
    journal.discard()
    return found


def _trusted(campaign: Campaign) -> tuple[str, ...]:
    """Pass on that what the campaign names may run: a worktree's files are others than ours."""
    engine = on_recorded_engine(campaign, StackConfig())
    foreign = [*of_judging(campaign.settings.trials), *of_stack(engine)]
    return ("--trust",) if foreign else ()


def _options(jittered: int, workers: int | None, time_limit: float | None) -> tuple[str, ...]:
    given = ["--jittered", str(jittered)]
    given += ["--workers", str(workers)] if workers is not None else []
    given += ["--time-limit", str(time_limit)] if time_limit is not None else []
    return tuple(given)


def _ends(repository: Repository, span: str) -> tuple[str, str]:
    """Resolve ``GOOD..BAD``.

    Raises:
        InputError: it is not of that form, there is no such commit, or BAD does not follow GOOD.
    """
    first, dots, last = span.partition("..")
    if not first or not dots or not last or last.startswith("."):
        raise InputError(f"--bisect is {span!r}; it must read GOOD..BAD, two commits")
    good, bad = repository.commit(first), repository.commit(last)
    if good == bad or not repository.is_ancestor(good, bad):
        raise InputError(f"--bisect {span}: BAD does not come after GOOD in {repository.top}")
    return good, bad


def _bisect(trial: _Trial, record: TrialRecord, good: str, bad: str) -> Bisected:
    """Halve the range until the first bad commit is left.

    Raises:
        InputError: the ends do not differ, or tell nothing.
    """
    ends = {commit: trial.runs(record, commit) for commit in (good, bad)}
    for name, commit in (("GOOD", good), ("BAD", bad)):
        if not ends[commit].runs:
            raise InputError(f"--bisect: {name} ({commit[:12]}) tells nothing: {ends[commit].why}")
    if ends[bad].failed <= ends[good].failed:
        raise InputError(
            f"--bisect: trial {record.id} fails in {_share(ends[good])} runs at GOOD and in "
            f"{_share(ends[bad])} at BAD, so no commit between them brought it"
        )
    middle = (ends[good].failed + ends[bad].failed) / 2.0
    tried, goods, first_bad, skipped = dict(ends), [good], bad, set[str]()
    while True:
        left = [
            commit
            for commit in trial.repository.between(goods, first_bad)
            if commit not in skipped and commit != first_bad
        ]
        if not left:
            break
        runs = tried[left[0]] = trial.runs(record, left[0])
        if not runs.runs or runs.failed == middle:
            skipped.add(left[0])
        elif runs.failed > middle:
            first_bad = left[0]
        else:
            goods.append(left[0])
    candidates = trial.repository.between(goods, first_bad)
    is_sure = len(candidates) == 1
    return Bisected(
        id=record.id,
        signature=record.signature,
        commit=first_bad if is_sure else "",
        subject=trial.repository.subject(first_bad) if is_sure else "",
        candidates=() if is_sure else candidates,
        failed_at_good=_share(ends[good]),
        failed_at_bad=_share(ends[bad]),
        tried=len(tried),
        skipped=len(skipped),
        runs=sum(one.runs for one in tried.values()),
    )


def _share(runs: CommitRuns) -> str:
    return f"{runs.failed} of {runs.runs}"


# --- one commit ------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, kw_only=True)
class _Trial:
    """Runs stored failures at commits."""

    campaign: Campaign
    repository: Repository
    config: StackConfig
    build: tuple[str, ...]
    options: tuple[str, ...]
    jittered: int
    journal: RunJournal[CommitRuns]
    on_commit: OnCommit

    def runs(self, record: TrialRecord, commit: str) -> CommitRuns:
        """Run a failure and its copies at a commit, unless an earlier call has done so."""
        asked = [commit, record.id, record.world_digest, self.config, self.jittered, self.build]
        key = codec.digest(asked)
        known = self.journal.answers.get(key)
        if known is None:
            known = self.journal.keep(key, self._run(record, commit))
        self.on_commit(commit, known)
        return known

    def _run(self, record: TrialRecord, commit: str) -> CommitRuns:
        folder = self.campaign.directory.resolve() / WORKTREES
        with self.repository.worktree(commit, folder / commit[:12]) as worktree:
            within = folder_as_of(self.repository.top, worktree)
            why = failed_build(self.build, within) if self.build else ""
            if tells_of_full_disk(why):
                raise PlaceError(f"{worktree}: {why}; make room")
            if why:
                return CommitRuns(why=why)
            try:
                config = moved(
                    self.config, self.repository.top, worktree, is_built=bool(self.build)
                )
            except InputError as error:
                return CommitRuns(why=str(error))
            file = folder / "stack.yaml"
            write_atomically(file, yaml.safe_dump(codec.encode(config)).encode())
            words = ("--stack", str(file), "--only", record.id, *self.options)
            code, said, complaint = _command(
                *("corpus", str(self.campaign.directory.resolve()), *words),
                top=self.repository.top,
                worktree=worktree,
            )
        if code == BAD_INPUT and tells_of_full_disk(complaint):
            raise PlaceError(complaint)  # it tells of the disk, not of the commit
        if code == BAD_INPUT:
            return CommitRuns(why=complaint)
        try:
            (row,) = json.loads(said)["failures"]
        except (ValueError, KeyError):
            raise HarnessError(f"the run at commit {commit[:12]} crashed: {complaint}") from None
        return _counted(record, row)


def _counted(record: TrialRecord, row: dict[str, Any]) -> CommitRuns:
    """Count the runs of a recheck that fail as the failure does."""
    verdict = leading(record.verdicts)
    assert verdict is not None, "only failures are bisected"
    if row["fate"] in ("timeout", "not judged"):
        return CommitRuns(why=f"the run ended as {row['fate']}")
    if STACK_RUNS in row["violated"] and verdict.spec != STACK_RUNS:
        return CommitRuns(why=f"the stack fails to run: {row['signature_now']}")
    signatures = (row["signature_now"], *row.get("copy_signatures", ()))
    failed = sum(one.partition("/")[0] == verdict.spec for one in signatures)
    return CommitRuns(failed=failed, runs=1 + row["jittered"])


def _command(*words: str, top: Path, worktree: Path) -> tuple[int, str, str]:
    """Run a command of ours with the modules of a worktree.

    Returns:
        Exit code, stdout, and the last line of stderr.
    """
    ours = [Path(entry or ".").resolve() for entry in sys.path]
    theirs = [str(worktree / one.relative_to(top)) for one in ours if one.is_relative_to(top)]
    path = os.pathsep.join([*theirs, *filter(None, [os.environ.get("PYTHONPATH")])])
    done = run_to_end(
        python_command("mrta_falsify.cli", *words, "--format", "json"),
        folder=folder_as_of(top, worktree),
        env={**os.environ, "PYTHONPATH": path},
    )
    lines = done.stderr.strip().splitlines() or ["no reason given"]
    return done.returncode, done.stdout, lines[-1].removeprefix("error: ")
