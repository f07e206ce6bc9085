"""The report of a campaign directory; reads what is stored and runs nothing."""

from __future__ import annotations

import contextlib
import dataclasses
import math
import shlex
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from urllib.parse import quote

import numpy as np
import yaml

from mrta_falsify.campaigns.made_here import refuse_links
from mrta_falsify.campaigns.settings import TrialSettings
from mrta_falsify.campaigns.stats import CampaignStats, FailureMode
from mrta_falsify.campaigns.store import Campaign
from mrta_falsify.campaigns.trial_index import TrialIndex
from mrta_falsify.core import codec
from mrta_falsify.core.claims import KIND_TEXT
from mrta_falsify.core.config import StackConfig
from mrta_falsify.core.durable import make_folder
from mrta_falsify.core.errors import InputError
from mrta_falsify.core.record import TrialRecord
from mrta_falsify.core.world import World, read_world
from mrta_falsify.specs.causes import kind_of, leading
from mrta_falsify.verbs.campaign_summary import (
    comparison_sentence,
    kinds_text,
    unjudged_sentences,
)
from mrta_falsify.verbs.report.against import comparison_tables, stack_difference
from mrta_falsify.verbs.report.cases import case_of, in_turn, readable_cases
from mrta_falsify.verbs.report.dimensions import parameter_importances, rank_dimensions
from mrta_falsify.verbs.report.overview import error_kinds, facts_of, notes_of, warnings_of
from mrta_falsify.verbs.report.summary import summary_parts, summary_sentences
from mrta_falsify.verbs.report.trial_table import trial_table
from mrta_falsify.verbs.stored_trials import layer_of, row_of
from reports.contents import CaseContents, Mode, ReportContents, TrialScores
from reports.page import draw_cases, write_page
from reports.sentences import violation_sentence

MAX_CASES = 20  # shown in full unless asked otherwise
PAGE_CASES = 100  # on the page itself; further ones are files beside it
BESIDE = ".cases"  # ends the name of their folder


def write_report(
    campaign: Campaign,
    path: Path,
    *,
    against: Campaign | None = None,
    cases: int = MAX_CASES,
    refresh: int = 0,
    watched_since: float = math.inf,
) -> Path:
    """Write the HTML report of a campaign.

    Args:
        campaign: to report.
        path: the HTML file.
        against: a campaign with another stack on the same scenario, to compare with.
        cases: failures to show in full at most; those that the page has no room for, and all
            behind the first hundred, are files in a folder beside it, which the page links.
        refresh: after how many seconds an open page loads itself again; 0: never.
        watched_since: when a watch of the campaign began [ns since the epoch]; pages of cases that
            it has written stay, unless files of their trials have changed.

    Returns:
        ``path``.

    Raises:
        PlaceError: the file cannot be written.
    """
    report = build_report(campaign, against=against, cases=min(cases, PAGE_CASES))
    drawn = draw_cases(report)
    report = dataclasses.replace(
        report,
        refresh=refresh,
        beside=_write_beside(campaign, path, report, set(drawn), cases, watched_since),
    )
    write_page(report, path, drawn=drawn)
    return path


