"""Run what has changed since the last run of a project."""

from __future__ import annotations

import os
import shutil
import time
from collections.abc import Callable
from dataclasses import dataclass

from mrta_falsify.campaigns.journal import RunJournal
from mrta_falsify.campaigns.store import owner_of
from mrta_falsify.commands.campaign import OnFeedback
from mrta_falsify.commands.ci.cell_run import NO_RESULT, CellRun
from mrta_falsify.commands.ci.cells import CAMPAIGNS, Cell, cells_of
from mrta_falsify.commands.ci.ledger import (
    CellState,
    Change,
    ChangeKind,
    Ledger,
    changes_of,
    read_ledger,
    write_ledger,
)
from mrta_falsify.commands.ci.project import Project
from mrta_falsify.commands.folders import make_directory
from mrta_falsify.commands.trust import Trust
from mrta_falsify.commands.workers import count_cores
from mrta_falsify.core.claims import KINDS
from mrta_falsify.core.codec import later
from mrta_falsify.core.findings import Recheck
from mrta_falsify.core.interruption import describe_interrupt

JOURNAL_NAME = "rechecks.journal.jsonl"
ORDER: tuple[ChangeKind, ...] = ("new", "ongoing", "flaky", "resolved")  #: in reports


@dataclass(frozen=True, slots=True, kw_only=True)
class CellOutcome:
    """What was done about a cell."""

    name: str
    changed: tuple[str, ...]  #: since the last run; empty: nothing, so it was not run
    trials: int = 0  #: of its search
    rechecked: int = 0  #: stored failures that were run again


@dataclass(frozen=True, slots=True, kw_only=True)
class CiResult:
    """What became of a project's findings since the last run."""

    project: str
    number: int  #: of this run
    last: str  #: when the last one ended; empty: there was none
    cells: tuple[CellOutcome, ...]
    changes: tuple[Change, ...]  #: new ones first
    at_rest: int  #: findings that were resolved before, and still are
    gone: tuple[str, ...] = ()  #: cells of the last run that the project has no more
    kinds: dict[str, int] = later(dict)  #: of the changes that fail now: deadlock, stuck, shut

    def count(self, kind: ChangeKind) -> int:
        """Count the changes of a kind."""
        return sum(change.kind == kind for change in self.changes)

    @property
    def fails(self) -> bool:
        """Whether anything fails now."""
        return any(change.kind != "resolved" for change in self.changes)


def run_project(
    project: Project,
    *,
    everything: bool = False,
    workers: int | None = None,
    trust: Trust = False,
    on_cell: Callable[[CellOutcome], None] = lambda cell: None,
    on_feedback: OnFeedback = lambda record, progress: None,
    on_result: Callable[[CiResult], None] = lambda result: None,
) -> CiResult:
    """Run the cells of a project that have changed, and write what was found for the next run.

    Args:
        project: read.
        everything: run cells that have not changed, too.
        workers: processes; one per core if None. They change no result.
        trust: run what is not ours and stored failures name, whoever has made their campaign.
        on_cell: called with each cell before it runs, or is left out.
        on_feedback: called with each trial of a search.
        on_result: called before the last run is replaced: what is stopped in it is new next time.

    Raises:
        InputError: something that the project names is wrong.
        Interrupted: Ctrl-C; finished trials and re-runs are kept for the next call.
    """
    make_directory(project.kept)
    before = read_ledger(project.kept)
    journal = RunJournal(Recheck, project.kept / JOURNAL_NAME)
    outcomes: list[CellOutcome] = []
    states: list[CellState] = []
    changes: list[Change] = []
    with describe_interrupt(lambda: ("finished trials and re-runs", NO_RESULT)):
        for cell in cells_of(project):
            known = _known(before, cell)
            changed = cell.changed(before.cell(cell.name)) or (("--all",) if everything else ())
            outcome = CellOutcome(name=cell.name, changed=changed)
            on_cell(outcome)
            state = known
            if changed:
                run = CellRun(
                    project,
                    cell,
                    known.findings,
                    before.number + 1,
                    journal,
                    count_cores(workers),
                    trust,
                )
                state = run.state(on_feedback)
                outcome = CellOutcome(
                    name=cell.name, changed=changed, trials=run.trials, rechecked=run.rechecked
                )
            outcomes.append(outcome)
            states.append(state)
            changes += changes_of(known, state)
        now = Ledger(
            number=before.number + 1, ended=time.strftime("%Y-%m-%d %H:%M"), cells=tuple(states)
        )
        resolved = sum(one.fate == "resolved" for state in states for one in state.findings)
        failing = [change.failure_kind for change in changes if change.kind != "resolved"]
        result = CiResult(
            project=str(project.path),
            number=now.number,
            last=before.ended,
            cells=tuple(outcomes),
            changes=tuple(sorted(changes, key=lambda one: (ORDER.index(one.kind), one.cell))),
            at_rest=resolved - sum(change.kind == "resolved" for change in changes),
            gone=tuple(cell.name for cell in before.cells if now.cell(cell.name) is None),
            kinds={kind: failing.count(kind) for kind in KINDS},
        )
        on_result(result)
        write_ledger(project.kept, now)
    journal.discard()
    _clear_away(project, now)
    return result


def _known(before: Ledger, cell: Cell) -> CellState:
    """Give the state of a cell before this run; what is stored in a corpus is known already."""
    return before.cell(cell.name) or CellState(name=cell.name, parts={}, findings=cell.corpus)


def _clear_away(project: Project, ledger: Ledger) -> None:
    """Delete searches of earlier runs that no finding refers to any more."""
    folder = project.kept / CAMPAIGNS
    used = {
        os.path.normpath(project.folder / example.directory)
        for cell in ledger.cells
        for finding in cell.findings
        for example in finding.examples
    }
    for path in folder.iterdir() if folder.is_dir() else ():
        if os.path.normpath(path) not in used and not owner_of(path):
            shutil.rmtree(path, ignore_errors=True)
