"""The files of a report, written once or again and again while the campaign runs."""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from mrta_falsify.campaigns.store import Campaign, log_size, owner_of
from mrta_falsify.commands.folders import Place, make_directory
from mrta_falsify.commands.made_again import keep_run
from mrta_falsify.commands.report.build import (
    MAX_CASES,
    CasePages,
    junit_report,
    markdown_report,
    write_report,
)
from mrta_falsify.commands.report.parameters import nearest_passing, passing_trials
from mrta_falsify.commands.report.reading import in_turn
from mrta_falsify.commands.stored_trials import open_campaign
from mrta_falsify.commands.trust import Trust, open_to_run
from mrta_falsify.core.durable import write_atomically
from mrta_falsify.core.record import TrialRecord


def write_reports(
    directory: Place,
    output: Place | None = None,
    *,
    junit: Place | None = None,
    markdown: Place | None = None,
    against: Place | None = None,
    cases: int = MAX_CASES,
    beside: bool = False,
    run: bool = False,
    trust: Trust = False,
    refresh: int = 0,
) -> tuple[Path, ...]:
    """Write the failure report of a campaign: one HTML file that opens from disk.

    Args:
        directory: of the campaign.
        output: the page; ``report.html`` in the directory if None.
        junit: also as JUnit XML.
        markdown: also as Markdown.
        against: directory of a campaign on another stack to compare with.
        cases: failures to show in full at most.
        beside: run the passing trial nearest to the first failure of each mode again, if it was
            not kept, and show it beside the failure.
        run: make the worlds and traces of failures again that were not kept.
        trust: with ``beside`` or ``run``, run what is not ours, though somebody else has made the
            campaign.
        refresh: after how many seconds an open page loads itself again; 0: never.

    Returns:
        The files written, the page first.

    Raises:
        InputError: not a campaign, or a trial that runs differently now.
        PlaceError: a file cannot be written.
    """
    return _write_reports(
        directory,
        output,
        CasePages(),
        refresh=refresh,
        junit=junit,
        markdown=markdown,
        against=against,
        cases=cases,
        beside=beside,
        run=run,
        trust=trust,
    )


def _write_reports(
    directory: Place,
    output: Place | None,
    pages: CasePages,
    *,
    refresh: int,
    junit: Place | None = None,
    markdown: Place | None = None,
    against: Place | None = None,
    cases: int = MAX_CASES,
    beside: bool = False,
    run: bool = False,
    trust: Trust = False,
) -> tuple[Path, ...]:
    campaign = open_to_run(directory, trust) if run or beside else open_campaign(directory)
    other = open_campaign(against) if against is not None else None
    page = Path(output) if output is not None else Path(directory) / "report.html"
    places = [Path(place) for place in (page, junit, markdown) if place is not None]
    for place in places:
        make_directory(place.parent)
    modes = campaign.stats().modes if run or beside else ()
    if run:
        for record in itertools.islice(in_turn(campaign.records, modes), cases):
            keep_run(campaign, record, trust)
    if beside:
        keep_neighbours(campaign, [campaign.record(mode.ids[0]) for mode in modes], trust)
    write_report(campaign, page, against=other, cases=cases, refresh=refresh, pages=pages)
    if junit is not None:
        write_atomically(Path(junit), junit_report(campaign).encode())
    if markdown is not None:
        write_atomically(Path(markdown), markdown_report(campaign, against=other).encode())
    return tuple(places)


def keep_neighbours(
    campaign: Campaign, failures: Sequence[TrialRecord], trust: Trust = False
) -> None:
    """Run the passing trials nearest to failures again, and keep them for the report.

    Raises:
        InputError: as of :func:`~mrta_falsify.commands.made_again.keep_run`.
    """
    settings = campaign.settings
    passing = passing_trials(campaign.records, settings.cube.dimensions)
    found = (nearest_passing(settings, passing, record) for record in failures)
    for near in {record.number: record for record in found if record is not None}.values():
        keep_run(campaign, near, trust)


def watch_reports(
    directory: Place, output: Place | None = None, *, seconds: float, **options: Any
) -> Iterator[tuple[Path, ...]]:
    """Write the report of a running campaign again whenever it has grown, until it has ended.

    A page that is open in a browser loads itself again; the last page does not. Pages of cases
    that the watch has written stay, unless files of their trials have changed; at the end all are
    written.

    Args:
        directory: of the campaign.
        output: as of :func:`write_reports`.
        seconds: between two looks, > 0.
        options: as of :func:`write_reports`.

    Yields:
        The files written, after each time.

    Raises:
        InputError: as of :func:`write_reports`.
    """
    seen, pages = -1, CasePages()
    while True:
        runs = bool(owner_of(Path(directory)))
        size = log_size(Path(directory))
        if size != seen or not runs:
            refresh = math.ceil(seconds) if runs else 0
            known = pages if runs else CasePages()
            yield _write_reports(directory, output, known, refresh=refresh, **options)
            seen = size
        if not runs:
            return
        time.sleep(seconds)