def _write_beside(
    campaign: Campaign,
    path: Path,
    report: ReportContents,
    drawn: Collection[str],
    cases: int,
    watched_since: float,
) -> dict[str, str]:
    """Write the cases that the page has no room for beside it, one page each.

    Args:
        campaign: to report.
        path: of the page.
        report: what the page says.
        drawn: ids of the cases on it.
        cases: failures to show in full at most, those on the page included.
        watched_since: pages that were written since then [ns], and after the files of their
            trials, stay.

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
    for record in in_turn(campaign):
        if len(drawn) + len(beside) >= cases or lost > cases:
            break
        if record.id in drawn:
            continue
        page = folder / f"trial-{record.id}.html"
        try:
            if not _is_newer(page, campaign.folder(record), watched_since):
                case = case_of(campaign, record)
                make_folder(folder)
                write_page(_case_page(report, case, path), page)
        except InputError:  # its files are damaged; the page names the first such trials
            lost += 1
            continue
        beside[record.id] = f"{quote(folder.name)}/{page.name}"
    return beside


def _is_newer(page: Path, folder: Path, since: float) -> bool:
    """Whether a page was written since a moment [ns], and after all files of a trial."""
    with contextlib.suppress(OSError):
        written = page.stat().st_mtime_ns
        return written > since and all(
            file.stat().st_mtime_ns < written for file in folder.iterdir()
        )
    return False


def _case_page(report: ReportContents, case: CaseContents, path: Path) -> ReportContents:
    """Make the page of one case beside that of its campaign."""
    verdict = leading(case.verdicts)
    happened = violation_sentence(verdict) if verdict is not None else ""
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


def build_report(
    campaign: Campaign, *, against: Campaign | None = None, cases: int = MAX_CASES
) -> ReportContents:
    """Build what the page says from what is stored.

    Args:
        campaign: to report.
        against: a campaign with another stack on the same scenario, to compare with.
        cases: failures to show in full at most.
    """
    settings, stats = campaign.settings, campaign.stats()
    judged = [record for record in campaign.records if record.status == "ok"]
    failed = [record for record in judged if record.failed]
    shown, lost = readable_cases(campaign, cases)
    floor = _any_world(campaign, judged)
    versions = next((record.origin.versions for record in judged), {})
    kinds = stats.modes
    layers = {record.id: layer_of(campaign, record) for record in failed}
    found = _modes(kinds, failed, shown, layers)
    ranking = rank_dimensions(campaign, judged)
    return ReportContents(
        title=f"{Path(settings.trials.scenario).stem}, seed {settings.trials.seed}",
        headline=_headline(stats),
        summary=summary_sentences(campaign, stats, ranking.mattering, layers),
        counted_by=shlex.join(["mrta-falsify", "list", str(campaign.directory)]),
        facts=facts_of(stats),
        modes=found,
        trials=_trials(judged, floor),
        importances=parameter_importances(campaign, judged, ranking),
        even=ranking.is_even,
        table=trial_table(campaign, kinds, [one.dimension for one in ranking.found]),
        errors=error_kinds(campaign),
        floor=floor,
        stack=yaml.safe_dump(codec.encode(settings.trials.stack), sort_keys=False),
        other_stack=_other_stack_text(settings.trials.against),
        versions=tuple(sorted(versions.items())),
        notes=(
            *_compared_notes(settings.trials),
            *notes_of(campaign, stats),
            *(f"{s}." for s in unjudged_sentences(stats)),
            *lost,
        ),
        warnings=warnings_of(campaign, judged),
        tables=comparison_tables(campaign, against) if against is not None else (),
    )


def short_summary(campaign: Campaign, layers: Mapping[str, str]) -> tuple[str, ...]:
    """Sum a campaign up as the first screen of its page does, with what the numbers do not say.

    Args:
        campaign: to sum up.
        layers: suspected layer by id of a failing trial (:func:`.stored_trials.layer_of`).
    """
    stats = campaign.stats()
    judged = [record for record in campaign.records if record.status == "ok"]
    mattering = rank_dimensions(campaign, judged).mattering
    told = summary_sentences(campaign, stats, mattering, layers)
    return (*told, *notes_of(campaign, stats))


def index_of(campaign: Campaign) -> TrialIndex:
    """Make the index of a campaign, from which it is listed without its log."""
    stats = campaign.stats()
    judged = [record for record in campaign.records if record.status == "ok"]
    mattering = rank_dimensions(campaign, judged).mattering
    before, after = summary_parts(campaign, stats, mattering)
    return TrialIndex(
        rows=tuple(row_of(record, record.layer) for record in campaign.records),
        ranked=frozenset(record.id for record in judged if record.rank != "none"),
        summary=(before, (*after, *notes_of(campaign, stats))),
    )


def _compared_notes(settings: TrialSettings) -> tuple[str, ...]:
    """Say what a campaign compares, and when a failure counts."""
    if settings.against is None:
        return ()
    return (
        "A failure counts if this stack fails in most copies of its world with small differences, "
        "and the other one passes in the world and in most of the same copies.",
        stack_difference(settings.stack, settings.against),
    )


def _other_stack_text(stack: StackConfig | None) -> str:
    return yaml.safe_dump(codec.encode(stack), sort_keys=False) if stack is not None else ""


def _headline(stats: CampaignStats) -> str:
    """Give the result of a campaign in one line; what is looked for last is counted apart."""
    judged = stats.judged
    if not judged:
        return "No trial has been judged" if stats.records else "No trial has been run yet"
    if stats.comparison is not None:
        return f"{judged} trials: {comparison_sentence(stats.comparison)}"
    last, shut, sought = stats.afterthoughts, stats.kinds["shut"], stats.sought
    count = stats.primary_modes
    kinds = "one mode" if count == 1 else f"{count} modes"
    verb = "violates" if sought == 1 else "violate"
    which = " that is looked for first" if last else ""
    first = f"{sought} of {judged} trials {verb} a specification{which}, in {kinds}"
    first += f": {kinds_text({**stats.kinds, 'shut': 0})}"
    if not sought:
        first = f"None of {judged} trials violates a specification"
        first += " that is looked for first" if last or shut else ""
    first += f"; {shut} {KIND_TEXT['shut']}" if shut else ""
    names = " or ".join(stats.settings.trials.then)
    return f"{first}; {last} only {names}" if last else first


def _modes(
    kinds: Sequence[FailureMode],
    failed: Sequence[TrialRecord],
    shown: Sequence[CaseContents],
    layers_by_id: Mapping[str, str],
) -> tuple[Mode, ...]:
    by_id = {record.id: record for record in failed}
    cases: dict[str, list[CaseContents]] = {}
    for case in shown:
        cases.setdefault(case.signature, []).append(case)
    found = []
    for mode in kinds:
        verdict = leading(by_id[mode.ids[0]].verdicts)
        layers = Counter(layers_by_id[i] for i in mode.ids)
        layers.pop("", None)
        found.append(
            Mode(
                signature=mode.signature,
                ids=tuple(mode.ids),
                cases=tuple(cases.get(mode.signature, ())),
                happened=violation_sentence(verdict) if verdict is not None else "",
                layers=tuple(sorted(layers, key=lambda name: (-layers[name], name))),
            )
        )
    return tuple(found)


def _any_world(campaign: Campaign, judged: Sequence[TrialRecord]) -> World | None:
    for record in judged:
        path = campaign.folder(record) / "world.json"
        if path.is_file():
            with contextlib.suppress(InputError):  # the case says what is wrong with it
                return read_world(path)
    return None


def _trials(judged: Sequence[TrialRecord], floor: World | None) -> TrialScores:
    places = np.array(
        [[r.search.descriptors.get("x", 0.5), r.search.descriptors.get("y", 0.5)] for r in judged]
    ).reshape(-1, 2)
    if floor is not None:
        places = floor.bounds[:2] + places * (floor.bounds[2:] - floor.bounds[:2])
    return TrialScores(
        numbers=tuple(record.number for record in judged),
        scores=tuple(record.score for record in judged),
        failed=tuple(record.rank != "none" for record in judged),
        deadlocked=tuple(r.rank != "none" and kind_of(r.verdicts) == "deadlock" for r in judged),
        situations=_situations_so_far(judged),
        places=places,
    )


def _situations_so_far(judged: Sequence[TrialRecord]) -> tuple[int, ...]:
    """Count the different situations that trials have shown, after each; empty: none are stored."""
    seen: set[str] = set()
    counts = []
    for record in judged:
        seen.update(record.search.situations)
        counts.append(len(seen))
    return tuple(counts) if seen else ()
