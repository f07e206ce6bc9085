"""Matplotlib painter of floor scenes."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.patches import Polygon
from matplotlib.patheffects import withStroke

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.costmap import Costmap
from mrta_falsify.core.world import World
from reports.colours import INK, PAINTS, UNSAFE, costmap_image, person_colour, robot_colour
from reports.floor_scene import (
    Extent,
    Role,
    Shape,
    costmap_extent,
    extent_of,
    floor_scene,
    outline_of,
)

LONG_SCALE, SHORT_SCALE = 5.0, 1.0  # m, lengths of the scale bar
WIDE_FLOOR = 12.0  # m; wider floors get the long scale bar


class AreaStyle(NamedTuple):
    """How areas of a role are outlined."""

    line: float  #: width of the outline [pt]
    layer: float
    outline: str = "-"
    filled: bool = True
    hatch: str | None = None


class MarkStyle(NamedTuple):
    """How places of a role are marked."""

    marker: str
    size: float  #: [pt]
    edge: float  #: width of its outline [pt]
    layer: float
    letters: float = 0.0  #: size of the text inside [pt]; 0: none


AREAS = {
    Role.ROOM_AREA: AreaStyle(1.0, 2, outline=":", filled=False),
    Role.FURNITURE: AreaStyle(0.5, 3),
    Role.SAMPLED_FURNITURE: AreaStyle(0.7, 5),
    Role.WALL: AreaStyle(0.4, 4),
    Role.BLOCKAGE: AreaStyle(0.8, 4, hatch="/////"),
}
MARKS = {
    Role.QUEUE_SPOT: MarkStyle("s", 8.0, 0.8, 5, letters=6.0),
    Role.PARKING: MarkStyle("o", 7.0, 0.7, 5, letters=5.5),
    Role.ROOM: MarkStyle("*", 11.0, 1.0, 9),
}


# --- a whole floor ---------------------------------------------------------------------------


def draw_floor(
    axes: Axes,
    world: World,
    costmap: Costmap | None = None,
    *,
    label_size: float = 9.0,
    furniture: Sequence[Array] | None = None,
) -> None:
    """Draw everything that stands still, with a scale bar.

    Args:
        axes: to draw in.
        world: what to draw.
        costmap: under it.
        label_size: of the rooms' names [pt].
        furniture: outlines ``(V, 2)`` [m]; all of the world's, at its first places, if None.
    """
    extent = extent_of(world)
    set_extent(axes, extent)
    axes.tick_params(labelsize=8, colors="#555555", length=2)
    axes.set_facecolor("white")
    for spine in axes.spines.values():
        spine.set_color("#bbbbbb")
    if costmap is not None:
        _draw_costmap(axes, costmap)
    paint_floor(axes, floor_scene(world, furniture), label_size=label_size)
    _draw_scale(axes, extent)


def set_extent(axes: Axes, extent: Extent) -> None:
    """Show a rectangle of the floor, as long as wide."""
    axes.set_xlim(extent.x_min, extent.x_max)
    axes.set_ylim(extent.y_min, extent.y_max)
    axes.set_aspect("equal")


def _draw_costmap(axes: Axes, costmap: Costmap) -> None:
    x_min, y_min, x_max, y_max = costmap_extent(costmap)
    axes.imshow(
        costmap_image(costmap),
        origin="lower",
        extent=(x_min, x_max, y_min, y_max),
        interpolation="nearest",
        zorder=0,
    )
    axes.set_aspect("equal")


def _draw_scale(axes: Axes, extent: Extent) -> None:
    length = LONG_SCALE if extent.width > WIDE_FLOOR else SHORT_SCALE
    x, y = extent.x_min + 0.4, extent.y_min + 0.4
    axes.plot([x, x + length], [y, y], color=INK, linewidth=2.5, zorder=12, solid_capstyle="butt")
    draw_label(axes, (x + length / 2.0, y + 0.12), f"{length:g} m", size=8, va="bottom")


# --- shapes ----------------------------------------------------------------------------------


def paint_floor(axes: Axes, shapes: Iterable[Shape], *, label_size: float = 9.0) -> None:
    """Paint what stands still; ``label_size`` of the rooms' names [pt]."""
    shapes = tuple(shapes)
    paint_areas(axes, shapes)
    _paint_lines(axes, shapes)
    for shape in shapes:
        if shape.role in MARKS:
            _paint_mark(axes, shape, MARKS[shape.role])
        x, y = shape.points.mean(axis=0)
        if shape.role is Role.ROOM:
            draw_label(axes, (x, y + 0.42), shape.text, size=label_size, weight="bold", va="bottom")
        elif shape.role is Role.BLOCKAGE:
            text = f"blocked {shape.start:.0f}-{shape.end:.0f} s"
            draw_label(axes, (x, y), text, size=7, colour=UNSAFE)


