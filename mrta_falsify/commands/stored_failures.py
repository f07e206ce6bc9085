"""What can be asked about stored failures, by the directory of their campaign."""

from __future__ import annotations

import itertools
import math
import shlex
import shutil
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from mrta_falsify.analysis.explain import MAX_RUNS, REWINDS, explain
from mrta_falsify.analysis.explain.explaining import Keep
from mrta_falsify.analysis.minimize import minimize
from mrta_falsify.analysis.minimize.minimising import MAX_RUNS as MAX_MINIMIZE_RUNS
from mrta_falsify.campaigns.store import Campaign, StoreError, log_size, owner_of
from mrta_falsify.commands.corpus import names_engine, on_recorded_engine, recheck
from mrta_falsify.commands.folders import Place, make_directory
from mrta_falsify.commands.made_again import keep_run
from mrta_falsify.commands.report import (
    MAX_CASES,
    junit_report,
    markdown_report,
    write_report,
)
from mrta_falsify.commands.report.build import CasePages
from mrta_falsify.commands.report.parameters import nearest_passing, passing_trials
from mrta_falsify.commands.report.reading import in_turn
from mrta_falsify.commands.run import write_run
from mrta_falsify.commands.stacks import Stack, load_stack
from mrta_falsify.commands.stored_trials import open_campaign
from mrta_falsify.commands.trust import Trust, open_to_run, permit_rechecks, permit_runs
from mrta_falsify.commands.workers import count_cores
from mrta_falsify.core.config import StackConfig
from mrta_falsify.core.durable import write_atomically
from mrta_falsify.core.findings import Explanation, Minimisation, Recheck
from mrta_falsify.core.record import TrialRecord
from mrta_falsify.core.world import World
from mrta_falsify.trial import Judged

EXPLAINED = "explain"  # folder of the runs that `explain` keeps, beside the trial


def explain_trial(
    directory: Place,
    id: str | int,
    max_runs: int = MAX_RUNS,
    *,
    rewinds: int = REWINDS,
    keep: bool = False,
    workers: int | None = None,
    trust: Trust = False,
    on_done: Callable[[int, int], None] = lambda done, total: None,
) -> Explanation:
    """Find the layer that a failure belongs to, by re-runs with one thing changed before its onset.

    The answer is kept beside the trial, for the report.

    Args:
        directory: of the campaign.
        id: of the trial.
        max_runs: re-runs at most.
        rewinds: copies at most, beside these, that tell when the failure was decided; 0: none.
        keep: write a run of each exchange that removes the failure into ``explain`` beside the
            trial, and one of the stack as it is.
        workers: processes; None: as many as the machine has cores.
        trust: run what is not ours, though somebody else has made the campaign.
        on_done: called after each re-run with how many are done, and how many there will be.

    Raises:
        InputError: no such trial, or it did not fail.
    """
    campaign = open_to_run(directory, trust)
    record = campaign.record(str(id))
    permit_runs(campaign, (record,), trust)
    return explain(
        campaign,
        record,
        max_runs=max_runs,
        rewinds=rewinds,
        keep=_keeping(campaign, record) if keep else None,
        workers=count_cores(workers),
        on_done=on_done,
    )


def _keeping(campaign: Campaign, record: TrialRecord) -> Keep:
    """Make room for the runs that are kept, and say how they are written."""
    folder = campaign.folder(record) / EXPLAINED
    shutil.rmtree(folder, ignore_errors=True)
    again = shlex.join(["mrta-falsify", "explain", str(campaign.directory), record.id, "--keep"])

    def write(name: str, config: StackConfig, world: World, judged: Judged) -> None:
        write_run(judged.outcome, world, folder / name, config=config, again=again)

    return write


def minimize_trial(
    directory: Place,
    id: str | int,
    max_runs: int = MAX_MINIMIZE_RUNS,
    *,
    workers: int | None = None,
    trust: Trust = False,
    on_run: Callable[[int, str], None] = lambda runs, text: None,
) -> Minimisation:
    """Find the smallest world that fails in the same way, and write it beside the trial.

    Args:
        directory: of the campaign.
        id: of the trial.
        max_runs: simulations at most, beside ten of the result; a second call with more goes on.
        workers: processes; one per core if None.
        trust: run what is not ours, though somebody else has made the campaign.
        on_run: called after each simulation with their number and a line about it.

    Raises:
        InputError: no such trial, or it did not fail.
    """
    campaign = open_to_run(directory, trust)
    record = campaign.record(str(id))
    permit_runs(campaign, (record,), trust, with_other=record.other is not None)
    return minimize(
        campaign, record, max_runs=max_runs, workers=count_cores(workers), on_run=on_run
    )


def recheck_corpus(
    directory: Place,
    *,
    stack: Stack | None = None,
    settings: Sequence[str] = (),
    jittered: int = 2,
    workers: int | None = None,
    time_limit: float | None = None,
    only: Sequence[str] = (),
    pictures: Place | None = None,
    run: bool = False,
    trust: Trust = False,
    on_done: Callable[[Recheck], None] = lambda row: None,
) -> tuple[Recheck, ...]:
    """Run all stored failures of a campaign on a changed stack.

    Each is fixed, still failing, flaky (only copies with small differences fail) or a timeout.
    The recorded engine is kept unless the stack file or a setting names one.

    Args:
        directory: of the campaign.
        stack: the changed stack, or its YAML file; the campaign's own if None.
        settings: ``--set`` texts applied to the stack.
        jittered: copies with small differences that are run of each failure.
        workers: processes; one per core if None.
        time_limit: what one run may work and sleep [s]; the campaign's own limit if None.
        only: ids of the failures to run; all if empty.
        pictures: directory for a picture of each run that fails; none are drawn if None.
        run: sample worlds anew that were not kept.
        trust: run what is not ours, though somebody else has made the campaign.
        on_done: called with each row.

    Raises:
        InputError: not a campaign, an unknown layer, or a trial that did not fail.
    """
    campaign = open_to_run(directory, trust)
    config = load_stack(stack, settings) if stack is not None or settings else None
    named = StackConfig() if config is not None else None
    if config is not None and named is not None and keeps_engine(stack, settings):
        config = on_recorded_engine(campaign, config)
        named = on_recorded_engine(campaign, named)
    chosen = failures_named(campaign, only)
    permit_rechecks(campaign, named, trust, only=chosen, run=run)
    return recheck(
        campaign,
        config=config,
        jittered=jittered,
        workers=count_cores(workers),
        time_limit=time_limit,
        only=chosen,
        pictures=make_directory(Path(pictures)) if pictures is not None else None,
        on_done=on_done,
    )


def failures_named(campaign: Campaign, names: Sequence[str]) -> tuple[str, ...]:
    """Find the ids of failures by what a user calls them, as ``0042`` or ``42``.

    Raises:
        InputError: no such trial, or it did not fail.
    """
    found = [campaign.record(name) for name in names]
    for record in found:
        if not record.failed:
            raise StoreError(f"trial {record.id} of {campaign.directory} violates nothing")
    return tuple(record.id for record in found)


def keeps_engine(stack: Stack | None, settings: Sequence[str] = ()) -> bool:
    """Say whether a changed stack leaves the engine to the campaign that it is run on.

    A stack given as a value names an engine; a file or ``--set`` text may.
    """
    path = Path(stack) if isinstance(stack, str | Path) else None
    is_value = stack is not None and path is None
    return not is_value and not names_engine(path, settings)


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
