"""The report of a campaign in forms other than HTML."""

from __future__ import annotations

from pathlib import Path

from mrta_falsify.campaigns.signature import leading
from mrta_falsify.campaigns.store import Campaign
from mrta_falsify.core.record import TrialRecord
from mrta_falsify.verbs.report.build import build_report
from mrta_falsify.verbs.report.commands import commands_of
from mrta_falsify.verbs.report.overview import last_line
from reports import text_forms
from reports.sentences import sentence


def markdown_report(campaign: Campaign, *, against: Campaign | None = None) -> str:
    """Write the report as Markdown: modes, one case each, commands."""
    return text_forms.markdown(build_report(campaign, against=against))


def junit_report(campaign: Campaign) -> str:
    """Write the trials as JUnit XML: a failure is a violation, an error one of the toolkit."""
    judged = [record for record in campaign.records if record.status != "rejected"]
    name = Path(campaign.settings.trials.scenario).stem
    return text_forms.junit(name, [_test_result(campaign, record) for record in judged])


def _test_result(campaign: Campaign, record: TrialRecord) -> text_forms.TestResult:
    failure = error = None
    verdict = leading(record.verdicts)
    if verdict is not None:
        commands = "\n".join(command for _, command in commands_of(campaign, record))
        failure = text_forms.Complaint(
            kind=record.signature, message=sentence(verdict), text=commands
        )
    elif record.status in ("crashed", "timeout"):
        error = text_forms.Complaint(
            kind=record.status, message=last_line(record), text=record.error
        )
    return text_forms.TestResult(
        name=f"trial {record.id}", time=record.wall_s, failure=failure, error=error
    )
