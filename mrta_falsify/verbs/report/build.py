"""The report of a campaign directory; reads what is stored and runs nothing."""

from __future__ import annotations

import contextlib
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import yaml

from mrta_falsify.campaigns.signature import leading
from mrta_falsify.campaigns.store import Campaign, owner_of
from mrta_falsify.core import codec
from mrta_falsify.core.errors import InputError
from mrta_falsify.core.record import TrialRecord
from mrta_falsify.core.world import World, read_world
from mrta_falsify.verbs.campaign import modes, probability_of, screening_agreement
from mrta_falsify.verbs.report.against import comparison_tables
from mrta_falsify.verbs.report.cases import commands_of, readable_cases
from reports.contents import CaseContents, ErrorKind, Mode, ReportContents, TrialScores
from reports.junit import Complaint, TrialResult, render_junit
from reports.markdown import render_markdown
from reports.page import write_page
from reports.sentences import violation_sentence

MOST_CASES = 20  # shown in full unless asked otherwise
CASE_BYTES = 225_000  # of the page for each that is asked for


def write(
    campaign: Campaign, path: Path, *, against: Campaign | None = None, cases: int = MOST_CASES
) -> Path:
    """Write the HTML report of a campaign.

    Args:
        campaign: to report.
        path: the HTML file.
        against: a campaign with another stack on the same scenario, to compare with.
        cases: failures to show in full at most.

    Returns:
        ``path``.

    Raises:
        FormatError: it cannot be written.
    """
    report = report_of(campaign, against=against, cases=cases)
    write_page(report, path, most_bytes=CASE_BYTES * max(cases, MOST_CASES))
    return path


def report_of(
    campaign: Campaign, *, against: Campaign | None = None, cases: int = MOST_CASES
) -> ReportContents:
    """What the page says, from what is stored."""
    settings = campaign.settings
    judged = [record for record in campaign.records if record.status == "ok"]
    failed = [record for record in judged if record.failed]
    shown, lost = readable_cases(campaign, cases)
    floor = _any_world(campaign, judged)
    versions = next((record.versions for record in judged), {})
    found = _modes(campaign, failed, shown)
    return ReportContents(
        title=f"{Path(settings.trials.scenario).stem}, seed {settings.trials.seed}",
        headline=headline(campaign, len(failed), len(judged), len(found)),
        facts=_facts(campaign, judged, failed),
        modes=found,
        trials=_trials(judged, floor),
        errors=_errors(campaign),
        floor=floor,
        stack=yaml.safe_dump(codec.encode(settings.trials.stack), sort_keys=False),
        versions=tuple(sorted(versions.items())),
        notes=(*_notes(campaign), *lost),
        warnings=_warnings(campaign, judged),
        tables=comparison_tables(campaign, against) if against is not None else (),
    )


def headline(campaign: Campaign, failed: int, judged: int, count: int) -> str:
    """The result of a campaign in one line."""
    if not judged:
        return "No trial has been judged" if campaign.records else "No trial has been run yet"
    if not failed:
        return f"None of {judged} trials violates a specification"
    kinds = "one mode" if count == 1 else f"{count} modes"
    verb = "violates" if failed == 1 else "violate"
    return f"{failed} of {judged} trials {verb} a specification, in {kinds}"


def _modes(
    campaign: Campaign, failed: Sequence[TrialRecord], shown: Sequence[CaseContents]
) -> tuple[Mode, ...]:
    by_id = {record.id: record for record in failed}
    cases: dict[str, list[CaseContents]] = {}
    for case in shown:
        cases.setdefault(case.signature, []).append(case)
    found = []
    for mode in modes(campaign):
        verdict = leading(by_id[mode["ids"][0]].verdicts)
        layers = Counter(by_id[i].layer for i in mode["ids"] if by_id[i].layer)
        layers.update(case.layer for case in cases.get(mode["signature"], []) if case.layer)
        found.append(
            Mode(
                signature=mode["signature"],
                ids=tuple(mode["ids"]),
                cases=tuple(cases.get(mode["signature"], ())),
                happened=violation_sentence(verdict) if verdict is not None else "",
                layers=tuple(sorted(layers, key=lambda name: (-layers[name], name))),
            )
        )
    return tuple(found)


