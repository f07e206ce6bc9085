"""Charts with axes: signals of robots over time, and the scores of a campaign's trials."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from markupsafe import Markup

from mrta_falsify.core.arrays import Array, BoolArray
from mrta_falsify.core.trace import Trace
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.core.words import number_text
from reports.colours import robot_colour
from reports.contents import TrialScores
from reports.svg import Drawing, ticks
from reports.timelines import runs_of_equal

DETAIL = 0.3  # px that a curve may be off
CHART_WIDTH = 806.0  # px between the axes of a chart
SIGNAL_HEIGHT, SCORE_HEIGHT = 110.0, 170.0  # px
LEFT, TOP, RIGHT = 44.0, 6.0, 10.0  # px around a chart
LARGEST_GAP = 2.0  # m; larger gaps are cut off
#: column of the trace and limit [m] of specifications about gaps
GAPS = {
    "no_robot_robot_contact": ("gap_robot", 0.0),
    "no_robot_static_contact": ("gap_static", 0.0),
    "no_robot_human_contact": ("gap_human", 0.0),
    "human_clearance": ("gap_human", 0.1),
}


@dataclass(frozen=True, slots=True)
class ChartAxes:
    """Maps values of a chart to pixels."""

    last: float  #: value at the right end
    low: float  #: at the bottom
    high: float  #: at the top
    height: float  #: px

    def x(self, value: float) -> float:
        """Pixel of a value on the horizontal axis."""
        return LEFT + CHART_WIDTH * value / self.last

    def y(self, value: float) -> float:
        """Pixel of a value on the vertical axis."""
        return TOP + self.height * (self.high - value) / (self.high - self.low)

    def points(self, across: Array, up: Array) -> Array:
        """Pixels ``(n, 2)`` of points."""
        x = LEFT + CHART_WIDTH * across / self.last
        return np.stack([x, TOP + self.height * (self.high - up) / (self.high - self.low)], -1)

    def drawing(self, label: str, foot: float) -> Drawing:
        """Begin the drawing of a chart, with ``foot`` [px] below it."""
        return Drawing(LEFT + CHART_WIDTH + RIGHT, self.height + foot, label=label)

    def label_x(self, drawing: Drawing, value: float, text: str, below: float) -> None:
        """Write a number under the horizontal axis, ``below`` [px] it."""
        drawing.add("text", text, x=self.x(value), y=self.height + below, class_="tick",
                    text_anchor="middle")  # fmt: skip

    def label_y(self, drawing: Drawing, value: float) -> None:
        """Write a number beside the vertical axis."""
        drawing.add("text", number_text(value), x=LEFT - 5, y=self.y(value) + 4, class_="tick",
                    text_anchor="end")  # fmt: skip

    def rule(self, drawing: Drawing, value: float, **style: object) -> None:
        """Draw a line across the chart."""
        y = self.y(value)
        drawing.line([(LEFT, y), (LEFT + CHART_WIDTH, y)], **style)


# --- signals ---------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class Signal:
    """Curves of some robots over time."""

    name: str
    values: Array  #: (K, n)
    limit: float | None = None  #: below which a specification is violated


def draw_signals(
    trace: Trace, violated: Sequence[Verdict], members: Sequence[str] = ()
) -> list[tuple[str, Markup]]:
    """Plot what the violated specifications are about, the time of violation shaded.

    Args:
        trace: of the run.
        violated: verdicts.
        members: robots concerned; all if empty.

    Returns:
        Name and plot of each signal.
    """
    since = min((v.violated_at for v in violated if v.violated_at is not None), default=None)
    numbers = {name: i for i, name in enumerate(trace.robots)}
    chosen = [numbers[name] for name in members if name in numbers] or list(numbers.values())
    return [
        (signal.name, _plot(signal, trace.columns["time"], chosen, since))
        for signal in _signals(trace, violated, chosen)
    ]


def _signals(trace: Trace, violated: Sequence[Verdict], chosen: list[int]) -> Iterator[Signal]:
    columns = trace.columns
    speed = np.hypot(columns["velocity"][:, chosen, 0], columns["velocity"][:, chosen, 1])
    yield Signal("speed [m/s]", speed)
    goal = columns["goal"][:, chosen] - columns["pose"][:, chosen, :2]
    yield Signal("distance to goal [m]", np.hypot(goal[..., 0], goal[..., 1]))
    for verdict in violated:
        if verdict.spec in GAPS:
            column, limit = GAPS[verdict.spec]
            values = np.minimum(columns[column][:, chosen], LARGEST_GAP)
            yield Signal(f"gap of {verdict.spec} [m]", values, limit)


def _plot(signal: Signal, time: Array, robots: Sequence[int], since: float | None) -> Markup:
    """Plot a signal, a curve per robot."""
    known = signal.values[np.isfinite(signal.values)]
    end = max(float(time[-1]) if len(time) else 1.0, 1e-9)
    low, high = float(min(known.min(initial=0.0), 0.0)), float(max(known.max(initial=1.0), 0.1))
    axis = ChartAxes(end, low, high, SIGNAL_HEIGHT)
    drawing = axis.drawing(f"{signal.name} over time", 24.0)
    if since is not None:
        x = axis.x(since)
        drawing.add("rect", x=x, y=TOP, width=LEFT + CHART_WIDTH - x, height=SIGNAL_HEIGHT,
                    class_="violated")  # fmt: skip
    for value in ticks(low, high, 4):
        axis.rule(drawing, value, stroke="var(--line)")
        axis.label_y(drawing, value)
    if signal.limit is not None:
        axis.rule(drawing, signal.limit, stroke="var(--bad)", stroke_dasharray="4 3")
    for i, robot in enumerate(robots):
        curve = signal.values[:, i]
        for first, last in _known(np.isfinite(curve)):
            points = _simplified(axis.points(time[first:last], curve[first:last]))
            drawing.line(points, stroke=robot_colour(robot), stroke_width=1.3)
    for value in ticks(0.0, end, 8):
        axis.label_x(drawing, value, f"{number_text(value)} s", 20)
    return drawing.markup()


def _known(finite: BoolArray) -> list[tuple[int, int]]:
    """First place and place after the last of each stretch of True."""
    return [(first, last) for first, last, value in runs_of_equal(finite) if value]


def _simplified(points: Array) -> Array:
    """Drop the points of a curve ``(n, 2)`` [px] that make no visible difference."""
    if len(points) < 3:
        return points
    return np.asarray(shapely.get_coordinates(shapely.LineString(points).simplify(DETAIL)))


# --- the search ------------------------------------------------------------------------------


def draw_scores(trials: TrialScores) -> Markup:
    """Draw the score of every trial in order, failures below the line."""
    scores = np.asarray(trials.scores, dtype=float)
    last = float(max([*trials.numbers, 1]))
    low, high = min(scores.min(), 0.0) - 0.02, max(scores.max(), 0.1) + 0.02
    axis = ChartAxes(last, float(low), float(high), SCORE_HEIGHT)
    drawing = axis.drawing("score of each trial, in order", 26.0)
    for value in ticks(axis.low, axis.high, 5):
        axis.label_y(drawing, value)
    axis.rule(drawing, 0.0, stroke="var(--bad)")
    places = axis.points(np.asarray(trials.numbers, dtype=float), scores)
    bad = np.asarray(trials.failed, dtype=bool)
    drawing.dots(places[~bad], radius=2.5, stroke="var(--driving)")
    drawing.crosses(places[bad], radius=3.0, stroke="var(--bad)")
    drawing.line(_best_so_far(places), stroke="var(--soft)")
    for number in sorted({round(tick) for tick in ticks(0.0, last, 8)}):
        axis.label_x(drawing, number, f"{number}", 22)
    return drawing.markup()


def draw_progress(trials: TrialScores) -> Markup:
    """Draw how many failures, and of them deadlocks, there were after each trial."""
    counts = [("failures", "var(--bad)", np.cumsum(trials.failed), "")]
    if any(trials.deadlocked):
        counts.append(("deadlocks", "var(--ink)", np.cumsum(trials.deadlocked), "5 3"))
    return _draw_counts(trials.numbers, counts, "failures found so far, by trial")


def draw_situations(trials: TrialScores) -> Markup:
    """Draw how many different situations trials had shown after each trial."""
    counts = [("situations", "var(--driving)", np.asarray(trials.situations), "")]
    return _draw_counts(trials.numbers, counts, "different situations seen so far, by trial")


def _draw_counts(
    numbers: Sequence[int], counts: Sequence[tuple[str, str, np.ndarray, str]], label: str
) -> Markup:
    """Draw counts that grow over trials: name, colour, values, dashes."""
    last = float(max([*numbers, 1]))
    most = max(float(values[-1]) for _, _, values, _ in counts)
    axis = ChartAxes(last, 0.0, max(1.08 * most, 1.0), SIGNAL_HEIGHT)
    drawing = axis.drawing(label, 26.0)
    for value in sorted({round(tick) for tick in ticks(0.0, axis.high, 4)}):
        axis.rule(drawing, value, stroke="var(--line)")
        axis.label_y(drawing, value)
    for name, colour, values, dashes in counts:
        places = axis.points(np.asarray(numbers, dtype=float), values.astype(float))
        corners = np.repeat(places, 2, axis=0)[:-1]
        corners[1::2, 0] = places[1:, 0]  # level up to the next trial
        style = {"stroke_dasharray": dashes} if dashes else {}
        drawing.line(_simplified(corners), stroke=colour, stroke_width=1.8, **style)
        x, y = places[-1]
        drawing.add("text", f"{int(values[-1])} {name}", x=x - 4, y=max(y - 5, 10.0),
                    class_="label", text_anchor="end")  # fmt: skip
    for number in sorted({round(tick) for tick in ticks(0.0, last, 8)}):
        axis.label_x(drawing, number, f"{number}", 22)
    return drawing.markup()


def _best_so_far(places: Array) -> Array:
    """Steps ``(n, 2)`` [px] down to the lowest score so far; pixels grow downward."""
    steps: list[tuple[float, float]] = []
    best = TOP
    for x, y in places:
        if y > best:
            steps += [(x, best), (x, y)]
            best = y
    return np.array([*steps, (LEFT + CHART_WIDTH, best)])
