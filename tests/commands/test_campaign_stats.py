"""Whoever tells the numbers of a campaign tells the same ones."""

from __future__ import annotations

import json
import re
import xml.etree.ElementTree as ET
from collections import Counter
from types import SimpleNamespace

import pytest
from click.testing import CliRunner

from mrta_falsify import pytest_plugin
from mrta_falsify.campaigns.runner import Progress
from mrta_falsify.campaigns.settings import Limits
from mrta_falsify.cli import campaign_commands, campaign_output, main
from mrta_falsify.commands.campaign import CampaignResult
from mrta_falsify.commands.campaign_summary import summarise_campaign
from mrta_falsify.commands.report.build import build_report
from mrta_falsify.commands.report.writing import watch_reports
from mrta_falsify.commands.search_outcomes import search_outcome
from mrta_falsify.core import codec
from tests.commands import all_kinds

RECORDS = len(all_kinds.RECORDS)
STATUSES = {"ok": 12, "rejected": 1, "impossible": 1, "crashed": 1, "timeout": 1}
KINDS = {"deadlock": 2, "stuck": 1, "shut": 1, "other": 3}
#: failures: with another stack, those that it does not pass are only counted
ALONE = {"robust": 5, "primary": 6, "modes": [2, 1, 3, 1, 1], "on_both": 0, "own": 8}
AGAINST = {"robust": 2, "primary": 4, "modes": [2, 2, 1, 1], "on_both": 1, "own": 2}


@pytest.fixture(scope="module", params=[False, True], ids=["alone", "against"])
def campaign(request, tmp_path_factory):
    return all_kinds.campaign(tmp_path_factory.mktemp("kinds") / "c", against=request.param)


@pytest.fixture(scope="module")
def expected(campaign):
    return ALONE if campaign.settings.trials.against is None else AGAINST


@pytest.fixture(scope="module")
def result(campaign):
    progress = Progress(campaign.settings, limits=Limits(budget=RECORDS))
    for record in campaign.records:
        progress.take(record)
    return CampaignResult(campaign=campaign, progress=progress, ended="budget", wall_s=1.0)


def _printed(*words):
    done = CliRunner().invoke(main, [str(word) for word in words])
    assert done.exit_code == 0, done.output
    return done.stdout


def test_the_counts_of_a_campaign(campaign, expected):
    stats = campaign.stats()
    assert stats.records == RECORDS == sum(STATUSES.values())
    assert (stats.ran, stats.judged, stats.errors) == (14, 12, 2)
    assert (stats.rejected, stats.impossible, stats.afterthoughts) == (1, 1, 1)
    assert stats.failed == sum(KINDS.values()) + stats.afterthoughts == 8
    assert stats.sought == stats.failed - KINDS["shut"] - stats.afterthoughts
    assert (stats.robust, stats.primary) == (expected["robust"], expected["primary"])
    assert [mode.count for mode in stats.modes] == expected["modes"]
    assert (stats.on_both, stats.own_failures) == (expected["on_both"], expected["own"])
    assert stats.first_primary.judged == 2
    assert (stats.first_failure, stats.first_primary.ran) == (2, 2)
    assert stats.uniform.drawn == RECORDS
    assert stats.uniform.judged + stats.uniform.undecided == stats.ran
    assert stats.uniform.failed == stats.primary


def test_progress_summary_and_exit_code_tell_these_counts(campaign, result, expected, capsys):
    stats, line = campaign.stats(), campaign_output._count_text(result.progress)
    told = [("failed", 8), ("rejected", 1), ("impossible", 1), ("errors", 2)]
    told += [("on both stacks", expected["on_both"])] if expected["on_both"] else []
    for name, count in told:
        assert f"{count} {name}" in line
    data = codec.encode(summarise_campaign(result))
    assert (data["ran"], data["failed"], data["rejected"]) == (14, 8, 1)
    assert (data["impossible"], data["errors"], data["afterthoughts"]) == (1, 2, 1)
    assert data["kinds"] == KINDS
    assert data["by_specification"] == stats.by_specification
    assert data["first_failure_at"] == stats.first_failure
    assert [mode["count"] for mode in data["modes"]] == expected["modes"]
    robust = data["robust"] if expected is ALONE else data["against"]["found"]
    assert robust == expected["robust"]
    assert data["probability"]["failures"] == expected["primary"]
    assert data["probability"]["trials"] + data["probability"]["undecided"] == stats.ran
    assert data["unseen"] == codec.encode(result.progress.unseen) == codec.encode(stats.unseen)
    campaign_output.print_campaign(result)
    said = capsys.readouterr().out
    assert "2 deadlocks, 1 stuck, 3 failed otherwise, 1 shut by the world, 1 only in" in said
    assert "1 scenes rejected, 1 impossible, 2 errors" in said
    assert campaign_commands._exit_code(result) == 1


