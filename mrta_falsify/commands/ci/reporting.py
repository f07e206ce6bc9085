"""The report of a run of ``ci``: what is new, ongoing, flaky and resolved."""

from __future__ import annotations

import contextlib
import dataclasses
import shlex

from mrta_falsify.commands.ci.ledger import Change, ChangeKind
from mrta_falsify.commands.ci.project import Project
from mrta_falsify.commands.ci.running import ORDER, CellOutcome, CiResult
from mrta_falsify.commands.report.build import case_of
from mrta_falsify.commands.stored_trials import open_campaign
from mrta_falsify.core.claims import KIND_TEXT
from mrta_falsify.core.errors import InputError
from reports.contents import CaseContents, Mode, ReportContents, Table
from reports.junit import Complaint, TrialResult, render_junit

MAX_CASES = 10  # shown in full
MEANINGS: dict[ChangeKind, str] = {
    "new": "fails now, and did not in the last run",
    "ongoing": "failed in the last run, too",
    "flaky": "fails in few of its perturbed runs, or not every time",
    "resolved": "does not fail any more",
}


def headline_of(result: CiResult) -> str:
    """Count the changes in one line."""
    counts = ", ".join(f"{result.count(kind)} {kind}" for kind in ORDER)
    against = f"against the run of {result.last}" if result.last else "the first run"
    kinds = ", ".join(f"{n} {KIND_TEXT[kind]}" for kind, n in result.kinds.items() if n)
    return f"{counts}{f' ({kinds})' if kinds else ''}; {against}"


def contents_of(project: Project, result: CiResult) -> ReportContents:
    """Build the page of a run from what is stored."""
    failing = [change for change in result.changes if change.kind != "resolved"]
    notes = (
        [f"{result.at_rest} findings were resolved before and stay so."] if result.at_rest else []
    )
    notes += [f"{name} is not in the project any more." for name in result.gone]
    return ReportContents(
        title=f"{project.path.name}, run {result.number}",
        headline=headline_of(result),
        facts=tuple((cell.name, done_text(cell)) for cell in result.cells),
        modes=tuple(
            _mode(project, change, in_full=place < MAX_CASES)
            for place, change in enumerate(failing)
        ),
        notes=tuple(notes),
        tables=tuple(_table(result, kind) for kind in ORDER if result.count(kind)),
    )


def done_text(cell: CellOutcome) -> str:
    """Say what was done about a cell, and why."""
    if not cell.changed:
        return "not run: nothing has changed"
    done = [f"{cell.trials} trials"] if cell.trials else []
    done += [f"{cell.rechecked} known failures again"] if cell.rechecked else []
    return f"{', '.join(done) or 'nothing to run'} (changed: {', '.join(cell.changed)})"


def command_of(project: Project, change: Change) -> str:
    """Give the command that runs the example of a change again; empty without one."""
    if change.example is None:
        return ""
    directory = str(project.folder / change.example.directory)
    return shlex.join(["mrta-falsify", "replay", directory, change.example.id, "--live"])


def junit_of(project: Project, result: CiResult) -> str:
    """Write the run as JUnit XML: a test for each finding, and one for each cell without any."""
    told = {change.cell for change in result.changes}
    results = [
        TrialResult(
            name=f"{change.cell}: {change.signature}",
            time=0.0,
            failure=None if change.kind == "resolved" else _complaint(project, change),
        )
        for change in result.changes
    ]
    results += [
        TrialResult(name=f"{cell.name}: no failure", time=0.0)
        for cell in result.cells
        if cell.name not in told
    ]
    return render_junit("mrta-falsify ci", results)


def _complaint(project: Project, change: Change) -> Complaint:
    return Complaint(
        kind=change.kind,
        message=f"{change.kind}: {change.sentence}",
        text=command_of(project, change),
    )


def _table(result: CiResult, kind: ChangeKind) -> Table:
    rows = [
        (
            change.cell,
            change.signature,
            KIND_TEXT.get(change.failure_kind, ""),
            change.sentence,
            f"run {change.since}" + (", came back" if change.came_back else ""),
        )
        for change in result.changes
        if change.kind == kind
    ]
    return Table(
        title=f"{kind.capitalize()}: {len(rows)}",
        columns=("where", "mode", "kind", "what happens", "since"),
        rows=tuple(rows),
        notes=(f"{kind.capitalize()}: {MEANINGS[kind]}.",),
    )


def _mode(project: Project, change: Change, *, in_full: bool) -> Mode:
    example = change.example
    case: CaseContents | None = None
    if in_full and example is not None:
        with contextlib.suppress(InputError):  # its files were deleted; the table still tells it
            campaign = open_campaign(project.folder / example.directory)
            case = case_of(campaign, campaign.record(example.id))
            case = dataclasses.replace(
                case, id=f"{change.kind}-{campaign.directory.name}-{case.id}"
            )
    return Mode(
        signature=f"{change.kind}: {change.signature}",
        ids=(f"{example.directory} {example.id}",) if example is not None else (),
        cases=(case,) if case is not None else (),
        happened=f"{change.cell}: {change.sentence}",
    )
