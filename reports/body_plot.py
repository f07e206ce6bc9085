"""Matplotlib painter of people and robots."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

from matplotlib.axes import Axes
from matplotlib.patches import Polygon

from reports.colours import PAINTS, person_colour, robot_colour
from reports.floor_scene import Role, Shape
from reports.moving_scene import outline_of


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
