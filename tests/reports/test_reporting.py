"""Reports of campaigns that are not as one would wish them: the bad-input list of reports."""

from __future__ import annotations

import dataclasses
import json
import os
import re
import shutil
from html.parser import HTMLParser
from urllib.parse import unquote
from xml.etree import ElementTree

import pytest
from click.testing import CliRunner

from mrta_falsify.campaigns.store import SETTINGS, Campaign, Store
from mrta_falsify.cli import main
from mrta_falsify.commands import report as reporting
from mrta_falsify.commands.report import build
from mrta_falsify.commands.stored_trials import open_campaign
from mrta_falsify.core import codec
from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.core.record import TrialRecord
from mrta_falsify.core.run_result import RunResult
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.testing.records import changed
from mrta_falsify.trial import Job, on_kinematic_engine
from reports.page import draw_page, render_page
from tests import browser
from tests.reports.newcomer import lines_of
from tests.reports.planted import stored

SPEC = "no_deadlock"
EVIL = "<img src=x onerror=alert(1)>&\"'`|*"


@pytest.fixture
def campaign(stalled, tmp_path):
    """A campaign directory with one failure."""
    world, judged = stalled
    config = on_kinematic_engine(StackConfig(defects=("same_room_twice_stalls",)))
    job = Job(world=world, config=config, early_stop=True, specifications=(SPEC,))
    return stored(tmp_path / "campaign", job, judged)


def report(*args):
    return CliRunner().invoke(main, ["report", *map(str, args)])


def text_of(campaign):
    return "\n".join(lines_of((campaign.directory / "report.html").read_text()))


def passing(campaign, number):
    """A record of a trial that holds."""
    (record,) = campaign.records
    return changed(
        record,
        candidate=dataclasses.replace(record.candidate, number=number),
        verdicts=(Verdict(spec=SPEC, robustness=0.4, violated=False),),
        score=0.4,
        signature="",
        layer="",
        trace_file="",
        world=f"{number:064d}",
    )


def with_records(campaign, directory, *records, stack=None):
    """A new campaign with the settings of another one."""
    settings = campaign.settings
    if stack is not None:
        trials = dataclasses.replace(settings.trials, stack=stack)
        settings = dataclasses.replace(settings, trials=trials)
    with Store.create(directory, settings) as store:
        for record in records:
            store.add(record)
    return open_campaign(directory)


def test_a_campaign_that_still_runs_is_reported_and_says_so(campaign):
    with Store.resume(campaign.directory):
        assert report(campaign.directory).exit_code == 0
    running = text_of(campaign)
    assert "The campaign was still running when this page was written (process " in running
    assert "it shows the 1 trials finished by then" in running
    assert report(campaign.directory).exit_code == 0
    assert "still running" not in text_of(campaign)


def test_an_empty_campaign_has_a_report(campaign, tmp_path):
    empty = with_records(campaign, tmp_path / "empty")
    result = report(empty.directory, "--markdown", tmp_path / "r.md", "--junit", tmp_path / "j.xml")
    assert result.exit_code == 0, result.stderr
    assert "No trial has been run yet" in text_of(empty)
    assert "No trial has been run yet" in (tmp_path / "r.md").read_text()
    assert ElementTree.parse(tmp_path / "j.xml").getroot().get("tests") == "0"


def test_the_probability_of_an_empty_campaign_is_unknown(campaign, tmp_path):
    settings = dataclasses.replace(
        campaign.settings,
        trials=dataclasses.replace(campaign.settings.trials, mode="exact"),
        sampler=Choice("random"),
    )
    with Store.create(tmp_path / "empty", settings) as store:
        empty = store.campaign()
    assert report(empty.directory).exit_code == 0
    assert "Probability of a violation: unknown, too few runs for a 95% interval" in text_of(empty)


def test_a_campaign_without_failures_claims_no_more_than_that(campaign, tmp_path):
    fine = with_records(campaign, tmp_path / "fine", passing(campaign, 0), passing(campaign, 1))
    assert report(fine.directory).exit_code == 0
    text = text_of(fine)
    assert "None of 2 trials violates a specification" in text
    assert "That is not a proof that there is none" in text


