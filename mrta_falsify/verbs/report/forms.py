"""The report of a campaign in forms other than HTML."""

from __future__ import annotations

from pathlib import Path

from mrta_falsify.campaigns.store import Campaign
from mrta_falsify.core.record import TrialRecord
from mrta_falsify.specs.causes import leading
from mrta_falsify.verbs.report.build import build_report
from mrta_falsify.verbs.report.commands import commands_of
from mrta_falsify.verbs.report.overview import last_line
from reports.junit import Complaint, TrialResult, render_junit
from reports.markdown import render_markdown
from reports.sentences import violation_sentence


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
    verdict = leading(record.verdicts)
    if record.other is not None and record.rank == "none":
        skipped = str(record.other)
    elif verdict is not None:
        commands = "\n".join(command for _, command in commands_of(campaign, record))
        failure = Complaint(
            kind=record.signature, message=violation_sentence(verdict), text=commands
        )
    elif record.status in ("crashed", "timeout"):
        error = Complaint(kind=record.status, message=last_line(record), text=record.error)
    else:
        skipped = "; ".join(f"{v.spec}: {v.not_judged}" for v in record.verdicts if v.not_judged)
    return TrialResult(
        name=f"trial {record.id}",
        time=record.wall_s,
        failure=failure,
        error=error,
        skipped=skipped,
    )
