"""Charts of a report: what robots did over time, signals, scores of the trials."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
from markupsafe import Markup

from mrta_falsify.core.arrays import Array, BoolArray
from mrta_falsify.core.fleet import Phase
from mrta_falsify.core.trace import Trace
from mrta_falsify.core.verdict import Verdict
from reports.colours import robot_colour
from reports.svg import Drawing, ticks

PHASE_COLOURS = {
    Phase.OFF: "var(--line)",
    Phase.IDLE: "var(--idle)",
    Phase.DRIVING: "var(--driving)",
    Phase.QUEUEING: "var(--queueing)",
    Phase.PLANNING: "var(--planning)",
    Phase.SERVING: "var(--serving)",
    Phase.PARKING: "var(--making-room)",
}
DETAIL = 0.3  # px that a curve may be off


def timelines(trace: Trace, marks: Sequence[tuple[float, str]] = ()) -> Markup:
    """A row per robot: what it was doing, and below, red, while it was blocked."""
    row, top, left, width = 30.0, 14.0, 90.0, 760.0
    end = max(trace.duration, 1e-9)
    height = top + row * len(trace.robots) + 24.0
    drawing = Drawing(
        left + width + 10.0,
        height,
        label="what each robot was doing over time",
        data={"left": left, "width": width, "end": end},
    )

    def x(time: float) -> float:
        return left + width * time / end

    for i, name in enumerate(trace.robots):
        y = top + row * i + 6.0
        drawing.add("text", name, x=left - 8, y=y + 13, class_="label", text_anchor="end")
        for first, last, phase in _runs(trace.columns["phase"][:, i]):
            start, stop = x(first * trace.dt), x(last * trace.dt)
            drawing.add("rect", x=start, y=y, width=max(stop - start, 0.3), height=12,
                        fill=PHASE_COLOURS[Phase(phase)])  # fmt: skip
        for span in trace.edges:
            if span.edge.robot == i and span.edge.cause != "task":
                start, stop = x(span.first * trace.dt), x((span.last + 1) * trace.dt)
                drawing.add("rect", x=start, y=y + 13, width=max(stop - start, 0.5), height=6,
                            fill="var(--bad)")  # fmt: skip
    for event in trace.events:
        if event.kind in ("picked-up", "dropped-off") and event.robot >= 0:
            y = top + row * event.robot + 5.0
            shape = "▲" if event.kind == "picked-up" else "▼"
            drawing.add("text", shape, x=x(event.time), y=y, class_="mark", text_anchor="middle")
    base = top + row * len(trace.robots) + 4.0
    for value in ticks(0.0, end, 8):
        drawing.add("text", f"{value:g} s", x=x(value), y=base + 16, class_="tick",
                    text_anchor="middle")  # fmt: skip
    for i, (time, what) in enumerate(sorted(marks)):
        drawing.line([(x(time), 2), (x(time), base)], stroke="var(--bad)", stroke_dasharray="3 2")
        side = "end" if i < len(marks) - 1 or time > 0.9 * end else "start"
        shift = -4.0 if side == "end" else 4.0
        drawing.add("text", what, x=x(time) + shift, y=10, class_="tick", text_anchor=side)
    return drawing.markup()


def _runs(values: np.ndarray) -> list[tuple[int, int, int]]:
    """First tick, tick after the last, and value of each stretch of equal values."""
    edges = np.flatnonzero(np.diff(values)) + 1
    starts = np.concatenate([[0], edges])
    ends = np.concatenate([edges, [len(values)]])
    return [(int(a), int(b), int(values[a])) for a, b in zip(starts, ends, strict=True) if b > a]


def signals(
    trace: Trace, verdicts: Sequence[Verdict], members: Sequence[str] = ()
) -> list[tuple[str, Markup]]:
    """Plots of what the violated specifications are about, the violated part shaded."""
    shade = [v.violated_at for v in verdicts if v.violated and v.violated_at is not None]
    since = min(shade, default=None)
    numbers = {name: i for i, name in enumerate(trace.robots)}
    chosen = [numbers[name] for name in members if name in numbers] or list(numbers.values())
    speed = np.hypot(trace.columns["velocity"][:, :, 0], trace.columns["velocity"][:, :, 1])
    goal = trace.columns["goal"] - trace.columns["pose"][:, :, :2]
    distance = np.hypot(goal[..., 0], goal[..., 1])
    plots: list[tuple[str, Array, float | None]] = [
        ("speed [m/s]", speed[:, chosen], None),
        ("distance to goal [m]", distance[:, chosen], None),
    ]
    gaps = {"no_robot_robot_contact": "gap_robot", "no_robot_static_contact": "gap_static",
            "no_robot_human_contact": "gap_human", "human_clearance": "gap_human"}  # fmt: skip
    for verdict in verdicts:
        if verdict.violated and verdict.spec in gaps:
            values = np.minimum(trace.columns[gaps[verdict.spec]][:, chosen], 2.0)
            limit = 0.1 if verdict.spec == "human_clearance" else 0.0
            plots.append((f"gap of {verdict.spec} [m]", values, limit))
    colours = [robot_colour(i) for i in chosen]
    time = trace.columns["time"]
    return [(name, _plot(name, time, v, colours, since, limit)) for name, v, limit in plots]


def _plot(
    name: str,
    time: Array,
    values: Array,
    colours: Sequence[str],
    since: float | None,
    limit: float | None,
) -> Markup:
    left, width, height = 44.0, 806.0, 110.0
    known = values[np.isfinite(values)]
    low, high = float(min(known.min(initial=0.0), 0.0)), float(max(known.max(initial=1.0), 0.1))
    end = max(float(time[-1]) if len(time) else 1.0, 1e-9)
    drawing = Drawing(left + width + 10.0, height + 24.0, label=f"{name} over time")

    def place(t: Array, v: Array) -> Array:
        return np.stack([left + width * t / end, 6.0 + height * (high - v) / (high - low)], -1)

    if since is not None:
        x = left + width * since / end
        drawing.add("rect", x=x, y=6, width=left + width - x, height=height, class_="violated")
    for value in ticks(low, high, 4):
        y = float(place(np.array(0.0), np.array(value))[1])
        drawing.line([(left, y), (left + width, y)], stroke="var(--line)")
        drawing.add("text", f"{value:g}", x=left - 5, y=y + 4, class_="tick", text_anchor="end")
    if limit is not None:
        y = float(place(np.array(0.0), np.array(limit))[1])
        drawing.line([(left, y), (left + width, y)], stroke="var(--bad)", stroke_dasharray="4 3")
    for i, colour in enumerate(colours):
        for first, last in _stretches(np.isfinite(values[:, i])):
            curve = _simplified(place(time[first:last], values[first:last, i]))
            drawing.line(curve, stroke=colour, stroke_width=1.3)
    for value in ticks(0.0, end, 8):
        x = left + width * value / end
        drawing.add("text", f"{value:g} s", x=x, y=height + 20, class_="tick", text_anchor="middle")
    return drawing.markup()


def _stretches(wanted: BoolArray) -> list[tuple[int, int]]:
    """First place and place after the last of each run of True."""
    return [(first, last) for first, last, value in _runs(wanted) if value]


def _simplified(points: Array) -> Array:
    """A curve ``(n, 2)`` [px] without the points that nobody would miss."""
    if len(points) < 3:
        return points
    return np.asarray(shapely.get_coordinates(shapely.LineString(points).simplify(DETAIL)))


# --- the search ----------------------------------------------------------------------------


def scores(numbers: Sequence[int], values: Sequence[float], failed: Sequence[bool]) -> Markup:
    """Score of every trial in order, failures below the line."""
    left, width, height = 44.0, 806.0, 170.0
    low = min([*values, 0.0]) - 0.02
    high = max([*values, 0.1]) + 0.02
    last = max([*numbers, 1])
    drawing = Drawing(left + width + 10.0, height + 26.0, label="score of each trial, in order")

    def y(value: float) -> float:
        return 6.0 + height * (high - value) / (high - low)

    for value in ticks(low, high, 5):
        drawing.add("text", f"{value:g}", x=left - 5, y=y(value) + 4, class_="tick",
                    text_anchor="end")  # fmt: skip
    drawing.line([(left, y(0.0)), (left + width, y(0.0))], stroke="var(--bad)")
    places = np.array(
        [[left + width * n / last, y(v)] for n, v in zip(numbers, values, strict=True)]
    )
    bad = np.asarray(failed, dtype=bool)
    best, steps = float("inf"), []
    for (x, _), value in zip(places, values, strict=True):
        if value < best:
            steps += [(x, y(min(best, high))), (x, y(value))]
            best = value
    drawing.dots(places[~bad], radius=2.5, stroke="var(--driving)")
    drawing.dots(places[bad], radius=2.5, stroke="var(--bad)")
    steps.append((left + width, y(min(best, high))))
    drawing.line(steps, stroke="var(--soft)")
    for value in sorted({round(tick) for tick in ticks(0.0, float(last), 8)}):
        drawing.add("text", f"{value}", x=left + width * value / last, y=height + 22,
                    class_="tick", text_anchor="middle")  # fmt: skip
    return drawing.markup()
