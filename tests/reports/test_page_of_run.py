"""The page of a single run: a report of one case."""

from __future__ import annotations

import dataclasses
from html.parser import HTMLParser

import pytest

from mrta_falsify.core.fleet import StackEvent
from mrta_falsify.core.verdict import Verdict
from reports import run_report
from reports.contents import RunView
from reports.page import render_page
from reports.run_picture import write_picture
from reports.run_report import event_table, report_of_run, run_headline, task_table
from tests import browser
from tests.reports.newcomer import lines_of


class _Reader(HTMLParser):
    def __init__(self):
        super().__init__()
        self.tags, self.addresses = [], []

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.addresses += [value for name, value in attrs if name in ("src", "href")]


@pytest.fixture
def view(hall, hall_trace):
    evidence = {
        "cycle": [
            {
                "robot": "robot1",
                "cause": "barrier",
                "blocked_by": "robot2",
                "resource": "<script>alert(1)</script>",
            }
        ]
    }
    verdict = Verdict(
        spec="no_deadlock", robustness=-2.0, violated=True, violated_at=3.0,
        who=("robot1", "robot2"), evidence=evidence,
    )  # fmt: skip
    return RunView(world=hall, trace=hall_trace, verdicts=(verdict,), facts=(("ended", "horizon"),))


@pytest.fixture
def page(view, tmp_path):
    def render(view=view):
        picture = tmp_path / "picture.png"
        write_picture(view, picture)
        report = report_of_run(
            view, command="mrta-falsify run x", stack="planner: astar", versions={"numpy": "2"},
            picture=picture,
        )  # fmt: skip
        return render_page(report)

    return render


def _read(text: str) -> _Reader:
    reader = _Reader()
    reader.feed(text)
    return reader


def _text(page: str) -> str:
    return " ".join(lines_of(page))


def test_the_page_needs_no_other_file(page):
    reader = _read(page())
    assert all(address.startswith(("data:", "#")) for address in reader.addresses)
    assert "img" in reader.tags


def test_the_page_tells_what_failed_when_and_who(page):
    text = _text(page())
    for part in (
        "1 of 1 specifications violated: no_deadlock",
        "no_deadlock violated -2 3.00 s robot1, robot2",
        "robot1 and robot2 hold each other up (found at 3.0 s)",
        "suspected layer: controller",
        "Run it again: mrta-falsify run x",
        "ended horizon",
        "planner: astar",
    ):
        assert part in text


def test_the_page_of_a_run_has_a_replay_and_no_empty_part_of_a_campaign(page):
    text = page()
    assert _read(text).tags.count("canvas") == 1
    for absent in ("Failure modes", "The search", "Score of each trial", "Errors of the toolkit"):
        assert absent not in text


def test_a_run_without_violations_shows_its_replay_and_no_failure(page, view):
    safe = Verdict(spec="no_deadlock", robustness=1.0, violated=False)
    text = page(dataclasses.replace(view, verdicts=(safe,)))
    assert "all 1 specifications hold" in _text(text)
    assert "canvas" in _read(text).tags
    assert "found" not in _text(text)


def test_the_page_begins_with_the_verdict_that_explains_the_others(view, tmp_path):
    (deadlock,) = view.verdicts
    late = dataclasses.replace(deadlock, spec="deadlines", evidence={}, who=("task0",))
    safe = Verdict(spec="progress", robustness=1.0, violated=False)
    picture = tmp_path / "picture.png"
    write_picture(view, picture)
    report = report_of_run(
        dataclasses.replace(view, verdicts=(safe, late, deadlock)), command="", stack="",
        versions={}, picture=picture,
    )  # fmt: skip
    assert [v.spec for v in report.run.verdicts] == ["no_deadlock", "deadlines", "progress"]


def test_a_run_that_kept_no_trace_has_a_page_without_replay(page, view):
    bare = dataclasses.replace(view.trace, columns={}, events=(), paths=(), edges=())
    text = page(dataclasses.replace(view, trace=bare, costmap=None))
    assert "canvas" not in _read(text).tags
    assert "The run did not keep its trace" in _text(text)
    assert "Run it again: mrta-falsify run x" in _text(text)


def test_the_page_lists_tasks_with_robot_times_and_state(page):
    text = _text(page())
    assert "0 0 store 1 ward 0 s robot1 0.0 s 10.0 s 100 s in time" in text
    assert "not delivered" in text


def test_events_of_a_long_run_are_those_around_its_first_violation(hall_trace, monkeypatch):
    monkeypatch.setattr(run_report, "MAX_EVENTS", 4)
    events = tuple(StackEvent(time=float(k), kind="replanned", robot=0) for k in range(10))
    trace = dataclasses.replace(hall_trace, events=events)
    times = {
        around: [row[0] for row in event_table(trace, around).rows]
        for around in (0.0, 5.0, float("inf"))
    }
    assert times[0.0] == ["0.00 s", "1.00 s", "2.00 s", "3.00 s"]
    assert times[5.0] == ["3.00 s", "4.00 s", "5.00 s", "6.00 s"]
    assert times[float("inf")] == ["6.00 s", "7.00 s", "8.00 s", "9.00 s"]
    assert event_table(trace, 5.0).title == "Events (3 to 6 s, 4 of 10)"


def test_a_long_table_of_tasks_is_folded(view, monkeypatch):
    assert not task_table(view.world, view.trace).folded
    monkeypatch.setattr(run_report, "MAX_TASKS", 0)
    assert task_table(view.world, view.trace).folded


def test_names_from_a_world_are_escaped(page, view):
    plain = _read(page()).tags.count("script")
    world = dataclasses.replace(view.world, name="<script>alert('world')</script>")
    text = page(dataclasses.replace(view, world=world))
    assert _read(text).tags.count("script") == plain
    assert "<script>alert" not in text
    assert "&lt;script&gt;alert" in text


def test_the_headline_counts_violations(view):
    assert run_headline(view.verdicts) == "1 of 1 specifications violated: no_deadlock"
    safe = Verdict(spec="a", robustness=1.0, violated=False)
    assert run_headline((safe,)) == "all 1 specifications hold"


@pytest.mark.browser
@pytest.mark.parametrize(("width", "mobile"), [(1280, False), (390, True)])
def test_the_page_of_a_run_replays_and_fits_the_screen(page, tmp_path, width, mobile):
    if browser.find() is None:
        pytest.skip("no Chromium on this machine")
    path = tmp_path / "report.html"
    path.write_text(page(), encoding="utf-8")
    with browser.browser() as running:
        running.open_replay(path, width=width, height=800, mobile=mobile)
        running.value("document.querySelector('.replay').focus()")
        running.press("End", "End")
        assert running.value("document.querySelector('.clock').textContent").startswith("10.0 s")
        assert running.value("document.documentElement.scrollWidth") <= width
        assert running.errors == []
