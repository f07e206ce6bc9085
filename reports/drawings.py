"""The drawings of a report that show a floor or a graph: who waits for whom, and where."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from markupsafe import Markup

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.trace import Trace
from mrta_falsify.core.world import Blockage, World
from reports.colours import robot_colour
from reports.furnishing import fixed_outlines, movable_outlines
from reports.run_view import extent_of
from reports.svg import Drawing, Floor

CLOSE_UP = 4.0  # m around the members of a cycle that a close-up shows
FITS = 8  # letters of a name inside its node
#: what the graph says where nobody and no known thing is waited for; a solid otherwise
NOBODY = {"stalled": "nothing", "no-path": "no way"}
NO_ROBOT = "#6b6b80"  # nodes of people, rooms and solids; white text reads on it
TRAIL = 20.0  # s of the way behind a robot


def wait_for_graph(edges: Sequence[dict[str, str]], world: World) -> Markup:
    """Graph of a wait-for cycle: a node per robot or person, an arrow per edge with its cause."""
    nodes = (name for edge in edges for name in (edge["robot"], blocker_of(edge)))
    names = list(dict.fromkeys(nodes))
    numbers = {robot.name: i for i, robot in enumerate(world.robots)}
    radius = 105.0
    width, height = 360.0, 130.0 if len(names) == 2 else 320.0
    drawing = Drawing(width, height, label="wait-for graph: " + ", ".join(map(_edge_text, edges)))
    angles = np.pi / 2.0 + 2.0 * np.pi * np.arange(len(names)) / max(len(names), 1)
    if len(names) == 2:
        angles = np.array([np.pi, 0.0])
    middle = np.array([width / 2.0, height / 2.0])
    place = {
        name: middle + radius * np.array([np.cos(a), -np.sin(a)])
        for name, a in zip(names, angles, strict=True)
    }
    for edge in edges:
        start, end = place[edge["robot"]], place[blocker_of(edge)]
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
        resource = edge["resource"] if edge["blocked_by"] else ""  # else it is the node
        text = edge["cause"] + (f" ({resource})" if resource else "")
        drawing.add("text", text, x=x, y=y + 4, class_="label", text_anchor="middle")
    for name, (x, y) in place.items():
        colour = robot_colour(numbers[name]) if name in numbers else NO_ROBOT
        drawing.add("circle", cx=x, cy=y, r=30, fill=colour)
        fits = len(name) <= FITS
        drawing.add("text", name, x=x, y=y + (4 if fits else 42), text_anchor="middle",
                    class_="node" if fits else "label")  # fmt: skip
    return drawing.markup()


def blocker_of(edge: dict[str, str]) -> str:
    """Node of the wait-for graph that an edge of a cycle leads to."""
    return edge["blocked_by"] or edge["resource"] or NOBODY.get(edge["cause"], "solid")


def _edge_text(edge: dict[str, str]) -> str:
    return f"{edge['robot']} waits for {blocker_of(edge)} ({edge['cause']})"


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
    shown = [floor(outline) for outline in furniture if floor.shows(outline)]
    drawing.polygons(shown, fill="var(--furniture)", stroke="var(--edge)", stroke_width=0.5)
    walls = [floor(wall.polygon) for wall in world.walls if floor.shows(wall.polygon)]
    drawing.polygons(walls, fill="var(--wall)")
    for event in world.events:
        if isinstance(event, Blockage) and time is not None and event.start <= time < event.end:
            drawing.polygon(floor(event.polygon), fill="var(--blocked)", stroke="var(--bad)")
    for resource in world.resources:
        for spot in filter(floor.shows, resource.spots):
            x, y = floor(spot)
            drawing.add("circle", cx=x, cy=y, r=2, fill="none", stroke="var(--soft)")
    for room in world.rooms:
        if floor.shows(room.point):
            x, y = floor(room.point)
            drawing.add("text", room.name, x=x, y=y, class_="room", text_anchor="middle")


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
    bad = np.asarray(failed, dtype=bool)
    points = floor(places)
    drawing.dots(points[~bad], radius=3.0, stroke="var(--driving)", opacity=0.7)
    drawing.dots(points[bad], radius=4.5, stroke="var(--bad)", opacity=0.7)
    return drawing.markup()
