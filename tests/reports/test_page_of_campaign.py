from __future__ import annotations

import dataclasses
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from mrta_falsify.core.findings import Counterfactual
from mrta_falsify.core.geometry import rectangle
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.core.wait_account import WaitsFor
from mrta_falsify.core.world import Furniture
from reports.contents import (
    CaseContents,
    ErrorKind,
    Mode,
    ReportContents,
    TrialRow,
    TrialScores,
    TrialTable,
)
from reports.markdown import render_markdown
from reports.page import render_page
from reports.sentences import violation_sentence, wait_sentence
from tests import browser
from tests.reports.decided import DECIDED


@pytest.fixture(scope="module")
def report(stalled):
    world, judged = stalled
    case = CaseContents(
        id="0007",
        signature="no_deadlock/1:stalled/ward_0",
        world=world,
        trace=judged.outcome.trace,
        verdicts=judged.verdicts,
        facts=(("world digest", world.digest()),),
        commands=(("Run it again", "mrta-falsify replay runs/a 0007 --verify 3"),),
        layer="waypoint_generator",
        identical=(3, 3),
        jittered=(18, 20),
        counterfactuals=(
            Counterfactual(layer="planner", change="planner: ompl", failure_gone=False),
            Counterfactual(
                layer="stack", change="stack: another", failure_gone=False, answered=False
            ),
        ),
        removals=("without robot1 from 12.0 s on, robot2 goes on",),
        needs=("The failure is gone without bed_3.",),
        inevitability=DECIDED,
        decided=("It was decided at 31.4 s, by the queue policy.",),
        repeated="the same run fails again in 3 of 4",
    )
    return ReportContents(
        title="a <b>bold</b> title",
        headline="1 of 40 trials violates a specification, in one mode",
        facts=(("trials", "40"),),
        modes=(Mode(signature=case.signature, ids=("0007", "0012"), cases=(case,)),),
        trials=TrialScores(
            numbers=tuple(range(40)),
            scores=tuple(0.5 - 0.02 * i for i in range(40)),
            failed=tuple(i > 25 for i in range(40)),
            places=np.tile(world.rooms[0].point, (40, 1)),
        ),
        errors=(ErrorKind(reason="worker ended by signal 9", ids=("0003",)),),
        floor=world,
        stack="planner: astar",
        summary=("40 trials of same_room (0.5 h simulated): 14 of 40 ended in a deadlock (35%).",),
        table=TrialTable(
            parameters=("<b>.x",),
            rows=tuple(
                TrialRow(
                    id=f"{i:04d}",
                    outcome="deadlock" if i > 25 else "pass",
                    mode=int(i > 25),
                    found=100.0 - i if i > 25 else None,
                    score=0.5 - 0.02 * i,
                    simulated=60.0,
                    values=(float(i % 7),),
                )
                for i in range(40)
            ),
        ),
    )


class _Reader(HTMLParser):
    def __init__(self):
        super().__init__()
        self.tags, self.addresses, self.text, self._skip = [], [], [], 0

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        self.addresses += [value for name, value in attrs if name in ("src", "href")]
        self._skip += tag in ("script", "style")

    def handle_endtag(self, tag):
        self._skip -= tag in ("script", "style")

    def handle_data(self, data):
        if not self._skip:
            self.text.append(data)


@pytest.fixture(scope="module")
def page(report):
    reader = _Reader()
    reader.feed(render_page(report))
    return reader


def test_the_page_asks_for_nothing_outside_itself(page):
    assert all(a.startswith(("data:", "#")) for a in page.addresses)
    policy = [a["content"] for tag, a in page.tags if tag == "meta" and "http-equiv" in a]
    assert policy[0].startswith("default-src 'none'")


def test_text_from_names_is_escaped(page):
    assert ("b", {}) not in page.tags
    assert "a <b>bold</b> title" in "".join(page.text)


def test_the_page_says_who_holds_up_whom(page):
    assert "without robot1 from 12.0 s on, robot2 goes on" in " ".join(page.text)


def test_the_page_says_and_draws_when_the_failure_was_decided(page):
    text = " ".join(page.text)
    assert "It was decided at 31.4 s, by the queue policy." in text
    assert "decided at 31.4 s" in text.split("What makes the failure go away")[0]
    assert "wide chances" in [attrs.get("class") for _, attrs in page.tags]


def test_page_and_markdown_say_what_the_failure_needs_and_how_often_it_comes_again(report, page):
    text = " ".join(page.text)
    assert "The failure is gone without bed_3." in text
    assert "the same run fails again in 3 of 4" in text
    assert "no answer" in text
    markdown = render_markdown(report)
    assert "- The failure is gone without bed_3." in markdown
    assert "The same run fails again in 3 of 4." in markdown