def test_list_and_frame_have_as_many_rows_of_each_kind(campaign):
    rows, frame = json.loads(_printed("list", campaign.directory, "--format", "json")), (
        campaign.frame()
    )  # fmt: skip
    failed = [row for row in rows if row["failed"]]
    assert Counter(row["status"] for row in rows) == frame["status"].value_counts().to_dict()
    assert Counter(row["status"] for row in rows) == STATUSES
    assert len(failed) == frame["failed"].sum() == campaign.stats().failed
    first = [row for row in failed if row["violated"] != ["deadlines"]]
    kinds = Counter(row.get("kind") or "other" for row in first)
    assert kinds == KINDS
    in_frame = frame[frame["failed"] & (frame["signature"] != "deadlines")]["kind"]
    assert Counter(kind or "other" for kind in in_frame) == KINDS
    named = json.loads(_printed("list", campaign.directory, "--failed", "--format", "json"))
    assert [row["id"] for row in named] == [row["id"] for row in failed]


def test_page_markdown_and_junit_tell_these_counts(campaign, expected, tmp_path):
    stats, report = campaign.stats(), build_report(campaign)
    facts = dict(report.facts)
    assert (facts["trials"], facts["deadlocks"], facts["stuck"]) == ("12", "2", "1")
    assert (facts["other failures"], facts["shut by the world"]) == ("3", "1")
    assert (facts["only deadlines"], facts["first failure"]) == ("1", "trial 2 of 12")
    assert (facts["scenes rejected"], facts["impossible worlds"]) == ("1", "1")
    assert facts["errors of the toolkit"] == "2"
    assert [len(mode.ids) for mode in report.modes] == expected["modes"]
    assert sum(report.trials.failed) == sum(expected["modes"])
    ways = re.search(r"fail in (\d+) different ways", " ".join(report.summary))
    assert ways is not None
    assert int(ways[1]) == stats.primary_modes

    page, markdown, junit = (tmp_path / f"r.{end}" for end in ("html", "md", "xml"))
    _printed("report", campaign.directory, "-o", page, "--markdown", markdown, "--junit", junit)
    said = markdown.read_text()
    assert report.headline in said
    assert all(f"- {label}: " in said for label in facts)
    suite = ET.parse(junit).getroot()
    assert (suite.get("tests"), suite.get("errors")) == (str(stats.ran), str(stats.errors))
    assert suite.get("failures") == str(sum(expected["modes"]))
    again = tmp_path / "again.md"
    next(watch_reports(campaign.directory, page, seconds=1.0, markdown=again))
    assert again.read_text() == said


def test_the_pytest_plugin_tells_how_many_fail(campaign, result, expected, monkeypatch):
    monkeypatch.setattr("mrta_falsify.commands.pictures.draw_trial", lambda *_: "picture.png")
    item = SimpleNamespace(funcargs={pytest_plugin.FIXTURE: result})
    with pytest.raises(pytest.fail.Exception) as failed:
        pytest_plugin.pytest_runtest_call(item)
    assert str(failed.value).startswith(f"{expected['own']} of 14 trials fail: ")
    own = (r for r in campaign.records if (r.failed if expected is ALONE else r.is_robust))
    assert str(failed.value).endswith(f" {next(own).id}")


@pytest.mark.parametrize("knife_edges", [True, False])
def test_a_comparison_of_samplers_counts_up_to_the_first_failure(campaign, knife_edges):
    stats = campaign.stats()
    outcome = search_outcome(campaign, budget=100, knife_edges=knife_edges)
    first = stats.first_primary if knife_edges else stats.first_robust
    assert (outcome.trials, outcome.simulations.found) == (stats.ran, True)
    assert outcome.simulations.spent == first.ran
    assert outcome.seconds.spent == first.computed_s
    assert search_outcome(campaign, budget=1).trials == 1


def test_counts_are_brought_up_to_date_record_by_record(campaign, result):
    progress = Progress(campaign.settings, limits=Limits(budget=RECORDS))
    in_a_row = []
    for told, record in enumerate(campaign.records):
        assert progress.told == told
        progress.take(record)
        in_a_row.append(progress.rejected_in_a_row)
    assert progress == result.progress
    assert [number for number, count in enumerate(in_a_row) if count] == [1, 10]