def test_a_campaign_of_rejected_scenes_and_errors_says_that_nothing_was_judged(campaign, tmp_path):
    (record,) = campaign.records
    rows = [
        TrialRecord(
            candidate=dataclasses.replace(record.candidate, number=number),
            result=RunResult(status=status) if status else None,
            error=f"Traceback\n\x1b[31mworker {number} ended by signal 9\x1b[0m",
        )
        for number, status in enumerate(("", "error", "timeout"))
    ]
    broken = with_records(campaign, tmp_path / "broken", *rows)
    result = report(broken.directory, "--junit", tmp_path / "j.xml")
    assert result.exit_code == 0, result.stderr
    assert "No trial has been judged" in text_of(broken)
    suite = ElementTree.parse(tmp_path / "j.xml").getroot()  # colours of a terminal are no XML
    assert (suite.get("tests"), suite.get("failures"), suite.get("errors")) == ("2", "0", "2")
    assert [e.get("type") for e in suite.iter("error")] == ["crashed", "timeout"]


@pytest.mark.parametrize("damage", ["missing", "cut off", "no world"])
def test_a_failure_without_its_files_is_told_with_a_way_to_run_it_again(campaign, damage):
    folder = campaign.directory / "trials" / "0000"
    if damage == "missing":
        (folder / "trace.zip").unlink()
    elif damage == "cut off":
        (folder / "trace.zip").write_bytes((folder / "trace.zip").read_bytes()[:2000])
    else:
        (folder / "world.json").write_text('{"name": "half a wor')
    assert report(campaign.directory, "--markdown", campaign.directory / "r.md").exit_code == 0
    text = text_of(campaign)
    assert "robot1 is stuck" in text  # from the record
    assert "Trial 0000 is not shown in full: " in text
    assert f"mrta-falsify replay {campaign.directory} 0000" in text
    assert "robot1 is stuck" in (campaign.directory / "r.md").read_text()


@pytest.mark.parametrize("name", ["explain.json", "minimize.json", "verify.json"])
def test_a_damaged_finding_costs_its_case_and_not_the_report(campaign, name):
    (campaign.directory / "trials" / "0000" / name).write_text('{"layer": "planner"}')
    (campaign.directory / "trials" / "0000" / "world.min.json").write_text("{}")
    result = report(campaign.directory)
    assert result.exit_code == 0, result.stderr
    assert "is not shown in full" in text_of(campaign)
    assert f"trials/0000/{name}" in text_of(campaign)


def test_a_trace_of_another_world_costs_its_case_and_not_the_report(campaign):
    path = campaign.directory / "trials" / "0000" / "world.json"
    path.write_text(path.read_text().replace('"robot1"', '"robot9"'))
    assert report(campaign.directory).exit_code == 0
    assert "trace.zip: has robots robot1; world.json has robot9" in text_of(campaign)


def test_a_campaign_of_another_version_is_refused_in_words(campaign):
    path = campaign.directory / SETTINGS
    data = json.loads(path.read_text())
    path.write_text(json.dumps({**data, "version": 999}))
    result = report(campaign.directory)
    assert result.exit_code == 2
    assert "has format version 999; this reads" in " ".join(result.stderr.split())


def test_trials_of_different_versions_are_pointed_out(campaign, tmp_path):
    (record,) = campaign.records
    versions = {**record.origin.versions, "numpy": "0.0.1"}
    other = changed(passing(campaign, 1), versions=versions)
    mixed = with_records(campaign, tmp_path / "mixed", record, other)
    assert report(mixed.directory).exit_code == 0
    assert "Trials were run by different versions of numpy" in text_of(mixed)


class _Tags(HTMLParser):
    def __init__(self):
        super().__init__()
        self.tags: list[str] = []
        self.attributes: set[str] = set()

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.attributes |= {name for name, _ in attrs}


@pytest.fixture
def evil(stalled, tmp_path):
    """A campaign in which all that a user names is HTML, XML and Markdown."""
    world, judged = stalled
    trace = judged.outcome.trace
    named = dataclasses.replace(
        world,
        name=EVIL,
        robots=tuple(dataclasses.replace(robot, name=EVIL) for robot in world.robots),
        rooms=tuple(
            dataclasses.replace(room, name=f"{EVIL}{i}") for i, room in enumerate(world.rooms)
        ),
    )
    text = json.dumps([codec.encode(verdict) for verdict in judged.verdicts])
    verdicts = json.loads(text.replace("robot1", json.dumps(EVIL)[1:-1]))
    outcome = dataclasses.replace(
        judged.outcome, trace=dataclasses.replace(trace, robots=(EVIL,) * len(trace.robots))
    )
    renamed = dataclasses.replace(
        judged, outcome=outcome, verdicts=tuple(codec.decode(Verdict, v) for v in verdicts)
    )
    config = on_kinematic_engine(StackConfig(defects=("same_room_twice_stalls",)))
    job = Job(world=named, config=config, specifications=(SPEC,))
    campaign = stored(tmp_path / "evil", job, renamed)
    (record,) = campaign.records
    record = changed(record, signature=f"{SPEC}/{EVIL}")
    crashed = TrialRecord(
        candidate=dataclasses.replace(record.candidate, number=1),
        result=RunResult(status="error"),
        error=EVIL,
    )
    return dataclasses.replace(campaign, records=(record, crashed))