def test_five_questions_of_a_newcomer_are_answered_by_the_text_alone(page):
    """What happened, to whom, when and where, why, whose fault; and how to see it again."""
    text = " ".join("".join(page.text).split())
    assert "robot1 is stuck" in text  # what, who
    assert "(found at " in text
    assert " s); it has made no progress since " in text  # when
    assert "ward_0 (x " in text  # where
    assert "robot1 has a goal and nothing in its way, but does not drive." in text  # why
    assert "suspected layer: waypoint_generator" in text  # whose fault
    assert "mrta-falsify replay runs/a 0007 --verify 3" in text  # see it again
    assert "replay: 3 of 3 identical" in text  # believe it
    assert "worker ended by signal 9" in text  # errors are apart


def test_a_campaign_without_failures_says_so_and_carries_no_replay(report):
    empty = dataclasses.replace(report, modes=(), headline="None of 40 trials ...")
    reader = _Reader()
    reader.feed(render_page(empty))
    assert "No violation was found. That is not a proof" in "".join(reader.text)
    assert "canvas" not in [tag for tag, _ in reader.tags]
    assert "class Replay" not in render_page(empty)


def test_a_mode_shows_one_case_and_folds_the_others(report):
    (mode,) = report.modes
    (case,) = mode.cases
    second = dataclasses.replace(case, id="0012")
    two = dataclasses.replace(mode, cases=(case, second))
    page = render_page(dataclasses.replace(report, modes=(two,)))
    open_part, _, folded = page.partition("1 further trial fails in the same way")
    assert 'aria-labelledby="trial-0007"' in open_part
    assert 'aria-labelledby="trial-0012"' not in open_part
    assert 'aria-labelledby="trial-0012"' in folded
    assert '<use href="#moment-0007"/>' in open_part  # its thumbnail
    assert 'id="moment-0007"' in open_part


@pytest.mark.parametrize(
    ("cause", "expected"),
    [
        ("queue", "robot1 waits for ward_2: robot2 holds it or is ahead in the queue."),
        ("barrier", "robot1 cannot drive on because robot2 stands in its path."),
        ("no-path", "robot1 has a goal but no path to it; robot2 cuts it off."),
    ],
)
def test_edges_are_told_in_words(cause, expected):
    wait = WaitsFor("robot1", cause, blocked_by="robot2", resource="ward_2")
    assert wait_sentence(wait) == expected


def test_a_verdict_is_told_with_time_and_names():
    verdict = Verdict(
        spec="no_robot_robot_contact", robustness=-0.01, violated=True, violated_at=12.34,
        who=("robot1", "robot3"),
    )  # fmt: skip
    assert violation_sentence(verdict) == "Two robots touched at 12.3 s: robot1 and robot3."


def test_a_place_without_a_name_is_told_by_its_coordinates():
    place = {"near": "", "distance": 3.0, "x": 1.0, "y": -2.0}
    verdict = Verdict(
        spec="progress", robustness=-1.0, violated=True, who=("robot1",), evidence={"place": place}
    )
    assert violation_sentence(verdict).endswith("robot1 at x 1.0 m, y -2.0 m.")


@pytest.fixture(scope="module")
def open_page(report, tmp_path_factory):
    if browser.find() is None:
        pytest.skip("no Chromium on this machine")
    path = tmp_path_factory.mktemp("page") / "report.html"
    path.write_text(render_page(report), encoding="utf-8")
    with browser.browser() as running:
        yield running, path


@pytest.mark.browser
def test_the_replay_plays_scrubs_and_answers_keys_without_a_request(open_page):
    running, path = open_page
    running.requests.clear()
    running.errors.clear()
    running.open_replay(path)
    clock = "document.querySelector('.clock').textContent"
    time = "document.querySelector('.replay').replay.time"

    began = running.value(time)
    running.click(".play")
    running.wait(f"{time} > {began} + 1")
    running.click(".play")
    stopped = running.value(time)
    assert running.value(clock).startswith(f"{stopped:.1f} s of ")

    running.value(
        "(() => { const s = document.querySelector('.replay input[type=range]'); s.value = 5; "
        "s.dispatchEvent(new Event('input')); })()"
    )
    assert running.value(clock).startswith("5.0 s of ")

    running.value("document.querySelector('.replay').focus()")
    running.press("ArrowRight", "ArrowRight")
    assert running.value(time) == pytest.approx(6.0)
    running.press("Home", "Home")
    assert running.value(time) == 0.0
    assert "robot1: " in running.value("document.querySelector('.now').textContent")

    own = [address for address in running.requests if address.startswith("file:")]
    assert own == [path.resolve().as_uri()]
    others = [a for a in running.requests if not a.startswith(("file:", "data:", "about:"))]
    assert others == []
    assert running.errors == []


