"""The report of a campaign: read what is stored, tell it as contents, write it in a form.

Nothing is run.
"""

from __future__ import annotations

import contextlib
import dataclasses
import functools
from collections.abc import Callable, Collection, Iterable, Mapping
from pathlib import Path
from urllib.parse import quote

from mrta_falsify.campaigns.made_here import refuse_links
from mrta_falsify.campaigns.store import Campaign
from mrta_falsify.campaigns.trial_index import TrialIndex
from mrta_falsify.commands.report import overview
from mrta_falsify.commands.report.against import comparison_tables
from mrta_falsify.commands.report.cases import commands_of, tell_case
from mrta_falsify.commands.report.parameters import PassingTrials, passing_trials
from mrta_falsify.commands.report.reading import (
    CampaignView,
    any_world,
    in_turn,
    read_failure,
    readable_failures,
    view_of,
)
from mrta_falsify.commands.stored_trials import row_of
from mrta_falsify.core.durable import make_folder
from mrta_falsify.core.errors import InputError
from mrta_falsify.core.record import TrialRecord
from reports.contents import CaseContents, Mode, ReportContents
from reports.junit import Complaint, TrialResult, render_junit
from reports.markdown import render_markdown
from reports.page import draw_page, write_page

MAX_CASES = 20  # shown in full unless asked otherwise
PAGE_CASES = 100  # on the page itself; further ones are files beside it
BESIDE = ".cases"  # ends the name of their folder


class CasePages:
    """Pages of cases that stand beside the page of a campaign, for as long as a watch lasts.

    What was written is not written again unless the files of its trial have changed.
    """

    def __init__(self) -> None:
        self._written: dict[Path, frozenset[tuple[str, int]]] = {}

    def write(self, page: Path, folder: Path, make: Callable[[], ReportContents]) -> None:
        """Write the page of a case, unless it stands there.

        Args:
            page: its place.
            folder: of its trial.
            make: what gives its contents.

        Raises:
            InputError: files of the trial are damaged.
            PlaceError: the page cannot be written.
        """
        made_from = _stamps(folder)
        if not page.is_file() or self._written.get(page) != made_from:
            contents = make()
            make_folder(page.parent)
            write_page(contents, page)
            self._written[page] = made_from


def _stamps(folder: Path) -> frozenset[tuple[str, int]]:
    """List the files of a trial with the times of their last changes [ns]; empty: not known."""
    with contextlib.suppress(OSError):
        return frozenset((file.name, file.stat().st_mtime_ns) for file in folder.iterdir())
    return frozenset()


def write_report(
    campaign: Campaign,
    path: Path,
    *,
    against: Campaign | None = None,
    cases: int = MAX_CASES,
    refresh: int = 0,
    pages: CasePages | None = None,
) -> Path:
    """Write the HTML report of a campaign.

    Args:
        campaign: to report.
        path: the HTML file.
        against: a campaign with another stack on the same scenario, to compare with.
        cases: failures to show in full at most; those that the page has no room for, and all
            behind the first hundred, are files in a folder beside it, which the page links.
        refresh: after how many seconds an open page loads itself again; 0: never.
        pages: of a watch, which has written pages of cases before; None: all are written.

    Returns:
        ``path``.

    Raises:
        PlaceError: the file cannot be written.
    """
    view = view_of(campaign)
    turn = tuple(in_turn(view.records, view.stats.modes))
    report = _report(campaign, view, turn, against, min(cases, PAGE_CASES))
    drawn = draw_page(report)
    tell = functools.partial(_case_page, report, campaign, view.passing, path)
    beside = _write_beside(campaign, path, tell, turn, drawn.cases, cases, pages or CasePages())
    write_page(dataclasses.replace(report, refresh=refresh, beside=beside), path, drawn=drawn)
    return path


def _write_beside(
    campaign: Campaign,
    path: Path,
    tell: Callable[[TrialRecord], ReportContents],
    turn: Iterable[TrialRecord],
    drawn: Collection[str],
    cases: int,
    pages: CasePages,
) -> dict[str, str]:
    """Write the cases that the page has no room for beside it, one page each.

    Args:
        campaign: to report.
        path: of the page.
        tell: gives the contents of the page of a case.
        turn: the failures, those to show first first.
        drawn: ids of the cases on it.
        cases: failures to show in full at most, those on the page included.
        pages: that were written before.

    Returns:
        Paths from the page, by id of the trial.
    """
    if path.exists() and not path.is_file():
        return {}  # a pipe or a terminal has no folder beside it
    folder = path.with_name(path.stem + BESIDE)
    if path.parent.resolve().is_relative_to(campaign.directory.resolve()):
        refuse_links(campaign.directory, folder)
    beside: dict[str, str] = {}
    lost = 0
    for record in turn:
        if len(drawn) + len(beside) >= cases or lost > cases:
            break
        if record.id in drawn:
            continue
        page = folder / f"trial-{record.id}.html"
        try:
            pages.write(page, campaign.folder(record), functools.partial(tell, record))
        except InputError:  # its files are damaged; the page names the first such trials
            lost += 1
            continue
        beside[record.id] = f"{quote(folder.name)}/{page.name}"
    return beside


