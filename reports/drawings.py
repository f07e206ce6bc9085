"""The drawings of a report: who waits for whom, when, where, and how the search went."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from markupsafe import Markup

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.fleet import Phase
from mrta_falsify.core.trace import Trace
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.core.world import Blockage, World
from reports.figures import extent_of, robot_colour
from reports.furnishing import fixed_outlines, movable_outlines
from reports.svg import Drawing, Floor, ticks

PHASE_COLOURS = {
    Phase.OFF: "var(--line)",
    Phase.IDLE: "var(--idle)",
    Phase.DRIVING: "var(--driving)",
    Phase.QUEUEING: "var(--queueing)",
    Phase.PLANNING: "var(--planning)",
    Phase.SERVING: "var(--serving)",
    Phase.MAKING_ROOM: "var(--making-room)",
}
CLOSE_UP = 4.0  # m around the members of a cycle that a close-up shows
TRAIL = 20.0  # s of the way behind a robot


def wait_for_graph(edges: Sequence[dict[str, str]], world: World) -> Markup:
    """Graph of a wait-for cycle: a node per robot or person, an arrow per edge with its cause."""
    names = list(
        dict.fromkeys(
            name for edge in edges for name in (edge["robot"], edge["blocked_by"] or "solid")
        )
    )
    numbers = {robot.name: i for i, robot in enumerate(world.robots)}
    size, radius = 320.0, 105.0
    drawing = Drawing(size, size, label="wait-for graph: " + ", ".join(map(_edge_text, edges)))
    angles = np.pi / 2.0 + 2.0 * np.pi * np.arange(len(names)) / max(len(names), 1)
    if len(names) == 2:
        angles = np.array([np.pi, 0.0])
    place = {
        name: size / 2.0 + radius * np.array([np.cos(a), -np.sin(a)])
        for name, a in zip(names, angles, strict=True)
    }
    for edge in edges:
        start, end = place[edge["robot"]], place[edge["blocked_by"] or "solid"]
        way = end - start
        length = float(np.hypot(*way))
        if length < 1.0:
            continue
        unit = way / length
        side = 14.0 * np.array([-unit[1], unit[0]])  # two arrows between two nodes lie apart
        drawing.arrow(
            start + 34.0 * unit + side, end - 34.0 * unit + side,
            stroke="var(--bad)", stroke_width=2,
        )  # fmt: skip
        x, y = (start + end) / 2.0 + 2.2 * side
        text = edge["cause"] + (f" ({edge['resource']})" if edge["resource"] else "")
        drawing.add("text", text, x=x, y=y + 4, class_="label", text_anchor="middle")
    for name, (x, y) in place.items():
        colour = robot_colour(numbers[name]) if name in numbers else "var(--soft)"
        drawing.add("circle", cx=x, cy=y, r=30, fill=colour)
        drawing.add("text", name, x=x, y=y + 4, class_="node", text_anchor="middle")
    return drawing.markup()


def _edge_text(edge: dict[str, str]) -> str:
    return f"{edge['robot']} waits for {edge['blocked_by'] or 'a solid'} ({edge['cause']})"


def moment(
    world: World,
    trace: Trace,
    time: float,
    edges: Sequence[dict[str, str]] = (),
    *,
    members: Sequence[str] = (),
    width: float = 520.0,
) -> Markup:
    """Floor plan at ``time`` [s], close up on ``members`` if there are any."""
    tick = int(np.clip(round(time / trace.dt), 0, max(len(trace) - 1, 0)))
    position = trace.columns["pose"][tick, :, :2]
    numbers = {name: i for i, name in enumerate(trace.robots)}
    people = {name: i for i, name in enumerate(trace.humans)}
    chosen = [numbers[name] for name in members if name in numbers]
    bounds = _around(position[chosen]) if chosen else np.array(extent_of(world))
    floor = Floor(bounds, width)
    who = ", ".join(members) or "the whole floor"
    drawing = Drawing(width, floor.height, label=f"floor plan at {time:.1f} s: {who}")
    furniture = fixed_outlines(world) + movable_outlines(world, trace, tick)
    _draw_solids(drawing, floor, world, furniture, time)
    first = max(0, tick - round(TRAIL / trace.dt))
    for i in range(len(trace.robots)):
        trail = trace.columns["pose"][first : tick + 1 : 4, i, :2]
        drawing.line(floor(trail), stroke=robot_colour(i), stroke_width=1.5, opacity=0.5)
        path = _path_at(trace, i, tick)
        if len(path):
            drawing.line(
                floor(path), stroke=robot_colour(i), stroke_width=1.2, stroke_dasharray="4 3"
            )
    human_position = trace.columns["human_position"][tick]
    for i, human in enumerate(world.humans):
        x, y = floor(human_position[i])
        if np.isfinite(x):
            radius = human.radius * floor.scale
            drawing.add("circle", cx=x, cy=y, r=radius, fill="none", stroke="var(--soft)",
                        stroke_width=1.5)  # fmt: skip
            drawing.add("text", human.name, x=x, y=y - radius - 3, class_="label",
                        text_anchor="middle")  # fmt: skip
    for i, robot in enumerate(world.robots):
        _draw_robot(drawing, floor, trace.columns["pose"][tick, i], robot.radius, i, robot.name)
    for edge in edges:
        start = numbers.get(edge["robot"])
        if start is None:
            continue
        if edge["cause"] == "human" and edge["blocked_by"] in people:
            end = human_position[people[edge["blocked_by"]]]
        elif edge["blocked_by"] in numbers:
            end = position[numbers[edge["blocked_by"]]]
        else:
            continue
        drawing.arrow(floor(position[start]), floor(end), stroke="var(--bad)", stroke_width=2)
    return drawing.markup()


def _around(points: Array) -> Array:
    low, high = points.min(axis=0) - CLOSE_UP, points.max(axis=0) + CLOSE_UP
    return np.concatenate([low, high])


def _draw_solids(
    drawing: Drawing, floor: Floor, world: World, furniture: Sequence[Array], time: float | None
) -> None:
    for outline in furniture:
        drawing.polygon(floor(outline), fill="var(--furniture)", stroke="var(--edge)",
                        stroke_width=0.5)  # fmt: skip
    for wall in world.walls:
        drawing.polygon(floor(wall.polygon), fill="var(--wall)")
    for event in world.events:
        if isinstance(event, Blockage) and time is not None and event.start <= time < event.end:
            drawing.polygon(floor(event.polygon), fill="var(--blocked)", stroke="var(--bad)")
    for room in world.rooms:
        x, y = floor(room.point)
        drawing.add("text", room.name, x=x, y=y, class_="room", text_anchor="middle")
    for resource in world.resources:
        for spot in resource.spots:
            x, y = floor(spot)
            drawing.add("circle", cx=x, cy=y, r=2, fill="none", stroke="var(--soft)")


def _draw_robot(
    drawing: Drawing, floor: Floor, pose: Array, radius: float, number: int, name: str
) -> None:
    x, y = floor(pose[:2])
    size = max(radius * floor.scale, 3.0)
    colour = robot_colour(number)
    drawing.add("circle", cx=x, cy=y, r=size, fill=colour)
    ahead = (x + size * np.cos(pose[2]), y - size * np.sin(pose[2]))
    drawing.line([(x, y), ahead], stroke="#fff", stroke_width=2)
    drawing.add("text", name, x=x, y=y + size + 12, class_="label", text_anchor="middle")


def _path_at(trace: Trace, robot: int, tick: int) -> Array:
    path = np.empty((0, 2))
    for change in trace.paths:
        if change.tick > tick:
            break
        if change.robot == robot:
            path = change.points
    return path


# --- over time -----------------------------------------------------------------------------


def timelines(world: World, trace: Trace, marks: Sequence[tuple[float, str]] = ()) -> Markup:
    """A row per robot: what it was doing, and below, red, while it was blocked."""
    row, left, width = 30.0, 90.0, 760.0
    end = max(trace.duration, 1e-9)
    height = row * len(trace.robots) + 24.0
    drawing = Drawing(left + width + 10.0, height, label="what each robot was doing over time")

    def x(time: float) -> float:
        return left + width * time / end

    for i, name in enumerate(trace.robots):
        y = row * i + 6.0
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
            y = row * event.robot + 5.0
            shape = "▲" if event.kind == "picked-up" else "▼"
            drawing.add("text", shape, x=x(event.time), y=y, class_="mark", text_anchor="middle")
    base = row * len(trace.robots) + 4.0
    for value in ticks(0.0, end, 8):
        drawing.add("text", f"{value:g} s", x=x(value), y=base + 16, class_="tick",
                    text_anchor="middle")  # fmt: skip
    for time, _ in marks:
        drawing.line([(x(time), 0), (x(time), base)], stroke="var(--bad)", stroke_dasharray="3 2")
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
    plots = [
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
    step = max(1, len(time) // 600)
    time, values = time[::step], values[::step]
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
        finite = np.isfinite(values[:, i])
        drawing.line(place(time[finite], values[finite, i]), stroke=colour, stroke_width=1.3)
    for value in ticks(0.0, end, 8):
        x = left + width * value / end
        drawing.add("text", f"{value:g} s", x=x, y=height + 20, class_="tick", text_anchor="middle")
    return drawing.markup()


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
    best, steps = float("inf"), []
    for number, value, bad in zip(numbers, values, failed, strict=True):
        x = left + width * number / last
        if value < best:
            steps += [(x, y(min(best, high))), (x, y(value))]
            best = value
        drawing.add("circle", cx=x, cy=y(value), r=2.5,
                    fill="var(--bad)" if bad else "var(--driving)")  # fmt: skip
    steps.append((left + width, y(min(best, high))))
    drawing.line(steps, stroke="var(--soft)")
    for value in ticks(0.0, float(last), 8):
        drawing.add("text", f"{value:g}", x=left + width * value / last, y=height + 22,
                    class_="tick", text_anchor="middle")  # fmt: skip
    return drawing.markup()


def coverage(world: World, places: Array, failed: Sequence[bool]) -> Markup:
    """Where on the floor each trial came closest to trouble.

    Args:
        world: whose floor.
        places: ``(n, 2)`` [m].
        failed: which of them are failures.
    """
    floor = Floor(extent_of(world), 420.0)
    drawing = Drawing(420.0, floor.height, label="where trials came closest to trouble")
    _draw_solids(drawing, floor, world, [item.polygon for item in world.furniture], None)
    order = np.argsort(np.asarray(failed, dtype=bool), kind="stable")  # failures on top
    for i in order:
        x, y = floor(places[i])
        drawing.add("circle", cx=x, cy=y, r=4.5 if failed[i] else 3,
                    fill="var(--bad)" if failed[i] else "var(--driving)", opacity=0.7)  # fmt: skip
    return drawing.markup()
