from __future__ import annotations

import dataclasses
from html.parser import HTMLParser

import pytest

from mrta_falsify.core.config import StackConfig
from mrta_falsify.core.verdict import Verdict
from reports.figures import write_picture
from reports.page import headline, write_page
from reports.run_view import RunView


class _Reader(HTMLParser):
    def __init__(self):
        super().__init__()
        self.tags, self.addresses, self.text = [], [], []

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.addresses += [value for name, value in attrs if name in ("src", "href")]

    def handle_data(self, data):
        self.text.append(data)


@pytest.fixture
def view(hall, hall_trace):
    evidence = {"cycle": ["robot1", "<script>alert(1)</script>"]}
    verdict = Verdict(
        spec="no_deadlock", robustness=-2.0, violated=True, violated_at=3.0,
        who=("robot1", "robot2"), evidence=evidence,
    )  # fmt: skip
    return RunView(world=hall, trace=hall_trace, verdicts=(verdict,), facts=(("ended", "horizon"),))


@pytest.fixture
def page(view, tmp_path):
    def write(view=view):
        picture = tmp_path / "picture.png"
        write_picture(view, picture)
        write_page(
            view, tmp_path / "report.html", picture=picture, command="mrta-falsify run x",
            config=StackConfig(), versions={"numpy": "2"},
        )  # fmt: skip
        return (tmp_path / "report.html").read_text()

    return write


def _read(text: str) -> _Reader:
    reader = _Reader()
    reader.feed(text)
    return reader


def test_the_page_needs_no_other_file_and_runs_no_script(page):
    reader = _read(page())
    assert all(address.startswith("data:image/") for address in reader.addresses)
    assert "script" not in reader.tags
    assert "link" not in reader.tags


def test_the_page_tells_what_failed_when_and_who(page):
    text = " ".join(_read(page()).text)
    for part in ("no_deadlock", "violated", "3.00 s", "robot1, robot2", "mrta-falsify run x"):
        assert part in text


def test_the_page_lists_tasks_with_robot_times_and_state(page):
    text = " ".join(" ".join(_read(page()).text).split())
    assert "0 0 store 1 ward 0 s robot1 0.0 s 10.0 s 100 s in time" in text
    assert "not delivered" in text


def test_names_from_a_world_are_escaped(page, view):
    world = dataclasses.replace(view.world, name="<script>alert('world')</script>")
    text = page(dataclasses.replace(view, world=world))
    assert "<script" not in text
    assert "&lt;script&gt;alert" in text


def test_the_headline_counts_violations(view):
    assert headline(view) == "1 of 1 specifications violated: no_deadlock"
    safe = Verdict(spec="a", robustness=1.0, violated=False)
    assert headline(dataclasses.replace(view, verdicts=(safe,))) == "all 1 specifications hold"