def _case_page(
    report: ReportContents,
    campaign: Campaign,
    passing: PassingTrials,
    path: Path,
    record: TrialRecord,
) -> ReportContents:
    """Make the page of one case beside that of its campaign."""
    case, happened = case_of(campaign, record, passing), overview.what_happened(record)
    mode = Mode(signature=case.signature, ids=(case.id,), cases=(case,), happened=happened)
    return ReportContents(
        title=f"Trial {case.id} of {report.title}",
        headline=happened,
        facts=(),
        modes=(mode,),
        stack=report.stack,
        other_stack=report.other_stack,
        versions=report.versions,
        whole=f"../{quote(path.name)}",
    )


def case_of(
    campaign: Campaign, record: TrialRecord, passing: PassingTrials | None = None
) -> CaseContents:
    """Read and tell a stored failure as the report shows it.

    Args:
        campaign: of the failure.
        record: of the failure.
        passing: the campaign's passing trials, if they are known already.

    Raises:
        InputError: one of its files is missing or damaged.
    """
    settings = campaign.settings
    if passing is None:
        passing = passing_trials(campaign.records, settings.cube.dimensions)
    return tell_case(campaign.directory, settings, read_failure(campaign, record, passing))


def build_report(
    campaign: Campaign, *, against: Campaign | None = None, cases: int = MAX_CASES
) -> ReportContents:
    """Build what the page says from what is stored.

    Args:
        campaign: to report.
        against: a campaign with another stack on the same scenario, to compare with.
        cases: failures to show in full at most.
    """
    view = view_of(campaign)
    turn = in_turn(view.records, view.stats.modes)
    return _report(campaign, view, turn, against, cases)


def _report(
    campaign: Campaign,
    view: CampaignView,
    turn: Iterable[TrialRecord],
    against: Campaign | None,
    cases: int,
) -> ReportContents:
    failures, lost = readable_failures(campaign, turn, view.passing, cases)
    return overview.tell_campaign(
        view,
        [tell_case(view.directory, view.settings, failure) for failure in failures],
        lost,
        any_world(campaign, view.judged),
        comparison_tables(campaign, against) if against is not None else (),
    )


# --- what is told without a page -----------------------------------------------------------


def short_summary(campaign: Campaign, layers: Mapping[str, str]) -> tuple[str, ...]:
    """Sum a campaign up as the first screen of its page does, with what the numbers do not say.

    Args:
        campaign: to sum up.
        layers: suspected layer by id of a failing trial (:func:`.stored_trials.layer_of`).
    """
    view = view_of(campaign, layers)
    return (*overview.summary_sentences(view), *overview.notes_of(view))


def index_of(campaign: Campaign) -> TrialIndex:
    """Make the index of a campaign, from which it is listed without its log."""
    view = view_of(campaign, {})
    before, after = overview.summary_parts(view)
    return TrialIndex(
        rows=tuple(row_of(record, record.layer) for record in view.records),
        ranked=frozenset(record.id for record in view.judged if record.rank != "none"),
        summary=(before, (*after, *overview.notes_of(view))),
    )


# --- forms other than HTML -----------------------------------------------------------------


def markdown_report(campaign: Campaign, *, against: Campaign | None = None) -> str:
    """Write the report as Markdown: modes, one case each, commands."""
    return render_markdown(build_report(campaign, against=against))


def junit_report(campaign: Campaign) -> str:
    """Write the trials as JUnit XML: a failure is a violation, an error one of the toolkit."""
    judged = [record for record in campaign.records if record.was_run]
    name = Path(campaign.settings.trials.scenario).stem
    return render_junit(name, [_test_result(campaign, record) for record in judged])


def _test_result(campaign: Campaign, record: TrialRecord) -> TrialResult:
    failure, error, skipped = None, None, ""
    happened = overview.what_happened(record)
    if record.other is not None and record.rank == "none":
        skipped = str(record.other)
    elif happened:
        commands = commands_of(campaign.directory, campaign.folder(record), record)
        text = "\n".join(command for _, command in commands)
        failure = Complaint(kind=record.signature, message=happened, text=text)
    elif record.status in ("crashed", "timeout"):
        error = Complaint(kind=record.status, message=overview.last_line(record), text=record.error)
    else:
        skipped = "; ".join(f"{v.spec}: {v.not_judged}" for v in record.verdicts if v.not_judged)
    return TrialResult(
        name=f"trial {record.id}",
        time=record.wall_s,
        failure=failure,
        error=error,
        skipped=skipped,
    )