@pytest.mark.browser
def test_a_click_in_the_timelines_jumps_there_and_a_line_shows_the_time(open_page):
    running, path = open_page
    running.open_replay(path)
    running.click(".timelines svg")  # in its middle
    svg, replay = "document.querySelector('.timelines svg')", "document.querySelector('.replay')"
    left, width, end = (
        running.value(f"Number({svg}.dataset.{name})") for name in ("left", "width", "end")
    )
    middle = running.value(f"{svg}.viewBox.baseVal.width") / 2.0
    time = running.value(f"{replay}.replay.time")
    assert time == pytest.approx((middle - left) / width * end, abs=0.1)
    assert running.value(f"Number({svg}.querySelector('.cursor').getAttribute('x1'))") == (
        pytest.approx(middle, abs=1.0)
    )


@pytest.mark.browser
def test_the_table_of_trials_sorts_and_filters(open_page):
    running, path = open_page
    running.errors.clear()
    running.open(path)
    running.value("document.querySelector('.trials').scrollIntoView()")
    running.wait("document.querySelector('.trials').table !== undefined")
    first = "document.querySelector('.trials tbody td').textContent"
    assert running.value(first) == "0000"
    assert running.value("document.querySelectorAll('.trials th')[6].textContent") == "<b>.x"
    running.click(".trials th:nth-child(4) button")  # found, empty ones last
    assert running.value(first) == "0039"
    running.click(".trials th:nth-child(4) button")
    sort = "document.querySelector('.trials th:nth-child(4)').getAttribute('aria-sort')"
    assert running.value(sort) == "descending"
    running.value(
        "(() => { const f = document.querySelector('.trials input'); "
        "f.value = 'deadlock found<65'; f.dispatchEvent(new Event('input')); })()"
    )
    assert running.value("document.querySelectorAll('.trials tbody tr').length") == 4
    assert running.value("document.querySelector('.trials output').textContent") == (
        "4 of 40 trials"
    )
    assert running.errors == []


@pytest.mark.browser
def test_a_link_opens_the_folded_part_it_points_to(report, tmp_path):
    if browser.find() is None:
        pytest.skip("no Chromium on this machine")
    (mode,) = report.modes
    (case,) = mode.cases
    two = dataclasses.replace(mode, cases=(case, dataclasses.replace(case, id="0012")))
    path = tmp_path / "report.html"
    path.write_text(render_page(dataclasses.replace(report, modes=(two,))), encoding="utf-8")
    with browser.browser() as running:
        running.open(path)
        running.value("location.hash = '#trial-0012'")
        running.wait("document.getElementById('trial-0012').closest('details').open")
        running.wait("document.querySelectorAll('.replay')[1].dataset.state === 'ready'")


@pytest.mark.browser
def test_the_page_can_be_switched_to_dark_and_back(open_page):
    running, path = open_page
    running.open(path)
    back = "getComputedStyle(document.body).backgroundColor"
    light = running.value(back)
    running.click("#theme")
    assert running.value(back) != light
    running.click("#theme")
    assert running.value(back) == light


@pytest.mark.browser
def test_a_command_is_copied_by_its_button(open_page):
    running, path = open_page
    running.open(path)
    running.value("Page.copy = async (text) => { window.copied = text; }")
    running.click(".copy")
    assert running.value("window.copied") == "mrta-falsify replay runs/a 0007 --verify 3"
    running.wait("document.querySelector('.copy').textContent === 'Copied'")


@pytest.mark.browser
def test_the_printed_page_has_its_pictures_and_opens_what_is_folded(open_page):
    running, path = open_page
    running.open(path)
    folded = "document.querySelectorAll('details:not([open])').length"
    before = running.value(folded)
    assert before > 0
    running.value("dispatchEvent(new Event('beforeprint'))")
    assert running.value(folded) == 0
    running.value("dispatchEvent(new Event('afterprint'))")
    assert running.value(folded) == before
    running.send("Emulation.setEmulatedMedia", media="print")
    shown = "getComputedStyle(document.querySelector('%s')).display !== 'none'"
    assert not running.value(shown % ".replay")
    assert running.value(shown % ".pair svg")
    running.send("Emulation.setEmulatedMedia", media="")


