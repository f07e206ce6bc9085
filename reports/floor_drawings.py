"""SVG painter of floor scenes: the moment of a failure, and where trials came to trouble."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from markupsafe import Markup

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.trace import Trace
from mrta_falsify.core.wait_account import Arrow
from mrta_falsify.core.world import Blockage, World
from reports.colours import robot_colour
from reports.contents import TrialScores
from reports.floor_scene import (
    Extent,
    Role,
    Shape,
    extent_of,
    floor_at,
    floor_scene,
    furniture_poses,
    moving_scene,
    path_scene,
    shapes_at,
)
from reports.svg import Drawing, FloorProjection


def place_of(world: World, trace: Trace, tick: int, name: str) -> Array | None:
    """Find the middle ``(2,)`` [m] of what is called ``name``; None if it has no place then.

    Args:
        world: of the run.
        trace: of the run, kept.
        tick: when.
        name: of a robot, a person, a piece of furniture or a blockage.
    """
    if name in trace.robots:
        return _finite(trace.columns["pose"][tick, trace.robots.index(name), :2])
    if name in trace.humans:
        return _finite(trace.columns["human_position"][tick, trace.humans.index(name)])
    for number, item in enumerate(world.movable_furniture()):
        if item.name == name:
            return _finite(furniture_poses(world, trace)[tick, number, :2])
    standing = [(item.name, item.polygon) for item in world.furniture]
    standing += [(e.name, e.polygon) for e in world.events if isinstance(e, Blockage)]
    for known, polygon in standing:
        if known == name:
            return np.asarray(0.5 * (polygon.min(axis=0) + polygon.max(axis=0)))
    return None


def _finite(place: Array) -> Array | None:
    return np.asarray(place) if np.isfinite(place).all() else None


CLOSE_UP = 4.0  # m around the robots concerned that a close-up shows
TRAIL = 20.0  # s of the way behind a robot
MOMENT_WIDTH = 520.0  # px
COVERAGE_WIDTH = 420.0  # px
LETTER = 5.5  # px, width of a letter of a name
LEAST_BODY = 3.0  # px, radius of a robot on a large floor
#: line widths [px] of areas, painted as one element a role
AREAS = {Role.FURNITURE: 0.5, Role.WALL: 0.0, Role.BLOCKAGE: 1.0}
SPOTS = (Role.QUEUE_SPOT, Role.PARKING)


def draw_moment(
    world: World,
    trace: Trace,
    time: float,
    waits: Sequence[Arrow] = (),
    *,
    members: Sequence[str] = (),
    named: Sequence[str] = (),
    name: str = "",
) -> Markup:
    """Draw the floor at ``time`` [s], close up on ``members`` if there are any.

    Args:
        world: of the run.
        trace: of the run.
        time: of the moment [s].
        waits: who waits for whom, painted as arrows.
        members: robots that must be in the picture; none: the whole floor is.
        named: furniture and blockages that took part; others are named where there is room.
        name: by which the page finds the drawing.
    """
    tick = int(np.clip(round(time / trace.dt), 0, max(len(trace) - 1, 0)))
    places = trace.columns["pose"][tick, :, :2]
    chosen = [i for i, name in enumerate(trace.robots) if name in members]
    extent = _around(places[chosen]) if chosen else extent_of(world)
    floor = FloorProjection(extent, MOMENT_WIDTH)
    who = ", ".join(members) or "the whole floor"
    label = f"floor plan at {time:.1f} s: {who}"
    drawing = Drawing(MOMENT_WIDTH, floor.height, label=label, name=name)
    _paint_floor(drawing, floor, shapes_at(floor_at(world, trace, tick), time))
    for shape in (*path_scene(trace, tick), *moving_scene(world, trace, tick, trail=TRAIL)):
        _paint_moving(drawing, floor, shape)
    _name_things(drawing, floor, world, trace, tick, named)
    for arrow in waits:
        start, end = (place_of(world, trace, tick, name) for name in (arrow.start, arrow.end))
        if start is not None and end is not None:
            drawing.arrow(floor(start), floor(end), stroke="var(--bad)", stroke_width=2)
    return drawing.markup()


def _around(points: Array) -> Extent:
    low, high = points.min(axis=0) - CLOSE_UP, points.max(axis=0) + CLOSE_UP
    return Extent(*map(float, (*low, *high)))


def draw_coverage(world: World, trials: TrialScores) -> Markup:
    """Draw where on the floor each trial came closest to trouble.

    Args:
        world: whose floor.
        trials: places and failures.
    """
    floor = FloorProjection(extent_of(world), COVERAGE_WIDTH)
    label = "where trials came closest to trouble"
    drawing = Drawing(COVERAGE_WIDTH, floor.height, label=label)
    lasting = (shape for shape in floor_scene(world) if shape.role is not Role.BLOCKAGE)
    _paint_floor(drawing, floor, lasting)
    bad = np.asarray(trials.failed, dtype=bool)
    points = floor(trials.places)
    drawing.dots(points[~bad], radius=3.0, stroke="var(--driving)", opacity=0.7)
    drawing.crosses(points[bad], radius=4.0, stroke="var(--bad)")
    return drawing.markup()


# --- shapes ----------------------------------------------------------------------------------


def _paint_floor(drawing: Drawing, floor: FloorProjection, shapes: Iterable[Shape]) -> None:
    """Paint what stands still, as far as it is in the picture."""
    seen = [shape for shape in shapes if floor.shows(shape.points)]
    for role, width in AREAS.items():
        outlines = [floor(shape.points) for shape in seen if shape.role is role]
        stroke = f"var(--{role}-edge)" if width else "none"
        drawing.polygons(outlines, fill=f"var(--{role})", stroke=stroke, stroke_width=width)
    for shape in seen:
        if shape.role is Role.DOOR:
            drawing.line(floor(shape.points), stroke="var(--door)", stroke_width=2)
        elif shape.role in SPOTS:
            x, y = floor(shape.points[0])
            edge = f"var(--{shape.role}-edge)"
            drawing.add("circle", cx=x, cy=y, r=2, fill=f"var(--{shape.role})", stroke=edge)
    for shape in seen:
        if shape.role is Role.ROOM:
            x, y = floor(shape.points[0])
            drawing.add("text", shape.text, x=x, y=y, class_="room", text_anchor="middle")


def _paint_moving(drawing: Drawing, floor: FloorProjection, shape: Shape) -> None:
    points = floor(shape.points)
    if shape.role is Role.TRAIL:
        colour = robot_colour(shape.number)
        drawing.line(points, stroke=colour, stroke_width=1.5, opacity=0.5)
    elif shape.role is Role.PATH:
        colour = robot_colour(shape.number)
        drawing.line(points, stroke=colour, stroke_width=1.2, stroke_dasharray="4 3")
    elif shape.role in (Role.PERSON, Role.BLIND_PERSON):
        (x, y), radius = points[0], shape.radius * floor.scale
        drawing.add("circle", cx=x, cy=y, r=radius, fill=f"var(--{shape.role})")
        _write_name(drawing, shape.text, x, y - radius - 3)
    elif shape.role is Role.ROBOT:
        (x, y), size = points[0], max(shape.radius * floor.scale, LEAST_BODY)
        drawing.add("circle", cx=x, cy=y, r=size, fill=robot_colour(shape.number))
        ahead = (x + size * np.cos(shape.yaw), y - size * np.sin(shape.yaw))
        drawing.line([(x, y), ahead], stroke="#fff", stroke_width=2)
        _write_name(drawing, shape.text, x, y + size + 12)


def _name_things(
    drawing: Drawing,
    floor: FloorProjection,
    world: World,
    trace: Trace,
    tick: int,
    named: Sequence[str],
) -> None:
    """Name furniture that is in the picture: what took part, and what has room for its name."""
    for item in world.furniture:
        place = place_of(world, trace, tick, item.name)
        if place is None or not floor.shows(place):
            continue
        across = float(np.ptp(item.polygon[:, 0])) * floor.scale
        if item.name in named or across >= LETTER * len(item.name):
            x, y = floor(place)
            style = "label" if item.name in named else "room"
            drawing.add("text", item.name, x=x, y=y + 4, class_=style, text_anchor="middle")


def _write_name(drawing: Drawing, name: str, x: float, y: float) -> None:
    drawing.add("text", name, x=x, y=y, class_="label", text_anchor="middle")
