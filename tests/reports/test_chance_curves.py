"""The drawing of the chance of failure over time, below the timelines."""

from __future__ import annotations

import xml.etree.ElementTree as ET

import pytest

from mrta_falsify.core.inevitability import Inevitability
from reports.timelines import NAMES, ROWS_WIDTH, draw_chances
from tests.reports.decided import DECIDED, NAME

END = 50.0  # s


@pytest.fixture(scope="module")
def drawing():
    return ET.fromstring(draw_chances(DECIDED, END))


def _numbers(text):
    return [tuple(map(float, pair.split(","))) for pair in text.split()]


def _all(drawing, tag):
    return [part for part in drawing.iter() if part.tag.endswith(tag)]


def test_the_moment_of_decision_is_marked_on_the_scale_of_the_timelines(drawing):
    (mark,) = [p for p in _all(drawing, "polyline") if p.get("stroke-dasharray")]
    assert _numbers(mark.get("points"))[0][0] == pytest.approx(
        NAMES + ROWS_WIDTH * 31.4 / END, abs=0.06
    )
    assert "decided at 31.4 s" in [text.text for text in _all(drawing, "text")]


def test_every_time_has_a_point_and_every_curve_its_band_and_its_name(drawing):
    assert len(_all(drawing, "circle")) == 5
    assert len(_all(drawing, "polygon")) == 2
    names = [text.text for text in _all(drawing, "text")]
    assert "the stack as it is" in names
    assert NAME in names


def test_a_curve_rises_to_the_violation_and_lies_within_its_band(drawing):
    lines = [p for p in _all(drawing, "polyline") if p.get("stroke-width") == "1.6"]
    for line, band in zip(lines, _all(drawing, "polygon"), strict=True):
        points, edges = _numbers(line.get("points")), _numbers(band.get("points"))
        heights = [y for _, y in points]
        assert heights == sorted(heights, reverse=True)
        assert points[-1][0] == pytest.approx(NAMES + ROWS_WIDTH * 40.0 / END, abs=0.06)
        for x, y in points:
            beside = [edge for across, edge in edges if across == x]
            assert min(beside) <= y <= max(beside)


def test_a_failure_that_could_not_be_rewound_has_no_mark():
    empty = Inevitability(onset=1.0, found=2.0, curves=(), decided_at=None, runs=0)
    assert "decided" not in draw_chances(empty, END)