@pytest.mark.browser
@pytest.mark.parametrize(("width", "mobile"), [(1280, False), (390, True)])
def test_the_canvas_shows_the_floor_and_the_page_does_not_scroll_sideways(open_page, width, mobile):
    running, path = open_page
    running.open_replay(path, width=width, height=800, mobile=mobile)
    colours = running.value(
        "(() => { const c = document.querySelector('canvas'); "
        "const d = c.getContext('2d').getImageData(0, 0, c.width, c.height).data; "
        "const seen = new Set(); for (let i = 0; i < d.length; i += 4) "
        "seen.add(`${d[i]},${d[i + 1]},${d[i + 2]},${d[i + 3]}`); return seen.size; })()"
    )
    assert colours > 5
    assert running.value("document.documentElement.scrollWidth") <= width
    assert Path(path).is_file()


#: mean column of the furniture's pixels at a time
FURNITURE_AT = """(() => {
  const replay = document.querySelector('.replay').replay, canvas = replay.canvas;
  replay.view = replay.whole();
  replay.seek(%s);
  const { data } = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height);
  const text = getComputedStyle(replay.root).getPropertyValue('--furniture').trim();
  const [r, g, b] = [1, 3, 5].map((k) => parseInt(text.slice(k, k + 2), 16));
  let sum = 0, count = 0;
  for (let i = 0; i < data.length; i += 4)
    if (data[i] === r && data[i + 1] === g && data[i + 2] === b) {
      sum += (i / 4) %% canvas.width; count++;
    }
  return count ? sum / count : -1;
})()"""


@pytest.mark.browser
def test_the_replay_moves_pushed_furniture(report, tmp_path):
    if browser.find() is None:
        pytest.skip("no Chromium on this machine")
    (mode,) = report.modes
    (case,) = mode.cases
    x, y = case.world.rooms[0].point
    cart = Furniture(name="cart", kind="cart", polygon=rectangle(1.5, 1.5, (x, y)), movable=True)
    pose = np.tile([x, y, 0.0], (len(case.trace), 1, 1))
    pose[:, 0, 0] += np.linspace(0.0, 4.0, len(pose))
    columns = {**case.trace.columns, "furniture_pose": pose}
    pushed = dataclasses.replace(
        case,
        world=dataclasses.replace(case.world, furniture=(cart,)),
        trace=dataclasses.replace(case.trace, columns=columns),
    )
    path = tmp_path / "pushed.html"
    modes = (dataclasses.replace(mode, cases=(pushed,)),)
    path.write_text(render_page(dataclasses.replace(report, modes=modes)), encoding="utf-8")
    with browser.browser() as running:
        running.open_replay(path)
        first, last = (running.value(FURNITURE_AT % time) for time in ("0", "1e9"))
    assert 0.0 < first < last - 50.0


@pytest.mark.browser
@pytest.mark.parametrize("width", [1280, 390])
def test_the_replays_of_two_stacks_stand_side_by_side_and_move_together(report, tmp_path, width):
    if browser.find() is None:
        pytest.skip("no Chromium on this machine")
    (mode,) = report.modes
    (case,) = mode.cases
    theirs = dataclasses.replace(case, id="0007, the other stack", verdicts=(), minimised=None)
    both = dataclasses.replace(case, other=theirs, compared=("the other stack passes",))
    mode = dataclasses.replace(mode, cases=(both,))
    path = tmp_path / "report.html"
    path.write_text(render_page(dataclasses.replace(report, modes=(mode,))), encoding="utf-8")
    with browser.browser() as running:
        running.open_replay(path, width=width, mobile=width < 500)
        running.value("document.querySelectorAll('.side')[1].scrollIntoView()")
        running.wait("document.querySelectorAll('.sides .replay[data-state=ready]').length === 2")
        tops = running.value(
            "[...document.querySelectorAll('.side')].map((e) => e.getBoundingClientRect().top)"
        )
        assert (tops[0] == tops[1]) == (width == 1280)
        assert running.value("document.documentElement.scrollWidth") <= width
        for moved, other in ((0, 1), (1, 0)):
            replays = "[...document.querySelectorAll('.sides .replay')]"
            running.value(f"{replays}[{moved}].replay.seek({3 + moved})")
            assert running.value(f"{replays}[{other}].replay.time") == 3 + moved
            marks = "[...document.querySelectorAll('.sides .cursor')].map((e) => e.attributes.x1)"
            assert len(running.value(f"{marks}.map((a) => a.value)")) == 2
        assert running.errors == []