def test_html_in_names_stays_text_in_every_form(evil, campaign):
    page = render_page(reporting.build_report(evil))
    plain = render_page(reporting.build_report(campaign))
    ours, theirs = _Tags(), _Tags()
    ours.feed(plain)
    theirs.feed(page)
    extra = ["article", "details", "summary", "section", "h2", "p", "pre", "a"]  # of the error
    assert set(theirs.tags) <= {*ours.tags, *extra}
    assert "onerror" not in theirs.attributes
    assert EVIL in "\n".join(lines_of(page))
    told = reporting.markdown_report(evil)
    assert "<img" not in re.sub(r"(`+).*?\1", "", told)
    failure = ElementTree.fromstring(reporting.junit_report(evil)).find("testcase/failure")
    assert EVIL in failure.get("message")
    assert failure.get("type") == f"{SPEC}/{EVIL}"


@pytest.mark.browser
def test_html_in_names_runs_nothing_in_a_browser(evil, tmp_path):
    if browser.find() is None:
        pytest.skip("no Chromium on this machine")
    path = reporting.write_report(evil, tmp_path / "evil.html")
    with browser.browser() as running:
        running.open(path)
        running.value("window.alert = () => { window.caught = true; }")
        running.value("document.querySelector('.replay').scrollIntoView()")
        running.wait("document.querySelector('.replay').dataset.state === 'ready'")
        assert running.value("document.querySelectorAll('img:not(.costmap)').length") == 0
        assert running.value("window.caught === undefined")
        assert EVIL in running.value("document.querySelector('.now').textContent")
        assert running.errors == []


def test_ten_thousand_trials_make_a_page_of_a_few_megabytes(campaign):
    (record,) = campaign.records
    records = []
    for number in range(10_000):
        row = changed(
            record if number % 3 == 0 else passing(campaign, number),
            candidate=dataclasses.replace(record.candidate, number=number),
            descriptors={"x": number % 97 / 97, "y": number % 89 / 89},
        )
        if number % 3 == 0:  # in 700 modes, each with a run of its own to show
            row = changed(row, signature=f"{record.signature}/{number % 2100}")
        if number % 100 == 1:
            row = changed(
                row, status="error", verdicts=(), error=f"Traceback\nerror {number % 300}"
            )
        records.append(row)
    many = _ManyFolders(
        directory=campaign.directory, settings=campaign.settings, records=tuple(records)
    )
    page = render_page(reporting.build_report(many))
    assert len(page) < 5_000_000
    lines = lines_of(page)
    # errors are not judged
    headline = "3301 of 9900 trials violate a specification, in 693 modes: "
    assert any(line.startswith(headline) for line in lines)
    assert "673 further modes without a replay here" in lines
    assert "173 more are left out; the command list has all." in lines
    assert sum(line.startswith("Trial ") and len(line) < 12 for line in lines) == 20
    assert any(re.match(r"\d+ trials: error 1$", line) for line in lines)


def test_cases_behind_the_first_ones_are_pages_beside_the_page(campaign, tmp_path, monkeypatch):
    (record,) = campaign.records
    rows = [
        dataclasses.replace(record, candidate=dataclasses.replace(record.candidate, number=i))
        for i in range(4)
    ]
    many = _ManyFolders(
        directory=campaign.directory, settings=campaign.settings, records=tuple(rows)
    )
    monkeypatch.setattr(build, "PAGE_CASES", 1)
    page = reporting.write_report(many, tmp_path / "a page.html", cases=3)
    links = re.findall(r'href="(a%20page[^"]+)"', page.read_text())
    assert links == [f"a%20page.cases/trial-000{i}.html" for i in (1, 2)]
    assert page.read_text().count("<article ") == 1
    assert "Without a replay here: 0003." in " ".join(lines_of(page.read_text()))
    for link in links:
        case = page.parent / unquote(link)
        text = case.read_text()
        assert text.count("<article ") == 1
        assert 'href="../a%20page.html"' in text
        assert not re.findall(r'(?:href|src)="https?:', text)


