"""Drawings of which parameters failing goes with: shares with intervals, and slices."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from markupsafe import Markup

from mrta_falsify.core.words import number_text
from reports.contents import ParameterImportance, TrialScores
from reports.svg import Drawing, ticks

MAX_BARS = 10  # parameters
NAMES, BARS, NUMBERS = 210.0, 430.0, 110.0  # px: names, bars, figures beside them
ROW, FOOT = 24.0, 26.0  # px
SLICE_WIDTH, SLICE_HEIGHT = 320.0, 130.0  # px of the points of one slice
LEFT, TOP, RIGHT, STRIP = 40.0, 8.0, 14.0, 18.0  # px around them; the strip of shares below
MAX_LETTERS = 32  # of a name
MAX_OF_OPTION = 8  # letters of an option below the axis
ROOM_FOR_SHARE = 28.0  # px
CROSS = 3.0  # px, half of the mark of a failure


def draw_importances(found: Sequence[ParameterImportance]) -> Markup:
    """Draw the share of variance that each parameter explains, with its interval."""
    shown = found[:MAX_BARS]
    drawing = Drawing(
        NAMES + BARS + NUMBERS,
        ROW * len(shown) + FOOT,
        label="how much of the variance of failing each parameter explains, with intervals",
    )
    base = ROW * len(shown)
    for value in (0.0, 0.25, 0.5, 0.75, 1.0):
        x = NAMES + BARS * value
        drawing.line([(x, 0), (x, base)], stroke="var(--line)")
        drawing.add("text", f"{value:.0%}", x=x, y=base + 16, class_="tick", text_anchor="middle")
    for number, one in enumerate(shown):
        share, low, high = (NAMES + BARS * v for v in (one.share, one.low, one.high))
        y = ROW * number + ROW / 2.0
        colour = "var(--bad)" if one.matters else "var(--soft)"
        name = one.name if len(one.name) <= MAX_LETTERS else f"{one.name[: MAX_LETTERS - 1]}…"
        drawing.add("text", name, x=NAMES - 8, y=y + 4, class_="label", text_anchor="end")
        drawing.add("rect", x=NAMES, y=y - 6, width=max(share - NAMES, 1.0), height=12.0,
                    fill=colour, opacity=0.55)  # fmt: skip
        drawing.line([(low, y), (high, y)], stroke="var(--ink)", stroke_width=1.4)
        for x in (low, high):
            drawing.line([(x, y - 4), (x, y + 4)], stroke="var(--ink)", stroke_width=1.4)
        figures = f"{one.share:.0%} ({one.low:.0%} to {one.high:.0%})"
        drawing.add("text", figures, x=NAMES + BARS + 8, y=y + 4, class_="tick")
    return drawing.markup()


def draw_slice(one: ParameterImportance, trials: TrialScores) -> Markup | None:
    """Plot the score of every trial over one parameter, and the share that fails by its parts.

    None where the parameter has no numbers, or always the same one.
    """
    values = np.array([np.nan if v is None else v for v in one.values], dtype=float)
    known = np.isfinite(values) & np.isfinite(np.asarray(trials.scores, dtype=float))
    if known.sum() < 2 or np.ptp(values[known]) == 0.0:
        return None
    across = _Across(float(values[known].min()), float(values[known].max()))
    scores = np.asarray(trials.scores, dtype=float)
    bottom, top = min(scores[known].min(), 0.0) - 0.02, max(scores[known].max(), 0.1) + 0.02
    drawing = Drawing(
        LEFT + SLICE_WIDTH + RIGHT,
        TOP + SLICE_HEIGHT + STRIP + FOOT,
        label=f"score of each trial over {one.name}, and the share of trials that fail",
    )
    heights = TOP + SLICE_HEIGHT * (top - scores) / (top - bottom)
    places = np.stack([[across.x(value) for value in values], heights], axis=-1)
    zero = TOP + SLICE_HEIGHT * top / (top - bottom)
    drawing.line([(LEFT, zero), (LEFT + SLICE_WIDTH, zero)], stroke="var(--bad)")
    for value in ticks(bottom, top, 4):
        y = TOP + SLICE_HEIGHT * (top - value) / (top - bottom)
        drawing.add(
            "text", number_text(value), x=LEFT - 5, y=y + 4, class_="tick", text_anchor="end"
        )
    failed = np.asarray(trials.failed, dtype=bool)
    drawing.dots(places[known & ~failed], radius=2.3, stroke="var(--driving)")
    drawing.crosses(places[known & failed], radius=CROSS, stroke="var(--bad)")
    _draw_strip(drawing, one, across)
    base = TOP + SLICE_HEIGHT + STRIP
    for value in ticks(across.low, across.high, 5):
        if one.options and not value.is_integer():
            continue
        drawing.add(
            "text",
            one.options[int(value)][:MAX_OF_OPTION] if one.options else number_text(value),
            x=across.x(value),
            y=base + 16,
            class_="tick",
            text_anchor="middle",
        )
    return drawing.markup()


@dataclass(frozen=True, slots=True)
class _Across:
    """Maps values of a parameter to pixels."""

    low: float
    high: float

    def x(self, value: float) -> float:
        return LEFT + SLICE_WIDTH * (value - self.low) / (self.high - self.low)


def _draw_strip(drawing: Drawing, one: ParameterImportance, across: _Across) -> None:
    """Write the share of trials that fail under each part of the range, darker where more do."""
    y = TOP + SLICE_HEIGHT + 2.0
    for part in one.parts:
        left, right = across.x(part.low), across.x(part.high)
        share = part.failures / part.trials
        drawing.add("rect", x=left, y=y, width=max(right - left, 2.0), height=STRIP - 4.0,
                    fill="var(--bad)", opacity=0.08 + 0.5 * share)  # fmt: skip
        if right - left > ROOM_FOR_SHARE:
            drawing.add("text", f"{share:.0%}", x=0.5 * (left + right), y=y + 11.0, class_="tick",
                        text_anchor="middle")  # fmt: skip
