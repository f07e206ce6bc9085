"""Timelines of a run: what each robot was doing, when it was blocked, and the chance of failure."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from markupsafe import Markup

from mrta_falsify.core.fleet import Phase
from mrta_falsify.core.inevitability import ChanceCurve, Inevitability, decisive, monotone_fit
from mrta_falsify.core.trace import Trace
from mrta_falsify.core.words import number_text
from reports.colours import PHASES, robot_colour
from reports.svg import Drawing, ticks

STOP_SHAPES = {"picked-up": "▲", "dropped-off": "▼"}
NAMES, ROWS_WIDTH = 90.0, 760.0  # px for the names, and for the rows beside them
RIGHT = 10.0  # px beside them
ROW, ROWS_TOP = 30.0, 14.0  # px, a robot's row; above the first
PHASE_BAR, BLOCKED_BAR = 12.0, 6.0  # px, heights


def draw_timelines(trace: Trace, marks: Sequence[tuple[float, str]] = ()) -> Markup:
    """Draw a row per robot: what it was doing and, below in red, when it was blocked.

    Args:
        trace: of the run.
        marks: times [s] to mark, each with its label.
    """
    end = max(trace.duration, 1e-9)
    drawing = Drawing(
        NAMES + ROWS_WIDTH + RIGHT,
        ROWS_TOP + ROW * len(trace.robots) + 24.0,
        label="what each robot was doing over time",
        data={"left": NAMES, "width": ROWS_WIDTH, "end": end},
    )
    for robot, name in enumerate(trace.robots):
        y = ROWS_TOP + ROW * robot + 6.0
        drawing.add("text", name, x=NAMES - 8, y=y + 13, class_="label", text_anchor="end")
        _draw_phases(drawing, trace, robot, y)
    for event in trace.events:
        if event.kind in STOP_SHAPES and event.robot >= 0:
            x, y = NAMES + ROWS_WIDTH * event.time / end, ROWS_TOP + ROW * event.robot + 5.0
            shape = STOP_SHAPES[event.kind]
            drawing.add("text", shape, x=x, y=y, class_="mark", text_anchor="middle")
    _draw_times(drawing, len(trace.robots), end, marks)
    return drawing.markup()


def _draw_phases(drawing: Drawing, trace: Trace, robot: int, y: float) -> None:
    scale = ROWS_WIDTH / max(trace.duration, 1e-9) * trace.dt  # px a tick

    def bar(first: int, last: int, top: float, height: float, least: float, fill: str) -> None:
        width = max((last - first) * scale, least)
        drawing.add("rect", x=NAMES + first * scale, y=top, width=width, height=height, fill=fill)

    for first, last, phase in runs_of_equal(trace.columns["phase"][:, robot]):
        bar(first, last, y, PHASE_BAR, 0.3, _colour(Phase(phase)))
    for span in trace.edges:
        if span.edge.robot == robot and span.edge.cause != "task":
            bar(span.first, span.last + 1, y + PHASE_BAR + 1, BLOCKED_BAR, 0.5, "var(--bad)")


def _colour(phase: Phase) -> str:
    return f"var(--{PHASES[phase].name})" if phase in PHASES else "var(--line)"


def _draw_times(
    drawing: Drawing, robots: int, end: float, marks: Sequence[tuple[float, str]]
) -> None:
    """Draw the time axis below the rows, and the marks across them."""
    base = ROWS_TOP + ROW * robots + 4.0
    for value in ticks(0.0, end, 8):
        x = NAMES + ROWS_WIDTH * value / end
        drawing.add(
            "text", f"{number_text(value)} s", x=x, y=base + 16, class_="tick", text_anchor="middle"
        )
    for i, (time, what) in enumerate(sorted(marks)):
        x = NAMES + ROWS_WIDTH * time / end
        drawing.line([(x, 2), (x, base)], stroke="var(--bad)", stroke_dasharray="3 2")
        before = i < len(marks) - 1 or time > 0.9 * end
        side, shift = ("end", -4.0) if before else ("start", 4.0)
        drawing.add("text", what, x=x + shift, y=10, class_="tick", text_anchor=side)


def runs_of_equal(values: np.ndarray) -> list[tuple[int, int, int]]:
    """First tick, tick after the last, and value of each stretch of equal values."""
    edges = np.flatnonzero(np.diff(values)) + 1
    starts = np.concatenate([[0], edges])
    ends = np.concatenate([edges, [len(values)]])
    return [(int(a), int(b), int(values[a])) for a, b in zip(starts, ends, strict=True) if b > a]


# --- the chance of failure, on the scale of the timelines ---------------------------------

HEIGHT, TOP, FOOT = 96.0, 16.0, 24.0  # px of the chart, above and below it
LEGEND = 15.0  # px, a line of the legend
STACK_COLOUR, BY_COLOUR = "var(--bad)", "var(--driving)"


def draw_chances(found: Inevitability, end: float) -> Markup:
    """Draw the chance of failure over time with its interval, and mark when it was decided.

    Args:
        found: what copies have told.
        end: duration of the run [s], which the timelines span.
    """
    end = max(end, 1e-9)
    shown = [curve for curve in found.curves if curve.points]
    drawing = Drawing(
        NAMES + ROWS_WIDTH + RIGHT,
        TOP + HEIGHT + FOOT + LEGEND * len(shown),
        label="chance of failure by the time from which the run is repeated",
    )
    base = TOP + HEIGHT
    for chance in (0.0, 0.5, 1.0):
        y = base - HEIGHT * chance
        drawing.line([(NAMES, y), (NAMES + ROWS_WIDTH, y)], stroke="var(--line)")
        drawing.add("text", f"{chance:g}", x=NAMES - 8, y=y + 4, class_="tick", text_anchor="end")
    for value in ticks(0.0, end, 8):
        x = NAMES + ROWS_WIDTH * value / end
        drawing.add(
            "text", f"{number_text(value)} s", x=x, y=base + 16, class_="tick", text_anchor="middle"
        )
    if found.decided_at is not None:
        x = NAMES + ROWS_WIDTH * found.decided_at / end
        drawing.line([(x, TOP - 4), (x, base)], stroke="var(--ink)", stroke_dasharray="3 2")
        side, shift = ("end", -4.0) if found.decided_at > 0.8 * end else ("start", 4.0)
        told = f"decided at {found.decided_at:.1f} s"
        drawing.add("text", told, x=x + shift, y=11, class_="tick", text_anchor=side)
    for number, curve in enumerate(shown):
        colour = _curve_colour(curve, found, number)
        _draw_curve(drawing, curve, found, end, colour)
        y = base + FOOT + LEGEND * number + 8.0
        drawing.line([(NAMES, y), (NAMES + 18, y)], stroke=colour, stroke_width=2)
        drawing.add("text", curve.change, x=NAMES + 24, y=y + 3.5, class_="tick")
    return drawing.markup()


def _curve_colour(curve: ChanceCurve, found: Inevitability, number: int) -> str:
    if curve.replaced == "nothing":
        return STACK_COLOUR
    return BY_COLOUR if curve is decisive(found.curves) else robot_colour(number)


def _draw_curve(
    drawing: Drawing, curve: ChanceCurve, found: Inevitability, end: float, colour: str
) -> None:
    """Draw the monotone fit from point to point up to the violation, its band and its points."""

    def place(time: float, chance: float) -> tuple[float, float]:
        return NAMES + ROWS_WIDTH * min(time, end) / end, TOP + HEIGHT * (1.0 - chance)

    times = [point.time for point in curve.points]
    fit = monotone_fit(curve.points)
    bands = [curve.band(time) for time in times]
    low = [place(time, band.low) for time, band in zip(times, bands, strict=True)]
    high = [place(time, band.high) for time, band in zip(times, bands, strict=True)]
    last = place(found.found, 1.0)
    drawing.polygon([*low, last, *reversed(high)], fill=colour, opacity="0.12")
    line = [place(time, chance) for time, chance in zip(times, fit, strict=True)]
    drawing.line([*line, last], stroke=colour, stroke_width=1.6)
    for point in curve.points:
        x, y = place(point.time, point.chance.failures / point.chance.trials)
        drawing.add("circle", cx=x, cy=y, r=2.4, fill=colour)