def paint_areas(
    axes: Axes, shapes: Iterable[Shape], styles: dict[Role, AreaStyle] | None = None
) -> None:
    """Paint areas, one collection a role; ``styles`` replace those of :data:`AREAS`."""
    chosen = styles or AREAS
    outlines: dict[Role, list[Array]] = {}
    for shape in shapes:
        if shape.role in chosen:
            outlines.setdefault(shape.role, []).append(shape.points)
    for role, points in outlines.items():
        style, paint = chosen[role], PAINTS[role]
        axes.add_collection(
            PolyCollection(
                points,
                facecolor=paint.fill if style.filled else "none",
                edgecolor=paint.edge,
                linewidth=style.line,
                linestyle=style.outline,
                hatch=style.hatch,
                zorder=style.layer,
            )
        )


def _paint_lines(axes: Axes, shapes: Sequence[Shape]) -> None:
    for role, width, alpha, layer in ((Role.LANE, 0.5, 0.35, 1), (Role.DOOR, 2.5, 1.0, 5)):
        lines = [shape.points for shape in shapes if shape.role is role]
        colour = PAINTS[role].edge
        axes.add_collection(
            LineCollection(lines, colors=colour, linewidths=width, alpha=alpha, zorder=layer)
        )


def _paint_mark(axes: Axes, shape: Shape, style: MarkStyle) -> None:
    paint = PAINTS[shape.role]
    x, y = shape.points[0]
    axes.plot(
        x,
        y,
        marker=style.marker,
        markersize=style.size,
        markerfacecolor=paint.fill,
        markeredgecolor=paint.edge,
        markeredgewidth=style.edge,
        zorder=style.layer,
    )
    if style.letters:
        write_text(
            axes, x, y, shape.text, size=style.letters, color=paint.edge, ha="center", va="center",
            zorder=style.layer + 1,
        )  # fmt: skip


# --- text ------------------------------------------------------------------------------------


def write_text(axes: Axes, x: float, y: float, text: str, **style: Any) -> None:
    """Write text as it is; names come from worlds and must not be read as formulas."""
    axes.text(x, y, text, parse_math=False, **style)


def draw_label(
    axes: Axes,
    at: tuple[float, float] | Array,
    text: str,
    *,
    size: float,
    colour: str = INK,
    weight: str = "normal",
    ha: str = "center",
    va: str = "center",
) -> None:
    """Write text with a white rim, to be read on anything."""
    x, y = np.asarray(at, dtype=float)
    write_text(
        axes,
        float(x),
        float(y),
        text,
        size=size,
        color=colour,
        weight=weight,
        ha=ha,
        va=va,
        zorder=12,
        path_effects=[withStroke(linewidth=2.2, foreground="white")],
        clip_on=True,
    )


# --- people and robots ----------------------------------------------------------------------


class BodyStyle(NamedTuple):
    """How people and robots are drawn."""

    person: float = 7.0  #: diameter of a person [pt]
    route: float = 1.1  #: width of a route [pt]
    scale: float = 1.0  #: robots are drawn so many times as large as they are
    edge: float = 0.8  #: width of a robot's outline [pt]


def paint_bodies(axes: Axes, shapes: Iterable[Shape], style: BodyStyle | None = None) -> None:
    """Paint people with their routes, and robots."""
    style = style or BodyStyle()
    for shape in shapes:
        if shape.role is Role.ROUTE:
            axes.plot(
                *shape.points.T,
                color=person_colour(blind=shape.blind),
                linewidth=style.route,
                linestyle=(0, (3, 2)),
                alpha=0.55,
                zorder=7,
            )
        elif shape.role in (Role.PERSON, Role.BLIND_PERSON):
            axes.plot(
                *shape.points.T,
                marker="o",
                markersize=style.person,
                color=PAINTS[shape.role].fill,
                markeredgecolor=PAINTS[shape.role].edge,
                markeredgewidth=0.4,
                zorder=8,
            )
        elif shape.role is Role.ROBOT:
            paint_robot(axes, shape, style)


def paint_robot(axes: Axes, robot: Shape, style: BodyStyle, *, layer: float = 9) -> None:
    """Paint a robot as an arrow that points forward."""
    axes.add_patch(
        Polygon(
            outline_of(robot, scale=style.scale),
            facecolor=robot_colour(robot.number),
            edgecolor="white",
            linewidth=style.edge,
            zorder=layer,
        )
    )