def _facts(
    campaign: Campaign, judged: Sequence[TrialRecord], failed: Sequence[TrialRecord]
) -> tuple[tuple[str, str], ...]:
    settings = campaign.settings
    statuses = Counter(record.status for record in campaign.records)
    hours = sum(record.sim_time for record in judged) / 3600.0
    computed = sum(record.wall_s + record.scene_s for record in campaign.records)
    first = next((i for i, record in enumerate(judged, start=1) if record.failed), None)
    facts = [
        ("scenario", settings.trials.scenario),
        ("trials", str(len(judged))),
        ("failures", str(len(failed))),
        ("first failure", f"trial {first} of {len(judged)}" if first else "none"),
        ("scenes rejected", str(statuses["rejected"])),
        ("errors of the toolkit", str(statuses["crashed"] + statuses["timeout"])),
        ("sampler", settings.sampler.name),
        ("search dimensions", str(settings.cube.dimensions)),
        ("simulated", f"{hours:.2f} h"),
        ("computed", f"{computed:.0f} s on one core"),
        ("specifications", ", ".join(settings.trials.specifications)),
    ]
    agreed = screening_agreement(campaign)
    if agreed is not None:
        text = f"{agreed['confirmed']} of {agreed['failed_in_screening']} kinematic failures"
        facts.append(("confirmed by physics", text))
    return tuple(facts)


def _notes(campaign: Campaign) -> tuple[str, ...]:
    chance = probability_of(campaign)
    if "why_not" in chance:
        return (f"No probability of failure is given: {chance['why_not']}.",)
    text = (
        f"Probability of a violation: {chance['estimate']:.3g}, "
        f"{chance['level']:.0%} interval [{chance['low']:.3g}, {chance['high']:.3g}] "
        f"({chance['method']}, {chance['trials']} trials)."
    )
    return (text, f"{chance['note']}.") if chance["note"] else (text,)


def _warnings(campaign: Campaign, judged: Sequence[TrialRecord]) -> tuple[str, ...]:
    warnings = []
    owner = owner_of(campaign.directory)
    if owner:
        warnings.append(
            f"The campaign was still running when this page was written ({owner}); it shows the "
            f"{len(campaign.records)} trials finished by then."
        )
    kinds = {tuple(sorted(record.versions.items())) for record in judged}
    if len(kinds) > 1:
        differing = sorted({name for kind in kinds for name, _ in set(kind) - set(min(kinds))})
        warnings.append(
            f"Trials were run by different versions of {', '.join(differing) or 'the toolkit'}: "
            "their digests need not agree."
        )
    return tuple(warnings)


def _errors(campaign: Campaign) -> tuple[ErrorKind, ...]:
    """Errors of the toolkit by their last line, the most frequent first."""
    groups: dict[str, list[TrialRecord]] = {}
    for record in campaign.records:
        if record.status in ("crashed", "timeout"):
            groups.setdefault(_last_line(record), []).append(record)
    found = [
        ErrorKind(reason=reason, ids=tuple(r.id for r in records), text=records[0].error.strip())
        for reason, records in groups.items()
    ]
    return tuple(sorted(found, key=lambda kind: (-len(kind.ids), kind.reason)))


def _last_line(record: TrialRecord) -> str:
    return (record.error.strip().splitlines() or [record.status])[-1]


def _any_world(campaign: Campaign, judged: Sequence[TrialRecord]) -> World | None:
    for record in judged:
        path = campaign.folder(record) / "world.json"
        if path.is_file():
            with contextlib.suppress(InputError):  # the case says what is wrong with it
                return read_world(path)
    return None


def _trials(judged: Sequence[TrialRecord], floor: World | None) -> TrialScores:
    places = np.array(
        [[r.descriptors.get("x", 0.5), r.descriptors.get("y", 0.5)] for r in judged]
    ).reshape(-1, 2)
    if floor is not None:
        places = floor.bounds[:2] + places * (floor.bounds[2:] - floor.bounds[:2])
    return TrialScores(
        numbers=tuple(record.number for record in judged),
        scores=tuple(record.score for record in judged),
        failed=tuple(record.failed for record in judged),
        places=places,
    )


# --- other formats -------------------------------------------------------------------------


def markdown(campaign: Campaign, *, against: Campaign | None = None) -> str:
    """The report as Markdown: modes, one case each, commands."""
    return render_markdown(report_of(campaign, against=against))


def junit(campaign: Campaign) -> str:
    """The trials as JUnit XML: a failure is a violation, an error one of the toolkit."""
    judged = [record for record in campaign.records if record.status != "rejected"]
    name = Path(campaign.settings.trials.scenario).stem
    return render_junit(name, [_test_result(campaign, record) for record in judged])


def _test_result(campaign: Campaign, record: TrialRecord) -> TrialResult:
    failure = error = None
    verdict = leading(record.verdicts)
    if verdict is not None:
        commands = "\n".join(command for _, command in commands_of(campaign, record))
        failure = Complaint(
            kind=record.signature, message=violation_sentence(verdict), text=commands
        )
    elif record.status in ("crashed", "timeout"):
        error = Complaint(kind=record.status, message=_last_line(record), text=record.error)
    return TrialResult(name=f"trial {record.id}", time=record.wall_s, failure=failure, error=error)
