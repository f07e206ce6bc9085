"""The chance of failure by the time from which a run is repeated, on the scale of the timelines."""

from __future__ import annotations

from markupsafe import Markup

from mrta_falsify.core.inevitability import ChanceCurve, Inevitability, decisive, monotone_fit
from mrta_falsify.core.words import number_text
from reports.colours import robot_colour
from reports.svg import Drawing, ticks
from reports.timelines import NAMES, RIGHT, ROWS_WIDTH

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
        colour = _colour(curve, found, number)
        _draw_curve(drawing, curve, found, end, colour)
        y = base + FOOT + LEGEND * number + 8.0
        drawing.line([(NAMES, y), (NAMES + 18, y)], stroke=colour, stroke_width=2)
        drawing.add("text", curve.change, x=NAMES + 24, y=y + 3.5, class_="tick")
    return drawing.markup()


def _colour(curve: ChanceCurve, found: Inevitability, number: int) -> str:
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