def test_a_watch_writes_a_case_again_only_if_files_of_its_trial_have_changed(
    campaign, tmp_path, monkeypatch
):
    own = dataclasses.replace(campaign, directory=tmp_path / "c")
    shutil.copytree(campaign.directory, own.directory)
    monkeypatch.setattr(build, "PAGE_CASES", 0)
    page, pages = tmp_path / "page.html", build.CasePages()
    reporting.write_report(own, page, pages=pages)
    case = tmp_path / "page.cases" / "trial-0000.html"
    text = case.read_text()
    assert text.count("<article ") == 1

    case.write_text("as before")
    reporting.write_report(own, page, pages=pages)
    assert case.read_text() == "as before"
    reporting.write_report(own, page)  # without a watch
    assert case.read_text() == text

    case.write_text("as before")
    os.utime(own.directory / "trials" / "0000" / "world.json", (1, 1))
    reporting.write_report(own, page, pages=pages)
    assert case.read_text() == text
    case.unlink()
    reporting.write_report(own, page, pages=pages)
    assert case.read_text() == text


class _ManyFolders(Campaign):
    """A campaign whose trials all have the files of the first one."""

    def folder(self, record):
        return self.directory / "trials" / "0000"


def test_two_stacks_are_compared_by_mode_and_world_by_world(campaign, tmp_path):
    (record,) = campaign.records
    fine = passing(campaign, 1)
    one = with_records(campaign, tmp_path / "one", record, fine)
    cured = changed(passing(campaign, 0), world=record.world_digest)
    other_stack = dataclasses.replace(campaign.settings.trials.stack, planner=Choice("ompl"))
    two = with_records(campaign, tmp_path / "two", cured, fine, stack=other_stack)
    result = report(one.directory, "--against", two.directory, "--markdown", tmp_path / "r.md")
    assert result.exit_code == 0, result.stderr
    text = text_of(one)
    assert "The stacks differ in planner: astar against ompl." in text
    assert (
        f"Of 2 worlds that both have run, 0 fail in both, 1 only in {one.directory}, 0 only in "
        f"{two.directory}, 1 in neither."
    ) in text
    assert "0000: passes" in text
    told = (tmp_path / "r.md").read_text()
    assert "The stacks differ in planner: astar against ompl." in told
    assert "| 0000: passes |" in told


def test_campaigns_on_other_scenarios_are_compared_with_a_warning(campaign, tmp_path):
    settings = campaign.settings
    trials = dataclasses.replace(settings.trials, scenario="elsewhere", params={"n": 3})
    with Store.create(tmp_path / "other", dataclasses.replace(settings, trials=trials)) as store:
        store.add(passing(campaign, 5))
    assert report(campaign.directory, "--against", tmp_path / "other").exit_code == 0
    text = text_of(campaign)
    assert "Not only the stack differs, also: scenario, parameters." in text
    assert "No world was run under both" in text


def test_what_against_names_must_be_a_campaign(campaign, tmp_path):
    result = report(campaign.directory, "--against", tmp_path)
    assert result.exit_code == 2
    assert "is not a campaign directory" in " ".join(result.stderr.split())


def test_cases_for_which_there_is_no_room_are_only_counted(campaign, tmp_path):
    (record,) = campaign.records
    rows = [
        dataclasses.replace(record, candidate=dataclasses.replace(record.candidate, number=i))
        for i in range(4)
    ]
    many = _ManyFolders(
        directory=campaign.directory, settings=campaign.settings, records=tuple(rows)
    )
    found = reporting.build_report(many)
    whole = render_page(found)
    assert whole.count("<article ") == 4
    room = [len(whole) // part for part in (1, 2, 4, 8, 16)]
    shown = [
        render_page(found, drawn=draw_page(found, most_bytes=most)).count("<article ")
        for most in room
    ]
    assert shown == sorted(shown, reverse=True)
    assert any(1 < count < 4 for count in shown)
    least = " ".join(lines_of(render_page(found, drawn=draw_page(found, most_bytes=1))))
    assert "Without a replay here: 0001, 0002, 0003." in least
