"""Charts over time: what robots did, their signals, and the scores of a campaign's trials."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from markupsafe import Markup

from mrta_falsify.core.arrays import Array, BoolArray
from mrta_falsify.core.fleet import Phase
from mrta_falsify.core.trace import Trace
from mrta_falsify.core.verdict import Verdict
from reports.colours import robot_colour
from reports.contents import TrialScores
from reports.svg import Drawing, ticks

PHASE_COLOURS = {
    Phase.OFF: "var(--line)",
    Phase.IDLE: "var(--idle)",
    Phase.DRIVING: "var(--driving)",
    Phase.QUEUEING: "var(--queueing)",
    Phase.PLANNING: "var(--planning)",
    Phase.SERVING: "var(--serving)",
    Phase.MAKING_ROOM: "var(--making-room)",
}
STOP_SHAPES = {"picked-up": "▲", "dropped-off": "▼"}
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


# --- what robots did -------------------------------------------------------------------------

NAMES, ROWS_WIDTH = 90.0, 760.0  # px for the names, and for the rows beside them
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

    for first, last, phase in _stretches(trace.columns["phase"][:, robot]):
        bar(first, last, y, PHASE_BAR, 0.3, PHASE_COLOURS[Phase(phase)])
    for span in trace.edges:
        if span.edge.robot == robot and span.edge.cause != "task":
            bar(span.first, span.last + 1, y + PHASE_BAR + 1, BLOCKED_BAR, 0.5, "var(--bad)")


def _draw_times(
    drawing: Drawing, robots: int, end: float, marks: Sequence[tuple[float, str]]
) -> None:
    """Draw the time axis below the rows, and the marks across them."""
    base = ROWS_TOP + ROW * robots + 4.0
    for value in ticks(0.0, end, 8):
        x = NAMES + ROWS_WIDTH * value / end
        drawing.add("text", f"{value:g} s", x=x, y=base + 16, class_="tick", text_anchor="middle")
    for i, (time, what) in enumerate(sorted(marks)):
        x = NAMES + ROWS_WIDTH * time / end
        drawing.line([(x, 2), (x, base)], stroke="var(--bad)", stroke_dasharray="3 2")
        before = i < len(marks) - 1 or time > 0.9 * end
        side, shift = ("end", -4.0) if before else ("start", 4.0)
        drawing.add("text", what, x=x + shift, y=10, class_="tick", text_anchor=side)


def _stretches(values: np.ndarray) -> list[tuple[int, int, int]]:
    """First tick, tick after the last, and value of each stretch of equal values."""
    edges = np.flatnonzero(np.diff(values)) + 1
    starts = np.concatenate([[0], edges])
    ends = np.concatenate([edges, [len(values)]])
    return [(int(a), int(b), int(values[a])) for a, b in zip(starts, ends, strict=True) if b > a]


# --- charts with axes ------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Axis:
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
        drawing.add("text", f"{value:g}", x=LEFT - 5, y=self.y(value) + 4, class_="tick",
                    text_anchor="end")  # fmt: skip

    def rule(self, drawing: Drawing, value: float, **style: object) -> None:
        """Draw a line across the chart."""
        y = self.y(value)
        drawing.line([(LEFT, y), (LEFT + CHART_WIDTH, y)], **style)


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
    axis = Axis(end, low, high, SIGNAL_HEIGHT)
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
        for first, last in _known_stretches(np.isfinite(curve)):
            points = _simplified(axis.points(time[first:last], curve[first:last]))
            drawing.line(points, stroke=robot_colour(robot), stroke_width=1.3)
    for value in ticks(0.0, end, 8):
        axis.label_x(drawing, value, f"{value:g} s", 20)
    return drawing.markup()


def _known_stretches(known: BoolArray) -> list[tuple[int, int]]:
    """First place and place after the last of each stretch of True."""
    return [(first, last) for first, last, value in _stretches(known) if value]


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
    axis = Axis(last, float(low), float(high), SCORE_HEIGHT)
    drawing = axis.drawing("score of each trial, in order", 26.0)
    for value in ticks(axis.low, axis.high, 5):
        axis.label_y(drawing, value)
    axis.rule(drawing, 0.0, stroke="var(--bad)")
    places = axis.points(np.asarray(trials.numbers, dtype=float), scores)
    bad = np.asarray(trials.failed, dtype=bool)
    drawing.dots(places[~bad], radius=2.5, stroke="var(--driving)")
    drawing.dots(places[bad], radius=2.5, stroke="var(--bad)")
    drawing.line(_best_so_far(places), stroke="var(--soft)")
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
